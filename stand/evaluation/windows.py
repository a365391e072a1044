"""A log cut into windows: how its estimates scatter, beside the sigma that methods state of them.

What is common to all windows, a bias above all, cannot show here; what changes between them must,
whatever a data sheet says.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, pairwise
from typing import Any

import numpy as np
from scipy.special import chdtri

from alignment import AttitudeEstimate, Dwell, ImuReadings, Options, Priors, Site, Turn
from alignment.arrays import Array
from alignment.doubts import ALIKE_DOUBT
from alignment.errors import NotAtRest
from alignment.estimate import ANGLE_LIMIT, LATITUDE_LIMIT
from alignment.methods.inertial import base_turns
from alignment.noise import DISTURBED, check_at_rest
from alignment.options import of_noise_alone
from alignment.readings import Grain
from alignment.rounding import rounding_variance, steps_of
from alignment.units import DEG
from stand.errors import StandError
from stand.evaluation.score import Refusal, answered, circular
from stand.imu.priors import NOISE_ONLY

_LEFT = 1e-3  # of a step squared: a hundredth of what rounding does without noise
SHORT = 0.02  # part of a window by which the last one may be short
TAIL = 0.025  # of either end of a 95 % interval
LIMITS = {
    "heading": ANGLE_LIMIT,
    "yaw": ANGLE_LIMIT,
    "latitude": LATITUDE_LIMIT,
}  # sigmas that say nothing
BELOW = "scatter below sigma: a unit better than its sheet"
COMMON = "most of sigma is common to all windows: no scatter shows it"
HIDDEN = "a part of sigma is common to all windows: a scatter below it says nothing"
CAREFUL = "scatter below sigma: noise is taken for more than windows show"
MOST = 0.5  # of a variance
ALIKE = 0.5  # of their scatter by which estimates with and without constant errors may differ
LEVEL = ("roll", "pitch")
BASE_MOVES = "the base moves, and so does what is estimated"
BEYOND = "scatter beyond sigma: what changes from window to window shows in none of them"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """One quantity by one method over the windows of one stretch.

    Attributes
    ----------
    method, window : str
        As of the estimates.
    label : str
        Of the stretch.
    seconds : float
        Length of a window.
    quantity : str
        heading (of a vertical X1 yaw), roll, pitch or latitude.
    count : int
        Windows that were estimated.
    scatter, low, high : float
        Standard deviation about their own mean (n - 1) [rad] and its 95 % interval by chi-square,
        as of independent normal values; NaN of one window, and where one of them does not tell.
    sigma : float or None
        Root mean square of the sigmas stated [rad]; None where a method states none, or one that
        says nothing (above 30 deg of heading, 10 deg of latitude).
    changing : float or None
        The same without what is common to all windows, the constant errors of a data sheet [rad]:
        what a scatter can show. None as `sigma` is, and where the answer itself hangs on them.
    ratio : float or None
        Square of the deviations over `changing`, else over those stated, per degree of freedom: 1
        of sigmas that are right. A window whose sigma is more than twice the usual one, for it
        was disturbed, counts by its own and is no measure of the others. None where there is none.
    remark : str
        What must be known beside the numbers; '' for nothing.
    """

    method: str
    window: str
    label: str
    seconds: float
    quantity: str
    count: int
    scatter: float
    low: float
    high: float
    sigma: float | None
    changing: float | None
    ratio: float | None
    remark: str

    @property
    def noise_only(self) -> bool:
        """Whether the sigma is of noise alone, as the remark says."""
        return self.remark.startswith(NOISE_ONLY)


def check_lengths(lengths: Sequence[float]) -> None:
    """Raise `StandError` of window lengths [s] that are none."""
    for seconds in lengths:
        if not (np.isfinite(seconds) and seconds > 0):
            raise StandError(f"windows {seconds:g}: must be lengths above 0 s")


def windows_of(dwell: Dwell, seconds: float) -> list[Dwell]:
    """The stretch in windows of a length [s], one after the other; what is left over is left out.

    The last one may be short by 2 %. Each has the encoder angles of its own time; of one that does
    not turn all readings of the stretch stay, of which it uses its own.
    """
    count = int((dwell.t_to - dwell.t_from) / seconds + SHORT)
    edges = [min(dwell.t_from + k * seconds, dwell.t_to) for k in range(count + 1)]
    return [_cut(dwell, a, b) for a, b in pairwise(edges)]


def _cut(dwell: Dwell, t_from: float, t_to: float) -> Dwell:
    if dwell.turn is None:  # the record around it tells what drifts too slowly to show in it
        return replace(dwell, t_from=t_from, t_to=t_to)
    part, turn = dwell.readings.between(t_from, t_to), dwell.turn
    if len(part):
        first = int(np.searchsorted(dwell.readings.t, part.t[0]))
        turn = Turn(turn.axis_b, turn.angle[first : first + len(part)])
    return replace(dwell, t_from=t_from, t_to=t_to, readings=part, turn=turn)


def scatters(
    dwells: Sequence[Dwell],
    site: Site,
    options: Options,
    methods: Sequence[str],
    lengths: Sequence[float],
) -> tuple[list[Scatter], list[Refusal]]:
    """Scatter and stated sigma of every method's estimates over windows of these lengths.

    Parameters
    ----------
    dwells : sequence of Dwell
        Stretches of a log: the k-th windows of all are estimated together, as positions of one
        unit, so that methods that need several have them.
    site : Site
    options : Options
    methods : sequence of str
        Of `ESTIMATORS`.
    lengths : sequence of float
        [s]

    Returns
    -------
    list of Scatter
        By method, length, stretch and quantity.
    list of Refusal
        Why a method left out windows.

    Raises
    ------
    StandError
        A length that is not above 0; longer than every stretch.
    """
    check_lengths(lengths)
    found: list[Scatter] = []
    refusals: list[Refusal] = []
    for seconds in lengths:
        parts = [windows_of(dwell, seconds) for dwell in dwells]
        most = max((len(part) for part in parts), default=0)
        if not most:
            longest = max((d.t_to - d.t_from for d in dwells), default=0.0)
            raise StandError(f"windows of {seconds:g} s: the longest stretch has {longest:.1f} s")
        together = [[part[k] for part in parts if k < len(part)] for k in range(most)]
        moving = {dwell.label for dwell in dwells if dwell.turn is None and not _rests(dwell)}
        tilting = {dwell.label for dwell in dwells if dwell.turn is None and _tilts(dwell, site)}
        for method in methods:
            estimates, refused = _estimated(method, together, site, options)
            changing = _changing(method, together, site, options)
            found += _summed(
                method, seconds, (estimates, changing), (moving, tilting), options.priors
            )
            if refused:
                refusals.append(_refusal(method, seconds, refused, most))
    return found, refusals


def _rests(dwell: Dwell) -> bool:
    try:
        check_at_rest(dwell)
    except NotAtRest:
        return False
    return True


def _tilts(dwell: Dwell, site: Site) -> bool:
    if site.latitude is None or not _rests(dwell):
        return False
    return base_turns(dwell, site)


def _refusal(method: str, seconds: float, refused: Sequence[str], most: int) -> Refusal:
    return Refusal(
        method, f"{len(refused)} of {most} windows of {seconds:g} s: the first: {refused[0]}"
    )


def _estimated(
    method: str, together: Sequence[Sequence[Dwell]], site: Site, options: Options
) -> tuple[list[AttitudeEstimate], list[str]]:
    estimates: list[AttitudeEstimate] = []
    refused: list[str] = []
    for dwells in together:
        found, reasons = answered(method, dwells, site, options)
        estimates += [e for e in found if not circular(e)]
        refused += [one.reason for one in reasons[:1]]
    return estimates, refused


def _changing(
    method: str, together: Sequence[Sequence[Dwell]], site: Site, options: Options
) -> list[AttitudeEstimate]:
    """The estimates without what is common to all windows; none where nothing is.

    That are the constant errors of a sheet, and what rounding leaves of a mean at rest.
    """
    changing = options.priors.changing
    if changing == options.priors and not any(map(_stuck, chain(*together))):
        return []
    smooth = [[replace(d, readings=_unrounded(d.readings)) for d in dwells] for dwells in together]
    return _estimated(method, smooth, site, replace(options, priors=changing))[0]


def _stuck(dwell: Dwell) -> bool:
    """Whether noise leaves steps of the readings unblurred."""
    window = dwell.window()
    return bool(np.any(rounding_variance(window) > _LEFT * steps_of(window) ** 2))


@lru_cache(maxsize=1)  # the windows of one record ask one after the other
def _unrounded(readings: ImuReadings) -> ImuReadings:
    return replace(readings, grains=(Grain(), Grain()))


def _summed(
    method: str,
    seconds: float,
    both: tuple[Sequence[AttitudeEstimate], Sequence[AttitudeEstimate]],
    motion: tuple[set[str], set[str]],
    priors: Priors,
) -> Iterator[Scatter]:
    """`motion`: which stretches move, and of which the base tilts though they rest."""
    moving, tilting = motion
    groups, others = (_grouped(estimates) for estimates in both)
    for (label, window), members in groups.items():
        own = {q: pair for q, *pair in _quantities(others.get((label, window), []))}
        for quantity, values, sigmas in _quantities(members):
            n, scatter = len(values), _spread(values)
            low, high = (
                scatter * np.sqrt((n - 1) / chdtri(n - 1, [TAIL, 1 - TAIL]))
                if n > 1
                else (np.nan, np.nan)
            )
            other, own_sigmas = own.get(quantity, (None, None))
            same = other is not None and _alike(values, other, scatter)
            row = Scatter(
                method=method,
                window=window,
                label=label,
                seconds=seconds,
                quantity=quantity,
                count=n,
                scatter=scatter,
                low=float(low),
                high=float(high),
                sigma=_rms(sigmas),
                changing=_rms(own_sigmas) if same else None,
                ratio=ratio_of(values, own_sigmas if same and own_sigmas is not None else sigmas),
                remark="",
            )
            hidden = other is not None and not same
            hidden |= any(ALIKE_DOUBT in e.flags for e in members)
            moves = label in moving or (label in tilting and quantity in LEVEL)
            yield _remarked(row, of_noise_alone(quantity, priors.noise_only), moves, hidden)


def _grouped(
    estimates: Sequence[AttitudeEstimate],
) -> dict[tuple[str, str], list[AttitudeEstimate]]:
    groups: dict[tuple[str, str], list[AttitudeEstimate]] = {}
    for e in estimates:
        groups.setdefault((e.label, e.window), []).append(e)
    return groups


def _rms(sigmas: Array | None) -> float | None:
    return None if sigmas is None else float(np.sqrt(np.mean(sigmas**2)))


def ratio_of(values: Array, sigmas: Array | None) -> float | None:
    """Chi-square of values (n,) with sigmas (n,) about their weighed mean, per degree of freedom.

    Sigmas that differ by chance are one: a small one would count for more than it knows.
    """
    if sigmas is None or len(values) < 2 or not np.all(sigmas > 0):
        return None
    if not np.all(np.isfinite(values)):
        return None
    calm = sigmas <= DISTURBED * np.median(sigmas)
    weights = 1 / np.where(calm, np.mean(sigmas[calm] ** 2), sigmas**2)
    middle = np.angle(np.sum(weights * np.exp(1j * values)))
    off = np.angle(np.exp(1j * (values - middle)))
    return float(np.sum(weights * off**2) / (len(values) - 1))


def _alike(values: Array, others: Array, scatter: float) -> bool:
    """Whether estimates (n,) with and without constant errors are the same answer."""
    if len(values) != len(others):
        return False
    off = np.angle(np.exp(1j * (values - others)))
    return float(np.sqrt(np.mean(off**2))) <= ALIKE * scatter


def _remarked(row: Scatter, noise_only: bool, moves: bool, hidden: bool) -> Scatter:
    """The row with what must be known beside it; a sigma that says nothing is taken away.

    `hidden`: whether nobody knows how much of the sigma is common to all windows.
    """
    remarks = [NOISE_ONLY] if noise_only else []
    remarks += [BASE_MOVES] if moves else []
    sigma = row.sigma
    if sigma is not None and sigma > LIMITS.get(row.quantity, np.inf):
        remarks.append(f"not determined: sigma {sigma / DEG:.0f} deg")
        return replace(row, sigma=None, changing=None, ratio=None, remark="; ".join(remarks))
    if sigma is not None and row.changing is not None and row.changing**2 < MOST * sigma**2:
        remarks.append(COMMON)
    if row.ratio is None:
        return replace(row, remark="; ".join(remarks))
    chi2, bounds = row.ratio * (row.count - 1), chdtri(row.count - 1, [TAIL, 1 - TAIL])
    if hidden and not chi2 > bounds[0]:
        remarks.append(HIDDEN)
    elif not moves:
        remarks += [BEYOND] if chi2 > bounds[0] else []
        below = CAREFUL if noise_only else BELOW
        remarks += [below] if chi2 < bounds[1] else []
    return replace(row, remark="; ".join(remarks))


def _quantities(
    members: Sequence[AttitudeEstimate],
) -> Iterator[tuple[str, Array, Array | None]]:
    """Values and stated sigmas (n,) of what all of the estimates tell."""
    if not members:
        return
    if all(e.angles is not None and not e.singular for e in members):
        angles = np.array([e.angles for e in members])
        own = [e.sigmas for e in members]
        sigmas = None if any(s is None for s in own) else np.array(own)
        yaw = "yaw" if any(e.heading is None for e in members) else "heading"
        for k, quantity in ((1, yaw), (0, "roll"), (2, "pitch")):
            yield quantity, angles[:, k], None if sigmas is None else sigmas[:, k]
    latitudes = [e.latitude for e in members]
    if all(value is not None for value in latitudes):
        own = [e.latitude_sigma for e in members]
        sigmas = None if any(s is None for s in own) else np.array(own, dtype=float)
        yield "latitude", np.array(latitudes, dtype=float), sigmas


def _spread(angles: Array) -> float:
    """Standard deviation (n - 1) of angles about their own mean, on the circle; NaN of one."""
    if len(angles) < 2:
        return float("nan")
    middle = np.angle(np.mean(np.exp(1j * angles)))
    off = np.angle(np.exp(1j * (angles - middle)))
    return float(off.std(ddof=1))


def scatter_to_json(row: Scatter) -> dict[str, Any]:
    """One row for machines, in degrees; null where there is no number."""
    scatter, low, high = (
        x / DEG if np.isfinite(x) else None for x in (row.scatter, row.low, row.high)
    )
    return {
        "method": row.method,
        "window": row.window,
        "label": row.label,
        "seconds": row.seconds,
        "quantity": row.quantity,
        "windows": row.count,
        "scatter_deg": scatter,
        "scatter_low_deg": low,
        "scatter_high_deg": high,
        "sigma_deg": None if row.sigma is None else row.sigma / DEG,
        "sigma_changing_deg": None if row.changing is None else row.changing / DEG,
        "variance_over_stated": row.ratio,
        "noise_only": row.noise_only,
        "remark": row.remark,
    }
