"""The fit of a hand-held calibration: rests, moves and priors as rows, solved together.

Each rest has a vertical u (unit vector in b, two unknowns of its own). It shows in the
accelerometers as ``reported(g u)``, in the gyros as ``reported(Earth rate, g u)``, and each move
turns one rest's into the next one's. Gravity, and Earth rate in b at the first rest, are unknowns
with priors. So what is shared by several rows (a rest between two moves, gravity) is said once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.calibration.apply import inverse
from alignment.calibration.constants import TriadConstants, columns, constants_of, reported, slope
from alignment.calibration.moves import Moves, Turned, turned
from alignment.calibration.rest_means import RestMeans
from alignment.calibration.result import Gravity, Sensor
from alignment.calibration.unknowns import Unknowns
from alignment.cross import cross, cross_matrix
from alignment.earth import EARTH_RATE
from alignment.errors import AlignmentError

STEPS = 40  # of Gauss-Newton; five are usual
SETTLED = 1e-3  # of a sigma
ROUNDS = 30  # in which what rests differ by beyond their noise is found
EVEN = 0.01  # relative, to which chi-square must come to the degrees of freedom
GROUPS = ("accel", "gyro", "move")  # of rows whose sigmas may be too small


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Problem:
    """What is fitted.

    Attributes
    ----------
    chain : (k,)
        Rests of one number have a known heading to one another.
    latitude : float or None
        [rad]
    drift : (float, float)
        Variances of gyros and accelerometers by which the biases of a rest differ from their mean
        over the log, as a data sheet's instability says.
    first_bias : bool
        The gyros' biases are those of the first rest, and the Earth is not there, as published.
    """

    unknowns: Unknowns
    rests: RestMeans
    moves: Moves
    gravity: Gravity
    chain: IntArray
    latitude: float | None = None
    drift: tuple[float, float] = (0.0, 0.0)
    first_bias: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class State:
    """Where the fit stands: `z` (q,) unknowns of the unit, `g` gravity, `earth` (c, 3) Earth rate
    in b at the first rest of each chain [rad/s], `up` (k, 3); `extra`: variances beyond noise by
    group of rows ([m^2/s^4], [rad^2/s^2], [rad^2])."""

    z: Array
    g: float
    earth: Array
    up: Array
    extra: dict[str, float] = field(default_factory=lambda: dict.fromkeys(GROUPS, 0.0))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rows:
    """Rows as they are linear about a state.

    `J` (n, q), residuals `r` (n,), their `variance` (n,) by noise alone and what each variance of
    `GROUPS` beyond noise adds to it by `more` (n, 3); the `group` and `item` (n,) of each.
    """

    J: Array
    r: Array
    variance: Array
    more: Array
    group: np.ndarray
    item: IntArray

    def whitened(self, extra: dict[str, float]) -> tuple[Array, Array]:
        """J and r over the sigmas, with variances beyond noise."""
        beyond = np.array([extra[group] for group in GROUPS])
        sigma = np.sqrt(self.variance + self.more @ beyond)
        return self.J / sigma[:, None], self.r / sigma


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    """A fit: `state`; `covariance` (q, q) of all unknowns, the unit's first; `J` and `r` whitened,
    `group` and `item` of each row.

    `chi_square` and `dof` are those of the noise alone, before anything was enlarged.
    """

    state: State
    covariance: Array
    J: Array
    r: Array
    group: np.ndarray
    item: IntArray
    chi_square: float = 0.0
    dof: int = 0

    def worth(self) -> Array:
        """Redundancy (n,) of each row: what the fit leaves of its variance."""
        return np.asarray(1 - np.sum(self.J @ self.covariance * self.J, axis=1))


def start(problem: Problem) -> State:
    """A unit without errors, verticals as they read."""
    f = problem.rests.accel
    up = f / np.linalg.norm(f, axis=1)[:, None]
    chains = int(problem.chain.max()) + 1
    first = np.array([int(np.flatnonzero(problem.chain == c)[0]) for c in range(chains)])
    vertical = 0.0 if problem.latitude is None else np.sin(problem.latitude)
    earth = EARTH_RATE * vertical * up[first] * (not problem.first_bias)
    return State(
        z=np.zeros(len(problem.unknowns.sigmas)), g=problem.gravity.value, earth=earth, up=up
    )


# --- rows ----------------------------------------------------------------------------------------


def triads(problem: Problem, z: Array) -> tuple[TriadConstants, TriadConstants]:
    """The constants of gyros and accelerometers."""
    values = problem.unknowns.basis @ z
    keys = problem.unknowns.keys
    return constants_of(keys, values, "gyro"), constants_of(keys, values, "accel")


def turned_by(problem: Problem, state: State) -> Turned:
    """The moves, integrated with the gyros as they are believed to be."""
    gyro, accel = triads(problem, state.z)
    force = inverse(accel, problem.moves.f, np.zeros_like(problem.moves.f))
    keys = [problem.unknowns.keys[n] for n in problem.unknowns.of("gyro")]
    return turned(problem.moves, gyro, force, keys)


def attitudes(problem: Problem, state: State, moved: Turned) -> Array:
    """C (k, 3, 3): b at each rest to b at the first rest of its chain."""
    C = np.tile(np.eye(3), (len(problem.chain), 1, 1))
    for n, (a, b) in enumerate(problem.moves.rests):
        # the Earth turns b against what stands still on it
        rate = C[a].T @ state.earth[problem.chain[a]]
        back = np.eye(3) - cross_matrix(rate * problem.moves.spans[n])
        C[b] = C[a] @ back @ moved.C[n]
    return C


def tangents(up: Array) -> Array:
    """Two unit vectors (k, 3, 2) across each of (k, 3)."""
    off = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    one = cross(up, off)
    one = one / np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, cross(up, one)], axis=2)


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Where unknowns stand among all: of the unit, gravity, the Earth, verticals."""

    q: int
    chains: int
    rests: int

    @property
    def gravity(self) -> int:
        return self.q

    def earth(self, chain: int) -> slice:
        return slice(self.q + 1 + 3 * chain, self.q + 4 + 3 * chain)

    def up(self, rest: int) -> slice:
        first = self.q + 1 + 3 * self.chains + 2 * rest
        return slice(first, first + 2)

    @property
    def total(self) -> int:
        return self.q + 1 + 3 * self.chains + 2 * self.rests


def places(problem: Problem) -> _Places:
    """Where each unknown stands."""
    unit = len(problem.unknowns.sigmas)
    return _Places(unit, int(problem.chain.max()) + 1, len(problem.rests.spans))


def rows_of(problem: Problem, state: State) -> Rows:
    """All rows at a state."""
    moved = turned_by(problem, state)
    C = attitudes(problem, state, moved)
    made = [
        _at_rest(problem, state, C),
        _of_moves(problem, state, moved, C),
        _of_priors(problem, state),
    ]
    return Rows(**{
        name: np.concatenate([getattr(one, name) for one in made])
        for name in Rows.__slots__
    })  # fmt: skip


def _at_rest(problem: Problem, state: State, C: Array) -> Rows:
    """What accelerometers and gyros read at rests."""
    at, u, B = places(problem), state.up, tangents(state.up)
    gyro, accel = triads(problem, state.z)
    rests, unknowns = problem.rests, problem.unknowns
    f = state.g * u
    earth = np.einsum("kji,kj->ki", C, state.earth[problem.chain])
    k = len(u)
    # (k, accel or gyro, 3, all unknowns)
    J = np.zeros((k, 2, 3, at.total))
    by_force = slope(accel, f)
    felt = gyro.g_sensitivity + 2 * gyro.g2_sensitivity * f[:, None, :]
    of_triads: tuple[tuple[Sensor, int, Array, TriadConstants], ...] = (
        ("accel", 0, f, accel),
        ("gyro", 1, earth, gyro),
    )
    for sensor, row, x, c in of_triads:
        own = unknowns.of(sensor)
        part = columns([unknowns.keys[n] for n in own], c, x, f)
        J[:, row, :, : at.q] = part @ unknowns.basis[own]
    by_earth = slope(gyro, earth) @ np.swapaxes(C, 1, 2)
    for n in range(k):
        J[n, :, :, at.up(n)] = state.g * np.stack([by_force[n] @ B[n], felt[n] @ B[n]])
        J[n, :, :, at.gravity] = np.stack([by_force[n] @ u[n], felt[n] @ u[n]])
        J[n, 1, :, at.earth(int(problem.chain[n]))] = by_earth[n]
    r = np.stack(
        [
            rests.accel - reported(accel, f, f),
            rests.gyro - reported(gyro, earth, f),
        ],
        axis=1,
    )
    gyro_drift, accel_drift = problem.drift
    variance = np.stack(
        [rests.accel_variance + accel_drift, rests.gyro_variance + gyro_drift], axis=1
    )
    group = np.broadcast_to(np.array(GROUPS[:2])[None, :, None], r.shape).ravel()
    item = np.broadcast_to(np.arange(k)[:, None, None], r.shape).ravel()
    keep = np.full(len(item), not problem.first_bias) | (group == "accel") | (item == 0)
    return Rows(
        J=J.reshape(-1, at.total)[keep],
        r=r.ravel()[keep],
        variance=variance.ravel()[keep],
        more=(group[:, None] == np.array(GROUPS)).astype(float)[keep],
        group=group[keep],
        item=item[keep],
    )


def _of_moves(problem: Problem, state: State, moved: Turned, C: Array) -> Rows:
    """How far each move's vertical is from that of the rest after it."""
    at, u, B = places(problem), state.up, tangents(state.up)
    unknowns, moves = problem.unknowns, problem.moves
    m = len(moves.spans)
    J, r = np.zeros((m, 2, at.total)), np.zeros((m, 2))
    by_unit = moved.by @ unknowns.basis[unknowns.of("gyro")] if m else moved.by
    for n, (a, b) in enumerate(moves.rests):
        T, chain = moves.spans[n], int(problem.chain[a])
        back, across = moved.C[n].T, B[b].T
        earth = C[a].T @ state.earth[chain]
        p = back @ (u[a] + T * np.cross(earth, u[a]))
        r[n] = -across @ (p - u[b])
        J[n, :, : at.q] = across @ cross_matrix(p) @ by_unit[n]
        J[n, :, at.up(a)] = across @ back @ (B[a] + T * cross_matrix(earth) @ B[a])
        J[n, :, at.up(b)] = -np.eye(2)
        J[n, :, at.earth(chain)] = -T * across @ back @ cross_matrix(u[a]) @ C[a].T
    # walk, and biases that are off those of the rests
    own = problem.rests.walk * moves.spans + problem.drift[0] * moves.spans**2
    more = np.column_stack([np.zeros(m), moves.spans**2, np.ones(m)])
    return Rows(
        J=J.reshape(-1, at.total),
        r=r.ravel(),
        variance=np.repeat(own, 2),
        more=np.repeat(more, 2, axis=0),
        group=np.repeat("move", 2 * m),
        item=np.repeat(np.arange(m), 2),
    )


def _of_priors(problem: Problem, state: State) -> Rows:
    """Data sheet, gravity, the Earth."""
    at, sigmas = places(problem), problem.unknowns.sigmas
    made: list[tuple[Array, float, str]] = []
    for n in np.flatnonzero(np.isfinite(sigmas)):
        row = np.zeros(at.total)
        row[n] = 1 / sigmas[n]
        made.append((row, -state.z[n] / sigmas[n], "data sheet"))
    # known to all digits: a millionth of it, which no unit resolves
    sigma = max(problem.gravity.sigma, 1e-8)
    row = np.zeros(at.total)
    row[at.gravity] = 1 / sigma
    made.append((row, (problem.gravity.value - state.g) / sigma, "gravity"))
    for chain in range(at.chains):
        made += _of_earth(problem, state, chain, at)
    J, r, group = zip(*made, strict=True)
    n = len(r)
    return Rows(
        J=np.array(J),
        r=np.array(r),
        variance=np.ones(n),
        more=np.zeros((n, len(GROUPS))),
        group=np.array(group),
        item=np.zeros(n, int),
    )


def _of_earth(
    problem: Problem, state: State, chain: int, at: _Places
) -> list[tuple[Array, float, str]]:
    """Earth rate in b: of known size, its level part toward anywhere."""
    first = int(np.flatnonzero(problem.chain == chain)[0])
    u, earth = state.up[first], state.earth[chain]
    if problem.first_bias:
        axes, mean, sizes = np.eye(3), np.zeros(3), np.full(3, 1e-12)
    elif problem.latitude is None:
        axes, mean, sizes = np.eye(3), np.zeros(3), np.full(3, EARTH_RATE / np.sqrt(3))
    else:
        axes = np.column_stack([u, tangents(u[None])[0]]).T
        mean = EARTH_RATE * np.sin(problem.latitude) * u
        # vertical as well as a latitude is known to 0.01 deg, level by its mean square
        level = EARTH_RATE * max(abs(np.cos(problem.latitude)), 1e-4) / np.sqrt(2)
        sizes = np.array([1e-4 * EARTH_RATE, level, level])
    made = []
    for axis, size in zip(axes, sizes, strict=True):
        row = np.zeros(at.total)
        row[at.earth(chain)] = axis / size
        made.append((row, float(axis @ (mean - earth)) / size, "Earth rate"))
    return made


# --- solved --------------------------------------------------------------------------------------


def solve(problem: Problem, state: State) -> tuple[State, Rows]:
    """Gauss-Newton to a thousandth of a sigma; the rows there.

    Raises
    ------
    AlignmentError
        It does not settle: readings that no unit of such errors gives.
    """
    rows = rows_of(problem, state)
    for _ in range(STEPS):
        step, covariance = _least_squares(*rows.whitened(state.extra))
        if not np.isfinite(step).all():
            break
        if (np.abs(step) <= SETTLED * np.sqrt(covariance.diagonal())).all():
            return state, rows
        state = _stepped(problem, state, step)
        rows = rows_of(problem, state)
    raise AlignmentError(
        "the fit does not settle: wrong units or axes, or readings that gravity and the gyros "
        "contradict"
    )


def _least_squares(J: Array, r: Array) -> tuple[Array, Array]:
    """Step (q,) and covariance (q, q) of whitened rows, by QR with columns of length one."""
    sizes = np.linalg.norm(J, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    Q, R = np.linalg.qr(J / sizes)
    inverse_R = np.linalg.solve(R, np.eye(len(R)))
    step = inverse_R @ (Q.T @ r) / sizes
    return step, inverse_R @ inverse_R.T / np.outer(sizes, sizes)


def _stepped(problem: Problem, state: State, step: Array) -> State:
    at = places(problem)
    B = tangents(state.up)
    by_rest = step[at.up(0).start :].reshape(-1, 2)
    up = state.up + np.einsum("kij,kj->ki", B, by_rest)
    return replace(
        state,
        z=state.z + step[: at.q],
        g=state.g + float(step[at.gravity]),
        earth=state.earth + step[at.gravity + 1 : at.up(0).start].reshape(-1, 3),
        up=up / np.linalg.norm(up, axis=1)[:, None],
    )


Ratio = Callable[[Array, Array], float]


def mean_ratio(chi_square: Array, worth: Array) -> float:
    """How far chi-square of items (m,) exceeds their degrees of freedom (m,)."""
    return float(chi_square.sum() / worth.sum()) if worth.sum() > 0 else 1.0


def median_ratio(chi_square: Array, worth: Array) -> float:
    """The same by the median, which few wild items do not move."""
    there = worth > 0.1
    if not there.any():
        return 1.0
    # the median of chi-square with k degrees of freedom is near k (1 - 2/(9 k))^3
    usual = worth[there] * (1 - 2 / (9 * np.maximum(worth[there], 0.5))) ** 3
    return float(np.median(chi_square[there] / usual))


def by_item(fit: Fit, group: str) -> tuple[Array, Array]:
    """Chi-square and redundancy (m,) of each rest or move, of one group of rows."""
    own = fit.group == group
    items, worth = fit.item[own], fit.worth()[own]
    count = int(items.max()) + 1 if own.any() else 0
    chi_square = np.bincount(items, fit.r[own] ** 2, count).astype(float)
    return chi_square, np.bincount(items, np.maximum(worth, 0.0), count).astype(float)


def fitted(problem: Problem, ratio: Ratio = mean_ratio) -> Fit:
    """The fit, with what rests and moves differ by beyond their noise found from themselves.

    Parameters
    ----------
    problem : Problem
    ratio : callable
        By which chi-square is brought to the degrees of freedom.
    """
    state, rows = solve(problem, start(problem))
    fit = _weighed(state, rows)
    # the unknowns without a prior are paid for by rows, the others by their own
    chi_square, dof = float(fit.r @ fit.r), len(fit.r) - fit.J.shape[1]
    for _ in range(ROUNDS):
        extra, settled = _enlarged(fit, rows, ratio)
        if settled:
            break
        fit = _weighed(replace(state, extra=extra), rows)
    if any(fit.state.extra.values()):
        fit = _weighed(*solve(problem, fit.state))
    return replace(fit, chi_square=chi_square, dof=max(dof, 0))


def _weighed(state: State, rows: Rows) -> Fit:
    """The fit by rows that are linear about a state, with variances as the state has them."""
    J, r = rows.whitened(state.extra)
    step, covariance = _least_squares(J, r)
    return Fit(
        state=state, covariance=covariance, J=J, r=r - J @ step, group=rows.group, item=rows.item
    )


def _enlarged(fit: Fit, rows: Rows, ratio: Ratio) -> tuple[dict[str, float], bool]:
    """Variances beyond noise that bring each group's chi-square nearer; whether it is there."""
    extra, settled = dict(fit.state.extra), True
    beyond = np.array([extra[group] for group in GROUPS])
    variance = rows.variance + rows.more @ beyond
    for group in GROUPS:
        chi_square, worth = by_item(fit, group)
        if worth.sum() < 1:
            continue
        usual = float(variance[rows.group == group].mean())
        wanted = max(0.0, extra[group] + (ratio(chi_square, worth) - 1) * usual)
        settled &= abs(wanted - extra[group]) <= EVEN * usual
        extra[group] = wanted
    return extra, settled
