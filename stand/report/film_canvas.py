"""The picture around the moving stand: drawn twice, without curves and with them.

Nothing is drawn again for a frame of a film: what is past shows the canvas with curves, what is
to come the one without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.options import of_noise_alone
from alignment.units import ARC_SECOND, DEG
from stand.recording.curves import ANGLES, AngleCurves
from stand.recording.thinning import bin_length, min_max_bins
from stand.report.film_scene import Scene, readouts
from stand.samples import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Image = NDArray[np.uint8]

DPI = 100
DESIGN = (1280, 720)  # pixels, at which letters have their own size
PAPER, PLATE, INK, SOFT, LINE = "#15181d", "#1d2127", "#e6e8eb", "#a3abb6", "#343a43"
HUES = ("#3a9bd9", "#e8743b", "#2bb58c")  # as pages have them by night
STAGES = {"dwell": HUES[0], "move": HUES[1], "profile": HUES[1]}  # others: evenly turning
TURNING = HUES[2]
SETTLED_PART = 20  # the first part in so many of a curve does not set the scale
PANELS = 4  # rates, forces, two of angles
LETTERS = "0123456789.-+°:/ abcdefghijklmnopqrstuvwxyz_"


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle in pixels, from the upper left corner."""

    x: int
    y: int
    width: int
    height: int

    @property
    def rows(self) -> slice:
        return slice(self.y, self.y + self.height)

    @property
    def columns(self) -> slice:
        return slice(self.x, self.x + self.width)


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things are: side by side, or one above the other where it is not wide enough."""

    width: int
    height: int

    @property
    def scale(self) -> float:
        least = min(self.width / DESIGN[0], self.height / DESIGN[1])
        return least if self.wide else 1.3 * least

    @property
    def wide(self) -> bool:
        return self.width >= 1.2 * self.height

    @property
    def head(self) -> int:
        return round(58 * self.scale)

    @property
    def foot(self) -> int:
        return round(44 * self.scale)

    @property
    def stand(self) -> Box:
        """Where the stand is seen."""
        if self.wide:
            return Box(0, self.head, round(0.44 * self.width), self.height - self.head - self.foot)
        return Box(0, self.head, self.width, round(0.46 * (self.height - self.head - self.foot)))

    @property
    def curves(self) -> Box:
        """Where the curves are, with their numbers and names."""
        stand = self.stand
        if self.wide:
            return Box(stand.width, self.head, self.width - stand.width, stand.height)
        top = stand.y + stand.height
        return Box(0, top, self.width, self.height - self.foot - top)

    @property
    def panels(self) -> list[slice]:
        """The rows of each panel, from the upper one on."""
        box = self.curves
        top, below, between = (round(x * self.scale) for x in (30, 40, 32))
        height = (box.height - top - below - (PANELS - 1) * between) / PANELS
        begins = [box.y + top + k * (height + between) for k in range(PANELS)]
        return [slice(round(y), round(y + height)) for y in begins]

    @property
    def plot(self) -> tuple[int, int]:
        """First and last column of the curves themselves."""
        box = self.curves
        return box.x + round(70 * self.scale), box.x + box.width - round(22 * self.scale)


class Canvas:
    """Frames of a scene between two times: `frame` puts one together.

    Parameters
    ----------
    scene : Scene
    t_from, t_to : float
        What the time axis spans [s].
    width, height : int
    """

    def __init__(self, scene: Scene, t_from: float, t_to: float, width: int, height: int) -> None:
        self.scene, self.t_from, self.t_to = scene, t_from, t_to
        self.layout = Layout(width, height)
        self._empty, self._full = self._drawn()

    def frame(self, t: float, stand: Image, joints: Array) -> Image:
        """The picture (height, width, 3) at a time [s] with the stand and its angles (6,) [rad]."""
        layout = self.layout
        first, last = layout.plot
        now = round(np.interp(t, [self.t_from, self.t_to], [first, last]))
        image = self._empty.copy()
        image[layout.curves.rows, first:now] = self._full[layout.curves.rows, first:now]
        for rows in layout.panels:
            image[rows, now : now + max(1, round(layout.scale))] = _rgb(INK)
        image[layout.stand.rows, layout.stand.columns] = stand
        self._foot(image, t)
        self._write(image, f"{t:.2f} s", (-18, 19), big=True)
        for k, line in enumerate(readouts(joints)):
            self._write(image, line, (14, 58 + 12 + 21 * k), big=False)
        return image

    def _foot(self, image: Image, t: float) -> None:
        """How far it is, and the stage that is on."""
        layout, on = self.layout, self.scene.stage(t)
        edge = round(6 * layout.scale)
        now = round(np.interp(t, [self.t_from, self.t_to], [0, layout.width]))
        rows = slice(layout.height - edge, layout.height)
        image[rows, :now] = self._full[rows, :now]
        if on is not None:
            caption = self._captions[on]
            top = layout.height - layout.foot
            image[top : top + caption.shape[0], : caption.shape[1]] = caption

    # --- drawn once

    def _drawn(self) -> tuple[Image, Image]:
        layout = self.layout
        figure = _figure(layout.width, layout.height)
        panels = [
            self._panel(figure, k, name) for k, name in enumerate(("rates", "forces", "a", "b"))
        ]
        self._heading(figure)
        curves = self._curves()
        for axes, (title, lines, bands) in zip(panels, curves, strict=True):
            self._describe(axes, title, lines, bands)
        panels[-1].set_xlabel(_time_name(self.t_to - self.t_from), fontsize=9.5 * layout.scale)
        empty = _pixels(figure)
        for axes, (_, lines, bands) in zip(panels, curves, strict=True):
            for colour, t, low, high in bands:
                axes.fill_between(t, low, high, color=colour, alpha=0.28, linewidth=0)
            for colour, t, values in lines:
                axes.plot(t, values, color=colour, linewidth=1.3 * layout.scale)
        full = _pixels(figure)
        rows = slice(layout.height - round(6 * layout.scale), layout.height)
        empty[rows] = _rgb(LINE)
        full[rows] = self._strip()
        return empty, full

    def _strip(self) -> Image:
        """A row of colours: what the table does, over the time that is shown."""
        row = np.tile(np.array(_rgb(SOFT), np.uint8), (self.layout.width, 1))
        for stage in self.scene.stages:
            ends = [stage.t_from, stage.t_to]
            a, b = np.interp(ends, [self.t_from, self.t_to], [0, self.layout.width])
            row[round(a) : round(b)] = _rgb(STAGES.get(stage.kind, TURNING))
        return row

    def _panel(self, figure: Figure, k: int, name: str) -> Axes:
        layout, rows = self.layout, self.layout.panels[k]
        first, last = layout.plot
        axes = figure.add_axes(
            (
                first / layout.width,
                1 - rows.stop / layout.height,
                (last - first) / layout.width,
                (rows.stop - rows.start) / layout.height,
            ),
            label=name,
        )
        axes.set_facecolor(PLATE)
        axes.set_xlim(self.t_from, self.t_to)
        axes.grid(True, color=LINE, linewidth=0.8 * layout.scale)
        axes.set_axisbelow(True)
        axes.tick_params(
            colors=SOFT,
            labelsize=8.5 * layout.scale,
            length=0,
            pad=4 * layout.scale,
            labelbottom=k == PANELS - 1,
        )
        axes.xaxis.label.set_color(SOFT)
        axes.xaxis.labelpad = 2 * layout.scale
        _time_ticks(axes, self.t_from, self.t_to)
        for spine in axes.spines.values():
            spine.set_visible(False)
        return axes

    def _describe(
        self, axes: Axes, title: str, lines: Sequence[Line], bands: Sequence[Band]
    ) -> None:
        """Title with the names of its curves, and the span of values."""
        size = 10 * self.layout.scale
        axes.set_title(title, loc="left", fontsize=size, color=INK, pad=4 * self.layout.scale)
        low, high = _span(lines, bands)
        axes.set_ylim(low, high)
        axes.locator_params(axis="y", nbins=4)
        if not any(np.isfinite(values).any() for _, _, values in lines):
            axes.set_yticks([])
            axes.text(
                0.5, 0.5, "not determined", transform=axes.transAxes, ha="center", va="center",
                color=SOFT, fontsize=size,
            )  # fmt: skip

    def _heading(self, figure: Figure) -> None:
        layout, s = self.layout, self.layout.scale
        y = 1 - 20 * s / layout.height
        figure.text(
            16 * s / layout.width, y, self.scene.title, color=INK, fontsize=14 * s, va="center"
        )
        figure.text(
            16 * s / layout.width, 1 - 43 * s / layout.height, self.scene.subtitle, color=SOFT,
            fontsize=10 * s, va="center",
        )  # fmt: skip
        names = [(name, HUES[k]) for k, name in enumerate(AXES)]
        last = layout.plot[1]
        for k, (name, colour) in enumerate(reversed(names)):
            figure.text(
                (last - 34 * s * k) / layout.width, 1 - (layout.head + 17 * s) / layout.height,
                name, color=colour, fontsize=10 * s, ha="right", va="center", weight="bold",
            )  # fmt: skip

    def _curves(self) -> list[tuple[str, list[Line], list[Band]]]:
        """Title, lines and bands of each panel."""
        readings = self.scene.readings.between(self.t_from, self.t_to)
        budget = 2 * (self.layout.plot[1] - self.layout.plot[0])
        rates = _thinned(readings.t, readings.w_ib_b / DEG, budget)
        forces = _thinned(readings.t, readings.f_b, budget)
        return [
            ("rate [deg/s]", rates, []),
            ("specific force [m/s²]", forces, []),
            self._errors((0, 2)),
            self._errors((1,)),
        ]

    def _errors(self, angles: Sequence[int]) -> tuple[str, list[Line], list[Band]]:
        estimate = [part for c in self.scene.estimate if len((part := self._shown(c)).t_ns)]
        names = " and ".join(f"{ANGLES[k]} ({AXES[k]})" for k in angles)  # about which it turns
        if not self.scene.estimate:
            return f"{names}: no method answers", [], []
        values = [c.errors[len(c.t_ns) // SETTLED_PART :, k] for c in estimate for k in angles]
        greatest = max((float(np.abs(v[np.isfinite(v)]).max(initial=0)) for v in values), default=0)
        unit, per = ("arc s", ARC_SECOND) if 0 < greatest < 0.02 * DEG else ("deg", DEG)
        lines: list[Line] = []
        bands: list[Band] = []
        for curve in estimate:
            t = curve.t_ns * 1e-9
            for k in angles:
                error, sigma = curve.errors[:, k] / per, curve.sigmas[:, k] / per
                colour = HUES[k % 3]
                lines.append((colour, t, error))
                bands.append((colour, t, error - sigma, error + sigma))
        against = "truth" if self.scene.true else "its last"
        method = self.scene.estimate[0].method
        alone = any(of_noise_alone(ANGLES[k], self.scene.noise_only) for k in angles)
        only = " of noise only" if alone else ""
        return f"{names}: {method} minus {against}, ±1 sigma{only} [{unit}]", lines, bands

    def _shown(self, curve: AngleCurves) -> AngleCurves:
        """The part of a curve that is within the time shown."""
        t = curve.t_ns * 1e-9
        own = (t >= self.t_from) & (t <= self.t_to)
        arrays = ("t_ns", "angles", "errors", "sigmas", "error_rotations")
        return replace(curve, **{name: getattr(curve, name)[own] for name in arrays})

    @cached_property
    def _captions(self) -> list[Image]:
        """What is written below the stand in each stage."""
        layout, stages = self.layout, self.scene.stages
        height = layout.foot - round(6 * layout.scale)
        made = []
        for number, stage in enumerate(stages, 1):
            figure = _figure(layout.width, height)
            figure.text(
                16 * layout.scale / layout.width, 0.5, f"{stage.kind}: {stage.label}", color=INK,
                fontsize=13 * layout.scale, va="center",
            )  # fmt: skip
            figure.text(
                1 - 18 * layout.scale / layout.width, 0.5, f"step {number} of {len(stages)}",
                color=SOFT, fontsize=10 * layout.scale, ha="right", va="center",
            )  # fmt: skip
            made.append(_pixels(figure))
        return made

    # --- letters

    def _write(self, image: Image, text: str, place: tuple[float, float], *, big: bool) -> None:
        """Letters of one width, their upper left corner at `place`; from the right where below 0.

        Over the stand they are mixed with what is there.
        """
        letters = self._letters[big]
        width = letters.shape[2]
        mask = np.concatenate([letters[LETTERS.index(c)] for c in text.lower()], axis=1)
        x, y = round(place[0] * self.layout.scale), round(place[1] * self.layout.scale)
        if x < 0:
            x = self.layout.width + x - len(text) * width
        part = image[y : y + mask.shape[0], x : x + mask.shape[1]]
        mask = mask[: part.shape[0], : part.shape[1], None]
        colour = np.array(_rgb(INK))
        part[...] = np.round(part * (1 - mask) + colour * mask)

    @cached_property
    def _letters(self) -> dict[bool, Array]:
        return {big: _letters((17 if big else 10.5) * self.layout.scale) for big in (False, True)}


Line = tuple[str, Array, Array]  # colour, times, values
Band = tuple[str, Array, Array, Array]  # colour, times, from, to


def _figure(width: int, height: int) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def _pixels(figure: Figure) -> Image:
    canvas: Any = figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _letters(points: float) -> Array:
    """How much of each point (letters, height, width) is ink, 0 to 1."""
    width, height = round(points * DPI / 72 * 0.62), round(points * DPI / 72 * 1.25)
    figure = _figure(width * len(LETTERS), height)
    for k, letter in enumerate(LETTERS):
        figure.text(
            (k + 0.5) / len(LETTERS), 0.28, letter, color="#ffffff", family="DejaVu Sans Mono",
            fontsize=points, ha="center", va="baseline",
        )  # fmt: skip
    figure.set_facecolor("#000000")
    drawn = _pixels(figure)[..., 0] / 255
    return np.stack(np.split(drawn, len(LETTERS), axis=1))


def _thinned(t: Array, values: Array, budget: int) -> list[Line]:
    t_ns = np.round(t * 1e9).astype(np.int64)
    m = bin_length(len(t_ns), budget)
    stamps, rows = min_max_bins(t_ns, np.ascontiguousarray(values), m)
    return [(HUES[k], stamps * 1e-9, rows[:, k]) for k in range(3)]


def _span(lines: Iterable[Line], bands: Iterable[Band]) -> tuple[float, float]:
    """What the curves span once they have begun, with room; the first moments may be anything."""
    parts = [v[len(v) // SETTLED_PART :] for _, _, v in lines]
    parts += [v[len(v) // SETTLED_PART :] for _, _, a, b in bands for v in (a, b)]
    values = np.concatenate([*parts, np.zeros(1)])
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    room = 0.12 * (high - low) or 1.0
    return low - room, high + room


_UNITS: Sequence[tuple[float, float, str]] = ((3 * 3600, 3600, "h"), (300, 60, "min"), (0, 1, "s"))


def _unit(span: float) -> tuple[float, str]:
    return next((per, name) for least, per, name in _UNITS if span >= least)


def _time_name(span: float) -> str:
    return f"time [{_unit(span)[1]}]"


def _time_ticks(axes: Axes, t_from: float, t_to: float) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    per, _ = _unit(t_to - t_from)
    ticks = MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(t_from / per, t_to / per)
    axes.set_xticks([tick * per for tick in ticks if t_from <= tick * per <= t_to])
    formatter: Callable[[float, int], str] = lambda t, _: f"{t / per:g}"  # noqa: E731
    axes.xaxis.set_major_formatter(FuncFormatter(formatter))
