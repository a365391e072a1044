"""This project and others side by side: `make peers` writes docs/speed.md and docs/speed.png.

The same work in turn, A B A B, each side in a process of its own that is warm by then. The medians
of the ratios are told: the machine's mood meets both. Nothing is asserted.
"""

import json
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from bench import imu_rows, truth_rows
from scipy.spatial.transform import Rotation

from alignment.units import ARC_SECOND, DEG_PER_HOUR

HERE = Path(__file__).parent
DOCS = HERE.parents[1] / "docs"
EARTH_RATE, LATITUDE = 7.292115e-5, np.radians(48.5)
REPEATS = 3
TURNTABLE_GOALS = {200: 5, 1000: 12}  # times as fast as pyins' turntable, random sway by us
MINUTES = (1, 10, 60, 360, 1440)
RATES = (20, 50, 100, 200, 500, 1000, 2000, 4000)
VERSIONS = """
from importlib.metadata import version
print(*(f"{name} {version(name)}" for name in ("python-ins", "ahrs", "allantools")), sep=", ")
"""
TURNS = int(sys.argv[2]) if len(sys.argv) > 2 else 5  # pairs that count, after one that does not

UNIT = """
title = "The errors that both sides have"
grade = "navigation, generic"
evidence = "C"
[gyro]
turn_on_bias_deg_h = { value = 0.01, kind = "assumed", source = "peers" }
angle_random_walk_deg_rt_h = { value = 0.003, kind = "assumed", source = "peers" }
rate_random_walk_deg_h_rt_h = { value = 0.01, kind = "assumed", source = "peers" }
scale_factor_ppm = { value = 10, kind = "assumed", source = "peers" }
[accel]
turn_on_bias_mg = { value = 0.1, kind = "assumed", source = "peers" }
velocity_random_walk_m_s_rt_h = { value = 0.03, kind = "assumed", source = "peers" }
acceleration_random_walk_ug_rt_h = { value = 1, kind = "assumed", source = "peers" }
scale_factor_ppm = { value = 10, kind = "assumed", source = "peers" }
"""
HEAD = """
title = "Side by side"
table = "{table}"
[site]
latitude_deg = 48.5
[estimate]
methods = []
"""
DWELL = '[[step]]\nkind = "dwell"\nlabel = "{label}"\nduration_s = {seconds}\n'
MOVE = '[[step]]\nkind = "move"\nlabel = "{label}"\njoints_deg = {{ {joints} }}\n'
SWAY = """
[[background]]
kind = "sway"
[background.axes]
base_roll = { rms_deg = 2.0, frequency_hz = 0.15, damping = 0.1 }
base_pitch = { rms_deg = 1.5, frequency_hz = 0.2, damping = 0.1 }
base_yaw = { rms_deg = 1.0, frequency_hz = 0.1, damping = 0.2 }
"""
AXES = ("base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner")


def rest(seconds: float) -> str:
    return HEAD.format(table="laboratory") + DWELL.format(label="rest", seconds=seconds)


def sway(seconds: float) -> str:
    return (
        HEAD.format(table="rocking-platform")
        + DWELL.format(label="swaying", seconds=seconds)
        + SWAY
    )


def turning(seconds: float) -> str:
    """Five rests and a quarter turn between each two, as `pyins_turntable` has them."""
    steps = [DWELL.format(label="rest 0", seconds=seconds)]
    limits = "[move_limits]\nrate_deg_s = 60.0\nacceleration_deg_s2 = 60.0\njerk_deg_s3 = 240.0\n"
    where = {"outer": 0, "middle": 0}
    for k, axis in enumerate(("middle", "outer", "middle", "outer"), start=1):
        where[axis] += 90
        joints = ", ".join(f"{name} = {angle}" for name, angle in where.items())
        steps.append(MOVE.format(label=f"turn {k}", joints=joints))
        steps.append(DWELL.format(label=f"rest {k}", seconds=seconds))
    return HEAD.format(table="laboratory") + limits + "".join(steps)


def nimble(folder: Path) -> Path:
    """The laboratory's table, quick enough for coning at 5 Hz."""
    text = (HERE.parents[1] / "stand/tables" / "laboratory.toml").read_text()
    limits = {"rate_deg_s": 1e3, "acceleration_deg_s2": 1e4, "jerk_deg_s3": 1e5, "torque_Nm": 1e4}
    for limit, size in limits.items():
        text = re.sub(rf"^{limit} = .*$", f"{limit} = {size}", text, flags=re.MULTILINE)
    path = folder / "nimble.toml"
    path.write_text(text)
    return path


def coning(seconds: float, table: Path) -> str:
    """The hardest of motions for whoever looks at its stamps alone."""
    step = '[[step]]\nkind = "coning"\nlabel = "cone"\naxis = "X1"\nhalf_angle_deg = 1.0\n'
    more = f"frequency_hz = 5\nduration_s = {seconds}\nfade_s = 2\n"
    return HEAD.format(table=table) + step + more


def rocking(axes: int, seconds: float) -> str:
    """The first so many axes in sines of 2 degrees, each of a frequency of its own."""
    sines = "".join(
        f"{axis} = {{ amplitude_deg = 2, frequency_hz = {0.1 + 0.03 * k:.2f} }}\n"
        for k, axis in enumerate(AXES[:axes])
    )
    step = f'[[step]]\nkind = "sine"\nlabel = "rocking"\nduration_s = {seconds}\nfade_s = 10\n'
    return HEAD.format(table="mid-class") + step + "[step.axes]\n" + sines


class Side:
    """A process that takes one job after the other."""

    def __init__(self, python: str) -> None:
        self._process = subprocess.Popen(
            [python, "-W", "ignore", str(HERE / "peers_worker.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def does(self, job: str, **told: Any) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"job": job, **told}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"peers: {job} ended with {self._process.wait()}")
        return json.loads(line)

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


@dataclass(frozen=True, slots=True)
class Pair:
    """Samples per second of both sides, and the median of how many times ours is faster."""

    work: str
    whose: str
    ours: float
    theirs: float
    ratio: float
    lowest: float
    highest: float
    ours_off: str = ""
    theirs_off: str = ""


Run = Callable[[], dict[str, Any]]


def in_turn(work: str, whose: str, a: Run, b: Run) -> Pair:
    """A B A B ..., the first pair for warmth alone."""
    pairs = [(a(), b()) for _ in range(TURNS + 1)][1:]
    rates = [[one["samples"] / one["wall"] for one in side] for side in zip(*pairs, strict=True)]
    ratios = [x / y for x, y in zip(*rates, strict=True)]
    ours, theirs = (statistics.median(side) for side in rates)
    ratio = statistics.median(ratios)
    found = Pair(work, whose, ours, theirs, ratio, min(ratios), max(ratios))
    print(f"{work}: {found.ours:,.0f} against {found.theirs:,.0f} of {whose}: {found.ratio:.1f}")
    return found


def integrated_back(saved: Path, *, earth: bool = True) -> float:
    """By how much [rad] integrated increments miss the attitude at the end.

    Centred three-sample rotation vectors, d + 7/120 (p x d + d x n) - p x n/60.
    """
    with np.load(saved) as made:
        t, q, dw = made["t"], made["q"], made["dw"]
    p, d, n = dw[:-2], dw[1:-1], dw[2:]
    steps = d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60
    turned = product(Rotation.from_rotvec(steps))
    w_ie = EARTH_RATE * np.array([np.cos(LATITUDE), 0.0, -np.sin(LATITUDE)]) * earth
    C = Rotation.from_rotvec(-w_ie * (t[-2] - t[0])) * Rotation.from_quat(q[0]) * turned
    return float((C.inv() * Rotation.from_quat(q[-2])).magnitude())


def apart(ours: Path, theirs: Path, rate: int) -> str:
    """By how much (rms) mean rates of the same motion differ; '' of another motion."""
    with np.load(ours) as a, np.load(theirs) as b:
        if len(a["dw"]) != len(b["dw"]):
            return ""
        off = (b["dw"] - a["dw"])[1:] * rate  # the first is made up
    return f", rates by {np.sqrt(np.mean(off**2)) / DEG_PER_HOUR:.2g} deg/h"


def product(turns: Rotation) -> Rotation:
    """Of all, in their order, two by two."""
    while len(turns) > 1:
        if len(turns) % 2:
            turns = Rotation.concatenate([turns, Rotation.identity()])
        turns = turns[0::2] * turns[1::2]
    return turns[0]


def seconds_of(angle: float) -> str:
    return f"{angle / ARC_SECOND:.2g}''"


def pairs(folder: Path, ours: Side, theirs: Side) -> list[Pair]:
    unit = folder / "unit.toml"
    unit.write_text(UNIT)
    works = (
        ("rest, 20 min at 200 Hz", rest(1200), 200),
        ("random sway, 10 min at 200 Hz", sway(600), 200),
        ("random sway, 5 min at 1 kHz", sway(300), 1000),
        ("coning of 1 deg at 5 Hz, 2 min at 100 Hz", coning(120, nimble(folder)), 100),
        ("coning of 1 deg at 5 Hz, 2 min at 1 kHz", coning(120, nimble(folder)), 1000),
        ("five rests and turns, 200 Hz", turning(30), 200),
        ("five rests and turns, 1 kHz", turning(15), 1000),
    )
    found = []
    for k, (work, text, rate) in enumerate(works):
        procedure = folder / f"work{k}.toml"
        procedure.write_text(text)
        mine, other = folder / f"ours{k}.npz", folder / f"theirs{k}.npz"
        ours.does("ours", procedure=str(procedure), unit="ideal", rate=rate, save=str(mine))
        off = seconds_of(integrated_back(mine))

        def run(procedure: Path = procedure, rate: int = rate) -> dict[str, Any]:
            return ours.does("ours", procedure=str(procedure), unit=str(unit), rate=rate)

        if "turns" in work:
            told: dict[str, Any] = {"job": "pyins_turntable", "rate": rate}
            told["rest"] = 30 if rate == 200 else 15
        else:
            told = {"job": "pyins_attitudes", "rate": rate, "attitudes": str(mine)}
        theirs.does(**told, save=str(other))
        their_off = seconds_of(integrated_back(other)) + apart(mine, other, rate)
        pair = in_turn(work, "pyins", run, lambda told=told: theirs.does(**told))
        found.append(_with(pair, off, their_off))
        if k in (0, 1):
            told = {"job": "ahrs_attitudes", "rate": rate, "attitudes": str(mine)}
            theirs.does(**told, save=str(other))
            their_off = seconds_of(integrated_back(other, earth=False)) + apart(mine, other, rate)
            pair = in_turn(work, "ahrs", run, lambda told=told: theirs.does(**told))
            found.append(_with(pair, off, their_off))
        if "sway" in work:
            told = {"job": "pyins_turntable", "rate": rate, "rest": 30 if rate == 200 else 15}
            whose, wanted = "pyins' turntable, at rest and turning", TURNTABLE_GOALS[rate]
            pair = in_turn(work, whose, run, lambda told=told: theirs.does(**told))
            found.append(_with(pair, off, f"another motion; asked: {wanted} times"))
    return found


def _with(pair: Pair, ours: str, theirs: str) -> Pair:
    return replace(pair, ours_off=ours, theirs_off=theirs)


def floors(folder: Path, ours: Side, theirs: Side) -> list[Pair]:
    path = str(folder / "log.mcap")
    n, m = 200_000, 1_000_000
    found = [
        in_turn(
            "200 000 samples into MCAP",
            "mcap.Writer, bytes ready made",
            lambda: ours.does("ours_mcap", path=path, n=n),
            lambda: ours.does("mcap_writer", path=path, n=n),
        )
    ]
    pair = in_turn(
        "Allan deviation of 1 000 000 samples",
        "allantools.oadev",
        lambda: ours.does("ours_allan", n=m),
        lambda: theirs.does("allantools", n=m),
    )
    a, b = ours.does("ours_allan", n=m), theirs.does("allantools", n=m)
    theirs_at = dict(zip(b["m"], b["deviation"], strict=True))
    both = [(x, theirs_at[k]) for k, x in zip(a["m"], a["deviation"], strict=True) if k <= 32]
    off = max(abs(x / y - 1) for x, y in both)
    return [*found, _with(pair, f"{off:.0e} of theirs, to 32 samples", "")]


# --- cost ----------------------------------------------------------------------------------------

Curve = list[tuple[float, float]]


def curves(folder: Path, ours: Side) -> dict[str, dict[str, Curve]]:
    """Seconds against length, rate and axes: the best of `REPEATS`, after one for warmth."""

    def cost(text: str, rate: int, unit: str, repeats: int = REPEATS) -> float:
        procedure = folder / "curve.toml"
        procedure.write_text(text)
        told = {"procedure": str(procedure), "unit": unit, "rate": rate}
        return min(ours.does("ours", **told)["wall"] for _ in range(repeats))

    unit = str(folder / "unit.toml")
    cost(sway(60), 200, unit, 1)
    lengths = [(60 * k, REPEATS if k < 360 else 1) for k in MINUTES]
    axes = range(1, len(AXES) + 1)
    found: dict[str, dict[str, Curve]] = {
        "length": {
            "at rest, 20 Hz": [(s, cost(rest(s), 20, unit, n)) for s, n in lengths],
            "three axes rock, 20 Hz": [(s, cost(rocking(3, s), 20, unit, n)) for s, n in lengths],
        },
        "rate": {
            "sway of 60 s, no errors": [(r, cost(sway(60), r, "ideal")) for r in RATES],
            "sway of 60 s, a unit's errors": [(r, cost(sway(60), r, unit)) for r in RATES],
        },
        "axes": {
            "sines of 60 s, 200 Hz": [(k, cost(rocking(k, 60), 200, unit)) for k in axes],
        },
    }
    return found


def draw(found: dict[str, dict[str, Curve]], path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4), layout="constrained")
    FigureCanvasAgg(figure)
    names = {"length": "length [s]", "rate": "rate [Hz]", "axes": "axes that move"}
    for axes, (kind, lines) in zip(figure.subplots(1, 3), found.items(), strict=True):
        for (label, curve), style in zip(lines.items(), ("o-", "s-"), strict=False):
            x, y = np.array(curve).T
            axes.plot(x, y, style, label=label, markersize=4)
        if kind != "axes":
            axes.set_xscale("log")
            axes.set_yscale("log")
            x, y = np.array(next(reversed(lines.values()))).T
            axes.plot(x, y[-1] * x / x[-1], ":", color="grey", label="proportional")
        else:
            axes.set_ylim(0, 1.1 * max(y for points in lines.values() for _, y in points))
        axes.set_xlabel(names[kind])
        axes.set_ylabel("whole run in memory [s]")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=110)


# --- words ---------------------------------------------------------------------------------------


def page(
    made: list[Pair],
    floor: list[Pair],
    rows: list[tuple[str, str, str]],
    cost: dict[str, dict[str, Curve]],
    others: str,
) -> str:
    named = "".join(
        f"| {p.work} | {p.ours / 1e3:,.0f} k | {p.whose} | {p.theirs / 1e3:,.0f} k | "
        f"**{p.ratio:.1f}** ({p.lowest:.1f} to {p.highest:.1f}) | {p.ours_off} | {p.theirs_off} |\n"
        for p in made
    )
    bare = "".join(
        f"| {p.work} | {p.ours / 1e3:,.0f} k | {p.whose} | {p.theirs / 1e3:,.0f} k | "
        f"{p.ratio:.2f} | {p.ours_off} |\n"
        for p in floor
    )
    within = "".join(f"| {what} | {rate} | {ratio} |\n" for what, rate, ratio in rows)
    return PAGE.format(
        named=named,
        bare=bare,
        within=within,
        grown=_growth(cost),
        others=others,
        turns=TURNS,
        **_machine(),
    )


def _growth(cost: dict[str, dict[str, Curve]]) -> str:
    lines = []
    for label, curve in cost["length"].items():
        (t0, y0), (t1, y1) = curve[-2], curve[-1]
        lines.append(f"{label}: {t1 / t0:.0f} times as long costs {y1 / y0:.1f} times as much")
    for label, curve in cost["rate"].items():
        (_, y0), (r1, y1) = curve[0], curve[-1]
        lines.append(f"{label}: {curve[0][0]:.0f} to {r1:.0f} Hz, {y0:.2g} to {y1:.2g} s")
    for label, curve in cost["axes"].items():
        lines.append(f"{label}: one axis {curve[0][1]:.2g} s, six {curve[-1][1]:.2g} s")
    return "".join(f"- {line}\n" for line in lines)


def _machine() -> dict[str, str]:
    model = platform.processor() or platform.machine()
    cpus = Path("/proc/cpuinfo")
    if cpus.exists():
        names = [line for line in cpus.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(": ")[2] if names else model
    ours = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "mujoco", "mcap"))
    return {
        "machine": f"{os.cpu_count()} cores of {model}",
        "python": platform.python_version(),
        "ours": ours,
        "load": f"{os.getloadavg()[0]:.1f}",
    }


PAGE = """# Speed, beside others

`make peers` makes this page anew: an environment of its own with the others, the same work in
turn (A B A B), samples per second in memory, the median of the ratios over {turns} turns with the
lowest and the highest. {machine}; Python {python}; {ours};
{others}. The last minute's load was {load} at the end: on a busy machine ratios hold better
than rates.

## The same motion, the same errors

Bias, scale factors, white noise and random walk on six channels; set-up, truth and attitudes
included. The last two columns: integrated back from the first sample to the last, by how much do
the angular rates without errors miss the attitude at the end, and by how much (rms) do they differ
from ours of the same motion?

| work | here | other | samples/s | times as fast | here off by | other off by |
|---|---|---|---|---|---|---|
{named}
pyins takes attitudes that are ready made, ours here, and draws a spline through them: its own
stamps it meets, and what the motion does between them, and what a rocking base does to the
accelerometers' place, is not in it. Its `Turntable` makes the motion too, as we do. What is felt
costs here by the motion, not by the rate: coning of 5 Hz in 50 pieces of polynomials a second takes
550 evaluations for each second, whether they give 100 samples or 1000; of whole turns that repeat
themselves the first alone is looked at.
`ahrs.Sensors` makes magnetometers as well, on an Earth that does not turn, and noise alone.

## Floors

What cannot be undercut, or does less: bytes that are ready made; a curve alone.

| work | here | floor | samples/s | here / floor | difference |
|---|---|---|---|---|---|
{bare}
MuJoCo's own evaluation of the same model, and NumPy's normal numbers:

| what | measured | ratio |
|---|---|---|
{within}
## What a run costs

![Cost of a run](speed.png)

{grown}"""


def main() -> None:
    other_python = sys.argv[1]
    others = subprocess.run(
        [other_python, "-c", VERSIONS], capture_output=True, text=True, check=True
    ).stdout.strip()
    ours, theirs = Side(sys.executable), Side(other_python)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = pairs(folder, ours, theirs)
        floor = floors(folder, ours, theirs)
        cost = curves(folder, ours)
    ours.close()
    theirs.close()
    rows = [*truth_rows(), *imu_rows()]
    draw(cost, DOCS / "speed.png")
    (DOCS / "speed.md").write_text(page(made, floor, rows, cost, others))
    print(DOCS / "speed.md")


if __name__ == "__main__":
    main()
