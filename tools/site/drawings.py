"""Drawings of the site: frames and signs, what a sample is, procedures' timelines and positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import stand
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR
from stand import toml_files
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.physics.picture import pictures, png
from stand.procedure.procedure import load_procedure
from stand.report.page import HUES
from stand.table.joints import JOINTS
from stand.table.table import load_table

INK, SOFT = "#59636e", "#8a939d"  # on white and on black alike
CAMERA = "135,-18,2.9"
SIDE = 300  # pixels of a position
MOST = 8  # positions of a procedure that are shown
ACROSS = (4, 3, 5, 7)  # of several in a row: the first that leaves no gap


def write_drawings(folder: Path) -> None:
    """All drawings of the explanations, as SVG and PNG."""
    (folder / "explanations").mkdir(parents=True, exist_ok=True)
    for name, (size, draw) in DRAWINGS.items():
        _save(folder / "explanations" / f"{name}.svg", size, draw)
    stand = pictures([[0] * 6, *np.eye(6)[3:] * np.pi / 4], CAMERA, 420, 420)
    (folder / "explanations" / "axes.png").write_bytes(png(_side_by_side(stand, 4)))


def write_procedures(folder: Path) -> None:
    """Of each procedure of the catalogue its timeline and its positions."""
    model = describe(load_model())
    target = folder / "catalogue" / "procedures"
    target.mkdir(parents=True, exist_ok=True)
    poses: list[Any] = []
    counts: dict[str, int] = {}
    for name in toml_files.ids("procedures"):
        procedure = load_procedure(name)
        planned = plan(procedure, model, load_table(procedure.entry.table))
        _save(target / f"{name}-timeline.svg", (9, 3.2), _timeline(planned))
        own = _positions(planned)
        counts[name] = len(own)
        poses += own
    images = iter(pictures(np.array(poses), CAMERA, SIDE, SIDE))  # one process draws them all
    for name, count in counts.items():
        across = count if count <= ACROSS[0] else next(k for k in ACROSS if not count % k)
        row = _side_by_side([next(images) for _ in range(count)], across)
        (target / f"{name}-positions.png").write_bytes(png(row))


def _positions(planned: Any) -> list[Any]:
    """Joint angles in the middle of each stretch, each that looks different once."""
    found: list[Any] = []
    for step in planned.stretches:
        q = planned.motion.joints(np.array([(step.t_from + step.t_to) / 2]))[0][0]
        if all(np.abs(np.exp(1j * q) - np.exp(1j * p)).max() > 1e-3 for p in found):
            found.append(q)
    return found[:MOST]


def _timeline(planned: Any) -> Callable[[Figure], None]:
    """The angles of the axes that move, with the steps below them."""

    def draw(figure: Figure) -> None:
        end = planned.steps[-1].t_to
        t = np.linspace(0, end, 1600)
        q = planned.motion.joints(t)[0] / DEG
        axes = figure.subplots()
        for k, name in enumerate(JOINTS):
            if np.ptp(q[:, k]) > 0.01 or np.abs(q[:, k]).max() > 0.01:
                axes.plot(t, q[:, k], color=HUES[k], label=name, linewidth=1.4)
        for step in planned.steps:
            colour = HUES[0] if step.kind == "dwell" else HUES[1]
            axes.axvspan(step.t_from, step.t_to, ymax=0.03, color=colour, linewidth=0)
        if axes.lines:
            axes.legend(frameon=False, labelcolor=INK, ncols=6, loc="lower center",
                        bbox_to_anchor=(0.5, 1.0))  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(0, end))
        _quiet(axes)

    return draw


def _side_by_side(images: Sequence[Any], across: int) -> Any:
    """One image of several, so many in a row."""
    rows = [images[k : k + across] for k in range(0, len(images), across)]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


def _save(path: Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> None:
    figure = Figure(figsize=size, layout="constrained")
    draw(figure)
    figure.savefig(path, transparent=True, metadata={"Date": None})


def _quiet(axes: Any) -> None:
    axes.tick_params(colors=INK)
    axes.grid(True, color=SOFT, alpha=0.25)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for side, spine in axes.spines.items():
        spine.set_color(SOFT)
        spine.set_visible(side in ("left", "bottom"))


# --- explanations


def _frames(figure: Figure) -> None:
    """n, b and the recordings' world, from above and from the east."""
    above, east = figure.subplots(1, 2)
    for axes, title in ((above, "from above"), (east, "from the east")):
        axes.set(xlim=(-1.5, 1.6), ylim=(-1.5, 1.6), aspect="equal")
        axes.axis("off")
        axes.set_title(title, color=INK, fontsize=11)
    yaw = 25 * DEG
    north, west = np.array([0, 1.0]), np.array([-1.0, 0])
    nose = np.cos(yaw) * north + np.sin(yaw) * west
    right = np.array([nose[1], -nose[0]])
    _arrow(above, north, "n: north", SOFT)
    _arrow(above, -west, "east", SOFT)
    _arrow(above, nose, "X1 forward", HUES[0])
    _arrow(above, right, "Z1 right", HUES[2])
    above.plot(0, 0, "o", color=HUES[1], markersize=9)
    above.text(0.08, 0.1, "Y1 up", color=HUES[1], fontsize=10)
    turn = np.linspace(0, yaw, 30)
    above.plot(-0.6 * np.sin(turn), 0.6 * np.cos(turn), color=INK)
    above.text(-0.35, 0.68, "yaw > 0", color=INK, fontsize=9, ha="center")
    above.text(0, -1.35, "heading = −yaw, clockwise from north", color=INK, fontsize=9, ha="center")
    pitch = 20 * DEG
    _arrow(east, np.array([1.0, 0]), "north", SOFT)
    _arrow(east, np.array([0, -1.0]), "n: down", SOFT)
    _arrow(east, np.array([np.cos(pitch), np.sin(pitch)]), "X1", HUES[0])
    _arrow(east, np.array([-np.sin(pitch), np.cos(pitch)]), "Y1", HUES[1])
    turn = np.linspace(0, pitch, 30)
    east.plot(0.7 * np.cos(turn), 0.7 * np.sin(turn), color=INK)
    east.text(0.95, 0.12, "pitch > 0: nose up", color=INK, fontsize=9)


def _arrow(axes: Any, to: Any, text: str, colour: str) -> None:
    axes.annotate(
        "", xy=tuple(to), xytext=(0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2}
    )
    axes.text(*(1.13 * to), text, color=colour, ha="center", va="center", fontsize=10)


def _earth(figure: Figure) -> None:
    """What a level unit at 48.5 deg reads: Earth rate and specific force."""
    axes = figure.subplots()
    axes.set(xlim=(-0.4, 1.5), ylim=(-0.25, 1.35), aspect="equal")
    axes.axis("off")
    lat = 48.5 * DEG
    w = 15.041067
    _arrow(axes, np.array([1.1, 0]), "north", SOFT)
    _arrow(axes, np.array([0, 1.1]), "up, f = 9.8094 m/s²", SOFT)
    _arrow(axes, np.array([np.cos(lat), np.sin(lat)]), f"Earth rate {w:.3f} deg/h", HUES[1])
    axes.plot([0, np.cos(lat)], [-0.06, -0.06], color=HUES[0], lw=3)
    axes.text(
        np.cos(lat) / 2, -0.15, f"X1: {w * np.cos(lat):.5f} deg/h", color=HUES[0], ha="center"
    )
    axes.plot([-0.06, -0.06], [0, np.sin(lat)], color=HUES[2], lw=3)
    axes.text(-0.1, 0.3, f"Y1: {w * np.sin(lat):.5f} deg/h", color=HUES[2], rotation=90,
              ha="right", va="center")  # fmt: skip
    axes.text(0.22, 0.07, "48.5°", color=INK)


def _sample(figure: Figure) -> None:
    """A sample is the mean over the interval that ends at its stamp."""
    axes = figure.subplots()
    t = np.linspace(0, 1, 1000)

    def rate(x: Any) -> Any:
        return np.sin(2 * np.pi * 1.1 * x) + 0.35 * np.sin(2 * np.pi * 3.3 * x)

    axes.plot(t, rate(t), color=SOFT, label="what the point of the unit does")
    stamps = np.arange(1, 11) / 10
    for k, end in enumerate(stamps):
        x = np.linspace(end - 0.1, end, 200)
        mean = rate(x).mean()
        axes.fill_between([end - 0.1, end], 0, mean, color=HUES[0], alpha=0.2, lw=0)
        axes.plot([end - 0.1, end], [mean, mean], color=HUES[0], lw=1.6)
        axes.plot(
            end, mean, "o", color=HUES[0], label="sample: the mean, at its end" if not k else ""
        )
        axes.plot(end, rate(end), "x", color=HUES[1], label="--sampling instant" if not k else "")
    axes.legend(frameon=False, labelcolor=INK)
    axes.set(xlabel="time, in intervals of ten", ylabel="rate")
    _quiet(axes)


def _integrate_back(figure: Figure) -> None:
    """How far ideal samples, integrated back, are from the recorded attitude, by their rate."""
    axes = figure.subplots()
    rates = np.array([25, 50, 100, 200])
    axes.loglog(rates, [_drift(int(r)) for r in rates], "o-", color=HUES[0])
    axes.set(xlabel="sample rate [Hz]", ylabel="error after the run [arc s]")
    axes.set_xticks(rates, [str(r) for r in rates])
    axes.minorticks_off()
    _quiet(axes)


def _drift(rate_hz: int) -> float:
    """Of Scorsby motion: attitude by three-sample coning from ideal samples, less truth [arc s]."""
    settings = stand.settings("scorsby", imu="ideal", rate_hz=rate_hz, true_table=True)
    run = stand.simulate(settings)
    d = run.true_w_ib_b / rate_hz
    p, n = np.roll(d, 1, axis=0), np.roll(d, -1, axis=0)
    turns = d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60
    first, last = 10, len(d) - 10
    C = run.C_nb[first - 1]
    for turn in Rotation.from_rotvec(turns[first:last]):
        C = C * turn
    earth = Rotation.from_rotvec(settings.site.w_ie_n * (last - first) / rate_hz)
    return float((earth.inv() * C * run.C_nb[last - 1].inv()).magnitude() / ARC_SECOND)


def _budget(figure: Figure) -> None:
    """What the heading of two positions is made of, as a rehearsal says it."""
    result = stand.rehearse(stand.settings("two-position", imu="ring-laser"))
    heading = next(
        p for p in result.predictions if (p.quantity, p.method) == ("heading", "two-position")
    )
    largest = sorted(heading.contributions, key=lambda part: -part.sigma)[:7]
    parts = [(part.source, part.sigma) for part in largest]
    axes = figure.subplots()
    names = [name for name, _ in parts][::-1]
    axes.barh(names, [value / heading.per for _, value in parts][::-1], color=HUES[0])
    axes.set(xlabel=f"sigma of heading [{heading.unit}]: parts add as squares")
    _quiet(axes)


def _walk(figure: Figure) -> None:
    """Why a mean is not better by sqrt n for ever: Allan deviation of a unit."""
    unit = stand.unit("stim300", rate_hz=10, seed=1)
    n = 10 * 7200
    t = np.arange(1, n + 1) / 10
    w = unit.report(t, np.zeros((n, 3)), np.tile([0.0, 9.81, 0.0], (n, 1))).w_ib_b[:, 0]
    theta = np.concatenate([[0], np.cumsum(w) / 10])
    taus = np.unique(np.logspace(0, 4.1, 40).astype(int))
    adev = [np.sqrt(np.mean((theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m]) ** 2) / 2)
            / (m / 10) for m in taus]  # fmt: skip
    axes = figure.subplots()
    axes.loglog(taus / 10, np.array(adev) / DEG_PER_HOUR, color=HUES[0])
    axes.loglog(taus / 10, 0.15 * 60 / np.sqrt(taus / 10), "--", color=HUES[1],
                label="0.15 deg/rt-h of white noise alone")  # fmt: skip
    axes.legend(frameon=False, labelcolor=INK)
    axes.set(xlabel="averaging time [s]", ylabel="Allan deviation [deg/h]")
    _quiet(axes)


DRAWINGS: dict[str, tuple[tuple[float, float], Callable[[Figure], None]]] = {
    "frames": ((9, 4.2), _frames),
    "earth": ((6, 4.6), _earth),
    "sample": ((9, 3.6), _sample),
    "integrate-back": ((6.5, 3.6), _integrate_back),
    "budget": ((8, 3.2), _budget),
    "walk": ((7, 3.8), _walk),
}
