"""The scatter of windows beside the sigmas stated, as a table."""

from collections.abc import Sequence
from math import isfinite

from alignment.units import DEG
from stand.evaluation.windows import Scatter
from stand.imu.priors import NOISE_ONLY
from stand.report.document import method_text, sigma_text
from stand.report.tables import TableData

NOTE = (
    "scatter: standard deviation of the windows' estimates about their own mean, with its 95 % "
    "interval; sigma: root mean square of what the method states; ratio: of their squares, 1 where "
    "the sigma is right; a window of more than twice the usual sigma, for something moved it, "
    "counts by its own. What is common to all windows, as a bias is, shows in none of it: with a "
    "data sheet the ratio is to what changes, sigma without the sheet's constant errors."
)


HEADER = (
    *("method", "stretch", "window s", "quantity", "n"),
    *("scatter", "sigma", "changes", "ratio", "remark"),
)


def windows_table(rows: Sequence[Scatter]) -> TableData:
    """One row per method, length, stretch and quantity [deg]."""
    return TableData(
        "scatter of windows beside the sigma stated [deg]",
        HEADER,
        tuple(_row(row) for row in rows),
        notes=(NOTE,),
        optional=("n", "changes"),
    )


def _row(row: Scatter) -> tuple[str, ...]:
    scatter = "one window" if row.count < 2 else "not determined"
    if isfinite(row.scatter):
        scatter = f"{row.scatter / DEG:.3g} ({row.low / DEG:.2g} to {row.high / DEG:.2g})"
    return (
        method_text(row.method, row.window),
        row.label,
        f"{row.seconds:g}",
        row.quantity,
        str(row.count),
        scatter,
        *(_sigma(sigma, row.noise_only) for sigma in (row.sigma, row.changing)),
        "" if row.ratio is None else f"{row.ratio:.2g}",
        row.remark.removeprefix(NOISE_ONLY).removeprefix("; ") if row.sigma else row.remark,
    )


def _sigma(sigma: float | None, noise_only: bool) -> str:
    return "" if sigma is None else sigma_text(sigma / DEG, noise_only)
