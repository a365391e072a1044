"""What the estimators found, as the review shows it: lines with gaps, one method after another."""

from collections.abc import Iterable, Sequence

import numpy as np

from alignment.units import DEG
from stand.recording.curves import AngleCurves
from stand.recording.thinning import Rows, bin_length, min_max_bins

CURVE_BUDGET = 20_000


def with_gaps(parts: Iterable[Rows]) -> Rows:
    """Rows of several dwells, thinned, each closed by a row of NaN that breaks the line."""
    dwells = list(parts)
    m = bin_length(sum(len(t_ns) for t_ns, _ in dwells), CURVE_BUDGET)
    times, rows = [], []
    for t_ns, values in dwells:
        thin_t, thin = min_max_bins(t_ns, values, m)
        times += [thin_t, thin_t[-1:] + 1]
        rows += [thin, np.full((1, values.shape[1]), np.nan)]
    return np.concatenate(times), np.concatenate(rows)


def relay(curves: Iterable[AngleCurves]) -> list[AngleCurves]:
    """Curves that follow one another in time, the first come first served."""
    taken: list[AngleCurves] = []
    for curve in curves:
        first, last = curve.t_ns[0], curve.t_ns[-1]
        if all(last <= other.t_ns[0] or other.t_ns[-1] <= first for other in taken):
            taken.append(curve)
    return sorted(taken, key=lambda curve: int(curve.t_ns[0]))


def exaggeration(curves: Sequence[AngleCurves]) -> float:
    """The power of ten that shows the median error as 2 to 20 degrees, if that is more."""
    errors = np.concatenate([np.linalg.norm(curve.error_rotations, axis=1) for curve in curves])
    errors = errors[np.isfinite(errors)]
    if not len(errors):
        return 1.0
    shown = 20.0 * DEG / max(float(np.median(errors)), 1e-9)
    return float(10.0 ** np.clip(np.floor(np.log10(shown)), 0.0, 6.0))
