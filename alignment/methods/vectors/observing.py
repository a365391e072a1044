"""The observing form: matching what passed through the orientation matrix, solved orthonormally.

With ``p = int C_b0b f dt`` and q its integral (gyros and accelerometers alone), and P, Q what the
satellites say less gravitation, ``P_k = v0 + C p_k`` and ``Q_k = r0 + v0 t_k + C q_k`` in an
inertial frame: no Coriolis term, no turn of the vertical is left out. The start's place and
velocity are fitted along with C instead of being taken from one noisy fix, and the matrix is the
proper rotation that fits all rows best (Wahba's problem, by SVD).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.errors import AlignmentError
from alignment.methods.vectors.fixes import Matching, Record, VectorOptions, check, joined
from alignment.methods.vectors.kalman import DISAGREE, UNLIKELY
from alignment.navigation import C_en, C_ie, attitude_in_n, geodetic, gravitation, integrals
from alignment.readings import Fixes, ImuReadings
from alignment.skew import Axes, back_from, spread

METHOD = "vectors observing"
MOST = 1000  # fixes: memory grows with their square, some 0.5 GB here


@dataclass(frozen=True, slots=True, eq=False)
class WhitenedRows:
    """The matching as whitened rows, velocity then place of each fix in turn (2 m rows).

    `y` (2m, 3) in i, `x` (2m, 3) in b0, `a` (2m, 2) how start place and velocity enter; `white`
    (2m, 2m) covariance of the isotropic noise after whitening; `effects` (2m, 3, s): rows of x per
    unit of each source of sensor error, `variances` (s,) of these.
    """

    y: Array
    x: Array
    a: Array
    white: Array
    effects: Array
    variances: Array


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """``C_ib0`` (3, 3); `noise` (3, 3): its covariance by the fixes' noise; `by_source` (3, s):
    its error per unit of each source; all about i."""

    C: Array
    noise: Array
    by_source: Array


def observing(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, options: VectorOptions | None = None
) -> Matching:
    """Attitude by matching integrated specific force with satellite velocity and position.

    Parameters and errors as for `alignment.methods.vectors.kalman.kalman`.
    The programmed attitude is only
    shown until the first accepted solution; it does not enter any.

    Notes
    -----
    Refused while the predicted sigma about any axis is above ``options.largest_sigma``: the
    determinant says nothing of that. The covariance holds the fixes' noise, both random walks and
    every error of the unit by its prior, exactly through the weights used; sensor errors enter the
    weights as if they were the same in all directions. Leading errors: b_a/g in tilt, b_a/a in
    heading with a the horizontal acceleration; gyro bias times half the time, a gyro's scale error
    times the angle turned. Gravity is taken along a cubic through the fixes. Source: methods.md
    section 4 (a).
    """
    options = options or VectorOptions()
    check(fixes)
    if len(fixes) > MOST:
        raise AlignmentError(
            f"{len(fixes)} fixes: the observing form takes {MOST} at most: take fewer"
        )
    latitude, longitude, _ = geodetic(fixes.position[0])
    record = joined(readings, fixes, C_nb0, C_en(latitude, longitude), options)
    velocity_g, place_g = _gravity_integrals(record)
    drifts = _drifts(readings, record, fixes)
    rows = _rows(record, fixes, velocity_g, place_g, drifts)
    turns = _turn_errors(record, fixes, back_from(record.priors.gyro_axes))

    T = record.t - record.t[0]
    solution = Solution(
        record.C_ib, options.attitude_sigma**2 * np.eye(3), np.zeros((3, len(rows.variances)))
    )
    C_ib, covariance, place, doubts, corrected = [], [], [], [], []
    starts: list[Array] = []  # of each fix, the first of which begins the record
    for k in range(len(T)):
        doubt, accepted = "", False
        if record.at_fix[k]:
            count = len(starts) + 1
            if count > 1:
                found, doubt = _solved(rows, 2 * count, turns[k], options)
                accepted = found is not None
                solution = found or solution
            starts.append(_start(rows, 2 * count, solution.C))
        C_ib.append(solution.C @ record.sensed.turn[k])
        covariance.append(_covariance(solution, turns[k], rows.variances))
        carried = place_g[k] + solution.C @ record.sensed.place[k]
        r, v = record.r_i[0] + starts[-1][0], record.v_i[0] + starts[-1][1]
        place.append(r + v * T[k] + carried)
        doubts.append(doubt)
        corrected.append(accepted)
    r_i = np.array(place)
    C_nb, C_ni = attitude_in_n(np.array(C_ib), r_i, T)
    return Matching(
        METHOD,
        record.t,
        np.cumsum(record.at_fix, dtype=np.int64),
        record.at_fix,
        corrected=np.array(corrected),
        C_nb=Rotation.from_matrix(C_nb),
        covariance=C_ni @ np.array(covariance) @ np.swapaxes(C_ni, 1, 2),
        position=np.einsum("kji,kj->ki", C_ie(T), r_i),
        differences=np.zeros((len(T), 3)),
        doubts=tuple(doubts),
        rule=options.rule,
    )


def _gravity_integrals(record: Record) -> tuple[Array, Array]:
    """First and second integral of gravitation (k, 3) in i along the fixes' path."""
    # 0.2 s to import, which every start of the methods' list would pay
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    T = record.t - record.t[0]
    path = CubicHermiteSpline(T[record.at_fix], record.r_i, record.v_i)
    g = CubicSpline(T, gravitation(path(T), T))
    once = g.antiderivative()
    return once(T), once.antiderivative()(T)


def _drifts(readings: ImuReadings, record: Record, fixes: Fixes) -> Array:
    """Rows of x (2m, 3, 3 (m - 1)) per unit of gyro random walk gathered between fixes.

    A walk's turn happens on average in the middle of its interval.
    """
    middles = (fixes.t[:-1] + fixes.t[1:]) / 2
    at = integrals(readings, np.append(fixes.t[0], middles))
    ends = record.sensed
    k = np.flatnonzero(record.at_fix)
    later = fixes.t[:, None] > middles
    T = np.where(later, fixes.t[:, None] - middles, 0.0)[..., None]
    dv = ends.velocity[k][:, None] - at.velocity[1:]
    dr = ends.place[k][:, None] - at.place[1:] - at.velocity[1:] * T
    effects = np.empty((2 * len(k), 3, len(middles), 3))
    effects[0::2] = np.moveaxis(-cross_matrix(dv) * later[..., None, None], 1, 2)
    effects[1::2] = np.moveaxis(-cross_matrix(dr) * later[..., None, None], 1, 2)
    return effects.reshape(2 * len(k), 3, -1)


def _turn_errors(record: Record, fixes: Fixes, back: Array) -> Array:
    """Error of the turn since the start (k, 3, s), in b0, per unit of each source.

    `back` (3, 3): components in b of the gyros' errors.
    """
    middles = (fixes.t[:-1] + fixes.t[1:]) / 2
    later = (record.t[:, None] > middles).astype(float)
    walks = np.einsum("kl,ij->kilj", later, back).reshape(len(record.t), 3, -1)
    gyro = record.sensed.turn_time @ back
    return np.concatenate([gyro, np.zeros_like(gyro), record.effects.turn, walks], axis=2)


def _rows(
    record: Record,
    fixes: Fixes,
    velocity_g: Array,
    place_g: Array,
    drifts: Array,
) -> WhitenedRows:
    k, priors, s = np.flatnonzero(record.at_fix), record.priors, record.sensed
    T = fixes.t - fixes.t[0]
    y_v = record.v_i - record.v_i[0] - velocity_g[k]
    y_r = record.r_i - record.r_i[0] - record.v_i[0] * T[:, None] - place_g[k]
    gyro = _interleaved(s.velocity_gyro[k], s.place_gyro[k])
    accel = _interleaved(s.turn_time[k], s.turn_time2[k])
    back = back_from(priors.gyro_axes)
    walks = (drifts.reshape(len(drifts), 3, -1, 3) @ back).reshape(drifts.shape)
    other = _interleaved(record.effects.velocity[k], record.effects.place[k])
    effects = [gyro @ back, accel @ back_from(priors.accel_axes), other, walks]
    effects = np.concatenate(effects, axis=2)
    walked = priors.gyro_walk**2 * np.repeat(np.diff(fixes.t), 3)
    biases = np.repeat([priors.gyro_bias**2, priors.accel_bias**2], 3)
    variances = np.concatenate([biases, np.ones(record.effects.count), walked])
    even = np.sqrt(np.trace(_spread(priors.accel_axes)) / 3)
    white = _isotropic(T, fixes, priors.accel_walk * even)
    spread = effects * np.sqrt(variances / 3)
    spread = spread.reshape(len(spread), -1)
    root = np.linalg.cholesky(white + spread @ spread.T)

    def whitened(rows: Array) -> Array:
        flat = solve_triangular(root, rows.reshape(len(rows), -1), lower=True)
        return np.ascontiguousarray(flat.reshape(rows.shape))  # the solver's are column by column

    enters = _interleaved(np.stack([0 * T, 1 + 0 * T], 1), np.stack([1 + 0 * T, T], 1))
    return WhitenedRows(
        whitened(_interleaved(y_v, y_r)),
        whitened(_interleaved(s.velocity[k], s.place[k])),
        whitened(enters),
        whitened(whitened(white).T),
        effects=whitened(effects),
        variances=variances,
    )


def _spread(axes: Axes | None) -> Array:
    return np.eye(3) if axes is None else spread(axes)


def _interleaved(velocity: Array, place: Array) -> Array:
    """Rows of velocity and place in turn: what is known at fix k is the first 2 k rows."""
    return np.stack([velocity, place], axis=1).reshape(2 * len(velocity), *velocity.shape[1:])


def _isotropic(T: Array, fixes: Fixes, walk: float) -> Array:
    """Covariance (2m, 2m) of the rows' noise that is the same in all directions."""
    m = len(T)
    first, last = np.minimum(T[:, None], T), np.maximum(T[:, None], T)
    near = np.exp(-(last - first) / fixes.drift_time)
    noise = np.zeros((m, 2, m, 2))
    noise[:, 0, :, 0] = fixes.velocity_sigma**2 * np.eye(m) + fixes.velocity_drift**2 * near
    noise[:, 1, :, 1] = fixes.position_sigma**2 * np.eye(m) + fixes.position_drift**2 * near
    noise[:, 0, :, 0] += walk**2 * first
    noise[:, 1, :, 1] += walk**2 * first**2 * (3 * last - first) / 6
    mixed = walk**2 * (T[None, :] * first - first**2 / 2)  # of velocity (row), place (column)
    noise[:, 0, :, 1] += mixed
    noise[:, 1, :, 0] += mixed.T
    return noise.reshape(2 * m, 2 * m)


def _solved(
    rows: WhitenedRows, count: int, turn: Array, options: VectorOptions
) -> tuple[Solution | None, str]:
    """The rotation that fits the first `count` rows best, or nothing and why."""
    y, x, a = rows.y[:count], rows.x[:count], rows.a[:count]
    basis, _ = np.linalg.qr(a)
    free_x = x - basis @ (basis.T @ x)  # what no start place and velocity can explain
    free_y = y - basis @ (basis.T @ y)
    spread = free_x.T @ free_x
    weakest = np.linalg.eigvalsh(np.trace(spread) * np.eye(3) - spread)[0]
    if weakest * options.largest_sigma**2 < 1:
        return None, _refusal(1 / np.sqrt(max(weakest, 1e-12)))
    U, _, Vt = np.linalg.svd(free_y.T @ free_x)
    C = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    turned = free_x @ C.T
    information = np.sum(turned**2) * np.eye(3) - turned.T @ turned
    gain = np.linalg.solve(information, np.moveaxis(cross_matrix(turned), 0, 1).reshape(3, -1))
    gain = gain.reshape(3, count, 3)
    by_axis = np.ascontiguousarray(np.moveaxis(gain, 2, 0))  # (3, 3, count)
    # a tall matrix on the left: BLAS is some ten times as fast as with nine rows there
    white = (rows.white[:count, :count] @ by_axis.reshape(9, count).T).T.reshape(by_axis.shape)
    noise = (white @ np.swapaxes(by_axis, 1, 2)).sum(axis=0)
    later = 3 * ((len(rows.y) - count) // 2)  # walks after this fix have no effect
    known = rows.effects.shape[2] - later
    effects = rows.effects[:count].reshape(3 * count, -1)[:, :known]
    by_source = np.zeros((3, rows.effects.shape[2]))
    by_source[:, :known] = -(effects.T @ (gain @ C).reshape(3, -1).T).T
    solution = Solution(C, noise, by_source)
    sigma = np.sqrt(np.linalg.eigvalsh(_covariance(solution, turn, rows.variances))[-1])
    if sigma > options.largest_sigma:
        return None, _refusal(sigma)
    misfit = float(np.sum((free_y - turned) ** 2))
    unlikely = chdtrc(3 * count - 9, misfit) < UNLIKELY
    return solution, DISAGREE if unlikely else ""


def _refusal(sigma: float) -> str:
    return f"refused: predicted sigma {np.degrees(sigma):.3g} deg about one axis"


def _start(rows: WhitenedRows, count: int, C: Array) -> Array:
    """Place and velocity (2, 3) of the start, less those of the first fix, that fit best."""
    rest = rows.y[:count] - rows.x[:count] @ C.T
    return np.linalg.lstsq(rows.a[:count], rest, rcond=None)[0]


def _covariance(solution: Solution, turn: Array, variances: Array) -> Array:
    """Of the attitude now (3, 3), about i: the start's errors and the gyros' since then."""
    by_source = solution.by_source + solution.C @ turn
    return solution.noise + (by_source * variances) @ by_source.T
