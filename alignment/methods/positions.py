"""Gyrocompassing in several positions: what turns with the instrument is not the Earth.

Constant biases stay in b while the table turns b, so several positions tell them from Earth rate
and gravity. Readings of all positions are fitted at once by least squares; what no turn can show
stays at its prior. Source: [S4] double gyrocompassing, methods.md section 2; rebuilt as a
maximum a posteriori fit.
"""

from collections.abc import Callable, Iterator
from collections.abc import Sequence as Ordered
from dataclasses import replace
from itertools import pairwise
from typing import Any, ParamSpec, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.constant_errors import constant_columns, with_products
from alignment.cross import cross_matrix
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site, normal_gravity
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate
from alignment.information.circle import chord, curvature
from alignment.information.drift import Span, switched_on
from alignment.methods.position_fit import (
    ROUNDING,
    PositionFit,
    drift_covariance,
    equal_spans,
    fit_positions,
    local_vectors,
    pooled_variances,
    predicted_covariance,
    rounding_covariance,
    steady_drift,
)
from alignment.noise import check_at_rest, gap_doubt, mean_and_unstated
from alignment.options import Options, Priors
from alignment.parts import mean
from alignment.readings import Dwell
from alignment.rocked import rocked_covariance, rocked_doubt
from alignment.rounding import blur_of, rounding_variance, shared_rounding, steps_of
from alignment.saturation import CHANNELS, saturation_doubt
from alignment.units import DEG

TWO_POSITION = "two-position"
MULTI_POSITION = "multi-position"

ANOMALY = 5e-4  # m/s^2: of gravity about its WGS 84 value, where nobody measured it

Answer = list[AttitudeEstimate] | AlignmentError
Summaries = Ordered[tuple[Array, Array]]  # means (6,) of each position, and their variances
_Set = tuple[Ordered[Dwell], Summaries]
P = ParamSpec("P")
T = TypeVar("T")

OVERLAP = 1.5  # samples by which dwells may share readings: stamps of either end are rounded
LEAST_TURN = np.radians(30.0)  # below it biases hardly change sides
AMBIGUOUS = 12.0  # margin of chi-square: odds of 400 to 1


# --- the estimators ------------------------------------------------------------------------------


def two_position(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude of each dwell that is followed by one turned by 30 deg or more: biases cancel.

    Parameters
    ----------
    dwells : sequence of Dwell
        At rest, with the nominal attitudes the table was told; 180 deg about the vertical is best.
    site : Site
        With the latitude the vertical gyro's bias is found too; without it latitude is estimated.
    options : Options
        `rule`; `priors`: `turn` is the placement of each position, `seat` that of the instrument
        on the table, instabilities the drift between positions; biases not stated are free.

    Returns
    -------
    list of AttitudeEstimate
        ``C_nb`` of the first dwell of each pair as it was, placement included.

    Raises
    ------
    AlignmentError
        No nominal attitudes, dwells that overlap, or no two successive ones 30 deg apart.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: placement ``(d180 - d0)/2`` in heading; white noise
    ``ARW/(W cos lat sqrt(T))`` with T the time of both dwells; drift of the biases between them;
    what the unit's axes are off, for it does not turn sides: accelerometers misaligned by m tilt
    the answer by m, gyros turn its heading by m about the vertical. Where the positions contradict
    one another (chi-square once in a thousand) all sigmas grow by `PositionFit.growth`, and by
    how far each position is seen off the level that the fit gives it.
    """
    return _alone(two_position_of_runs([dwells], [site], options))


def two_position_of_runs(
    runs: Ordered[Ordered[Dwell]], sites: Ordered[Site], options: Options
) -> list[Answer]:
    """As `two_position`, of many runs, to the bit, and what each is refused by.

    Their pairs are fitted at once; sites differ in their gravity alone.
    """
    every = [_or_refusal(_pairs, dwells, options.priors) for dwells in runs]
    answers = _estimates(TWO_POSITION, every, sites, options)
    return [
        found if isinstance(found, AlignmentError) else [one[0] for one in found]
        for found in answers
    ]


def _pairs(dwells: Ordered[Dwell], priors: Priors) -> list[_Set]:
    dwells = _in_time(dwells)
    summaries = _summaries(dwells, priors)
    pairs = [slice(k, k + 2) for k in range(len(dwells) - 1)]
    pairs = [own for own in pairs if _widest_turn(dwells[own]) >= LEAST_TURN]
    if not pairs:
        raise AlignmentError("too little turn: no two successive dwells are 30 deg or more apart")
    return [(dwells[own], summaries[own]) for own in pairs]


def multi_position(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude of every dwell, from all of them together: biases are estimated beside it.

    Parameters
    ----------
    dwells : sequence of Dwell
        Two or more, at rest, with the nominal attitudes the table was told.
    site : Site
        With the latitude the vertical gyro's bias is found too; without it latitude is estimated.
    options : Options
        `rule`; `priors`: `turn` is the placement of each position, `seat` that of the instrument
        on the table, instabilities the drift between positions; biases not stated are free.

    Raises
    ------
    AlignmentError
        Fewer than two dwells, no nominal attitudes, dwells that overlap, or no two of them 30 deg
        apart.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: placements (in each attitude its own, less what the others tell of it); white
    noise ``ARW/(W cos lat sqrt(T))``, T the time of all dwells; drift of the biases. With three
    positions or more the placements themselves show, as far as Earth rate and scale are known:
    leave `gyro_scale` at 0 only where it is. Axes off, scale errors and g-sensitivity are matrices
    that many positions tell from biases; what they do not tell stays in the sigmas. Where the
    positions contradict one another (chi-square once in a thousand) all sigmas grow by
    `PositionFit.growth`, and by how far each position is seen off the level that the fit gives it.
    """
    return _alone(multi_position_of_runs([dwells], [site], options))


def multi_position_of_runs(
    runs: Ordered[Ordered[Dwell]], sites: Ordered[Site], options: Options
) -> list[Answer]:
    """As `multi_position`, of many runs; see `two_position_of_runs`."""
    every = [_or_refusal(_whole, dwells, options.priors) for dwells in runs]
    answers = _estimates(MULTI_POSITION, every, sites, options)
    return [found if isinstance(found, AlignmentError) else found[0] for found in answers]


def _whole(dwells: Ordered[Dwell], priors: Priors) -> list[_Set]:
    if len(dwells) < 2:
        raise AlignmentError(f"too little turn: {len(dwells)} dwells, at least 2 are needed")
    dwells = _in_time(dwells)
    summaries = _summaries(dwells, priors)
    if _widest_turn(dwells) < LEAST_TURN:
        raise AlignmentError("too little turn: no two dwells are 30 deg or more apart")
    return [(dwells, summaries)]


def _or_refusal(function: Callable[P, T], *args: P.args, **options: P.kwargs) -> T | AlignmentError:
    """What a function gives, or is refused by."""
    try:
        return function(*args, **options)
    except AlignmentError as error:
        return error


def _alone(answers: list[Answer]) -> list[AttitudeEstimate]:
    """That of one run."""
    (found,) = answers
    if isinstance(found, AlignmentError):
        raise found
    return found


def _in_time(dwells: Ordered[Dwell]) -> list[Dwell]:
    """Successive is meant in time: the order in which dwells are handed over does not matter.

    The noise of dwells that share readings is not independent: `AlignmentError`.
    """
    found = sorted(dwells, key=lambda dwell: dwell.t_from)
    for one, next_ in pairwise(found):
        if next_.t_from < one.t_to - OVERLAP * one.readings.interval:
            raise AlignmentError(
                f"{one.label} and {next_.label} overlap: {next_.label} begins at "
                f"{next_.t_from:g} s, {one.label} ends at {one.t_to:g} s"
            )
    return found


def _summaries(dwells: Ordered[Dwell], priors: Priors) -> list[tuple[Array, Array]]:
    """Means (6,) and their variances (6,) but for stated drifts, which are told beside them.

    One noise is pooled of all positions: what a long one drifts by would count for short ones too.
    """
    for dwell in dwells:
        check_at_rest(dwell)
        _nominal_of(dwell)
    stated = [np.repeat(steady_drift(priors, span), 3) for span in _times_of(dwells)]
    told = zip(dwells, stated, strict=True)
    return [mean_and_unstated(dwell.window(), own) for dwell, own in told]


def _rounding(
    dwells: Ordered[Dwell], means: Array, drift: Array, site: Site, priors: Priors
) -> Array:
    """Covariance (6, n, n) of the means by the rounding of the samples, `drift` (6, n, n) apart."""
    windows = [dwell.window() for dwell in dwells]
    steps = [steps_of(readings) for readings in windows]
    told = list(zip(windows, steps, strict=True))
    step = np.max(steps, axis=0)
    if not step.any() or not priors.nominal > 0 or site.latitude is None:
        left = [rounding_variance(readings, own) for readings, own in told]
        return rounding_covariance(np.array(left), means, step)
    noises = np.array([blur_of(readings, own) for readings, own in told])
    felt, doubts = _told_apart(dwells, drift, site, priors)
    found = np.zeros_like(drift)
    for k in np.flatnonzero(step):
        apart = felt[:, None, k] - felt[:, k]
        found[k] = shared_rounding(float(step[k]), noises[:, k], apart, doubts[k])
    return found


def _told_apart(
    dwells: Ordered[Dwell], drift: Array, site: Site, priors: Priors
) -> tuple[Array, Array]:
    """Readings (n, 6) at the told attitudes, and variances (6, n, n) of how any two differ.

    By where the base stands, the seat and the unit's constants but its biases, which are common to
    them; by each one's placement, and drift. Heading is sought: of the horizontal Earth rate no
    more is told than its size, half its square to north and half to east, or what rounding hides
    would lie along the told heading, and the fit would find that.
    """
    p = priors
    C_bn = [_nominal_of(dwell).inv().as_matrix() for dwell in dwells]
    down = np.array([0.0, 0.0, 1.0])
    vertical = down * (down @ site.w_ie_n)
    round_ = np.linalg.norm(site.w_ie_n - vertical) / np.sqrt(2) * np.eye(3)[:, :2]
    base = np.diag([p.nominal, p.nominal, p.azimuth])
    felt = np.array([np.concatenate([C @ vertical, C @ site.f_n]) for C in C_bn])
    turned = np.concatenate([cross_matrix(felt[:, :3]), cross_matrix(felt[:, 3:])], axis=1)
    leaned = [
        np.concatenate([C @ cross_matrix(v) @ base for v in (vertical, site.f_n)]) for C in C_bn
    ]
    headed = [np.concatenate([C @ round_, np.zeros((3, 2))]) for C in C_bn]
    shared = np.concatenate(
        [
            np.array(leaned),
            np.array(headed),
            p.seat * turned,
            constant_columns(felt[:, :3], felt[:, 3:], p),
        ],
        axis=2,
    )
    placed = p.turn**2 * np.sum(turned**2, axis=2).T
    doubts = np.sum((shared[:, None] - shared) ** 2, axis=3).transpose(2, 0, 1)
    doubts = doubts + placed[:, :, None] + placed[:, None]
    own = np.einsum("kii->ki", drift)
    doubts = doubts + own[:, :, None] + own[:, None] - 2 * drift
    same = np.arange(len(dwells))
    doubts[:, same, same] = 0.0
    return felt, doubts


def _nominal_of(dwell: Dwell) -> Rotation:
    if dwell.nominal is None:
        raise AlignmentError(
            f"{dwell.label}: its attitude is not known: give its attitude_deg or a schedule"
        )
    return dwell.nominal


def _widest_turn(dwells: Ordered[Dwell]) -> float:
    """Largest turn [rad] between any two nominal attitudes."""
    quats = np.array([_nominal_of(dwell).as_quat() for dwell in dwells])
    return float(2 * np.arccos(np.clip(np.abs(quats @ quats.T).min(), 0, 1)))


def _estimates(
    method: str,
    every: Ordered[list[_Set] | AlignmentError],
    sites: Ordered[Site],
    options: Options,
) -> list[list[list[AttitudeEstimate]] | AlignmentError]:
    """Of each run's sets, all of as many positions and fitted at once: they share latitude and
    priors. A run that is refused stays so."""
    asked = {k: sets for k, sets in enumerate(every) if not isinstance(sets, AlignmentError)}
    answers: list[Any] = list(every)
    if not asked:
        return answers
    options = replace(options, priors=switched_on(with_products(options.priors)))
    told = [(*own, sites[k]) for k, sets in asked.items() for own in sets]
    fits = _fitted(told, options.priors)
    for k, sets in asked.items():
        own = [(dwells, *next(fits)) for dwells, _ in sets]
        answers[k] = _or_refusal(_answers_of, method, own, sites[k], options)
    return answers


def _fitted(
    every: Ordered[tuple[Ordered[Dwell], Summaries, Site]], priors: Priors
) -> Iterator[tuple[PositionFit, tuple[Array, Array]]]:
    """The fit of each set with variances of its means, and turns."""
    given = [local_vectors(site) for _, _, site in every]
    latitude, site = given[0][0], every[0][2]
    if latitude is not None:
        site.horizontal_rate()  # refuses at a pole
    gravity = None if given[0][1] is None else np.array([own for _, own in given])
    anomaly = ANOMALY if site.local_gravity is None else 0.0
    told = [_told_of(*own, priors) for own in every]
    means, variances, relative, drift = (np.array(parts) for parts in zip(*told, strict=True))
    fits = fit_positions(means, variances, relative, latitude, gravity, priors, anomaly, drift)
    yield from zip(fits.each(), zip(variances, relative, strict=True), strict=True)


def _answers_of(
    method: str,
    fitted: Ordered[tuple[Ordered[Dwell], PositionFit, tuple[Array, Array]]],
    site: Site,
    options: Options,
) -> list[list[AttitudeEstimate]]:
    return [_answers(method, dwells, fit, told, site, options) for dwells, fit, told in fitted]


def _told_of(
    dwells: Ordered[Dwell], summaries: Summaries, site: Site, priors: Priors
) -> tuple[Array, Array, Array, Array]:
    """Means, variances (n, 6), turns (n, 3, 3) and drift (6, n, n) of some positions."""
    means, scatter = (np.array(values) for values in zip(*summaries, strict=True))
    spans = np.array([dwell.t_to - dwell.t_from for dwell in dwells])
    first = _nominal_of(dwells[0]).inv()
    relative = np.array([(first * _nominal_of(dwell)).as_matrix() for dwell in dwells])
    drift = np.repeat(drift_covariance(priors, _times_of(dwells)), 3, axis=0)
    drift = drift + _rounding(dwells, means, drift, site, priors) + _leaned(dwells, means)
    return means, pooled_variances(scatter, spans), relative, drift


def _leaned(dwells: Ordered[Dwell], means: Array) -> Array:
    """Covariance (6, n, n) of the means by how a base that rocked leaned away from its turns."""
    found = np.zeros((6, len(dwells), len(dwells)))
    for k, dwell in enumerate(dwells):
        f = means[k, 3:]
        away = np.eye(3) - np.outer(f, f) / (f @ f)
        found[3:, k, k] = f @ f * np.diag(away @ rocked_covariance(dwell.window()) @ away)
    return found


def _times_of(dwells: Ordered[Dwell]) -> list[Span]:
    return [Span(dwell.t_from, dwell.t_to - dwell.t_from) for dwell in dwells]


def _answers(
    method: str,
    dwells: Ordered[Dwell],
    fit: PositionFit,
    told: tuple[Array, Array],
    site: Site,
    options: Options,
) -> list[AttitudeEstimate]:
    """Of every position; `told`: variances of its means, and turns."""
    t_from, t_to = min(d.t_from for d in dwells), max(d.t_to for d in dwells)
    growth = _growth(fit)
    covariances = growth * fit.covariance + _misplaced(dwells, fit) + _rocked(dwells, fit)
    bias_sigmas = _bias_sigmas(fit, growth, site)
    shared = _doubts(fit)
    if options.verdicts:
        given = *local_vectors(site), float(sum(span.length for span in _times_of(dwells)))
        shared += _verdict(fit, *told, given, options.priors)
    return [
        AttitudeEstimate(
            method,
            dwell.label,
            t_from,
            t_to,
            C_nb=site.plumb * Rotation.from_matrix(fit.C_nb[k]),
            sequence=options.rule.sequence_at(_nominal_of(dwell)),
            covariance=site.about_n(covariances[k]),
            latitude=None if fit.latitude is None else float(fit.latitude) - site.deflection[0],
            latitude_sigma=None
            if fit.latitude_sigma is None
            else float(np.sqrt(growth) * fit.latitude_sigma),
            flags=gap_doubt(dwell.window())
            + saturation_doubt(dwell.label, dwell.window())
            + rocked_doubt(dwell.window())
            + heading_doubt(covariances[k])
            + shared,
            biases=fit.biases,
            bias_sigmas=bias_sigmas,
        )
        for k, dwell in enumerate(dwells)
    ]


def _misplaced(dwells: Ordered[Dwell], fit: PositionFit) -> Array:
    """What positions that contradict one another add to each one's covariance (n, 3, 3).

    Birge's ratio makes all variances grow alike, but what was not told is mostly one of them: a
    turn that ends elsewhere. How far the accelerometers see each position off the level that the
    fit gives it (about n, bias apart) is what its attitude may be wrong by, and about down, where
    they see nothing, as much as about a level axis in the mean of all positions.
    """
    n = len(dwells)
    if not fit.contradicted:
        return np.zeros((n, 3, 3))
    felt = np.array([mean(dwell.window().f_b) for dwell in dwells]) - fit.biases[3:]
    up = np.einsum("kij,kj->ki", fit.C_nb, felt)
    off = np.cross(up / np.linalg.norm(up, axis=1)[:, None], [0.0, 0.0, -1.0])
    usual = float(np.mean(off[:, :2] ** 2))
    return off[:, :, None] * off[:, None] + usual * np.eye(3)


def _rocked(dwells: Ordered[Dwell], fit: PositionFit) -> Array:
    """What turns about a base that rocked add to each position's covariance (3, 3), about n.

    The fit takes its turns for true, so what one position was off by is in all: the mean of them.
    """
    shown = np.array([rocked_covariance(dwell.window()) for dwell in dwells])
    return np.asarray(np.mean(fit.C_nb @ shown @ np.swapaxes(fit.C_nb, 1, 2), axis=0))


def _bias_sigmas(fit: PositionFit, growth: float, site: Site) -> Array:
    """Standard deviations (6,) of the biases, with heading on its circle.

    A heading off by h leaves ``sin h`` of the horizontal Earth rate in the readings across it and
    ``1 - cos h`` along it, and a bias has the mean of that over the positions: never more than
    twice that rate, however large first order finds h, of which the covariance has h and 0.
    """
    own, heading = fit.bias_covariance.diagonal(), fit.covariance[0, 2, 2]
    latitude = fit.latitude if site.latitude is None else site.latitude
    assert latitude is not None
    across = fit.cross[0, 2] / heading
    along = np.zeros(6)
    along[:3] = EARTH_RATE * np.cos(latitude) * np.mean(fit.C_nb[:, 0], axis=0)
    off = float(np.sqrt(growth * heading))
    straight = growth * np.maximum(own - across**2 * heading, 0.0)
    return np.sqrt(straight + across**2 * chord(off) + along**2 * curvature(off))


def _growth(fit: PositionFit) -> float:
    """Factor of all covariances; a refusal where a contradiction leaves too little to tell it."""
    growth = float(fit.growth)
    if not np.isfinite(growth):
        raise AlignmentError(
            f"positions contradict one another: chi-square {float(fit.chi2):.0f} for "
            f"{float(fit.freedom):.0f} degrees of freedom, too few to tell how large the errors "
            "are: another position, the latitude or priors of the biases would do"
        )
    return growth


def _doubts(fit: PositionFit) -> tuple[str, ...]:
    hidden = [name for name, unseen in zip(CHANNELS, fit.unseen, strict=True) if unseen]
    flags = (f"biases not shown by these turns: {', '.join(hidden)}",) if hidden else ()
    if fit.margin < AMBIGUOUS:
        flags += (
            "ambiguous: another attitude fits nearly as well (chi-square "
            f"{float(fit.margin):.1f} more), and the sigmas reach over to it; "
            "a turn about a second axis would tell",
        )
    if fit.contradicted:
        flags += (
            f"positions contradict one another: chi-square {float(fit.chi2):.0f} for "
            f"{float(fit.freedom):.0f} degrees of freedom (errors that nobody stated, or other "
            f"turns than told): sigmas are {float(np.sqrt(fit.growth)):.3g} times as large for it",
        )
    return flags


def _verdict(
    fit: PositionFit,
    variances: Array,
    relative: Array,
    given: tuple[float | None, float | None, float],
    priors: Priors,
) -> tuple[str, ...]:
    """Whether the turns paid, and of two positions 90 against 180 deg.

    `given`: latitude, gravity, and the time [s] of all positions. Empty without a bias to weigh
    the turns against, and where the positions contradict what the priors say.
    """
    if not priors.gyro_bias or fit.contradicted:
        return ()
    latitude = float(fit.latitude) if fit.latitude is not None else given[0]
    assert latitude is not None
    gravity = given[1] or normal_gravity(latitude)
    # the noise of the mean of all positions: what one alone would have in all the time
    whole = 1 / np.sum(1 / (variances + ROUNDING**2), axis=0)

    def heading(turns: Array) -> float:
        n = len(turns)
        drift = drift_covariance(priors, equal_spans(n, given[2]))
        shared, unknown = np.tile(n * whole, (n, 1)), given[0] is None
        P = predicted_covariance(
            fit.C_nb[0], shared, turns, latitude, gravity, priors, unknown, drift
        )
        return float(np.sqrt(P[0, 2, 2]))

    one, several = heading(relative[:1]), float(np.sqrt(fit.covariance[0, 2, 2]))
    if len(relative) > 2:
        return (pays(several, one),)
    axis = Rotation.from_matrix(relative[1]).as_rotvec()
    axis = axis / np.linalg.norm(axis)
    half, quarter = (heading(_turns(axis, angle)) for angle in (np.pi, np.pi / 2))
    return (f"{pays(several, one)}; 180 deg: {_degrees(half)}, 90 deg: {_degrees(quarter)}",)


def _turns(axis_b: Array, angle: float) -> Array:
    """Relative attitudes (2, 3, 3) of a position and of one turned [rad] about an axis."""
    return Rotation.from_rotvec(np.outer([0.0, angle], axis_b)).as_matrix()


def _degrees(angle: float) -> str:
    return f"{angle / DEG:.3g} deg"


def pays(several: float, one: float) -> str:
    """In words; sigmas of heading [rad] with and without turns."""
    verdict = "pay" if several < one else "do not pay"
    return (
        f"turns {verdict}: heading sigma {_degrees(several)} "
        f"against {_degrees(one)} of one position in the same time"
    )


# --- does a turn pay? ----------------------------------------------------------------------------


def half_turn_means(first: Array, second: Array, axis: int = 1) -> Array:
    """Means (..., 6) in axes of the first position, from it and one turned by 180 deg about `axis`.

    [S4]: half differences across the axis, which are free of constant biases, and half sums along
    it, which are not: the axis's own bias stays, and tilts it into heading.
    """
    signs = np.full(3, -1.0)
    signs[axis] = 1.0
    return (first + np.tile(signs, 2) * second) / 2


# --- how long noise takes ------------------------------------------------------------------------
