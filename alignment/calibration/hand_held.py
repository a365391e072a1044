"""Calibration without a table: a unit turned by hand from rest to rest.

Accelerometers by gravity's norm at rests, gyros by how they turn one rest's vertical into the next
one's. Source: D. Tedaldi, A. Pretto, E. Menegatti, A robust and easy to implement method for IMU
calibration without external equipments (ICRA 2014), as imu_tk has it. Here beyond it: everything in
one fit with each rest's own covariance, Earth rate, the gyros' g-sensitivity, gravity's own sigma,
a data sheet's priors, and a full covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations, product

import numpy as np
from scipy.special import chdtrc

from alignment.arrays import Array
from alignment.calibration.hand_held_fit import (
    GROUPS,
    Fit,
    Problem,
    State,
    by_item,
    fitted,
    mean_ratio,
    median_ratio,
    places,
    rows_of,
    start,
    turned_by,
)
from alignment.calibration.moves import moves_of
from alignment.calibration.orientations import NAMES, additions, in_words, norm_rows, rank_of
from alignment.calibration.rest_means import RestMeans, drift_variances, rest_means
from alignment.calibration.result import (
    Calibration,
    Contribution,
    Gravity,
    LeftOut,
    Nuisance,
    Residual,
    derived_of,
    nuisance_of,
    parameters_of,
)
from alignment.calibration.unknowns import Unknowns, unknowns_of
from alignment.earth import EARTH_RATE, Site, normal_gravity
from alignment.errors import AlignmentError, TooShort
from alignment.noise import GAP
from alignment.options import Priors
from alignment.readings import ImuReadings
from alignment.rests import find_stretches
from alignment.rounding import steps_of
from alignment.saturation import CHANNELS, clipped
from alignment.units import STANDARD_GRAVITY

SHORTEST = 1.0  # s, of a rest
FEWEST = 9  # rests: nine unknowns of the accelerometers, one number a rest
FAR = 1e-6  # probability of so large a residual by chance, below which an item is left out
MOST_LEFT_OUT = 0.2  # of all rests
WRONG_UNIT = 0.5  # relative, that the norm at rest may be off gravity
ASTRAY = 0.35  # rad rms, by which gyros miss the next vertical: no scale factor of a unit does
EXPLAINED = 0.3  # of that miss, which other axes must leave to be believed
LEAST_TURNING = 0.02  # of the largest singular value: turning about two axes alone
HIGHEST_CONDITION = 50.0
MOST_ENLARGED = 100.0  # of sigmas, by what rests and moves differ beyond their noise
ODD_GRAVITY = 0.01  # m/s^2 from normal gravity: anomalies and 3 km of height come to less


@dataclass(frozen=True, slots=True)
class HandHeld:
    """Choices.

    `shortest` [s] of a rest. `as_published`: the published method to the letter: no weights, the
    gyros' bias from the first rest, no g-sensitivity, no Earth rate, nothing left out.
    """

    shortest: float = SHORTEST
    as_published: bool = False


def hand_held(
    readings: ImuReadings,
    gravity: Gravity,
    site: Site | None = None,
    priors: Priors | None = None,
    choices: HandHeld | None = None,
) -> Calibration:
    """A unit's constant errors from a log in which it was turned by hand, and rested between.

    Parameters
    ----------
    readings : ImuReadings
        In SI; begins and ends anyhow. Nine rests or more, in attitudes that differ much.
    gravity : Gravity
        See `gravity_of`.
    site : Site, optional
        For the Earth's rate; without a latitude its vertical part is not known either.
    priors : Priors, optional
        Of the unit's data sheet; without it nothing is known before.
    choices : HandHeld, optional

    Returns
    -------
    Calibration
        b is the frame in which the accelerometers' triad is not turned; how it lies in the case
        only a data sheet says.

    Raises
    ------
    TooShort
        Too few rests.
    AlignmentError
        Rests or turns that do not tell all (with what to add), wrong units, mirrored axes, gyros
        that contradict the accelerometers.

    Notes
    -----
    Leading errors: gravity's sigma is the scale factors'; what accelerometers do beyond scale and
    axes (K2, asymmetry) shows as a chi-square beyond noise, and enlarges all sigmas of theirs.
    """
    choices, site = choices or HandHeld(), site or Site(None)
    found = find_stretches(readings, choices.shortest)
    rests = [(one.t_from, one.t_to) for one in found if one.kind == "rest"]
    _check_rests(readings, rests)
    _check_unit(rest_means(readings, rests), gravity)
    told = _accelerometers_tell(readings, rests, priors) + _odd_gravity(gravity, site)
    unknowns = unknowns_of(priors, not choices.as_published)
    log = _Log(readings, rests, unknowns, gravity, site=site, priors=priors, choices=choices)
    left = _without_clipped(log)
    problem = log.problem(left)
    _check_axes(problem, left)
    _gyros_tell(problem, start(problem), priors)  # before the fit, which could not settle
    left = left if choices.as_published else _without_wild(log, left)
    problem = log.problem(left)
    fit = fitted(problem, mean_ratio)
    _check_contradiction(fit)
    turning = _gyros_tell(problem, fit.state, priors)
    return _calibration(log, problem, fit, left, (*told, *turning), priors)


# --- what is there -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Left:
    """What is left out: rests by number, moves by the numbers of the rests before and after."""

    rests: frozenset[int] = frozenset()
    moves: frozenset[tuple[int, int]] = frozenset()
    reasons: tuple[LeftOut, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Log:
    """A log with its rests, and all that a problem is made of."""

    readings: ImuReadings
    rests: list[tuple[float, float]]
    unknowns: Unknowns
    gravity: Gravity
    site: Site
    priors: Priors | None
    choices: HandHeld

    def drift(self, rests: Sequence[tuple[float, float]]) -> Array:
        """Of gyros and accelerometers (2,): variances of biases, alike in all rests and apart."""
        p = self.priors or Priors()
        plateaus = p.gyro_instability, p.accel_instability
        return np.array([drift_variances(rests, one) for one in plateaus])

    def rounding(self, means: RestMeans) -> float:
        """Variance of a gyro's bias by what rounding leaves of all of its means alike.

        Where moves tell the bias, it has of that the part of a move in which the gyro reads what it
        reads at rest: of the stillest one. And no rounding is by more than what is rounded.
        """
        p = self.priors
        known = np.inf if p is None or not p.gyro_bias else p.gyro_bias
        felt = known, EARTH_RATE, 0.0 if p is None else p.gyro_g_sensitivity * self.gravity.value
        return min(means.rounding, float(np.dot(felt, felt))) * self._still(means) ** 2

    def _still(self, means: RestMeans) -> float:
        """Part of the time between rests in which the stillest gyro reads, to a step, what it reads
        at rest."""
        r, first, last = self.readings, self.rests[0][1], self.rests[-1][0]
        between = (r.t > first) & (r.t <= last)
        for a, b in self.rests:
            between &= (r.t <= a) | (r.t > b)
        off = np.abs(r.w_ib_b[between] - means.gyro.mean(axis=0))
        return float(np.mean(off <= steps_of(r)[:3], axis=0).max()) if len(off) else 1.0

    def problem(self, left: _Left | None = None) -> Problem:
        """The problem without what is left out."""
        left = left or _Left()
        kept = [n for n in range(len(self.rests)) if n not in left.rests]
        rests = [self.rests[n] for n in kept]
        gaps = _gaps(self.readings, rests)
        out = {k for k, pair in enumerate(pairwise(kept)) if pair in left.moves}
        moves = moves_of(self.readings, rests, out | gaps)
        joined = np.zeros(len(rests), bool)
        joined[moves.rests[:, 1]] = True
        means, apart = rest_means(self.readings, rests), self.drift(rests)[:, 1]
        return Problem(
            unknowns=self.unknowns,
            rests=_evenly(means) if self.choices.as_published else means,
            moves=moves,
            gravity=self.gravity,
            chain=np.cumsum(~joined) - 1,
            latitude=self.site.latitude,
            drift=(float(apart[0]), float(apart[1])),
            first_bias=self.choices.as_published,
        )

    def named(self, rest: int) -> str:
        """A rest as a person finds it."""
        a, b = self.rests[rest]
        return f"rest {rest + 1} ({a:.1f} to {b:.1f} s)"


def _evenly(means: RestMeans) -> RestMeans:
    """All rests alike, as published; the first one's rate is the gyros' bias."""
    gyro = means.gyro_variance.copy()
    gyro[0] = 1e-20
    accel = np.full_like(means.accel_variance, means.accel_variance.mean())
    return replace(means, gyro_variance=gyro, accel_variance=accel)


def _gaps(readings: ImuReadings, rests: Sequence[tuple[float, float]]) -> set[int]:
    """Moves with a gap in them, by the number of the rest before."""
    steps = np.diff(readings.t)
    wide = readings.t[1:][steps > GAP * np.median(steps)]
    # a rest that a gap begins starts a step before its first stamp
    late = 2 * readings.interval
    pairs = enumerate(pairwise(rests))
    return {k for k, (a, b) in pairs if ((wide > a[1]) & (wide <= b[0] + late)).any()}


def _check_rests(readings: ImuReadings, rests: Sequence[tuple[float, float]]) -> None:
    if len(rests) < FEWEST:
        span = readings.interval * len(readings)
        few = {0: "no rest", 1: "one rest"}.get(len(rests), f"{len(rests)} rests")
        raise TooShort(
            f"{few} in {span:.0f} s: at least {FEWEST} are needed, {SHORTEST:g} s and longer, in "
            "attitudes that differ: each face up, and each edge"
        )


def _check_unit(means: RestMeans, gravity: Gravity) -> None:
    """Whether what rests read can be gravity at all."""
    norm = float(np.median(np.linalg.norm(means.accel, axis=1)))
    if abs(norm / gravity.value - 1) > WRONG_UNIT:
        hints = [name for name, size in _UNITS if abs(norm * size / gravity.value - 1) < WRONG_UNIT]
        hint = f": their unit seems to be {hints[0]}" if hints else ""
        raise AlignmentError(
            f"accelerometers read {norm:.4g} m/s^2 at rest, must be near {gravity.value:.4g}{hint}"
        )


# what accelerometers may be in whose unit was taken for m/s^2, or for g where they are in that
_UNITS = (
    ("g", STANDARD_GRAVITY),
    ("mg", 1e-3 * STANDARD_GRAVITY),
    ("m/s^2, not g", 1 / STANDARD_GRAVITY),
)


def _accelerometers_tell(
    readings: ImuReadings, rests: Sequence[tuple[float, float]], priors: Priors | None
) -> tuple[str, ...]:
    """Rank and condition by the norm, before any number; what is not told, where a sheet is there.

    Raises
    ------
    AlignmentError
        The attitudes do not tell all, and nothing else says it.
    """
    f = rest_means(readings, rests).accel
    up = f / np.linalg.norm(f, axis=1)[:, None]
    rank, condition, lost = rank_of(norm_rows(up))
    words = in_words(lost, NAMES)
    if words and priors is None:
        raise AlignmentError(
            f"{len(rests)} rests, rank {rank} of {len(NAMES)} by gravity's norm: "
            f"{'; '.join(words)}: add rests with {', '.join(additions(up))}"
        )
    if words:
        return (f"accelerometers by gravity's norm: rank {rank} of {len(NAMES)}", *words)
    text = f"{len(rests)} rests: rank {rank} of {len(NAMES)}, condition {condition:.2g}"
    if condition > HIGHEST_CONDITION:
        text += f" (poor: {', '.join(additions(up)) or 'edges'} up would better it)"
    return (f"accelerometers by gravity's norm: {text}",)


def _odd_gravity(gravity: Gravity, site: Site) -> tuple[str, ...]:
    """What is odd of a measured gravity, where the site is known."""
    if site.latitude is None:
        return ()
    off = gravity.value - normal_gravity(site.latitude, site.height)
    if abs(off) <= ODD_GRAVITY + 3 * gravity.sigma:
        return ()
    return (f"gravity {gravity.value:g} m/s^2 is {off:+.3g} off normal gravity of the site",)


def _check_axes(problem: Problem, out: _Left) -> None:
    """`AlignmentError` where the gyros turn otherwise than the accelerometers' vertical does."""
    if not len(problem.moves.spans):
        why = "".join(f"; {one.stretch}: {one.reason}" for one in out.reasons[:1])
        raise AlignmentError(f"no move between rests that is whole: nothing tells the gyros{why}")
    whole = _miss(problem)
    if whole < ASTRAY:
        return
    found = f"gyros miss the accelerometers' vertical by {np.degrees(whole):.0f} deg after a move"
    for name, size in (("deg/s", np.pi / 180), ("mdeg/s", np.pi / 180e3), ("rad/s", 180 / np.pi)):
        if _miss(_seen(problem, size * np.eye(3))) < EXPLAINED * whole:
            raise AlignmentError(f"{found}: they seem to be in {name}")
    best, left = min(((C, _miss(_seen(problem, C))) for C in _axes()), key=lambda pair: pair[1])
    if left > EXPLAINED * whole:
        raise AlignmentError(f"{found}: wrong unit, or axes that are not the accelerometers'")
    if (best == -np.eye(3)).all():
        raise AlignmentError(
            f"{found}: mirrored axes, or rates of the wrong sign; turned the other way they fit"
        )
    raise AlignmentError(f"{found}: their axes should be {_written(best)} of what they are")


def _miss(problem: Problem) -> float:
    """How far gyros miss the verticals after moves [rad], rms."""
    state = start(problem)
    moved = turned_by(problem, state)
    a, b = problem.moves.rests.T
    p = np.einsum("mji,mj->mi", moved.C, state.up[a])
    off = np.linalg.norm(p - state.up[b], axis=1)
    return float(np.sqrt(np.mean(off**2))) if len(off) else 0.0


def _seen(problem: Problem, C: Array) -> Problem:
    """The same with the gyros' readings, less what the first rest shows, taken otherwise."""
    w = (problem.moves.w - problem.rests.gyro[0]) @ C.T
    return replace(problem, moves=replace(problem.moves, w=w))


def _axes() -> list[Array]:
    """All 48 ways in which three axes can be taken for one another."""
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        C = np.zeros((3, 3))
        C[range(3), order] = signs
        found.append(C)
    return found


def _written(C: Array) -> str:
    """What X1, Y1, Z1 should be of x, y, z."""
    return ",".join(
        ("-" if row[np.flatnonzero(row)[0]] < 0 else "") + "xyz"[np.flatnonzero(row)[0]]
        for row in C
    )


# --- what is wild --------------------------------------------------------------------------------


def _without_clipped(log: _Log) -> _Left:
    """Moves in which a sensor stood at full scale: what it felt there is lost."""
    at_scale, t = clipped(log.readings), log.readings.t
    moves, reasons = set(), []
    for k, (one, other) in enumerate(pairwise(log.rests)):
        inside = at_scale[(t > one[1]) & (t <= other[0])]
        if inside.any():
            channel = CHANNELS[int(np.argmax(inside.sum(axis=0)))]
            name = f"move from {log.named(k)} to {log.named(k + 1)}"
            reasons.append(LeftOut(name, f"{channel} at full scale"))
            moves.add((k, k + 1))
    return _Left(frozenset(), frozenset(moves), tuple(reasons))


def _check_contradiction(fit: Fit) -> None:
    """`AlignmentError` where no enlarging of sigmas makes sense."""
    ratio = float(np.sqrt(fit.chi_square / fit.dof)) if fit.dof else 1.0
    if ratio > MOST_ENLARGED:
        extra = "; ".join(_beyond_noise(fit)) or "all of them"
        raise AlignmentError(
            f"rests and moves contradict one another by {ratio:.0f} times their noise: {extra}: "
            "moves too quick for the samples, a sensor at full scale, or rests that were none"
        )


def _without_wild(log: _Log, left: _Left) -> _Left:
    """Rests and moves that the others contradict, one after the other, worst first."""
    before = len(left.reasons)
    while True:
        problem = log.problem(left)
        fit = fitted(problem, median_ratio)
        worst = _worst(fit)
        if worst is None:
            return left
        left = _with(log, problem, left, *worst)
        wild = left.reasons[before:]
        if len(wild) > MOST_LEFT_OUT * len(log.rests):
            raise AlignmentError(
                f"more than {MOST_LEFT_OUT:.0%} of rests and moves contradict the others, first "
                f"{wild[0].stretch}: {wild[0].reason}"
            )


def _worst(fit: Fit) -> tuple[str, int, float] | None:
    """Group, number and size in sigmas of what chance does not explain."""
    found = []
    for group in GROUPS:
        chi_square, worth = by_item(fit, group)
        there = np.flatnonzero(worth > 0.05)
        for n in there:
            size = chi_square[n] / worth[n]
            dof = max(1.0, round(worth[n]))
            if chdtrc(dof, size * dof) < FAR:
                found.append((float(np.sqrt(size)), group, int(n)))
    if not found:
        return None
    size, group, n = max(found)
    return group, n, size


def _with(log: _Log, problem: Problem, left: _Left, group: str, number: int, size: float) -> _Left:
    kept = [n for n in range(len(log.rests)) if n not in left.rests]
    if group == "move":
        a, b = (kept[n] for n in problem.moves.rests[number])
        out = LeftOut(
            f"move from {log.named(a)} to {log.named(b)}",
            f"its gyros miss the next vertical by {size:.1f} sigma",
        )
        return replace(left, moves=left.moves | {(a, b)}, reasons=(*left.reasons, out))
    what = "its norm is off gravity" if group == "accel" else "its rates are off the others'"
    rest = kept[number]
    out = LeftOut(log.named(rest), f"{what} by {size:.1f} sigma: bumped, or not at rest")
    return replace(left, rests=left.rests | {rest}, reasons=(*left.reasons, out))


# --- what comes of it ----------------------------------------------------------------------------


def _gyros_tell(problem: Problem, state: State, priors: Priors | None) -> tuple[str, ...]:
    """Rank and condition of scale and axes by the moves, as the unit is believed to be.

    Raises
    ------
    AlignmentError
        Turns do not tell all, and nothing else says it.
    """
    first = 3  # of the unknowns: biases come first, then scale, rotation, leaning
    rows = rows_of(problem, state)
    J, _ = rows.whitened(state.extra)
    J = J[rows.group == "move", first : first + 9]
    rank, condition, lost = rank_of(J, LEAST_TURNING)
    text = f"gyros by {len(problem.moves.spans)} moves: rank {rank} of 9"
    if rank == 9:
        return (f"{text}, condition {condition:.2g}",)
    words = in_words(lost, _GYRO_NAMES)
    if priors is None:
        raise AlignmentError(
            f"{text}: {'; '.join(words)}: add moves that turn by 90 deg and more about "
            f"{' and '.join(_unturned(problem, state))}"
        )
    return (text, *words)


_GYRO_NAMES = (
    *(f"gyro scale factor {axis}" for axis in ("X1", "Y1", "Z1")),
    *(f"gyro triad's rotation about {axis}" for axis in ("X1", "Y1", "Z1")),
    *(f"gyro non-orthogonality {pair}" for pair in ("Y1-Z1", "Z1-X1", "X1-Y1")),
)


def _unturned(problem: Problem, state: State) -> list[str]:
    """Axes about which moves turn least."""
    moved = turned_by(problem, state)
    turns = np.abs(np.array([_rotation_vector(C) for C in moved.C])).sum(axis=0)
    least = [n for n in range(3) if turns[n] < 0.5 * turns.max()] or [int(np.argmin(turns))]
    return [("X1", "Y1", "Z1")[n] for n in least]


def _rotation_vector(C: Array) -> Array:
    off = np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]])
    size = np.linalg.norm(off)
    angle = np.arctan2(size, np.trace(C) - 1)
    return np.asarray(off / size * angle if size > 0 else off)


def _calibration(
    log: _Log,
    problem: Problem,
    fit: Fit,
    left: _Left,
    told: tuple[str, ...],
    priors: Priors | None,
) -> Calibration:
    unknowns, q = problem.unknowns, len(problem.unknowns.sigmas)
    basis = unknowns.basis
    turned_case = 0.0 if priors is None else priors.accel_misalignment
    case = turned_case**2 * unknowns.rotation @ unknowns.rotation.T
    common = log.drift(log.rests)[:, 0] + np.array([log.rounding(problem.rests), 0.0])
    drift = np.diag(_of_biases(unknowns, common))
    covariance = basis @ fit.covariance[:q, :q] @ basis.T + case + drift
    values = basis @ fit.state.z
    before = np.sqrt(_prior_variances(unknowns) + case.diagonal())
    return Calibration(
        parameters=parameters_of(unknowns.keys, values, covariance, before),
        covariance=covariance,
        chi_square=fit.chi_square,
        dof=fit.dof,
        enlarged=max(1.0, float(np.sqrt(fit.chi_square / fit.dof))) if fit.dof else 1.0,
        gravity=log.gravity,
        nuisance=_nuisance(problem, fit),
        null_space=_cannot(turned_case),
        notes=(*told, *_beyond_noise(fit)),
        left_out=left.reasons,
        derived=derived_of(unknowns.keys, values, covariance),
        residuals=_residuals(log, problem, fit, left),
        budget=_budget(fit, basis, {"rotation of the case": case, "drift of biases": drift}),
    )


def _residuals(log: _Log, problem: Problem, fit: Fit, left: _Left) -> tuple[Residual, ...]:
    """Of rests along the vertical and of rates, of moves across it, in sigmas of each."""
    kept = [n for n in range(len(log.rests)) if n not in left.rests]
    scale = np.sqrt(np.maximum(fit.worth(), 1e-3))
    found = []
    for n, rest in enumerate(kept):
        own = (fit.group == "accel") & (fit.item == n)
        # two of three are the vertical's own: one is left, along it
        along = float(np.sign(fit.r[own] @ fit.state.up[n]))
        worth = float(fit.worth()[own].sum())
        size = along * float(np.sqrt(np.sum(fit.r[own] ** 2) / max(worth, 1e-3)))
        found.append(Residual(f"rest {rest + 1}", "norm of force at rest", (size,)))
        rates = (fit.group == "gyro") & (fit.item == n)
        if rates.any():
            values = tuple((fit.r[rates] / scale[rates]).tolist())
            found.append(Residual(f"rest {rest + 1}", "rate at rest", values))
    for n, (a, b) in enumerate(problem.moves.rests):
        own = (fit.group == "move") & (fit.item == n)
        values = tuple((fit.r[own] / scale[own]).tolist())
        name = f"rest {kept[a] + 1} to {kept[b] + 1}"
        found.append(Residual(name, "vertical after a move", values))
    return tuple(found)


def _of_biases(unknowns: Unknowns, variances: Array) -> Array:
    """Variances (p,) of the parameters that are biases, of gyros and of accelerometers (2,)."""
    by_sensor = dict(zip(("gyro", "accel"), variances.tolist(), strict=True))
    return np.array([by_sensor[k.sensor] * (k.term == "bias") for k in unknowns.keys])


def _prior_variances(unknowns: Unknowns) -> Array:
    """Of parameters (p,), of which one that any free unknown moves is free."""
    known = np.isfinite(unknowns.sigmas)
    variance = unknowns.basis[:, known] ** 2 @ unknowns.sigmas[known] ** 2
    free = (unknowns.basis[:, ~known] != 0).any(axis=1)
    return np.where(free, np.inf, variance)


def _cannot(turned_case: float) -> tuple[str, ...]:
    frame = "rotation of the accelerometers' triad in the case"
    if turned_case > 0:
        return (f"{frame}: only the data sheet says it",)
    return (f"{frame}: b is the frame in which it is none, gyros are told against it",)


def _beyond_noise(fit: Fit) -> tuple[str, ...]:
    """What rests and moves differ by beyond their noise, where it counts."""
    units = {"accel": (1e3, "mm/s^2"), "gyro": (3600 * 180 / np.pi, "deg/h"), "move": (1e3, "mrad")}
    names = {"accel": "forces at rests", "gyro": "rates at rests", "move": "verticals after moves"}
    return tuple(
        f"{names[group]} differ by {np.sqrt(variance) * units[group][0]:.3g} {units[group][1]} "
        "beyond their noise: every sigma holds that"
        for group, variance in fit.state.extra.items()
        if variance > 0
    )


def _nuisance(problem: Problem, fit: Fit) -> tuple[Nuisance, ...]:
    at = places(problem)
    found = [("gravity", fit.state.g, at.gravity, max(problem.gravity.sigma, 1e-8), "m/s^2")]
    made = []
    for name, value, n, prior, unit in found:
        sigma = float(np.sqrt(fit.covariance[n, n]))
        made.append(nuisance_of(name, value, sigma, prior, unit))
    return tuple(made)


def _budget(fit: Fit, basis: Array, more: dict[str, Array]) -> tuple[Contribution, ...]:
    """Where the variances come from: each group of rows moves the fit on its own."""
    q = basis.shape[1]
    gain = basis @ fit.covariance[:q] @ fit.J.T
    found = []
    for name, groups in _SOURCES.items():
        own = np.isin(fit.group, groups)
        variance = (gain[:, own] ** 2).sum(axis=1)
        found.append(Contribution(name, np.sqrt(variance)))
    found += [Contribution(name, np.sqrt(P.diagonal())) for name, P in more.items()]
    return tuple(one for one in found if one.sigmas.any())


_SOURCES = {
    "readings at rests": ("accel", "gyro"),
    "moves": ("move",),
    "gravity": ("gravity",),
    "Earth rate": ("Earth rate",),
    "data sheet": ("data sheet",),
}
