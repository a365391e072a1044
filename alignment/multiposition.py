"""Gyrocompassing in several positions: what turns with the instrument is not the Earth.

Constant biases stay in b while the table turns b, so several positions tell them from Earth rate
and gravity. Readings of all positions are fitted at once by least squares; what no turn can show
stays at its prior. Source: [S4] double gyrocompassing, methods.md section 2; rebuilt as a
maximum a posteriori fit.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from alignment.angles import Sequence
from alignment.arrays import Array
from alignment.earth import EARTH_RATE, Site, normal_gravity
from alignment.errors import AlignmentError, PoleError
from alignment.estimate import AttitudeEstimate
from alignment.levelling import attitude_from_means
from alignment.noise import check_at_rest, gap_doubt, mean_and_variance
from alignment.options import Options, Priors
from alignment.readings import Dwell
from alignment.saturation import CHANNELS, saturation_doubt
from alignment.static import heading_doubt
from alignment.units import ARC_MINUTE

TWO_POSITION = "two-position"
MULTI_POSITION = "multi-position"

# standard deviations of what nobody stated: wider than any instrument that could gyrocompass
UNKNOWN_BIAS = np.repeat([0.01, 0.5], 3)  # rad/s, m/s^2
UNKNOWN_LATITUDE = 1.0  # rad
UNKNOWN_GRAVITY = 0.03  # m/s^2: 9.78 to 9.83 over the Earth
ANOMALY = 5e-4  # m/s^2: of gravity about its WGS 84 value, where nobody measured it
ROUNDING = np.repeat([1e-10, 1e-7], 3)  # rad/s (2e-5 deg/h), m/s^2: no mean is surer than this

LEAST_TURN = np.radians(30.0)  # below it biases hardly change sides
SEEN = 0.5  # part of its prior that a bias must come down to
MISFIT = 1e-3  # probability of chi-square above which positions contradict one another
AMBIGUOUS = 12.0  # margin of chi-square: odds of 400 to 1

_EXACT = 1e-12  # a scale error not stated beside one that is
_ITERATIONS = 30
_CONVERGED = 1e-9  # rad, and parts of a standard deviation
_POLE = 1e-3  # least horizontal part of Earth rate
_ANOTHER = np.radians(1.0)  # two ends farther apart than this are two attitudes
_GRAVITY = 9.81  # m/s^2, to start from
_DOUBTED = 0.05  # part of Earth rate: a component known worse may have either sign
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
    bias_prior : (6,)
        Standard deviations before the fit.
    latitude, latitude_sigma : (...) rad, or None where it was given
    chi2, freedom : (...)
        Sum of squared residuals and priors over their variances; its expectation.
    rank : int
        How many of attitude (3) and biases (6) the readings alone determine.
    margin : (...)
        By how much chi-square of another attitude exceeds this one's; inf where there is none.
    """

    C_nb: Array
    covariance: Array
    biases: Array
    bias_covariance: Array
    cross: Array
    bias_prior: Array
    latitude: Array | None
    latitude_sigma: Array | None
    chi2: Array
    freedom: Array
    rank: int
    margin: Array

    @property
    def unseen(self) -> Array:
        """Which biases (..., 6) stayed near their prior: the turns do not show them."""
        return np.sqrt(np.einsum("...ii->...i", self.bias_covariance)) > SEEN * self.bias_prior


@dataclass(frozen=True, slots=True, eq=False)
class _Unknowns:
    """Where each group of unknowns lies in the vector of p, and the prior sigmas (p - 3,).

    Attitude comes first and has no prior; then biases; then scale errors, placements (n, 3), seat,
    latitude and gravity where they are unknown. `vague`: which priors nobody stated.
    """

    sigmas: Array
    vague: Array
    scale: slice
    placement: slice
    seat: slice
    latitude: slice
    gravity: slice

    @property
    def count(self) -> int:
        return 3 + len(self.sigmas)

    def misplaced(self, relative: Array) -> Array:
        """Small turns (n, 3, p) in b of each position that unknowns give it beside the told one.

        A seat turned by m in b makes of the told turn R another one: ``exp(-m) R exp(m)``, to
        first order R turned on by ``m - R^T m``.
        """
        n = len(relative)
        to_turn = np.zeros((n, 3, self.count))
        if self.placement.stop > self.placement.start:
            for k in range(n):
                at = self.placement.start + 3 * k
                to_turn[k, :, at : at + 3] = np.eye(3)
        if self.seat.stop > self.seat.start:
            to_turn[:, :, self.seat] = np.eye(3) - relative.transpose(0, 2, 1)
        return to_turn


def _unknowns(n: int, priors: Priors, latitude_known: bool, gravity_sigma: float) -> _Unknowns:
    stated = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    groups = [
        np.where(stated > 0, stated, UNKNOWN_BIAS),
        np.maximum(scale, _EXACT) if scale.any() else scale[:0],
        np.full(3 * n if priors.turn > 0 else 0, priors.turn),
        np.full(3 if priors.seat > 0 else 0, priors.seat),
        np.full(0 if latitude_known else 1, UNKNOWN_LATITUDE),
        np.full(1 if gravity_sigma > 0 else 0, gravity_sigma),
    ]
    ends = 3 + np.cumsum([len(group) for group in groups])
    parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    vague = np.zeros(ends[-1] - 3, dtype=bool)
    vague[:6] = stated == 0
    vague[parts[2].start - 3 : parts[2].stop - 3] = True
    return _Unknowns(np.concatenate(groups), vague, *parts)


def fit_positions(
    means: Array,
    variances: Array,
    relative: Array,
    latitude: float | None,
    gravity: float | None,
    priors: Priors,
    gravity_sigma: float = 0.0,
) -> PositionFit:
    """Attitude of every position and the biases, from the means of all of them.

    Parameters
    ----------
    means : (..., n, 6)
        Mean rates [rad/s] and specific forces [m/s^2] of each position.
    variances : (..., n, 6)
        Of these means.
    relative : (n, 3, 3)
        ``C_b0_bk`` by the encoders: takes components of position k to those of position 0.
    latitude, gravity : float or None
        [rad], [m/s^2]; None: estimated.
    priors : Priors
        Biases and scale errors of each axis; `turn` is the placement of each position about each
        of its three axes, `seat` that of b on the table. A bias of 0 here means that nobody
        knows it, not that there is none.
    gravity_sigma : float
        Of a gravity that is given [m/s^2].

    Raises
    ------
    PoleError
        No horizontal Earth rate is left after the biases are taken out.

    Notes
    -----
    Model: ``y_k = (1 + K)(C_nbk^T (w_ie, -g)) + b + noise``, ``C_nbk = C_nb0 C_b0_bk exp(d_k)``,
    `d_k` being its placement and what the seat makes of its turn; Gauss-Newton by QR, started from
    linear fits of the two vectors and the biases; of two ends the likelier one.
    """
    lead, n = means.shape[:-2], means.shape[-2]
    sigma = np.sqrt(np.broadcast_to(variances, means.shape) + ROUNDING**2).reshape(-1, n, 6)
    y = means.reshape(-1, n, 6)
    unknown_gravity = UNKNOWN_GRAVITY if gravity is None else gravity_sigma
    unknowns = _unknowns(n, priors, latitude is not None, unknown_gravity)
    given = latitude, gravity
    starts, hidden = _starts(y, sigma, relative, unknowns)
    ends = [_descended(start, y, sigma, relative, given, unknowns) for start in starts]
    C, x, margin = _likeliest(ends)
    if hidden is not None:
        start = _mirrored(C, x, hidden, latitude, unknowns)
        ends.append(_descended(start, y, sigma, relative, given, unknowns))
        C, x, margin = _likeliest(ends)
    C, x = C.reshape(*lead, 3, 3), x.reshape(*lead, unknowns.count)
    sigma = sigma.reshape(means.shape)
    predicted, J = _readings(C, x, relative, given, unknowns)
    fit = _result(C, x, (means - predicted) / sigma, J / sigma[..., None], relative, unknowns)
    return replace(fit, margin=margin.reshape(lead))


def _likeliest(ends: list[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    """Of several ends (C, x, cost) the best of each run, and by how much (r,) another one's cost
    exceeds it."""
    attitudes, unknowns, costs = (np.stack(parts) for parts in zip(*ends, strict=True))
    best, runs = np.argmin(costs, axis=0), np.arange(costs.shape[1])
    C = attitudes[best, runs]
    between = Rotation.from_matrix((attitudes @ np.swapaxes(C, -1, -2)).reshape(-1, 3, 3))
    another = between.magnitude().reshape(costs.shape) > _ANOTHER
    margins = np.where(another, costs - costs[best, runs], np.inf)
    return C, unknowns[best, runs], margins.min(axis=0)


def _mirrored(
    C: Array, x: Array, hidden: Array, latitude: float | None, unknowns: _Unknowns
) -> tuple[Array, Array]:
    """Start from the other sign of the rate along the axis that the turns do not show."""
    lat = x[:, unknowns.latitude][:, 0] if latitude is None else np.full(len(C), latitude)
    w_n = EARTH_RATE * np.stack([np.cos(lat), np.zeros(len(C)), -np.sin(lat)], axis=1)
    w = np.einsum("rji,rj->ri", C, w_n)
    flipped = 2 * (w @ hidden)[:, None] * hidden
    x = x.copy()
    x[:, 3:6] += flipped
    up = -C[:, 2]
    return attitude_from_means(w - flipped, up, Sequence.YAW_PITCH_ROLL).as_matrix(), x


def _descended(
    start: tuple[Array, Array],
    y: Array,
    sigma: Array,
    relative: Array,
    given: tuple[float | None, float | None],
    unknowns: _Unknowns,
) -> tuple[Array, Array, Array]:
    """Attitudes (r, 3, 3), unknowns (r, p) and costs (r,) that Gauss-Newton ends in."""
    C, x = (part.copy() for part in start)
    active = np.arange(len(y))
    for _ in range(_ITERATIONS):
        predicted, J = _readings(C[active], x[active], relative, given, unknowns)
        noise = sigma[active]
        step, _ = _step((y[active] - predicted) / noise, J / noise[..., None], x[active], unknowns)
        # beyond a radian the linear system says nothing
        turn = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
        step = step / np.maximum(turn, 1.0)
        C[active] = _turned(step[:, :3], C[active])
        x[active, 3:] += step[:, 3:]
        scaled = np.concatenate([step[:, :3], step[:, 3:] / unknowns.sigmas], axis=1)
        active = active[np.abs(scaled).max(axis=1) >= _CONVERGED]
        if not len(active):
            break
    predicted, J = _readings(C, x, relative, given, unknowns)
    _, whole = _system((y - predicted) / sigma, J, x, unknowns)
    return C, x, np.sum(whole**2, axis=-1)


def predicted_covariance(
    C_nb: Array,
    variances: Array,
    relative: Array,
    latitude: float,
    gravity: float,
    priors: Priors,
    estimated: bool = False,
) -> Array:
    """Covariance (n, 3, 3) about n of each position's attitude, before there are readings.

    `C_nb` (3, 3) of position 0; `variances` (n, 6) of the means; `estimated`: whether the fit is
    not given latitude and gravity; the rest as `fit_positions`.
    """
    given = (None, None) if estimated else (latitude, gravity)
    unknowns = _unknowns(len(relative), priors, not estimated, UNKNOWN_GRAVITY * estimated)
    x = np.zeros(unknowns.count)
    x[unknowns.latitude] = latitude
    predicted, J = _readings(C_nb, x, relative, given, unknowns)
    sigma = np.sqrt(variances + ROUNDING**2)
    return _result(C_nb, x, 0 * predicted, J / sigma[..., None], relative, unknowns).covariance


def _turned(eta: Array, C: Array) -> Array:
    """``exp(eta x) C`` for (..., 3) and (..., 3, 3)."""
    turns = Rotation.from_rotvec(eta.reshape(-1, 3)).as_matrix()
    return np.asarray(turns.reshape(*eta.shape, 3) @ C)


def _cross_matrix(v: Array) -> Array:
    """Matrices (..., 3, 3) with ``M u = v x u``."""
    M = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        M[..., i, j], M[..., i, k] = -v[..., k], v[..., j]
    return M


def _starts(
    y: Array, sigma: Array, relative: Array, unknowns: _Unknowns
) -> tuple[list[tuple[Array, Array]], Array | None]:
    """Attitudes (r, 3, 3) of position 0 and unknowns (r, p) to start from; the hidden axis.

    Linear least squares for each triad: ``y_k = R_k^T u + b``, `u` no larger than it can be. Where
    the turns do not tell the rate along their axis from its bias, there are two starts: along the
    axis (3,) in b, either way what is missing of Earth rate.
    """
    w, w_bias, weak, doubt = _linear(y[..., :3], sigma[..., :3], relative, unknowns, EARTH_RATE)
    f, f_bias, _, _ = _linear(y[..., 3:], sigma[..., 3:], relative, unknowns, _GRAVITY)
    candidates, hidden = [(w, w_bias)], None
    if doubt > _DOUBTED * EARTH_RATE:
        hidden = weak
        along = w @ weak
        across = w - along[:, None] * weak
        missing = EARTH_RATE**2 - np.sum(across**2, axis=1)
        size = np.sqrt(np.maximum(missing, (_DOUBTED * EARTH_RATE) ** 2))
        candidates = [
            (across + sign * size[:, None] * weak, w_bias + (along - sign * size)[:, None] * weak)
            for sign in (1.0, -1.0)
        ]
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    level_parts = [np.linalg.norm(np.cross(w, up), axis=1) for w, _ in candidates]
    if np.any(np.max(level_parts, axis=0) < _POLE * EARTH_RATE):
        raise PoleError("mean rate and vertical are collinear: heading is undefined")
    starts = []
    for w, w_bias in candidates:
        x = np.zeros((len(y), unknowns.count))
        x[:, 3:9] = np.concatenate([w_bias, f_bias], axis=1)
        lean = np.einsum("ri,ri->r", w, up) / np.linalg.norm(w, axis=1)
        x[:, unknowns.latitude] = np.arcsin(np.clip(lean, -_LATITUDE_START, _LATITUDE_START))[
            :, None
        ]
        C = attitude_from_means(w, f, Sequence.YAW_PITCH_ROLL).as_matrix()
        starts.append((C, x))
    return starts, hidden


def _linear(
    y: Array, sigma: Array, relative: Array, unknowns: _Unknowns, size: float
) -> tuple[Array, Array, Array, float]:
    """Vectors (r, 3), biases (r, 3), the direction (3,) known worst, and its sigma."""
    n = len(relative)
    bias_sigma = unknowns.sigmas[:3] if size == EARTH_RATE else unknowns.sigmas[3:6]
    A = np.zeros((3 * n + 6, 6))
    A[: 3 * n, :3] = relative.transpose(0, 2, 1).reshape(3 * n, 3)
    A[: 3 * n, 3:] = np.tile(np.eye(3), (n, 1))
    # one noise for all positions is enough to start from
    noise = float(np.sqrt(np.mean(sigma**2)))
    A[: 3 * n] /= noise
    A[3 * n :] = np.diag(1 / np.concatenate([np.full(3, size), bias_sigma]))
    inverse = np.linalg.pinv(A)
    solution = y.reshape(len(y), 3 * n) / noise @ inverse[:, : 3 * n].T
    variances, directions = np.linalg.eigh((inverse @ inverse.T)[:3, :3])
    worst = float(np.sqrt(variances[-1]))
    return solution[:, :3], solution[:, 3:], directions[:, -1], worst


def _readings(
    C: Array,
    x: Array,
    relative: Array,
    given: tuple[float | None, float | None],
    unknowns: _Unknowns,
) -> tuple[Array, Array]:
    """Predicted readings (..., n, 6) and their Jacobian (..., n, 6, p)."""
    n = len(relative)
    lead = x.shape[:-1]
    latitude, gravity = given
    lat = x[..., unknowns.latitude][..., 0] if latitude is None else np.full(lead, latitude)
    g = _normal_gravity(lat) if gravity is None else np.full(lead, gravity)
    heavier = unknowns.gravity.stop > unknowns.gravity.start
    if heavier:
        g = g + x[..., unknowns.gravity][..., 0]
    zero = np.zeros(lead)
    w_n = EARTH_RATE * np.stack([np.cos(lat), zero, -np.sin(lat)], axis=-1)
    f_n = np.stack([zero, zero, -g], axis=-1)
    to_turn = unknowns.misplaced(relative)
    C_k = _placed(C, x, relative, to_turn)
    C_kn = np.swapaxes(C_k, -1, -2)
    felt, J = [], np.zeros((*lead, n, 6, unknowns.count))
    for part, vector in ((slice(0, 3), w_n), (slice(3, 6), f_n)):
        v = C_kn @ vector[..., None, :, None]
        felt.append(v[..., 0])
        J[..., part, :] = _cross_matrix(v[..., 0]) @ to_turn
        J[..., part, 0:3] = C_kn @ _cross_matrix(vector)[..., None, :, :]
    true = np.concatenate(felt, axis=-1)
    J[..., 3:9] = np.eye(6)
    scale = np.zeros((*lead, 1, 6))
    if unknowns.scale.stop > unknowns.scale.start:
        scale = x[..., None, unknowns.scale]
        turned = [*range(3), *range(unknowns.placement.start, unknowns.seat.stop)]
        J[..., turned] *= 1 + scale[..., None]
        J[..., unknowns.scale] = true[..., None] * np.eye(6)
    if latitude is None:
        by_lat = EARTH_RATE * np.stack([-np.sin(lat), zero, -np.cos(lat)], axis=-1)
        J[..., :3, unknowns.latitude] = C_kn @ by_lat[..., None, :, None]
    if heavier:
        J[..., 3:, unknowns.gravity] = true[..., 3:, None] / g[..., None, None, None]
    return (1 + scale) * true + x[..., None, 3:9], J


def _placed(C: Array, x: Array, relative: Array, to_turn: Array) -> Array:
    """Attitudes (..., n, 3, 3) of all positions from that of position 0 and the unknowns."""
    C_k = C[..., None, :, :] @ relative
    d = np.einsum("nip,...p->...ni", to_turn, x)
    if not to_turn.any():
        return np.asarray(C_k)
    turns = Rotation.from_rotvec(d.reshape(-1, 3)).as_matrix()
    return np.asarray(C_k @ turns.reshape(*d.shape, 3))


def _normal_gravity(latitude: Array) -> Array:
    """WGS 84 on the ellipsoid, of many latitudes."""
    return np.vectorize(normal_gravity, otypes=[float])(latitude)


def _system(residual: Array, J: Array, x: Array, unknowns: _Unknowns) -> tuple[Array, Array]:
    """Whitened rows of readings and priors: matrix (..., m, p) in units of the priors, vector."""
    lead, p = x.shape[:-1], unknowns.count
    units = np.concatenate([np.ones(3), unknowns.sigmas])
    prior = np.broadcast_to(np.eye(p)[3:], (*lead, p - 3, p))
    A = np.concatenate([J.reshape(*lead, -1, p) * units, prior], axis=-2)
    expected = -x[..., 3:] / unknowns.sigmas
    return A, np.concatenate([residual.reshape(*lead, -1), expected], axis=-1)


def _step(residual: Array, J: Array, x: Array, unknowns: _Unknowns) -> tuple[Array, Array]:
    """Step (..., p) to the least squares solution, and the root (..., p, p) of the covariance."""
    A, y = _system(residual, J, x, unknowns)
    Q, R = np.linalg.qr(A)
    diagonal = np.abs(np.einsum("...ii->...i", R))
    if np.any(diagonal[..., :3] == 0):
        raise PoleError("readings do not determine the attitude: heading is undefined")
    inverse = np.linalg.inv(R)
    units = np.concatenate([np.ones(3), unknowns.sigmas])
    root = units[:, None] * inverse
    return (root @ (np.swapaxes(Q, -1, -2) @ y[..., None]))[..., 0], root


def _result(
    C: Array, x: Array, residual: Array, J: Array, relative: Array, unknowns: _Unknowns
) -> PositionFit:
    n = len(relative)
    lead = x.shape[:-1]
    _, root = _step(residual, J, x, unknowns)
    P = root @ np.swapaxes(root, -1, -2)
    to_turn = unknowns.misplaced(relative)
    C_k = _placed(C, x, relative, to_turn)
    # position k turns with position 0, and by its own misplacement seen in n
    to_n = C_k @ to_turn
    to_n[..., :3] = np.eye(3)
    half = to_n @ P[..., None, :, :]
    _, whole = _system(residual, J, x, unknowns)
    estimated = unknowns.latitude.stop > unknowns.latitude.start
    at = unknowns.latitude.start
    return PositionFit(
        C_nb=C_k,
        covariance=half @ np.swapaxes(to_n, -1, -2),
        biases=x[..., 3:9],
        bias_covariance=P[..., 3:9, 3:9],
        cross=half[..., 3:9],
        bias_prior=unknowns.sigmas[:6],
        latitude=x[..., at] if estimated else None,
        latitude_sigma=np.sqrt(P[..., at, at]) if estimated else None,
        chi2=np.sum(whole**2, axis=-1),
        freedom=6 * n - 3 - _spent(P, unknowns),
        rank=_rank(J, unknowns),
        margin=np.full(lead, np.inf),
    )


def _spent(P: Array, unknowns: _Unknowns) -> Array:
    """How many readings (...) went into unknowns whose prior is so vague that it adds nothing."""
    kept = np.einsum("...ii->...i", P)[..., 3:] / unknowns.sigmas**2
    return np.asarray(np.sum((1 - kept) * unknowns.vague, axis=-1))


def _rank(J: Array, unknowns: _Unknowns) -> int:
    """Of the readings' Jacobian for attitude and biases, in units of noise and priors.

    A direction counts that the readings of the first run know better than the priors do.
    """
    units = np.concatenate([np.ones(3), unknowns.sigmas[:6]])
    A = J.reshape(-1, *J.shape[-3:])[0].reshape(-1, unknowns.count)[:, :9] * units
    return int(np.sum(np.linalg.svd(A, compute_uv=False) > 1.0))


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
        No nominal attitudes, or no two successive dwells 30 deg apart.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: placement ``(d180 - d0)/2`` in heading; white noise
    ``ARW/(W cos lat sqrt(T))`` with T the time of both dwells; drift of the biases between them.
    """
    dwells = _in_time(dwells)
    summaries = _summaries(dwells)
    estimates = []
    for k in range(len(dwells) - 1):
        pair = dwells[k : k + 2]
        if _widest_turn(pair) >= LEAST_TURN:
            found = _estimates(TWO_POSITION, pair, summaries[k : k + 2], site, options)
            estimates.append(found[0])
    if not estimates:
        raise AlignmentError("too little turn: no two successive dwells are 30 deg or more apart")
    return estimates


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
        Fewer than two dwells, no nominal attitudes, or no two of them 30 deg apart.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: placements (in each attitude its own, less what the others tell of it); white
    noise ``ARW/(W cos lat sqrt(T))``, T the time of all dwells; drift of the biases. With three
    positions or more the placements themselves show, as far as Earth rate and scale are known:
    leave `gyro_scale` at 0 only where it is.
    """
    if len(dwells) < 2:
        raise AlignmentError(f"too little turn: {len(dwells)} dwells, at least 2 are needed")
    dwells = _in_time(dwells)
    summaries = _summaries(dwells)
    if _widest_turn(dwells) < LEAST_TURN:
        raise AlignmentError("too little turn: no two dwells are 30 deg or more apart")
    return _estimates(MULTI_POSITION, dwells, summaries, site, options)


def _in_time(dwells: Ordered[Dwell]) -> list[Dwell]:
    """Successive is meant in time: the order in which dwells are handed over does not matter."""
    return sorted(dwells, key=lambda dwell: dwell.t_from)


def _summaries(dwells: Ordered[Dwell]) -> list[tuple[Array, Array]]:
    for dwell in dwells:
        check_at_rest(dwell)
        _told(dwell)
    return [mean_and_variance(dwell.window()) for dwell in dwells]


def _told(dwell: Dwell) -> Rotation:
    if dwell.nominal is None:
        raise AlignmentError(f"{dwell.label}: nobody said the attitude that the table was told")
    return dwell.nominal


def _widest_turn(dwells: Ordered[Dwell]) -> float:
    """Largest turn [rad] between any two nominal attitudes."""
    quats = np.array([_told(dwell).as_quat() for dwell in dwells])
    return float(2 * np.arccos(np.clip(np.abs(quats @ quats.T).min(), 0, 1)))


def pooled_variances(variances: Array, spans: Array) -> Array:
    """Variances (n, 6) of means over `spans` (n,) [s] when all dwells share one noise density.

    One instrument, one noise: n times the degrees of freedom that one dwell's blocks have.
    """
    density = np.mean(variances * spans[:, None], axis=0)
    return density / spans[:, None]


def drift_variances(priors: Priors, n: int) -> Array:
    """By how much (6,) biases of one of n positions leave their common mean: no turn cancels that.

    Notes
    -----
    Two positions: the squared Allan deviation, so that their means differ by twice it and half a
    turn has the sigma of `double_sigma`. Flicker goes on growing over more of them, by
    ``n ln n / (2 (n - 1) ln 2)``: J. A. Barnes, Tables of bias functions, NBS TN 375 (1969).
    """
    plateau = np.repeat([priors.gyro_instability, priors.accel_instability], 3)
    if n < 2:
        return np.zeros(6)
    return np.asarray(plateau**2 * n * np.log(n) / (2 * (n - 1) * np.log(2)))


def local_vectors(site: Site) -> tuple[float | None, float | None]:
    """Latitude [rad] between plumb line and Earth's axis, and gravity [m/s^2]; None if unknown."""
    if site.latitude is None:
        return None, site.local_gravity
    w = site.plumb.inv().apply(site.w_ie_n)
    return float(np.arctan2(-w[2], np.hypot(w[0], w[1]))), site.gravity


def _estimates(
    method: str,
    dwells: Ordered[Dwell],
    summaries: Ordered[tuple[Array, Array]],
    site: Site,
    options: Options,
) -> list[AttitudeEstimate]:
    means, scatter = (np.array(values) for values in zip(*summaries, strict=True))
    spans = np.array([dwell.t_to - dwell.t_from for dwell in dwells])
    t_from, t_to = min(d.t_from for d in dwells), max(d.t_to for d in dwells)
    variances = pooled_variances(scatter, spans)
    first = _told(dwells[0]).inv()
    relative = np.array([(first * _told(dwell)).as_matrix() for dwell in dwells])
    latitude, gravity = local_vectors(site)
    if latitude is not None:
        site.horizontal_rate()  # refuses at a pole
    anomaly = ANOMALY if site.local_gravity is None else 0.0
    drifting = variances + drift_variances(options.priors, len(dwells))
    fit = fit_positions(means, drifting, relative, latitude, gravity, options.priors, anomaly)
    shared = _doubts(fit) + _verdict(fit, variances, relative, (latitude, gravity), options.priors)
    return [
        AttitudeEstimate(
            method,
            dwell.label,
            t_from,
            t_to,
            site.plumb * Rotation.from_matrix(fit.C_nb[k]),
            options.rule.sequence_for(_told(dwell).inv().apply([0.0, 0.0, -1.0])),
            covariance=fit.covariance[k],
            latitude=None if fit.latitude is None else float(fit.latitude) - site.deflection[0],
            latitude_sigma=None if fit.latitude_sigma is None else float(fit.latitude_sigma),
            flags=gap_doubt(dwell.window())
            + saturation_doubt(dwell.label, dwell.window())
            + heading_doubt(fit.covariance[k])
            + shared,
            biases=fit.biases,
            bias_sigmas=np.sqrt(fit.bias_covariance.diagonal()),
        )
        for k, dwell in enumerate(dwells)
    ]


def _doubts(fit: PositionFit) -> tuple[str, ...]:
    hidden = [name for name, unseen in zip(CHANNELS, fit.unseen, strict=True) if unseen]
    flags = (f"biases not shown by these turns: {', '.join(hidden)}",) if hidden else ()
    if fit.margin < AMBIGUOUS:
        flags += (
            "ambiguous: another attitude fits nearly as well (chi-square "
            f"{float(fit.margin):.1f} more); a turn about a second axis would tell",
        )
    if fit.chi2 > chdtri(fit.freedom, MISFIT):
        flags += (
            f"positions contradict one another: chi-square {float(fit.chi2):.0f} for "
            f"{float(fit.freedom):.0f} degrees of freedom (bias drifts, or other turns than told)",
        )
    return flags


def _verdict(
    fit: PositionFit,
    variances: Array,
    relative: Array,
    given: tuple[float | None, float | None],
    priors: Priors,
) -> tuple[str, ...]:
    """Whether the turns paid, and of two positions 90 against 180 deg; empty without a bias."""
    if not priors.gyro_bias:
        return ()
    latitude = float(fit.latitude) if fit.latitude is not None else given[0]
    assert latitude is not None
    gravity = given[1] or normal_gravity(latitude)
    # the noise of the mean of all positions: what one alone would have in all the time
    whole = 1 / np.sum(1 / (variances + ROUNDING**2), axis=0)

    def heading(turns: Array) -> float:
        shared = np.tile(len(turns) * whole + drift_variances(priors, len(turns)), (len(turns), 1))
        P = predicted_covariance(
            fit.C_nb[0], shared, turns, latitude, gravity, priors, given[0] is None
        )
        return float(np.sqrt(P[0, 2, 2]))

    one, several = heading(relative[:1]), float(np.sqrt(fit.covariance[0, 2, 2]))
    if len(relative) > 2:
        return (_pays(several, one),)
    axis = Rotation.from_matrix(relative[1]).as_rotvec()
    axis = axis / np.linalg.norm(axis)
    half, quarter = (heading(_turns(axis, angle)) for angle in (np.pi, np.pi / 2))
    return (f"{_pays(several, one)}; 180 deg: {_minutes(half)}, 90 deg: {_minutes(quarter)}",)


def _turns(axis_b: Array, angle: float) -> Array:
    """Relative attitudes (2, 3, 3) of a position and of one turned [rad] about an axis."""
    return Rotation.from_rotvec(np.outer([0.0, angle], axis_b)).as_matrix()


def _minutes(angle: float) -> str:
    return f"{angle / ARC_MINUTE:.3g}'"


def _pays(several: float, one: float) -> str:
    """In words; sigmas of heading [rad] with and without turns."""
    verdict = "pay" if several < one else "do not pay"
    return (
        f"turns {verdict}: heading sigma {_minutes(several)} "
        f"against {_minutes(one)} of one position in the same time"
    )


# --- does a turn pay? ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TurnPays:
    """Predicted sigma of heading [rad] in one position, or turned half-way, by a half or quarter.

    The same total time each. `verdict` in words.
    """

    one_position: float
    half_turn: float
    quarter_turn: float

    @property
    def pays(self) -> bool:
        """Whether any turn is better than none."""
        return min(self.half_turn, self.quarter_turn) < self.one_position

    @property
    def verdict(self) -> str:
        """For a person."""
        best = min(self.half_turn, self.quarter_turn)
        angle = "180" if self.half_turn <= self.quarter_turn else "90"
        return f"{_pays(best, self.one_position)}; {angle} deg is the better turn"


def turn_pays(
    C_nb: Rotation,
    site: Site,
    priors: Priors,
    seconds: float,
    axis_b: ArrayLike = (0.0, 1.0, 0.0),
    gyros: ArrayLike = (True, True, True),
) -> TurnPays:
    """Turn error against bias: sigma of heading with and without a turn about `axis_b`.

    Parameters
    ----------
    C_nb : Rotation
        Attitude before the turn.
    site : Site
        Latitude known.
    priors : Priors
        Of the unit (`gyro_bias` stated; `gyro_walk` and `accel_walk` give the noise) and the
        table (`turn`).
    seconds : float
        Of rest, all positions together.
    axis_b : (3,)
        In b.
    gyros : (3,) bool
        Which gyros there are; the others are left out.

    Raises
    ------
    AlignmentError
        The bias is not stated, or the latitude.
    PoleError

    Notes
    -----
    With one gyro, known latitude and its axis east or west, a quarter turn is free of the turn
    error to first order (it looks along the meridian, where azimuth does not show) but scale
    error enters 1:1; a half turn carries half of the difference of both placements.
    """
    if not priors.gyro_bias > 0:
        raise AlignmentError("gyro_bias: not stated, so nothing tells whether a turn pays")
    site.horizontal_rate()
    latitude, gravity = local_vectors(site)
    assert latitude is not None
    assert gravity is not None
    axis = np.asarray(axis_b, dtype=float)
    axis = axis / np.linalg.norm(axis)
    density = np.repeat([priors.gyro_walk, priors.accel_walk], 3) ** 2
    density[:3] = np.where(np.asarray(gyros, dtype=bool), density[:3], _ABSENT * seconds)

    def heading(*angles: float) -> float:
        relative = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
        variances = np.tile(density * len(angles) / seconds, (len(angles), 1))
        variances += drift_variances(priors, len(angles))
        P = predicted_covariance(C_nb.as_matrix(), variances, relative, latitude, gravity, priors)
        return float(np.sqrt(P[0, 2, 2]))

    return TurnPays(heading(0.0), heading(0.0, np.pi), heading(0.0, np.pi / 2))


_ABSENT = 1.0  # (rad/s)^2: variance of a gyro that is not there


def half_turn_means(first: Array, second: Array, axis: int = 1) -> Array:
    """Means (..., 6) in axes of the first position, from it and one turned by 180 deg about `axis`.

    [S4]: half differences across the axis, which are free of constant biases, and half sums along
    it, which are not: the axis's own bias stays, and tilts it into heading.
    """
    signs = np.full(3, -1.0)
    signs[axis] = 1.0
    return (first + np.tile(signs, 2) * second) / 2


# --- how long noise takes ------------------------------------------------------------------------


def double_sigma(adev: ArrayLike, latitude: float) -> Array:
    """Heading sigma [rad] of a half turn with two gyros: ``ADEV(T/2) / (sqrt 2 W cos lat)``.

    `adev` [rad/s] is the Allan deviation at half the time: it covers all drift terms at once.
    """
    return np.asarray(adev) / (np.sqrt(2) * EARTH_RATE * np.cos(latitude))


def time_needed(
    target: float, latitude: float, walk: float, instability: float = 0.0, rate_walk: float = 0.0
) -> float | None:
    """Seconds until `double_sigma` falls to `target` [rad]; None: never.

    Parameters
    ----------
    target : float
        Heading sigma wanted [rad].
    latitude : float
        [rad]
    walk : float
        Angle random walk N [rad/sqrt(s)].
    instability : float
        Floor of the Allan deviation [rad/s] (0.664 times the bias instability B).
    rate_walk : float
        Rate random walk K [rad/s/sqrt(s)].

    Notes
    -----
    ``ADEV(tau)^2 = N^2/tau + floor^2 + K^2 tau/3`` with tau = T/2, solved for the first tau.
    White noise alone: ``T = (N / (W cos lat target))^2``.
    """
    allowed = 2 * (EARTH_RATE * np.cos(latitude) * target) ** 2 - instability**2
    if allowed <= 0:
        return None
    # K^2/3 tau^2 - allowed tau + N^2 = 0, in the form that does not cancel for small K
    root = allowed**2 - 4 * walk**2 * rate_walk**2 / 3
    if root < 0:
        return None
    return float(2 * 2 * walk**2 / (allowed + np.sqrt(root)))
