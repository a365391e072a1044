"""Least squares fit of several positions: attitudes and biases at once, with priors."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence
from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.earth import EARTH_RATE, Site, normal_gravity
from alignment.errors import PoleError
from alignment.levelling import attitude_from_means
from alignment.options import Priors

# standard deviations of what nobody stated: wider than any instrument that could gyrocompass
UNKNOWN_BIAS = np.repeat([0.01, 0.5], 3)  # rad/s, m/s^2
UNKNOWN_LATITUDE = 1.0  # rad
UNKNOWN_GRAVITY = 0.03  # m/s^2: 9.78 to 9.83 over the Earth
ROUNDING = np.repeat([1e-10, 1e-7], 3)  # rad/s (2e-5 deg/h), m/s^2: no mean is surer than this
SEEN = 0.5  # part of its prior that a bias must come down to
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
        J[..., part, :] = cross_matrix(v[..., 0]) @ to_turn
        J[..., part, 0:3] = C_kn @ cross_matrix(vector)[..., None, :, :]
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
