"""Speed, measured: `make bench` prints what is asked for and what is reached, in processor time.

``make bench ARGS="truth servo"`` measures groups of more beside it, ``ARGS=all`` every one of them
(a quarter of an hour): samples/s on the clock and ratios to a reference of the same run, each the
best of several repeats, except whole runs, whose median is taken. Linear algebra has one thread,
as in commands. Nothing here is asserted: a busy machine would fail it.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from asked import HOUR, ROCKED, asked_rows
from bench_film import film_rows
from bench_logs import log_rows
from bench_long import long_rows, step_rows
from bench_methods import allan_rows, calibration_rows, compare_rows, method_rows
from bench_rehearsal import keeping_bytecode, rehearsal_rows
from mujoco.batch import Batch

from alignment import Site
from stand.imu import Imu, ImuSpec, Temperature, load_imu
from stand.motion.moves import joined, move_piece
from stand.motion.polynomial import Motion, fitted
from stand.physics.hinges import ROWS
from stand.physics.mjcf import load_model
from stand.physics.servo import STEP, Servo
from stand.physics.truth import Sampling, Truth
from stand.procedure.procedure import procedure_from
from stand.report.console import console, show
from stand.report.tables import TableData
from stand.samples import Sensed
from stand.simulation.settings import settings
from stand.simulation.simulation import Simulation
from stand.table.table import load_table
from stand.toml_files import Source


def best(action: Callable[[], object], repeats: int = 7) -> float:
    """Shortest time of several [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def moving() -> Motion:
    """Some 20 s of moves of all six axes, without a rest."""
    rng = np.random.default_rng(0)
    joints, pieces = np.zeros(6), []
    for _ in range(6):
        target = np.radians(rng.uniform(-1, 1, 6) * [14, 14, 18, 170, 170, 170])
        pieces.append(
            move_piece(joints, target, *np.radians([np.full(6, x) for x in (60, 60, 240)]))
        )
        joints = target
    return joined(pieces)


def truth_rows() -> list[tuple[str, str, str]]:
    """Truth of motion, in samples/s, against the evaluations/s of the bare `Batch.forward`."""
    truth, motion = Truth(load_model(), Site(0.8)), moving()
    t = np.linspace(0, motion.duration, ROWS, endpoint=False)
    truth.instants(*motion.joints(t))
    batch = truth.batch

    def forward() -> None:
        for _ in range(20):
            batch.forward()

    edges = np.arange(int(motion.duration * 1000)) / 1000.0
    # in turns, so that a change of the machine's mood meets both
    pairs = [(best(forward, 1), best(lambda: truth.means(motion, edges), 1)) for _ in range(15)]
    raw = 20 * ROWS / min(p[0] for p in pairs)
    ours = (len(edges) - 1) / min(p[1] for p in pairs)
    rest = Motion(np.array([0.0, 600.0]), np.zeros((4, 1, 6)))
    dwell = best(lambda: list(truth.blocks(rest, 1000, Sampling.MEAN)), 3)
    return [
        ("Batch.forward, one thread", f"{raw:,.0f} evaluations/s", "1"),
        ("truth of moves at 1 kHz", f"{ours:,.0f} samples/s", f"{ours / raw:.2f} of it"),
        ("truth of dwells", f"{600_000 / dwell:,.0f} samples/s", ""),
    ]


def sway_rows() -> list[tuple[str, str, str]]:
    """Whole runs in process: ten minutes of random sway, an hour of rest; with a unit's errors."""
    hour = procedure_from(Source("hour", "hour.toml", HOUR))
    cases = (
        ("random-sway", "random sway", "stim300", 20, 0),
        ("random-sway", "random sway, ideal unit", "ideal", 200, 250e3),
        ("random-sway", "random sway", "stim300", 200, 0),
        ("random-sway", "random sway", "stim300", 1000, 700e3),
        (hour, "an hour of rest", "stim300", 200, 800e3),
    )
    rows = [_ready_row()]
    for procedure, name, unit, rate_hz, goal in cases:
        simulation = Simulation(settings(procedure, unit, rate_hz=rate_hz, seed=1))
        begin, cpu = time.perf_counter(), time.process_time()
        samples = sum(len(block.truth) for block in simulation.blocks())
        rate = samples / (time.perf_counter() - begin)
        cpu = (time.process_time() - cpu) / samples
        told = f"; goal: {goal:,.0f} samples/s" if goal else ""
        what = f"{cpu * 1e6:.2f} us of computing each{told}"
        rows.append((f"{name} at {rate_hz} Hz", f"{rate:,.0f} samples/s", what))
    return rows


def _ready_row() -> tuple[str, str, str]:
    """What stands before the first sample of a short run."""
    asked = settings("six-position", "stim300", rate_hz=200, seed=1)
    took = best(lambda: Simulation(asked))
    return "six-position made ready", f"{1e3 * took:.0f} ms", "goal: 60 ms"


def everything() -> ImuSpec:
    """A unit with every term on."""
    spec = load_imu("stim300")
    terms = {"instability", "random_walk", "ramp", "asymmetry", "nonlinearity", "non_orthogonality"}
    terms |= {"bias_temperature", "scale_temperature", "resolution"}
    small = dict.fromkeys(terms, 1e-6) | {"bandwidth": 200.0, "range": 50.0, "full_scale": 50.0}
    return replace(
        spec,
        gyro=replace(spec.gyro, g_sensitivity=1e-8, g2_sensitivity=1e-9, **small),
        accel=replace(spec.accel, second_order=1e-6, **small),
    )


def rocking() -> Motion:
    """Five minutes of sines on all six axes, within every table's limits."""
    amplitude = np.radians([4, 3, 5, 20, 15, 25])
    w = 2 * np.pi * np.array([0.15, 0.2, 0.1, 0.12, 0.17, 0.23])

    def angles(t: np.ndarray) -> np.ndarray:
        return amplitude * np.sin(w * t[:, None]) * np.clip(t / 10, 0, 1)[:, None] ** 3

    return fitted(angles, np.arange(0.0, 300.5, 0.5))


def servo_actions() -> tuple[Callable[[], None], Callable[[], None], Callable[[], None]]:
    """Five minutes of the bare `Batch.rollout`, of the servo with the same inputs, and of what is
    felt on it."""
    model, table, demand = load_model(), load_table("mid-class"), rocking()
    truth = Truth(model, Site(0.8))
    steps = round(demand.duration / STEP)
    servo = Servo(model, table, demand)
    told = servo.drive.controls(demand.joints(STEP * np.arange(-1, steps + 1))[0])
    batch = Batch(servo.drive.model, 1, nthread=1)
    servo.drive.settle(batch, demand.joints([0.0])[0][0])
    state = {name: batch.bind(name).copy() for name in ("qpos", "qvel", "act")}

    def rollout() -> None:
        for name, values in state.items():
            batch.bind(name)[:] = values
        batch.rollout(steps, told[None], record=("qpos",))

    def simulate() -> None:
        Servo(model, table, demand).covering(0.0, demand.duration)

    def sensed() -> None:
        realised = Servo(model, table, demand)
        for t in range(0, 300, 5):
            window = realised.covering(t, t + 5)
            truth.block(window, 200, Sampling.MEAN, 200 * t, 200 * (t + 5))

    return rollout, simulate, sensed


def servo_rows() -> list[tuple[str, str, str]]:
    """Servo runs against the bare `Batch.rollout` of the same model with the same inputs."""
    actions, steps = servo_actions(), round(300 / STEP)
    # in turns, so that a change of the machine's mood meets all
    turns = [[best(action, 1) for action in actions] for _ in range(5)]
    raw, ours, both = (min(column) for column in zip(*turns, strict=True))
    return [
        ("Batch.rollout, one thread", f"{steps / raw:,.0f} steps/s", "1"),
        ("servo, six axes moving", f"{steps / ours:,.0f} steps/s", f"{raw / ours:.2f} of it"),
        ("servo, truth at 200 Hz", f"{60_000 / both:,.0f} samples/s", f"{300 / both:.0f} x real"),
    ]


def imu_rows() -> list[tuple[str, str, str]]:
    """The sensor model against drawing the same normals, in blocks of 4000 samples."""
    rng = np.random.default_rng(0)
    n, count = 4000, 50
    w, f = rng.normal(size=(2, n, 3))
    warm = Temperature(np.array([0.0, 1e3]), np.array([20.0, 40.0]))

    def blocks(imu: Imu) -> None:
        for k in range(count):
            imu.report(Sensed((np.arange(n) + 1 + k * n) * 10**6, w, f))

    def drawn() -> None:
        for _ in range(count):
            rng.standard_normal((n, 6))

    normals = n * count / best(drawn)
    rows = [("six normals alone", f"{normals:,.0f} samples/s", "1")]
    for name, spec, warmth in (
        ("IMU, bias and noise", load_imu("adis16405"), None),
        ("IMU, every term", everything(), warm),
    ):
        imu = Imu(spec, 0, 1000, warmth)
        rate = n * count / best(lambda imu=imu: blocks(imu))
        rows.append((name, f"{rate:,.0f} samples/s", f"{rate / normals:.2f} of it"))
    return rows


def command_rows(folder: Path) -> list[tuple[str, str, str]]:
    """Whole commands in processes of their own, start-up included."""
    stand = str(Path(sys.executable).with_name("stand"))

    def run(*arguments: str) -> float:
        begin = time.perf_counter()
        command = [stand, *arguments]
        kept = keeping_bytecode(folder)
        subprocess.run(command, check=True, cwd=folder, stdout=subprocess.DEVNULL, env=kept)
        return time.perf_counter() - begin

    run("--help")  # bytecode is kept from here on
    run("run", "six-position")
    help_time = statistics.median(run("--help") for _ in range(5))
    test = statistics.median(run("run", "six-position", "--force") for _ in range(5))
    hour = folder / "hour.toml"
    hour.write_text(HOUR)
    long = run("run", str(hour), "--rate", "1000", "--out", "hour")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    rocked = folder / "rocked.toml"
    rocked.write_text(ROCKED)
    servo = statistics.median(
        run("run", str(rocked), "--motion", "servo", "--out", "rocked", "--force") for _ in range(3)
    )
    return [
        ("stand --help", f"{help_time:.2f} s", ""),
        ("stand run six-position", f"{test:.2f} s", f"{384 / test:.0f} x real time; goal: 250"),
        ("1 h at 1 kHz, recorded", f"{long:.1f} s", f"{3600 / long:.0f} x real time"),
        ("its peak memory", f"{peak:.0f} MB", ""),
        (
            "10 min six-axis servo run, recorded",
            f"{servo:.1f} s",
            f"{600 / servo:.0f} x real time; goal: 60",
        ),
    ]


Rows = list[tuple[str, str, str]]
GROUPS: dict[str, Callable[[Path], Rows]] = {
    "truth": lambda _: truth_rows(),
    "sway": lambda _: sway_rows(),
    "servo": lambda _: servo_rows(),
    "imu": lambda _: imu_rows(),
    "methods": lambda _: [*method_rows(best), *calibration_rows(best)],
    "allan": lambda _: allan_rows(),
    "compare": lambda _: compare_rows(),
    "rehearsal": lambda _: rehearsal_rows(),
    "commands": command_rows,
    "logs": lambda _: log_rows(),
    "long": long_rows,
    "steps": step_rows,
    "film": film_rows,
}


def main(wanted: Sequence[str]) -> None:
    groups = list(GROUPS) if "all" in wanted else wanted
    unknown = [name for name in groups if name not in GROUPS]
    if unknown:
        raise SystemExit(f"{', '.join(unknown)}: must be of {', '.join(GROUPS)}, all")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"In processor time of {os.cpu_count()} cores")
        heads = "what", "reached", "asked", "times as good"
        for row in chain([heads], asked_rows(folder)):
            print("{:46}{:>20}{:>20}{:>16}".format(*row), flush=True)
        for group in groups:
            rows = tuple(GROUPS[group](folder))
            show(console(), [TableData(group, ("what", "measured", "ratio"), rows)])


if __name__ == "__main__":
    main(sys.argv[1:])
