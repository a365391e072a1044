"""The one style of every page: a template, tables, figures drawn once for light, dark and paper.

A page is one file that loads nothing: its policy forbids the browser to. matplotlib and jinja2
are imported where they are used: they take a second to start.
"""

from __future__ import annotations

import re
import warnings
from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any

from stand.report.tables import TableData
from stand.versions import VERSION

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# What a figure is drawn with; in the page each becomes the variable of that name, which is one
# colour by day, another by night and a third on paper. The hues are Okabe and Ito's, told apart
# by colour-blind eyes.
PAPER, INK, SOFT, LINE = "#ffffff", "#1b1f24", "#5a626d", "#d9dde3"
HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8f7fd0", "#8a8f98")
ON_HUE = ("#fefefe",) * 3 + ("#1b1f25",) * 3 + ("#fefefe",) * 2  # of letters on each
_VARIABLES = {
    PAPER: "paper",
    INK: "ink",
    SOFT: "soft",
    LINE: "line",
    "#fefefe": "on-deep",
    "#1b1f25": "on-bright",
} | {hue: f"hue{k}" for k, hue in enumerate(HUES)}
INKS = {
    "light": {"paper": "#ffffff", "ink": "#1b1f24", "grid": "#d9dde3", "sheet": "#4a4f57"},
    "dark": {"paper": "#15181d", "ink": "#e6e8eb", "grid": "#343a43", "sheet": "#b9c0ca"},
}
"""For figures that are pictures of their own: one file per theme."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure of a page: SVG that takes its colours from the page, and the same in words."""

    svg: str
    alt: str
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Photo:
    """A picture made of pixels, as a data URI, and the same in words."""

    uri: str
    alt: str
    caption: str = ""


def photo(png: bytes, alt: str, caption: str = "") -> Photo:
    """A PNG for a page."""
    return Photo(data_uri(png), alt, caption)


def data_uri(image: bytes, kind: str = "png") -> str:
    """A PNG, or an image of another kind, as an address that holds it."""
    return f"data:image/{kind};base64,{b64encode(image).decode()}"


def drawing(
    name: str,
    size: tuple[float, float],
    alt: str,
    draw: Callable[[Figure], None],
    caption: str = "",
) -> Drawing:
    """Draw a figure for a page.

    Parameters
    ----------
    name : str
        Of its own in the page: letters and digits.
    size : (2,)
        Width and height in inches; 10 wide fills the page.
    alt : str
        What it shows, for who cannot see it.
    draw : callable
        Is given the figure; colours are `PAPER`, `INK`, `SOFT`, `LINE` and `HUES`.
    caption : str, optional
        Below it.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    # text stays text: it can be searched and read aloud, and comes in the page's letters
    style: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": name,
        "text.parse_math": False,  # a label may hold a dollar
        "hatch.linewidth": 0.6,
    }
    with rc_context(style), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # letters that matplotlib's font lacks: the page's has them
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        buffer = StringIO()
        figure.savefig(buffer, format="svg", transparent=True)
    return Drawing(_inline(buffer.getvalue(), name), alt, caption)


def picture(size: tuple[float, float], draw: Callable[[Figure], None]) -> bytes:
    """The same figure as a PNG of its own, by day."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context({"text.parse_math": False}), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # letters that matplotlib's font lacks
        figure = Figure(figsize=size, dpi=120, facecolor=PAPER, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", facecolor=PAPER, metadata={"Software": None})
    return buffer.getvalue()


def _inline(svg: str, name: str) -> str:
    """A file of SVG as part of a page: names of its own, colours and letters of the page."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<!--.*?-->|<(metadata|style)\b.*?</\1>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg)
    svg = re.sub(
        r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" aria-hidden="true">', svg
    )
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'xlink:href="#', f'href="#{name}-', svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    svg = re.sub(r" ?font-family: [^;\"]*;?", "", svg)
    svg = re.sub("#[0-9a-f]{6}", _colour, svg)
    return re.sub(r"\n\s*", "\n", svg)


def _colour(match: re.Match[str]) -> str:
    variable = _VARIABLES.get(match[0])
    return match[0] if variable is None else f"var(--{variable})"


def frame(axes: Axes, title: str = "", grid: str = "both") -> None:
    """The look of axes in a page: a quiet frame, the title at the left."""
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_axisbelow(True)
    axes.grid(True, which="major", axis=grid, color=LINE, linewidth=0.8)  # pyright: ignore[reportArgumentType]
    axes.tick_params(which="both", colors=SOFT, labelsize=9)
    axes.xaxis.label.set(color=SOFT, fontsize=9)
    axes.yaxis.label.set(color=SOFT, fontsize=9)
    for side, spine in axes.spines.items():
        spine.set_color(LINE)
        spine.set_visible(side in ("left", "bottom"))


def logarithmic(axis: Axis) -> None:
    """A logarithmic axis whose ticks are plain numbers: a page's letters are no mathematics."""
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(lambda value, _: "")


def render(template: str, content: Mapping[str, Any]) -> str:
    """A page from a template beside this module."""
    return _environment().get_template(template).render(version=VERSION, **content)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stand.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["drawing"] = lambda value: isinstance(value, Drawing)
    environment.tests["numeric"] = _numeric
    environment.filters["mark"] = mark
    return environment


MARKS = {"PASS": "good", "FAIL": "bad", "INDETERMINATE": "open", "yes": "good", "no": "bad"}


def mark(text: str) -> str:
    """The class of a cell that is a verdict, or nothing."""
    return MARKS.get(text.split(":")[0], "")


_NUMBER = re.compile(r"[-+−±<>≥≤]?\s*\d+(\.\d*)?(e[-+]?\d+)?([\s%°″(].*)?", re.DOTALL)
_NO_NUMBERS = ("", "none", "never", "not determined", "unlimited", "singular")


def _numeric(table: TableData, column: int) -> bool:
    """Whether a column of a table, not its first, holds numbers: they stand to the right."""
    rows = (*table.rows, *table.footers)
    cells = [row[column] for row in rows if row[column] not in _NO_NUMBERS]
    return column > 0 and bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)


def span_text(seconds: float) -> str:
    """A duration for a person: '12.3 s', '6 min 5 s', '2 h 04 min'."""
    if seconds < 99.95:
        return f"{seconds:.3g} s" if seconds < 10 else f"{seconds:.1f} s".replace(".0 s", " s")
    if seconds < 3599.5:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest:02d} s" if rest else f"{minutes} min"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min"
