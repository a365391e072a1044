"""The chart of admissible rocking: amplitude by frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

from alignment.units import DEG
from stand.rehearsal.rocking_allowed import AdmissibleRocking
from stand.report.page import HUES, INK, Drawing, drawing, frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rocking(found: AdmissibleRocking) -> Drawing:
    """What a method admits by frequency, beside what is planned."""
    curve = found.curve / DEG

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.fill_between(found.frequencies, curve.min() / 10, curve, color=HUES[2], alpha=0.2)
        axes.plot(found.frequencies, curve, color=HUES[2], linewidth=1.6, label="admissible")
        axes.plot(
            [found.frequency], [found.planned / DEG], marker="X", markersize=9, color=HUES[1],
            linestyle="", label="planned",
        )  # fmt: skip
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(found.frequencies[0], found.frequencies[-1])
        frame(axes)
        axes.set_xlabel("frequency of rocking [Hz]")
        axes.set_ylabel("rocking [deg rms]")
        for text in axes.legend(frameon=False, fontsize=9, loc="upper right").get_texts():
            text.set_color(INK)

    return drawing(
        "rocking",
        (10.0, 3.6),
        f"Admissible rocking by its frequency. {found.text}",
        draw,
        f"{found.text}. Below the line: admissible about one axis, of a resonance with a damping "
        "of 0.1; what is slow against the record turns less from its start to its end.",
    )
