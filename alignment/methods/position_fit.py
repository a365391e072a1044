"""Least squares fit of several positions: attitudes and biases at once, with priors."""

from collections.abc import Callable, Iterator
from collections.abc import Sequence as Ordered
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from alignment.angles import Sequence
from alignment.arrays import Array, IntArray
from alignment.constant_errors import ConstantForm, constant_form
from alignment.cross import cross_matrix
from alignment.earth import EARTH_RATE, Site, normal_gravity
from alignment.errors import PoleError
from alignment.information.drift import Span, flicker, gauss_markov, walked
from alignment.levelling import attitude_from_means
from alignment.options import Priors
from alignment.readings import BoolArray

# standard deviations of what nobody stated: wider than any instrument that could gyrocompass
UNKNOWN_BIAS = np.repeat([0.01, 0.5], 3)  # rad/s, m/s^2
UNKNOWN_LATITUDE = 1.0  # rad
UNKNOWN_GRAVITY = 0.03  # m/s^2: 9.78 to 9.83 over the Earth
# rad/s (2e-5 deg/h), m/s^2: no mean is surer than this. Far below what a table's tilt t makes of
# an accelerometer's error b, ``t b``: the fit knows how the base leans, and that is no noise to it
ROUNDING = np.repeat([1e-10, 1e-10], 3)
SEEN = 0.5  # part of its prior that a bias must come down to
MISFIT = 1e-3  # probability of chi-square above which positions contradict one another
_TOLD = 1e-14  # of a reading's variance: some fifty roundings
_ITERATIONS = 60
_LEVEL = 1e-6  # of chi-square: rounding may raise a cost so much
_IN_VAIN = 7  # times that a step, each a quarter of that before, may lead up before it is left
_HELPLESS = (
    1.5  # times as much as seen may the cost be bent, and whole steps still halve what is left
)
_FURTHER = 4  # times as far as the last step a step may go for its secant
_CONVERGED = 1e-9  # rad, and parts of a standard deviation
_POLE = 1e-3  # least horizontal part of Earth rate
# two ends farther apart than this are two attitudes, and so are those a standard deviation apart,
# unless they are as near as steps end
_ANOTHER, _ONE = np.radians(1.0), 1e-5
_GRAVITY = 9.81  # m/s^2, to start from
_SIZES = (EARTH_RATE, _GRAVITY)
_TILT = 1e-3  # rad: axes off by as much as any turn ten times more of it into a few ug
_DOUBTED = 0.05  # part of Earth rate: a component known worse may have either sign
_SURE = 5.0  # standard deviations of a bias: a component that is more has the sign it seems to
# what may have the other sign: rate, force, both
_MIRRORS = np.array([[True, False], [False, True], [True, True]])
# turns about down (3, 3, 3): where another heading is sought
_QUARTERS = Rotation.from_euler("z", [[90.0], [180.0], [270.0]], degrees=True).as_matrix()
_LATITUDE_START = 0.999  # sine of the latitude to start from: not at a pole


@dataclass(frozen=True, slots=True, eq=False)
class PositionFit:
    """Attitudes and biases from n positions; leading dimensions (...) are independent runs.

    Attributes
    ----------
    C_nb : (..., n, 3, 3)
        Attitude of each position as it was, placement included.
    covariance : (..., n, 3, 3)
        Of the small rotation about n [rad^2] of each.
    biases, bias_covariance : (..., 6), (..., 6, 6)
        Of gyros [rad/s] and accelerometers [m/s^2].
    cross : (..., n, 3, 6)
        Covariance of attitude errors and biases.
    bias_prior, bias_reach : (6,), (..., 6)
        Standard deviations before the fit, and of one that is told the Earth's rate and gravity.
    latitude, latitude_sigma : (...) rad, or None where it was given
    chi2, freedom : (...)
        Sum of squared residuals and priors over their variances; its expectation.
    margin : (...)
        By how much chi-square of another attitude exceeds this one's; inf where there is none.

    The covariances are those of the priors and of the noise, and where another attitude fits nearly
    as well they reach over to it: the mean square of what would be wrong, by its odds
    ``exp(-margin/2)``. What a contradiction among the positions makes of them is `growth`.
    """

    C_nb: Array
    covariance: Array
    biases: Array
    bias_covariance: Array
    cross: Array
    bias_prior: Array
    bias_reach: Array
    latitude: Array | None
    latitude_sigma: Array | None
    chi2: Array
    freedom: Array
    margin: Array

    @property
    def contradicted(self) -> Array:
        """Whether (...) the positions contradict one another: once in a thousand by chance."""
        return np.asarray(self.chi2 > chdtri(self.freedom, MISFIT))

    @property
    def growth(self) -> Array:
        """Factor (...) of all covariances: 1, or ``chi2/(freedom - 2)`` of a contradiction.

        What is wrong is not known then, only how much larger than stated the errors are: all
        variances grow alike. That is Birge's ratio, with the 2 that Student's variance has over
        the normal one for a scale found from so few residuals; infinite where two or fewer are
        left. Source: R. T. Birge, Phys. Rev. 40 (1932) 207; A. Gelman et al., Bayesian Data
        Analysis (2013), eq. 14.4 to 14.7.
        """
        enough = self.freedom > 2.5  # vague priors leave parts of one
        left = np.where(enough, self.freedom - 2, 1.0)
        ratio = np.where(enough, self.chi2 / left, np.inf)
        return np.where(self.contradicted, ratio, 1.0)

    def each(self) -> list["PositionFit"]:
        """That of every run, of fits with one leading dimension."""
        return [self._with(lambda value, k=k: value[k]) for k in range(len(self.chi2))]

    def shaped(self, lead: tuple[int, ...]) -> "PositionFit":
        """The same with leading dimensions (...) for that of all runs."""
        return self._with(lambda value: value.reshape((*lead, *value.shape[1:])))

    def _with(self, change: Callable[[Array], Array]) -> "PositionFit":
        names = [name for name in self.__slots__ if name != "bias_prior"]
        told = {name: getattr(self, name) for name in names}
        return replace(self, **{n: change(v) for n, v in told.items() if v is not None})

    @property
    def unseen(self) -> Array:
        """Which biases (..., 6) stayed near their prior, though noise and drift would let them be
        known: the turns do not show them."""
        found = np.einsum("...ii->...i", self.bias_covariance)
        least = self.bias_reach**2
        return found > least + SEEN**2 * (self.bias_prior**2 - least)


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """What r runs of n positions are fitted by; of all runs alike where there is one row for them.

    Sought are attitude (3), biases (6), then latitude and gravity where they are unknown, p in
    all. Weighed, each in units of its standard deviation, are placements and seat (t of them) and
    the instrument's constants: nobody asks for them, but they are found beside the rest.

    Attributes
    ----------
    y, sigma : (r, 6n)
        Means, position by position, and their standard deviations.
    correlated : (r, 6n, 6n)
        Covariance of the means by noise and by drift of the biases, in units of the noise.
    relative : (r, n, 3, 3)
    turned : (r, n, 3, t)
        Small turns in b of each position by placements and seat.
    latitude : float or None
        Given, or None.
    gravity : (r,) or None
        Likewise.
    priors : Priors
        Of the constants.
    form : ConstantForm
        How they show in the readings.
    sigmas : (p - 3,)
        Of what is sought; attitude has no prior. `vague` (p - 3,): which of them nobody stated.
    units : (p,)
        What all that is sought is measured in: a radian, or its standard deviation.
    """

    y: Array
    sigma: Array
    correlated: Array
    relative: Array
    turned: Array
    latitude: float | None
    gravity: Array | None
    priors: Priors
    form: ConstantForm
    sigmas: Array
    vague: Array
    units: Array
    heavier: bool

    @property
    def count(self) -> int:
        """How many unknowns are sought."""
        return len(self.units)

    @property
    def positions(self) -> int:
        """How many there are."""
        return self.relative.shape[1]

    @property
    def turns(self) -> int:
        """How many of the weighed errors turn positions."""
        return self.turned.shape[-1]

    def of(self, runs: IntArray) -> "_Problem":
        """That of some runs."""
        names = ("y", "sigma", "correlated", "relative", "turned")
        own = {name: getattr(self, name) for name in names}
        if self.gravity is not None:
            own["gravity"] = self.gravity
        return replace(self, **{n: x if len(x) == 1 else x[runs] for n, x in own.items()})


def _problem(
    readings: tuple[Array, Array],
    relative: Array,
    given: tuple[float | None, float | Array | None],
    priors: Priors,
    gravity_sigma: float,
    drift: Array | None,
) -> _Problem:
    """Of means and their standard deviations (r, 6n), turns (r, n, 3, 3), drift (r, c, n, n)."""
    (y, sigma), (latitude, gravity) = readings, given
    n = relative.shape[1]
    stated = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    gravity_sigma = UNKNOWN_GRAVITY if gravity is None else gravity_sigma
    sigmas = [
        *np.where(stated > 0, stated, UNKNOWN_BIAS),
        *([UNKNOWN_LATITUDE] if latitude is None else []),
        *([gravity_sigma] if gravity_sigma > 0 else []),
    ]
    vague = np.zeros(len(sigmas), dtype=bool)
    vague[:6], vague[6:7] = stated == 0, latitude is None
    correlated = np.eye(6 * n)[None]
    if drift is not None:
        by_channel = np.zeros((len(drift), n, 6, n, 6))
        for channel in range(6):
            by_channel[:, :, channel, :, channel] = drift[:, channel * drift.shape[1] // 6]
        by_drift = by_channel.reshape(len(drift), 6 * n, 6 * n)
        correlated = correlated + by_drift / (sigma[:, :, None] * sigma[:, None, :])
    return _Problem(
        y=y,
        sigma=sigma,
        correlated=correlated,
        relative=relative,
        turned=_turned_by_table(relative, priors),
        latitude=latitude,
        gravity=None if gravity is None else np.reshape(gravity, -1),
        priors=priors,
        form=constant_form(priors),
        sigmas=np.array(sigmas),
        vague=vague,
        units=np.array([1.0, 1.0, 1.0, *sigmas]),
        heavier=gravity_sigma > 0,
    )


def _turned_by_table(relative: Array, priors: Priors) -> Array:
    """Small turns (r, n, 3, t) in b of each position beside the told one, by placements and seat.

    A seat turned by m in b makes of the told turn R another one: ``exp(-m) R exp(m)``, to
    first order R turned on by ``m - R^T m``.
    """
    runs, n, *_ = relative.shape
    parts = [np.zeros((runs, n, 3, 0))]
    if priors.turn > 0:
        own = priors.turn * np.eye(3 * n).reshape(n, 3, 3 * n)
        parts.append(np.broadcast_to(own, (runs, *own.shape)))
    if priors.seat > 0:
        parts.append(priors.seat * (np.eye(3) - np.swapaxes(relative, -1, -2)))
    return np.concatenate(parts, axis=-1)


def fit_positions(
    means: Array,
    variances: Array,
    relative: Array,
    latitude: float | None,
    gravity: float | Array | None,
    priors: Priors,
    gravity_sigma: float = 0.0,
    drift: Array | None = None,
) -> PositionFit:
    """Attitude of every position and the biases, from the means of all of them.

    Parameters
    ----------
    means : (..., n, 6)
        Mean rates [rad/s] and specific forces [m/s^2] of each position.
    variances : (..., n, 6)
        Of these means.
    relative : (..., n, 3, 3)
        ``C_b0_bk`` by the encoders: takes components of position k to those of position 0; one
        for all runs, or each its own.
    latitude : float or None
        [rad]; None: estimated.
    gravity : float, (...) or None
        [m/s^2]; likewise, one for all runs, or each its own.
    priors : Priors
        Biases and all other constant errors of each triad; `turn` is the placement of each
        position about each of its three axes, `seat` that of b on the table. A bias of 0 here
        means that nobody knows it, not that there is none; any other 0 that there is none.
    gravity_sigma : float
        Of a gravity that is given [m/s^2].
    drift : (..., 2, n, n), (..., 6, n, n) or None
        Likewise: covariance of the means, by triad or by channel, of what is no constant bias
        (`drift_covariance`, `rounding_covariance`).

    Raises
    ------
    PoleError
        No horizontal Earth rate is left after the biases are taken out.

    Notes
    -----
    Model: ``y_k = x_k + A(x_k) u + b + noise``, x_k the true ``C_nbk^T (w_ie, -g)``,
    ``C_nbk = C_nb0 C_b0_bk exp(d_k)``, `d_k` being its placement and what the seat makes of its
    turn; A u are scale, axes' misalignment and non-orthogonality, g-sensitivity and so on, which
    change with the attitude as `alignment.constant_errors` says. Gauss-Newton; in each step the
    weighed errors stand in the covariance ``R + A A^T`` of the readings, which is the same as to
    solve for them, and are then found from what the step leaves. Started from linear fits of the
    two vectors and the biases; of two ends the likelier one, the other in its covariance.

    What comes out of a run is the same to the bit, whatever others it is fitted with: all that
    is done is of each run alone.
    """
    lead, n = means.shape[:-2], means.shape[-2]
    sigma = np.sqrt(np.broadcast_to(variances, means.shape) + ROUNDING**2).reshape(-1, 6 * n)
    readings = means.reshape(-1, 6 * n), sigma
    each = None if drift is None else drift.reshape(-1, *drift.shape[-3:])
    turns = relative.reshape(-1, n, 3, 3)
    problem = _problem(readings, turns, (latitude, gravity), priors, gravity_sigma, each)
    starts, hidden, weak = _starts(problem)
    every = np.arange(len(sigma))
    # those that have two go both ways at once
    both = _descended(_joined(starts), problem.of(np.concatenate([every, hidden])))
    first, second = _parted(both, len(every))
    ends = [first, _put(first, hidden, second)]
    state = _likeliest(ends)
    for runs, start in _elsewhere(state, weak, problem):
        ends.append(_put(first, runs, _descended(start, problem.of(runs))))
    state = _likeliest(ends)
    fit = _tilted(_result(state, _linearised(state, problem), problem), state, problem)
    return _spread(fit, *_others(ends, state, fit.covariance[:, 0], problem)).shaped(lead)


# runs' attitudes of position 0 (r, 3, 3), what is sought (r, p) with zeros for the attitude, and
# the weighed errors (r, q)
_State = tuple[Array, Array, Array]
_End = tuple[_State, Array]  # and its cost (r,)


def _joined(starts: Ordered[tuple[Array, Array]]) -> tuple[Array, Array]:
    C, x = (np.concatenate(parts) for parts in zip(*starts, strict=True))
    return C, x


def _parted(end: _End, runs: int) -> tuple[_End, _End]:
    """The first so many, and the rest."""
    (C, x, u), cost = end
    return ((C[:runs], x[:runs], u[:runs]), cost[:runs]), (
        (C[runs:], x[runs:], u[runs:]),
        cost[runs:],
    )


def _put(end: _End, runs: IntArray, another: _End) -> _End:
    """The end with that of some runs in place of theirs."""
    state, cost = tuple(part.copy() for part in end[0]), end[1].copy()
    for all_, new in zip((*state, cost), (*another[0], another[1]), strict=True):
        all_[runs] = new
    C, x, u = state
    return (C, x, u), cost


def _likeliest(ends: list[_End]) -> _State:
    """Of several ends (state, cost) the best of each run."""
    states, costs = [end[0] for end in ends], np.stack([end[1] for end in ends])
    C, x, u = (np.stack(parts) for parts in zip(*states, strict=True))
    best, runs = np.argmin(costs, axis=0), np.arange(costs.shape[1])
    return C[best, runs], x[best, runs], u[best, runs]


def _by_cost(ends: list[_End]) -> list[_End]:
    """The ends, of each run its best first: of two that are one valley's the deeper counts."""
    costs = np.stack([cost for _, cost in ends])
    order, runs = np.argsort(costs, axis=0, kind="stable"), np.arange(costs.shape[1])
    C, x, u = (np.stack(parts)[order, runs] for parts in zip(*(s for s, _ in ends), strict=True))
    return [((C[k], x[k], u[k]), costs[order, runs][k]) for k in range(len(ends))]


def _angle(C: Array, other: Array) -> Array:
    """Of the turns (r,) between attitudes (r, 3, 3) [rad].

    The square sum of what nine numbers differ by is ``8 sin^2(angle/2)``.
    """
    squares = np.sum((C - other) ** 2, axis=(-2, -1))
    return np.asarray(2 * np.arcsin(np.sqrt(np.minimum(squares / 8, 1.0))))


def _another(C: Array, other: Array, P: Array) -> BoolArray:
    """Whether ends (r, 3, 3) are two attitudes, of which one has the covariance P (r, 3, 3)."""
    angle, off = _angle(C, other), _off(C @ np.swapaxes(other, -1, -2))[..., None]
    # what nothing tells is no matter of rounding, either
    P = P + _TOLD * np.trace(P, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    far = (np.swapaxes(off, -1, -2) @ np.linalg.solve(P, off))[..., 0, 0] > 1.0
    return np.asarray((angle > _ANOTHER) | (far & (angle > _ONE)))


def _others(
    ends: list[_End], taken: _State, P: Array, problem: _Problem
) -> tuple[Array, Array, Array]:
    """Margins (r,) of other ends, how far they lie from the one taken, and their probabilities.

    `P` (r, 3, 3): of position 0. What the one taken is off if they are true, (e, r, 3n + p - 3):
    all attitudes and what else is sought; weights (e, r), ``exp(-margin/2)`` over the sum of all,
    each attitude counted once.
    """
    least = np.min([cost for _, cost in ends], axis=0)
    ordered, margins, seen = _by_cost(ends), [], [taken[0]]
    for (C, _, _), cost in ordered:
        new = np.all([_another(C, other, P) for other in seen], axis=0)
        margins.append(np.where(new, cost - least, np.inf))
        seen.append(C)
    margin, weights = np.min(margins, axis=0), np.exp(-np.array(margins) / 2)
    if not weights.any():
        none = np.zeros((*weights.shape, 3 * problem.positions + problem.count - 3))
        return margin, none, weights
    placed, apart = _placed(taken[0], taken[2], problem), []
    for (C, x, u), _ in ordered:
        turns = _off(placed @ np.swapaxes(_placed(C, u, problem), -1, -2)).reshape(len(x), -1)
        apart.append(np.concatenate([turns, (taken[1] - x)[:, 3:]], axis=1))
    return margin, np.array(apart), weights / (1 + weights.sum(axis=0))


def _off(turned: Array) -> Array:
    """Tilt about north and east of the vertical, and turn about down (..., 3) [rad] by rotations.

    A heading far off turns the axis of a rotation away from that of its tilt.
    """
    flat = turned.reshape(-1, 3, 3)
    heading = Rotation.from_matrix(flat).as_rotvec()[:, 2]
    return np.stack([-flat[:, 1, 2], flat[:, 0, 2], heading], axis=-1).reshape(turned.shape[:-1])


def _tilted(fit: PositionFit, state: _State, problem: _Problem) -> PositionFit:
    """The fit whose other tilt and accelerometers' biases are as unsure as a tilt makes them.

    Axes that are off turn a force that a tilt leaves along the turns' axis across it, and it is a
    bias there, or a tilt across it that positions tell finely: a product of two errors, which first
    order has not. By the law of total variance over tilts t of a standard deviation either way
    about the axis known worst: what the covariance there is more, by how much more than first order
    biases change with t, and of what is bent by ``q t^2`` the mean square ``3 q^2``.
    """
    variances, axes = np.linalg.eigh(fit.covariance[:, 0, :2, :2])
    sigmas = np.sqrt(variances[:, -1])
    runs = np.flatnonzero(sigmas > _TILT)
    if not len(runs):
        return fit
    own, (C, x, u) = problem.of(runs), _of(state, runs)
    way, across = np.zeros((2, len(runs), 3))
    way[:, :2] = sigmas[runs, None] * axes[runs, :, -1]
    across[:, :2] = axes[runs, :, 0]
    at = [_beside(across, (_turned(s * way, C), x, u), own) for s in (0.0, 1.0, -1.0)]
    (there, P), (one, P_one), (two, P_two) = at
    q = (one + two) / 2 - there
    slope = np.einsum("ri,rij->rj", way[:, :2], fit.cross[runs, 0, :2, 3:])
    s = ((one - two) / 2)[:, 1:] - slope / variances[runs, -1, None]
    bent = q[:, 1:]
    more = s[:, :, None] * s[:, None] + 3 * bent[:, :, None] * bent[:, None]
    found, covariance = fit.bias_covariance.copy(), fit.covariance.copy()
    found[runs, 3:, 3:] += ((P_one + P_two) / 2 - P)[:, 1:, 1:] + more
    tilt = 3 * q[:, 0, None, None] ** 2 * across[:, :, None] * across[:, None]
    covariance[runs] += tilt[:, None]
    return replace(fit, bias_covariance=found, covariance=covariance)


def _beside(across: Array, state: _State, problem: _Problem) -> tuple[Array, Array]:
    """Likeliest turn about an axis `across` (r, 3) of n and biases of the accelerometers (r, 1 + 3)
    at an attitude that else stays, and their covariances."""
    system, x = _linearised(state, problem), state[1]
    told = problem.count - 3
    prior = np.zeros((len(x), told, told + 1))
    prior[:, :, 1:] = np.eye(told)
    turned = system.J[..., :3] @ across[..., None]
    A = np.concatenate([turned, system.J[..., 3:] * problem.units[3:]], axis=-1)
    Q, R = np.linalg.qr(np.concatenate([A, prior], axis=-2))
    wanted = np.concatenate([system.innovation, -x[:, 3:] / problem.sigmas], axis=-1)
    root = np.append(1.0, problem.units[3:])[:, None] * np.linalg.inv(R)
    step = (root @ np.swapaxes(Q, -1, -2) @ wanted[..., None])[..., 0]
    P = root @ np.swapaxes(root, -1, -2)
    found = np.concatenate([step[:, :1], x[:, 6:9] + step[:, 4:7]], axis=-1)
    chosen = [0, 4, 5, 6]
    return found, P[:, chosen][:, :, chosen]


def _spread(fit: PositionFit, margin: Array, apart: Array, weights: Array) -> PositionFit:
    """The fit whose covariances hold the other ends too: the mean square about the one taken."""
    n = fit.C_nb.shape[1]
    turns = apart[..., : 3 * n].reshape(*apart.shape[:2], n, 3)
    rest = apart[..., 3 * n :]
    covariance = np.einsum("er,erni,ernj->rnij", weights, turns, turns)
    cross = np.einsum("er,erni,erj->rnij", weights, turns, rest[..., :6])
    biases = np.einsum("er,eri,erj->rij", weights, rest[..., :6], rest[..., :6])
    latitude = fit.latitude_sigma
    if latitude is not None:
        latitude = np.sqrt(latitude**2 + np.einsum("er,er->r", weights, rest[..., 6] ** 2))
    return replace(
        fit,
        covariance=_symmetric(fit.covariance + covariance),
        cross=fit.cross + cross,
        bias_covariance=fit.bias_covariance + biases,
        latitude_sigma=latitude,
        margin=margin,
    )


def _elsewhere(
    state: _State, weak: "_Weak", problem: _Problem
) -> Iterator[tuple[IntArray, tuple[Array, Array]]]:
    """Where else the cost may have a valley: which runs may lie there, and starts for them."""
    for mirror in _MIRRORS:
        runs, start = _mirrored(state, weak, mirror, problem)
        if len(runs):
            yield runs, start
    runs = _headless(state, weak, problem)
    for turn in _QUARTERS if len(runs) else ():
        yield runs, (turn @ state[0][runs], state[1][runs])


def _headless(state: _State, weak: "_Weak", problem: _Problem) -> IntArray:
    """Runs that may have another heading: of the level Earth rate a part may have either sign.

    Its size is known, so that what is sure of one part leaves the other's size, and two headings.
    """
    C, x, _ = state
    P = C @ weak.rate @ np.swapaxes(C, -1, -2)
    half, apart = (P[:, 0, 0] + P[:, 1, 1]) / 2, (P[:, 0, 0] - P[:, 1, 1]) / 2
    worst = np.sqrt(half + np.hypot(apart, P[:, 0, 1]))
    w_n, *_ = _vectors(x, problem)
    return np.flatnonzero(np.abs(w_n[:, 0]) < _SURE * worst)


def _mirrored(
    state: _State, weak: "_Weak", mirror: Array, problem: _Problem
) -> tuple[IntArray, tuple[Array, Array]]:
    """Runs that may lie in another valley, and where it is: with the other sign of rate, force or
    both (`mirror` (2,)) along the axis that the turns do not show.

    Turns about one axis show a vector across it, and its size what lies along it but for the sign.
    Rate and force that are mirrored both stand at the angle at which they stood, so that their
    attitude fits but for the biases, by twice what lies along the axis.
    """
    C, x, _ = state
    w_n, f_n, _ = _vectors(x, problem)
    vectors = np.stack([w_n, f_n], axis=1) @ C
    along = np.sum(vectors * weak.axes, axis=-1)
    runs = np.flatnonzero(np.all((np.abs(along) < _SURE * weak.doubts) | (mirror == 0), axis=1))
    moved = np.where(mirror[:, None], 2 * along[..., None] * weak.axes, 0.0)[runs]
    there = x[runs]
    there[:, 3:9] += moved.reshape(-1, 6)
    w, f = np.moveaxis(vectors[runs] - moved, 1, 0)
    return runs, (_levelled(w, f), there)


def _levelled(w: Array, f: Array) -> Array:
    """Attitudes (r, 3, 3) from rates and forces (r, 3), by angles.

    With a row more: of one alone the last digit of a sum is another than of one of many.
    """
    w, f = np.concatenate([w, w[:1]]), np.concatenate([f, f[:1]])
    return attitude_from_means(w, f, Sequence.YAW_PITCH_ROLL).as_matrix()[:-1]


def _descended(start: tuple[Array, Array], problem: _Problem) -> _End:
    """The state that Gauss-Newton ends in, and its cost (r,).

    A step that raises the cost is tried again at a quarter. Where Earth rate is small beside the
    biases heading is nearly free: the cost is bent over it by what first order leaves out, up to
    thousands of times more than Gauss-Newton sees, and whole steps would leap about for ever. So
    what the steps show of that curvature is added to it (`_bent`).
    Runs that steps of the first order lead nowhere are those of coarse units, whose errors' squares
    are more than the noise: they go on with all of the Jacobian.
    """
    C, x = start[0].copy(), start[1].copy()
    system = _linearised((C, x, _no_errors(problem, len(C))), problem)
    state = C, x, system.weighed(np.zeros_like(x))
    costs, stuck = _walked(state, problem)
    if len(stuck):
        rest = _of(state, stuck)
        costs[stuck], _ = _walked(rest, problem.of(stuck), whole=True)
        for all_, new in zip(state, rest, strict=True):
            all_[stuck] = new
    return state, costs


def _walked(state: _State, problem: _Problem, whole: bool = False) -> tuple[Array, IntArray]:
    """Costs (r,) where steps from a state end, which is moved there, and the runs still on the way.

    `whole`: with all of the Jacobian.
    """
    system = _linearised(state, problem, whole)
    costs = _cost(system, state, problem)
    runs, own = len(costs), problem
    active, stuck = np.arange(runs), np.zeros(runs, dtype=bool)
    bend, in_vain, before = np.zeros(runs), np.zeros(runs), np.zeros((runs, 4))
    for _ in range(_ITERATIONS):
        here = _of(state, active)
        step, seen = _step(system, here[1], own, bend[active])
        bend[active], changed = _bent(bend[active], seen, before[active], step[:, :3])
        if changed:
            step, seen = _step(system, here[1], own, bend[active])
        # beyond a radian the linear system says nothing
        part = 0.25 ** in_vain[active] / np.maximum(np.linalg.norm(step[:, :3], axis=1), 1.0)
        then, changes = _moved(here, system, step, part, own)
        tried = _linearised(then, own, whole)
        cost = _cost(tried, then, own)
        better = cost <= costs[active] + _LEVEL
        taken = active[better]
        for all_, new in zip(state, then, strict=True):
            all_[taken] = new[better]
        costs[taken] = cost[better]
        before[active] = np.where(better[:, None], np.column_stack([step[:, :3], part]), 0.0)
        bend[active] += np.where(better, 0.0, 3 * seen)
        in_vain[active] = np.where(better, 0, in_vain[active] + 1)
        stuck[active] = changes >= _CONVERGED
        going = stuck[active] & (in_vain[active] < _IN_VAIN)
        system = _either(better, tried, system, going)
        active = active[going]
        if not len(active):
            break
        if not going.all():
            own = problem.of(active)
    return costs, np.flatnonzero(stuck)


def _bent(bend: Array, seen: Array, before: Array, now: Array) -> tuple[Array, bool]:
    """What to add (r,) to the curvature of the cost over the turn, and whether it is new for any.

    A step s of which a part p was taken is followed by ``(1 - k p) s`` where the cost is bent k
    times as much as was `seen` (r,) [1/rad^2] on that way, all that was added included: the secant
    of the gradient. `before` (r, 4): s and p, zeros where there are none; `now` (r, 3): what
    follows.
    """
    s, p = before[:, :3], before[:, 3]
    size, known = np.sum(s**2, axis=1), p > 0
    k = np.ones(len(p))
    np.divide(np.sum(s * (s - now), axis=1), size * p, out=k, where=known)
    k = np.clip(k, 1 / _FURTHER, None)
    new = np.maximum(bend + (k - 1) * seen, 0.0)
    # where it is bent about as seen, steps need no help
    new = np.where(known & ((bend > 0) | (k > _HELPLESS)), new, bend)
    return new, bool(np.any(new != bend))


def _of(state: _State, runs: IntArray) -> _State:
    C, x, u = state
    return C[runs], x[runs], u[runs]


def _either(first: BoolArray, a: "_System", b: "_System", runs: BoolArray) -> "_System":
    """System `a` of runs that are `first` (r,), `b` of others; those `runs` (r,) alone."""
    if first.all() or not first.any():  # of one run always
        taken = a if first.all() else b
        return taken if runs.all() else _System(*(x[runs] for x in taken.all()))
    parts = [
        np.where(first.reshape(-1, *[1] * (x.ndim - 1)), x, y)[runs]
        for x, y in zip(a.all(), b.all(), strict=True)
    ]
    return _System(*parts)


def _moved(
    state: _State, system: "_System", step: Array, part: Array, problem: _Problem
) -> tuple[_State, Array]:
    """The state after a part (r,) of a step, and the largest change (r,) in units of sigmas."""
    C, x, u = state
    t, part = problem.turns, part[:, None]
    placed = u[:, :t] + part * (system.weighed(step) - u)[:, :t]
    step = step * part
    found = np.concatenate([placed, system.weighed(step)[:, t:]], axis=1)
    changes = np.concatenate([step / problem.units, found - u], axis=1)
    then = x.copy()
    then[:, 3:] += step[:, 3:]
    return (_turned(step[:, :3], C), then, found), np.abs(changes).max(axis=1)


def _no_errors(problem: _Problem, runs: int) -> Array:
    """Weighed errors (r, q), none of them there."""
    return np.zeros((runs, problem.turns + problem.form.count))


def predicted_covariance(
    C_nb: Array,
    variances: Array,
    relative: Array,
    latitude: float,
    gravity: float,
    priors: Priors,
    estimated: bool = False,
    drift: Array | None = None,
) -> Array:
    """Covariance (n, 3, 3) about n of each position's attitude, before there are readings.

    `C_nb` (3, 3) of position 0; `variances` (n, 6) of the means; `estimated`: whether the fit is
    not given latitude and gravity; the rest as `fit_positions`.
    """
    given = (None, None) if estimated else (latitude, gravity)
    state, problem = _expected(C_nb, variances, relative, given, priors, 0.0, drift)
    if estimated:
        state[1][:, 9] = latitude
        problem = replace(problem, y=_predicted(state, problem)[0])
    return _result(state, _linearised(state, problem), problem).covariance[0]


def predicted_mirrors(
    C_nb: Array,
    variances: Array,
    relative: Array,
    latitude: float,
    gravity: float,
    priors: Priors,
    gravity_sigma: float = 0.0,
    drift: Array | None = None,
) -> list[tuple[float, Array, Array]]:
    """Other attitudes that a fit may take for the true ones, before there are readings.

    Each with its chi-square by readings that are as they should be, and with what the true ones
    are off it: tilts about north and east of all positions and turns about down (n, 3) [rad], and
    biases (6,). Arguments as `predicted_covariance` and `fit_positions` have them.
    """
    given = latitude, gravity
    true, problem = _expected(C_nb, variances, relative, given, priors, gravity_sigma, drift)
    weak = _worst([_linear(problem, size) for size in _SIZES])
    P = _result(true, _linearised(true, problem), problem).covariance[:, 0]
    placed, there = _placed(true[0], true[2], problem), [true[0]]
    found = []
    for _, start in _elsewhere(true, weak, problem):
        (C, x, u), cost = _descended(start, problem)
        if all(_another(C, other, P)[0] for other in there):
            off = _off(placed @ np.swapaxes(_placed(C, u, problem), -1, -2))
            found.append((float(cost[0]), off[0], -x[0, 3:9]))
            there.append(C)
    return found


def _expected(
    C_nb: Array,
    variances: Array,
    relative: Array,
    given: tuple[float | None, float | None],
    priors: Priors,
    gravity_sigma: float,
    drift: Array | None,
) -> tuple[_State, _Problem]:
    """One run whose readings are as they should be at `C_nb` (3, 3)."""
    sigma = np.sqrt(variances + ROUNDING**2).reshape(1, -1)
    each = None if drift is None else drift[None]
    readings = np.zeros_like(sigma), sigma
    problem = _problem(readings, relative[None], given, priors, gravity_sigma, each)
    state = C_nb[None], np.zeros((1, problem.count)), _no_errors(problem, 1)
    return state, replace(problem, y=_predicted(state, problem)[0])


def _turned(eta: Array, C: Array) -> Array:
    """``exp(eta x) C`` for (r, 3) and (r, 3, 3)."""
    return np.asarray(Rotation.from_rotvec(eta).as_matrix() @ C)


# --- where to start ------------------------------------------------------------------------------


class _Weak(NamedTuple):
    """Of rate and force the directions (r, 2, 3) in b known worst, and their sigmas (r, 2).

    `rate` (r, 3, 3): covariance of the rate.
    """

    axes: Array
    doubts: Array
    rate: Array


def _starts(
    problem: _Problem,
) -> tuple[tuple[tuple[Array, Array], tuple[Array, Array]], IntArray, _Weak]:
    """Attitudes (., 3, 3) of position 0 and what is sought (., p) to start from, of all runs and of
    those again that have another start; which runs those are; what all know worst.

    Linear least squares for each triad: ``y_k = R_k^T v + b``, `v` no larger than it can be. Where
    the turns do not tell the rate along their axis from its bias, there are two starts: along the
    axis, either way what is missing of Earth rate.
    """
    both = [_linear(problem, size) for size in _SIZES]
    (w, w_bias, weak, doubt, _), (f, f_bias, *_) = both
    doubted = doubt > _DOUBTED * EARTH_RATE
    hidden = np.flatnonzero(doubted)
    along = np.sum(w * weak, axis=1, keepdims=True)
    across = w - along * weak
    missing = EARTH_RATE**2 - np.sum(across**2, axis=1, keepdims=True)
    size = np.sqrt(np.maximum(missing, (_DOUBTED * EARTH_RATE) ** 2))
    ways = [(across + s * size * weak, w_bias + (along - s * size) * weak) for s in (1.0, -1.0)]
    one = [np.where(doubted[:, None], *pair) for pair in zip(ways[0], (w, w_bias), strict=True)]
    another = [part[hidden] for part in ways[1]]
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    level = np.linalg.norm(np.cross(one[0], up), axis=1)
    level[hidden] = np.maximum(
        level[hidden], np.linalg.norm(np.cross(another[0], up[hidden]), axis=1)
    )
    if np.any(level < _POLE * EARTH_RATE):
        raise PoleError("mean rate and vertical are collinear: heading is undefined")

    def start(w: Array, w_bias: Array, runs: IntArray) -> tuple[Array, Array]:
        x = np.zeros((len(runs), problem.count))
        x[:, 3:9] = np.concatenate([w_bias, f_bias[runs]], axis=1)
        if problem.latitude is None:
            lean = np.sum(w * up[runs], axis=1) / np.linalg.norm(w, axis=1)
            x[:, 9] = np.arcsin(np.clip(lean, -_LATITUDE_START, _LATITUDE_START))
        return _levelled(w, f[runs]), x

    starts = start(one[0], one[1], np.arange(len(w))), start(another[0], another[1], hidden)
    return starts, hidden, _worst(both)


_Linear = tuple[Array, Array, Array, Array, Array]


def _worst(linear: Ordered[_Linear]) -> _Weak:
    """Of `_linear` of rate and of force."""
    _, _, axes, doubts, covariances = zip(*linear, strict=True)
    return _Weak(np.stack(axes, axis=1), np.stack(doubts, axis=1), covariances[0])


def _linear(problem: _Problem, size: float) -> _Linear:
    """Vectors (r, 3), biases (r, 3), the directions (r, 3) known worst, their sigmas (r,), and
    the vectors' covariances (r, 3, 3)."""
    n, runs = problem.positions, len(problem.y)
    gyros = size == EARTH_RATE
    own = slice(0, 3) if gyros else slice(3, 6)
    y, sigma = (x.reshape(runs, n, 6)[..., own] for x in (problem.y, problem.sigma))
    A = np.zeros((runs, 3 * n + 6, 6))
    A[:, : 3 * n, :3] = np.swapaxes(problem.relative, -1, -2).reshape(-1, 3 * n, 3)
    A[:, : 3 * n, 3:] = np.tile(np.eye(3), (n, 1))
    # one noise for all positions is enough to start from, with what gravity pulls of gyros
    pulled = problem.priors.gyro_g_sensitivity * _GRAVITY if gyros else 0.0
    noise = np.hypot(np.sqrt(np.mean(sigma**2, axis=(1, 2))), pulled)[:, None, None]
    A[:, : 3 * n] /= noise
    A[:, 3 * n :] = np.diag(1 / np.concatenate([np.full(3, size), problem.sigmas[own]]))
    inverse = np.linalg.pinv(A)
    solution = (inverse[..., : 3 * n] @ (y.reshape(runs, 3 * n, 1) / noise))[..., 0]
    covariance = (inverse @ np.swapaxes(inverse, -1, -2))[:, :3, :3]
    variances, axes = np.linalg.eigh(covariance)
    return solution[:, :3], solution[:, 3:], axes[..., -1], np.sqrt(variances[:, -1]), covariance


# --- the readings, and one step ------------------------------------------------------------------


def _vectors(x: Array, problem: _Problem) -> tuple[Array, Array, Array]:
    """Earth rate, specific force and Earth rate's change with latitude in n, each (r, 3)."""
    runs = len(x)
    lat = x[:, 9] if problem.latitude is None else np.full(runs, problem.latitude)
    given = problem.gravity
    g = _normal_gravity(lat) if given is None else np.broadcast_to(given, runs)
    if problem.heavier:
        g = g + x[:, -1]
    zero = np.zeros(runs)
    w_n = EARTH_RATE * np.stack([np.cos(lat), zero, -np.sin(lat)], axis=-1)
    by_lat = EARTH_RATE * np.stack([-np.sin(lat), zero, -np.cos(lat)], axis=-1)
    return w_n, np.stack([zero, zero, -g], axis=-1), by_lat


def _predicted(state: _State, problem: _Problem, whole: bool = False) -> tuple[Array, Array, Array]:
    """Readings (r, 6n), their Jacobian (r, 6n, p), and what each weighed error adds (r, 6n, q).

    To first order in the instrument's errors: that they change what a turn does to the readings is
    left out of the Jacobian, not of the readings, unless it is to be `whole`. What their squares
    tell is no knowledge, for the errors are stated to first order alone; but where a coarse unit's
    exceed the noise a step that leaves them out climbs the walls of the valley.
    """
    C, x, u = state
    runs, n, t = len(x), problem.positions, problem.turns
    w_n, f_n, by_lat = _vectors(x, problem)
    C_kn = np.swapaxes(_placed(C, u, problem), -1, -2)
    J = np.zeros((runs, n, 6, problem.count))
    felt = np.empty((runs, n, 6))
    by_turn = np.empty((runs, n, 6, 3))
    for part, vector in ((slice(0, 3), w_n), (slice(3, 6), f_n)):
        felt[..., part] = (C_kn @ vector[:, None, :, None])[..., 0]
        by_turn[..., part, :] = cross_matrix(felt[..., part])
        J[..., part, 0:3] = C_kn @ cross_matrix(vector)[:, None]
    J[..., 3:9] = np.eye(6)
    if problem.latitude is None:
        J[..., :3, 9] = (C_kn @ by_lat[:, None, :, None])[..., 0]
    if problem.heavier:
        J[..., 3:, -1] = felt[..., 3:] / np.linalg.norm(f_n, axis=1)[:, None, None]
    constants = problem.form.columns(felt)
    if whole and constants.shape[-1]:
        moved = J.copy()
        moved[..., 3:9] = 0.0
        J = J + problem.form.slopes(felt, u[:, t:]) @ moved
    weighed = np.concatenate([by_turn @ problem.turned, constants], axis=-1)
    y = felt + (constants @ u[:, None, t:, None])[..., 0] + x[:, None, 3:9]
    return y.reshape(runs, -1), J.reshape(runs, 6 * n, -1), weighed.reshape(runs, 6 * n, -1)


def _placed(C: Array, u: Array, problem: _Problem) -> Array:
    """Attitudes (r, n, 3, 3) of all positions from that of position 0 and the weighed errors."""
    C_k = C[:, None] @ problem.relative
    t = problem.turns
    if not t:
        return np.asarray(C_k)
    d = (problem.turned @ u[:, None, :t, None])[..., 0]
    turns = Rotation.from_rotvec(d.reshape(-1, 3)).as_matrix()
    return np.asarray(C_k @ turns.reshape(*d.shape, 3))


def _normal_gravity(latitude: Array) -> Array:
    """WGS 84 on the ellipsoid, of many latitudes."""
    return np.vectorize(normal_gravity, otypes=[float])(latitude)


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """The readings about a state, whitened by noise, drift and weighed errors together.

    `J` (r, 6n, p), `A` (r, 6n, q) and `innovation` (r, 6n): what is left of the readings without
    the weighed errors. `left` (r, 6n): what is left with the placements as they are, whitened by
    all but them.
    """

    J: Array
    A: Array
    innovation: Array
    left: Array

    def all(self) -> tuple[Array, ...]:
        """Its arrays."""
        return self.J, self.A, self.innovation, self.left

    def weighed(self, step: Array) -> Array:
        """The likeliest weighed errors (r, q) after a step (r, p)."""
        left = self.innovation - (self.J @ step[..., None])[..., 0]
        return np.asarray((np.swapaxes(self.A, -1, -2) @ left[..., None])[..., 0])


def _linearised(state: _State, problem: _Problem, whole: bool = False) -> _System:
    predicted, J, A = _predicted(state, problem, whole)
    y, sigma = problem.y, problem.sigma
    J, A = J / sigma[..., None], A / sigma[..., None]
    t, u = problem.turns, state[2]
    left = (y - predicted) / sigma + (A[..., t:] @ u[:, t:, None])[..., 0]
    residual = left + (A[..., :t] @ u[:, :t, None])[..., 0]
    S = problem.correlated + A[..., t:] @ np.swapaxes(A[..., t:], -1, -2)
    L = _rooted(S)
    left = np.linalg.solve(L, left[..., None])[..., 0]
    if t:
        L = _rooted(S + A[..., :t] @ np.swapaxes(A[..., :t], -1, -2))
    p = problem.count
    solved = np.linalg.solve(L, np.concatenate([J, residual[..., None], A], axis=-1))
    return _System(
        J=solved[..., :p],
        A=solved[..., p + 1 :],
        innovation=solved[..., p],
        left=left,
    )


def _rooted(S: Array) -> Array:
    """L of ``L L^T = S``, of readings no surer than double numbers tell what errors make of them.

    Constants by 1e-3 of g are 1e8 times `ROUNDING`: of their squares less one another noise is lost
    by rounding. So each reading has a ten millionth of all its errors as noise of its own.
    """
    own = np.einsum("...ii->...i", S)
    return np.linalg.cholesky(S + _TOLD * own[..., None] * np.eye(S.shape[-1]))


def _cost(system: _System, state: _State, problem: _Problem) -> Array:
    """Chi-square (r,) of a state: of its readings, of its priors, and of placements as they are.

    Placements turn readings by sine and cosine: with those that were likeliest a step ago the cost
    of the likeliest would be another function at each of them, and no step better. The
    instrument's errors are linear in the readings, and whatever they are the cost is the same.
    """
    _, x, u = state
    parts = system.left, x[:, 3:] / problem.sigmas, u[:, : problem.turns]
    return np.asarray(sum(np.sum(part**2, axis=-1) for part in parts))


def _step(system: _System, x: Array, problem: _Problem, bend: Array) -> tuple[Array, Array]:
    """Step (r, p) to the least squares solution, and the curvature (r,) [1/rad^2] on its way.

    `bend` (r,) is added to the curvature over the turn of all positions.
    """
    Q, R = _triangular(system, problem, bend)
    held = np.zeros((len(x), 3))
    wanted = np.concatenate([system.innovation, -x[:, 3:] / problem.sigmas, held], axis=-1)
    unit = np.linalg.solve(R, np.swapaxes(Q, -1, -2) @ wanted[..., None])[..., 0]
    way = np.zeros_like(unit)
    way[:, :3] = unit[:, :3]
    spread = np.linalg.solve(np.swapaxes(R, -1, -2), way[..., None])[..., 0]
    turned = np.sum(way**2, axis=1)
    seen = np.divide(turned, np.sum(spread**2, axis=1), out=np.zeros(len(x)), where=turned > 0)
    return unit * problem.units, seen


def _root(system: _System, problem: _Problem) -> Array:
    """The root (r, p, p) of the covariance."""
    return problem.units[:, None] * np.linalg.inv(_triangular(system, problem)[1])


def _triangular(
    system: _System, problem: _Problem, bend: Array | float = 0.0
) -> tuple[Array, Array]:
    """Q and R of readings, priors and `bend` (`_step`), by what is sought in its units."""
    runs, p = len(system.J), problem.count
    prior = np.broadcast_to(np.eye(p)[3:], (runs, p - 3, p))
    held = np.sqrt(np.broadcast_to(bend, runs))[:, None, None] * np.eye(p)[:3]
    Q, R = np.linalg.qr(np.concatenate([system.J * problem.units, prior, held], axis=-2))
    if not np.diagonal(R, axis1=-2, axis2=-1)[:, :3].all():
        raise PoleError("readings do not determine the attitude: heading is undefined")
    return Q, R


def _result(state: _State, system: _System, problem: _Problem) -> PositionFit:
    """The fit about a state that is its end.

    The weighed errors that turn positions are what the readings make of the sought ones' errors,
    ``-A^T J dx``, and what no reading tells, of covariance ``1 - A^T A``.
    """
    C, x, u = state
    n, t = problem.positions, problem.turns
    root = _root(system, problem)
    P = root @ np.swapaxes(root, -1, -2)
    C_k = _placed(C, u, problem)
    to_n = C_k @ problem.turned
    A_t = np.swapaxes(system.A[..., :t], -1, -2)
    moved = np.zeros((len(x), n, 3, problem.count))
    moved[..., :3] = np.eye(3)
    moved -= to_n @ (A_t @ system.J)[:, None]
    left = np.eye(t) - A_t @ np.swapaxes(A_t, -1, -2)
    half = moved @ P[:, None]
    estimated = problem.latitude is None
    return PositionFit(
        C_nb=C_k,
        covariance=_symmetric(
            half @ np.swapaxes(moved, -1, -2) + to_n @ left[:, None] @ np.swapaxes(to_n, -1, -2)
        ),
        biases=x[:, 3:9],
        bias_covariance=P[:, 3:9, 3:9],
        cross=half[..., 3:9],
        bias_prior=problem.sigmas[:6],
        bias_reach=np.broadcast_to(_reach(problem), (len(x), 6)),
        latitude=x[:, 9] if estimated else None,
        latitude_sigma=np.sqrt(P[:, 9, 9]) if estimated else None,
        chi2=_cost(system, state, problem),
        freedom=6 * n - 3 - _spent(P, problem),
        margin=np.full(len(x), np.inf),
    )


def _reach(problem: _Problem) -> Array:
    """Standard deviations (r, 6) of the biases by noise and drift alone, of r or one for all."""
    every = np.arange(6 * problem.positions).reshape(-1, 6).T
    own = problem.correlated[:, every[:, :, None], every[:, None, :]]  # (r, 6, n, n)
    weights = 1 / problem.sigma[:, every][..., None]
    told = np.swapaxes(weights, -1, -2) @ np.linalg.solve(own, weights)
    return np.asarray((told[..., 0, 0] + 1 / problem.sigmas[:6] ** 2) ** -0.5)


def _spent(P: Array, problem: _Problem) -> Array:
    """How many readings (r,) went into unknowns whose prior is so vague that it adds nothing."""
    kept = np.einsum("...ii->...i", P)[:, 3:] / problem.sigmas**2
    return np.asarray(np.sum((1 - kept) * problem.vague, axis=-1))


# --- noise and drift -----------------------------------------------------------------------------


def pooled_variances(variances: Array, spans: Array) -> Array:
    """Variances (n, 6) of means over `spans` (n,) [s] when all dwells share one noise density.

    One instrument, one noise: n times the degrees of freedom that one dwell's blocks have.
    """
    density = np.mean(variances * spans[:, None], axis=0)
    return density / spans[:, None]


def _symmetric(P: Array) -> Array:
    """Without what rounding leaves between ``P`` and its transpose."""
    return (P + np.swapaxes(P, -1, -2)) / 2


def drift_covariance(priors: Priors, spans: Ordered[Span]) -> Array:
    """Covariance (2, n, n) of means of gyro and accelerometer biases about those switched on.

    Instability, random walk and ramp since time 0 of the spans; no turn cancels that. Biases have
    the prior `switched_on` beside it, and early positions tell more of them than late ones do.
    """
    return _drifts(priors, tuple(spans))


def steady_drift(priors: Priors, span: Span) -> Array:
    """Variances (2,) of how far biases drift from end to end of a position, as its halves show it.

    Twice what their means differ by: of a ramp all it rises by, of a random walk 4/3 of its
    variance, for the slope that fits best has 6/5 of it.
    """
    half = span.length / 2
    halves = [Span(span.start, half), Span(span.start + half, half)]
    apart = np.array([-2.0, 2.0])
    return np.asarray(np.einsum("i,sij,j->s", apart, drift_covariance(priors, halves), apart))


@lru_cache(maxsize=64)  # every run of a procedure has the same times
def _drifts(priors: Priors, spans: tuple[Span, ...]) -> Array:
    found = walked(priors, spans)
    heights = np.array([priors.gyro_instability, priors.accel_instability])
    if heights.any():
        unit = sum(one.sigma**2 * gauss_markov(spans, one.time) for one in flicker(1.0))
        found = found + np.square(heights)[:, None, None] * unit
    found.flags.writeable = False  # there is one for all who ask
    return found


def rounding_covariance(left: Array, means: Array, steps: Array) -> Array:
    """Covariance (6, n, n) of means (n, 6) by what rounding leaves of them, `left` (n, 6) each.

    Positions that read alike, by less than a part of their `steps` (6,), may share all of it or
    nothing: nobody knows how near they truly are. So it is counted once as common to them, for the
    biases' sake, and once as each one's own.
    """
    apart = means.T[:, :, None] - means.T[:, None, :]
    scale = np.where(steps > 0, 2 * np.pi / np.where(steps > 0, steps, 1.0), 0.0)
    alike = np.exp(-0.5 * (apart * scale[:, None, None]) ** 2)
    root = np.sqrt(left.T)
    common = root[:, :, None] * alike * root[:, None, :]
    n = len(means)
    nearest = np.where(np.eye(n, dtype=bool), 0.0, alike).max(axis=2)
    common[:, np.arange(n), np.arange(n)] += nearest * left.T
    return np.asarray(common)


def equal_spans(n: int, seconds: float) -> list[Span]:
    """The times of `n` positions that follow one another at once, `seconds` in all."""
    return [Span(k * seconds / n, seconds / n) for k in range(n)]


def local_vectors(site: Site) -> tuple[float | None, float | None]:
    """Latitude [rad] between plumb line and Earth's axis, and gravity [m/s^2]; None if unknown."""
    if site.latitude is None:
        return None, site.local_gravity
    w = site.plumb.inv().apply(site.w_ie_n)
    return float(np.arctan2(-w[2], np.hypot(w[0], w[1]))), site.gravity
