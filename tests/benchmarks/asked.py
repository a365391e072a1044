"""What is asked of the speed, and what is reached: the table of `make bench`. Nothing is asserted.

All in processor time, user and system, of all threads and of processes that are waited for: on a
busy machine as on an idle one, but for caches that are shared. Two cores make less of it on the
clock where two threads work.
"""

import resource
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_rehearsal import keeping_bytecode, twelve_positions

from alignment import ESTIMATORS, Dwell, ImuReadings
from alignment.allan import analyse
from stand.motion.polynomial import MotionKind
from stand.procedure.procedure import procedure_from
from stand.rehearsal.advice import with_advice
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, settings
from stand.simulation.simulation import Simulation
from stand.toml_files import Source, ids

HOUR = """
title = "One hour of rest in six positions"
[site]
latitude_deg = 48.5
[estimate]
methods = ["six-position", "rk4", "triad"]
""" + "".join(
    f'[[step]]\nkind = "move"\nlabel = "to {k}"\njoints_deg = {{ outer = {10 * k} }}\n'
    f'[[step]]\nkind = "dwell"\nlabel = "{k}"\nduration_s = 598\n'
    for k in range(1, 7)
)

ROCKED = """
title = "Ten minutes on all six axes"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = []
[[step]]
kind = "sine"
label = "rocking"
duration_s = 560
fade_s = 20
[step.axes]
base_roll = { amplitude_deg = 5, frequency_hz = 0.15 }
base_pitch = { amplitude_deg = 4, frequency_hz = 0.2 }
base_yaw = { amplitude_deg = 5, frequency_hz = 0.1 }
outer = { amplitude_deg = 20, frequency_hz = 0.12 }
middle = { amplitude_deg = 15, frequency_hz = 0.17 }
inner = { amplitude_deg = 25, frequency_hz = 0.23 }
"""
SIX_POSITION_S = 384  # of the procedure `six-position`
ALLAN_SAMPLES = 10_000_000

Row = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Asked:
    """A number that is asked for: `most` true where it may not be exceeded, else reached."""

    what: str
    goal: float
    unit: str
    most: bool = False

    def row(self, found: float) -> Row:
        times = self.goal / found if self.most else found / self.goal
        size = f"{found:,.0f}" if found >= 1000 else f"{found:.3g}"
        goal = f"{self.goal:,.0f}" if self.goal >= 1000 else f"{self.goal:g}"
        bound = "at most" if self.most else "at least"
        return self.what, f"{size} {self.unit}", f"{bound} {goal}", f"{times:.2f}"


def processor() -> float:
    """Seconds of it that this process and those that it waited for have used."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def spent(action: Callable[[], object]) -> float:
    """Processor seconds of one call."""
    begin = processor()
    action()
    return processor() - begin


def least(actions: Sequence[Callable[[], object]]) -> float:
    """Fewest processor seconds of several but the first, which is for warmth."""
    actions[0]()
    return min(map(spent, actions[1:]))


# --- what is asked -------------------------------------------------------------------------------


def simulated_rows() -> Iterator[Row]:
    """Runs in process, and what stands before their first sample."""
    short = settings("six-position", "stim300", rate_hz=200, seed=1)
    ready = least([lambda: Simulation(short)] * 5)
    yield Asked("six-position made ready", 60, "ms", most=True).row(1e3 * ready)
    hour = procedure_from(Source("hour", "hour.toml", HOUR))
    for procedure, name, unit, rate_hz, goal in (
        ("random-sway", "random sway, ideal, 200 Hz", "ideal", 200, 250e3),
        ("random-sway", "random sway, all errors, 1 kHz", "stim300", 1000, 700e3),
        (hour, "an hour of rest, 200 Hz", "stim300", 200, 800e3),
    ):
        asked = settings(procedure, unit, rate_hz=rate_hz, seed=1)
        count = Simulation(asked).total
        rate = count / least([lambda asked=asked: _whole(asked)] * 3)
        yield Asked(name, goal, "samples/s").row(rate)


def _whole(asked: Settings) -> None:
    for _ in Simulation(asked).blocks():
        pass


def servo_rows() -> Iterator[Row]:
    """A servo's steps against the bare `Batch.rollout` of them, in turn."""
    from bench import servo_actions

    rollout, simulate, _ = servo_actions()
    pairs = [(spent(rollout), spent(simulate)) for _ in range(4)][1:]
    ratio = statistics.median(raw / ours for raw, ours in pairs)
    yield Asked("servo, six axes, of the bare rollout", 0.8, "of it").row(ratio)


def method_rows() -> Iterator[Row]:
    """Estimates, of samples that nobody has looked at before."""
    still = settings("two-position", "ring-laser", rate_hz=200)
    swaying = settings("random-sway", "ring-laser", rate_hz=200)
    for name, asked, goal in (
        ("triad", still, 5e6),
        ("inertial", swaying, 2e6),
        ("fine", swaying, 400e3),
    ):
        dwells, _ = Trials(asked).readings(0)
        used = dwells[:1] if name == "triad" else list(dwells)
        count = sum(len(dwell.window()) for dwell in used)

        def estimate(
            dwells: list[Dwell], name: str = name, asked: Settings = asked
        ) -> Callable[[], object]:
            return lambda: ESTIMATORS[name].estimate(dwells, asked.site, asked.options)

        new = [estimate([_fresh(dwell) for dwell in used]) for _ in range(5)]
        yield Asked(f"{name}, whole", goal, "samples/s").row(count / least(new))


def _fresh(dwell: Dwell) -> Dwell:
    """The same samples, of which nothing is kept yet."""
    return replace(dwell, readings=replace(dwell.readings))


def allan_rows(n: int = ALLAN_SAMPLES) -> Iterator[Row]:
    """Allan analysis of six channels."""
    readings = white(n)
    took = spent(lambda: analyse(readings))
    name = f"allan of {n / 1e6:.0f} M samples (3 s by two threads)"
    yield Asked(name, 6, "s", most=True).row(took)


def white(n: int) -> ImuReadings:
    """White noise at rest, n samples at 200 Hz."""
    rng = np.random.default_rng(0)
    w, f = rng.standard_normal((2, n, 3))
    for values, level in ((w, [0, 5e-5, 5e-5]), (f, [0, 9.81, 0])):
        values *= 1e-3
        values += level
        values.flags.writeable = False
    return ImuReadings(np.arange(1, n + 1) / 200, w, f)


def command_rows(folder: Path) -> Iterator[Row]:
    """Whole commands in processes of their own, start-up included."""
    stand, kept = str(Path(sys.executable).with_name("stand")), keeping_bytecode(folder)

    def run(*arguments: str) -> float:
        given, silent = [stand, *arguments], subprocess.DEVNULL
        return spent(
            lambda: subprocess.run(
                given, check=False, cwd=folder, env=kept, stdout=silent, stderr=silent
            )
        )

    run("run", "six-position")  # bytecode is kept from here on
    test = min(run("run", "six-position", "--force") for _ in range(3))
    name = "stand run six-position, recorded"
    yield Asked(name, 250, "x real time").row(SIX_POSITION_S / test)
    (folder / "rocked.toml").write_text(ROCKED)
    servo = run("run", "rocked.toml", "--motion", MotionKind.SERVO.value)
    yield Asked("10 min of servos, six axes, recorded", 60, "x real time").row(600 / servo)
    names = list(ids("procedures"))
    run("rehearse", names[0], "--imu", "hg9900")
    each = [run("rehearse", one, "--imu", "hg9900") for one in names]
    name = f"stand rehearse, median of {len(names)}"
    yield Asked(name, 0.6, "s", most=True).row(statistics.median(each))


def advice_rows(folder: Path) -> Iterator[Row]:
    """What would help twelve positions that miss what is required, by five methods."""
    asked = twelve_positions(folder)
    took = spent(lambda: with_advice(asked))
    yield Asked("advice for twelve positions", 5, "s", most=True).row(took)


def asked_rows(folder: Path) -> Iterator[Row]:
    """Every number that is asked for."""
    yield from simulated_rows()
    yield from servo_rows()
    yield from method_rows()
    yield from allan_rows()
    yield from advice_rows(folder)
    yield from command_rows(folder)
