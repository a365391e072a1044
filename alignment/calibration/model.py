"""What the stations and moves of sessions read, and how that changes with every unknown.

The unknowns, in order: those of the unit (`terms`), then the nuisances: gravity, the table's
errors, and where there are several sessions what changes from one to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from alignment.arrays import Array, IntArray, set_owned
from alignment.calibration import terms
from alignment.calibration.apply import inverse
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.constants import TriadConstants, constants_of, reported
from alignment.calibration.session import Move, Poses, Session, by_errors, by_place, true_input
from alignment.earth import Site
from alignment.quaternions import multiply
from alignment.strapdown import matrices, quaternions, rotation_vectors

AXES = ("X1", "Y1", "Z1")
GRAVITY = "gravity"
ARM = "place on the table along "  # of the unit's point, from where the axes cross


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Unknowns:
    """All that is unknown: `names` and `units` of the nuisances, priors of everything.

    `expected`, `sigmas` (p,): of the unit's unknowns first, then of the nuisances.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    expected: Array
    sigmas: Array

    def __post_init__(self) -> None:
        p = terms.COUNT + len(self.names)
        set_owned(self, expected=(self.expected, (p,), float), sigmas=(self.sigmas, (p,), float))

    def at(self, name: str) -> int:
        """Column of a nuisance."""
        return terms.COUNT + self.names.index(name)


class Model:
    """The readings of sessions of one unit on one bench, as functions of the unknowns.

    Readings are in one vector: of every session the gyros' coefficients, three at a time, station
    by station; its moves' rotations; the accelerometers' coefficients.
    """

    def __init__(self, sessions: Sequence[Session], bench: Bench, site: Site) -> None:
        self.sessions, self.bench, self.site = tuple(sessions), bench, site
        several = len(sessions) > 1
        self.poses = [
            Poses(session, bench, site, f"recording {k + 1}" if several else "")
            for k, session in enumerate(sessions)
        ]
        self.unknowns = _unknowns(self.sessions, self.poses, bench)
        self._paths = {k: _Paths(s.moves) for k, s in enumerate(sessions) if s.moves}

    @property
    def count(self) -> int:
        """How many unknowns."""
        return len(self.unknowns.sigmas)

    def rows(self) -> list[list[IntArray]]:
        """Of each session, the rows of every station, then of every move."""
        found: list[list[IntArray]] = []
        at = 0
        for poses in self.poses:
            edges = 3 * np.cumsum([0, *poses.orders])
            total, moves = int(edges[-1]), 3 * len(poses.session.moves)
            own = [
                at + np.r_[a:b, total + moves + a : total + moves + b]
                for a, b in pairwise(edges.tolist())
            ]
            own += [at + total + np.arange(k, k + 3) for k in range(0, moves, 3)]
            found.append(own)
            at += 2 * total + moves
        return found

    # --- the readings

    def left(self, y: Array, x: Array) -> Array:
        """What of the readings (m,) the unknowns (p,) leave unexplained."""
        found, at = [], 0
        keys, values = terms.ALL.keys, terms.ALL.matrix @ x[: terms.COUNT]
        for k, poses in enumerate(self.poses):
            shift = np.zeros(terms.COUNT)
            shift[terms.columns_of("gyro", "bias")] = self._three(x, _own(k, "gyro bias X1"))
            shift[terms.columns_of("accel", "bias")] = self._three(x, _own(k, "accel bias X1"))
            own = values + terms.ALL.matrix @ shift
            gyro, accel = (constants_of(keys, own, s) for s in SENSORS)
            errors = x[self.columns_of_table(k)]
            arm = self.bench.arm + self._three(x, _arms(k)[0])
            w, f = self._coefficients(poses, gyro, accel, (arm, errors, x[terms.COUNT]))
            moves = self._moves(k, gyro, errors) if poses.session.moves else np.zeros(0)
            n = len(w) + len(moves) + len(f)
            part = y[at : at + n]
            found += [part[: len(w)] - w, moves, part[len(w) + len(moves) :] - f]
            at += n
        return np.concatenate(found)

    def _three(self, x: Array, first: str) -> Array:
        """Three nuisances from a name on; zeros where there are none."""
        own = self._columns_from(first)
        return np.zeros(3) if own is None else x[own]

    def _columns_from(self, first: str) -> slice | None:
        if first not in self.unknowns.names:
            return None
        at = self.unknowns.at(first)
        return slice(at, at + 3)

    def columns_of_table(self, k: int) -> list[int]:
        """Where the table's errors of session k stand."""
        return [self.unknowns.at(name) for name in _names(k, self.poses[k])]

    def _coefficients(
        self,
        poses: Poses,
        gyro: TriadConstants,
        accel: TriadConstants,
        nuisances: tuple[Array, Array, float],
    ) -> tuple[Array, Array]:
        there = true_input(poses, *nuisances, accel.places)
        w = reported(gyro, there.w, there.f, poses.warmth)
        f = reported(accel, there.at_places, there.at_places, poses.warmth)
        return self._projected(poses, w, gyro.lag), self._projected(poses, f, accel.lag)

    def _projected(self, poses: Poses, values: Array, lag: Array) -> Array:
        """Coefficients as they are sampled, of values (n, 3) at the nodes."""
        found = []
        for k, station in enumerate(poses.session.stations):
            own = poses.project[k] @ values[poses.edges[k] : poses.edges[k + 1]]
            if station.stretch.rate:
                own = self._sampled(own, station.stretch.rate, lag, poses.session.interval)
            found.append(own.ravel())
        return np.concatenate(found)

    def _sampled(self, own: Array, rate: float, lag: Array, interval: float) -> Array:
        """Coefficients (3, 3, ...) of values that come late, as means over the samples."""
        half = rate * interval / 2 * self.bench.means
        late = (half + rate * lag).reshape(3, *(1,) * (own.ndim - 2))
        c, s, size = np.cos(late), np.sin(late), np.sinc(half / np.pi)
        return np.stack(
            [own[0], size * (c * own[1] - s * own[2]), size * (s * own[1] + c * own[2])]
        )

    def _moves(self, k: int, gyro: TriadConstants, errors: Array) -> Array:
        """Rotations (3 m,) that the gyros, corrected, make too much of the moves."""
        poses = self.poses[k]
        start, end = (turns @ errors for turns in poses.of_ends())
        table = _exponential(-start) @ poses.expected @ _exponential(end)
        before, after = _swings(poses.session)
        own = self._paths[k].rotations(gyro)
        own = _exponential(-gyro.lag * before) @ own @ _exponential(gyro.lag * after)
        return _logarithm(np.swapaxes(table, 1, 2) @ own).ravel()

    # --- their derivatives

    def jacobian(self) -> Array:
        """Derivatives (m, p) of the readings at the expected unknowns."""
        blocks = []
        for k, poses in enumerate(self.poses):
            w, f = self._node_columns(k, poses)
            lags = self.unknowns.expected
            gyro = self._station_columns(poses, w, lags, "gyro")
            accel = self._station_columns(poses, f, lags, "accel")
            blocks += [gyro, self._move_columns(k, poses), accel]
        return np.concatenate(blocks)

    def _node_columns(self, k: int, poses: Poses) -> tuple[Array, Array]:
        """(n, 3, p) of the gyros and of the accelerometers at every node."""
        n, p, x0 = len(poses.w), self.count, self.unknowns.expected
        places = x0[terms.columns_of("accel", "lever_arm")].reshape(3, 3)
        there = true_input(poses, self.bench.arm, np.zeros(poses.slopes.shape[2]), 0.0, places)
        found = np.zeros((2, n, 3, p))
        for own, x, sensor in zip(found, (there.w, there.at_places), SENSORS, strict=True):
            for term in terms.UNIT:
                if term.sensor == sensor:
                    own[:, :, term.columns] = terms.columns(
                        sensor, term.name, x, there.f, poses.warmth
                    )
            biases = self._columns_from(_own(k, f"{sensor} bias X1"))
            if biases is not None:
                own[..., :, biases] = np.eye(3)
        swings = by_place(poses)
        found[1][:, :, terms.columns_of("accel", "lever_arm")] = swings
        arm = self._columns_from(_arms(k)[0])
        if arm is not None:
            found[1][:, :, arm] = swings.reshape(-1, 3, 3, 3).sum(axis=2)
        w, f = by_errors(poses, self.bench, places)
        columns = self.columns_of_table(k)
        found[0][:, :, columns], found[1][:, :, columns] = w, f
        found[1][:, :, terms.COUNT] = poses.f / self.site.gravity
        return found[0], found[1]

    def _station_columns(self, poses: Poses, nodes: Array, x0: Array, sensor: str) -> Array:
        columns = terms.columns_of(sensor, "lag")
        found = []
        x = poses.w if sensor == "gyro" else poses.f
        for k, station in enumerate(poses.session.stations):
            part = slice(poses.edges[k], poses.edges[k + 1])
            own = np.einsum("hk,kip->hip", poses.project[k], nodes[part])
            rate = station.stretch.rate
            if rate:
                own[1:, :, columns] = _by_lag(poses.project[k] @ x[part], rate)
                own = self._sampled(own, rate, x0[columns], poses.session.interval)
            found.append(own.reshape(-1, self.count))
        return np.concatenate(found)

    def _move_columns(self, k: int, poses: Poses) -> Array:
        moves = poses.session.moves
        own = np.zeros((len(moves), 3, self.count))
        if not moves:
            return own.reshape(0, self.count)
        for term in terms.UNIT:
            if term.sensor == "gyro" and term.name != "lag":
                own[:, :, term.columns] = self._paths[k].columns(term.name)
        before, after = _swings(poses.session)
        # the gyros have not yet turned what comes within the lag
        back = np.swapaxes(poses.expected, 1, 2)
        own[:, :, terms.columns_of("gyro", "lag")] = back * before[:, None, :] - after[
            :, None, :
        ] * np.eye(3)
        biases = self._columns_from(_own(k, "gyro bias X1"))
        if biases is not None:
            own[:, :, biases] = own[:, :, terms.columns_of("gyro", "bias")]
        start, end = poses.of_ends()
        own[:, :, self.columns_of_table(k)] = end - back @ start
        return own.reshape(-1, self.count)

    def paths(self, k: int) -> Array:
        """Integrals (m, 3, 3) [s] of the attitude in b at a move's end over each move of k."""
        return self._paths[k].turned if k in self._paths else np.zeros((0, 3, 3))

    def integration(self, k: int) -> Array:
        """What the samples of each move of k are too few for (m, 3) [rad], and was mended."""
        return self._paths[k].left if k in self._paths else np.zeros((0, 3))


def _swings(session: Session) -> tuple[Array, Array]:
    """Rates (m, 3) in b of the turning of the station before each move, and of that after it."""
    swing = np.array([s.stretch.rate * s.stretch.axis_b for s in session.stations])
    return swing[[m.first for m in session.moves]], swing[[m.last for m in session.moves]]


def _by_lag(own: Array, rate: float) -> Array:
    """Derivative (2, 3, 3) of cosine and sine by each channel's lag, of coefficients (3, 3)."""
    return rate * np.stack([np.diag(-own[2]), np.diag(own[1])])


def _own(k: int, name: str) -> str:
    return f"recording {k + 1}: {name}"


def _arms(k: int) -> list[str]:
    """Where the unit's point was in session k."""
    return [_own(k, f"{ARM}{axis}") if k else f"{ARM}{axis}" for axis in AXES]


def _names(k: int, poses: Poses) -> list[str]:
    """Of the table's errors in session k: what is of one station alone is of this session."""
    return [
        _own(k, name) if k and name.startswith(("position of ", "axis of ")) else name
        for name in poses.leanings.names
    ]


def _unknowns(sessions: Sequence[Session], poses: Sequence[Poses], bench: Bench) -> Unknowns:
    turning, warm = any(s.turning for s in sessions), any(s.warm for s in sessions)
    expected, sigmas = terms.priors(bench, turning, warm)
    names, units, sizes = [GRAVITY], ["m/s^2"], [bench.gravity_sigma]
    for k, own in enumerate(poses):
        for name, sigma in zip(_names(k, own), own.leanings.sigmas.tolist(), strict=True):
            if name not in names:
                names.append(name)
                units.append("rad")
                sizes.append(sigma)
    for k, session in enumerate(sessions):
        if session.turning and bench.arm_sigma:
            names += _arms(k)
            units += ["m"] * 3
            sizes += [bench.arm_sigma] * 3
    several = len(sessions) > 1
    for k in range(len(sessions) if several else 0):
        for sensor, unit in (("gyro", "rad/s"), ("accel", "m/s^2")):
            size = sigmas[terms.columns_of(sensor, "bias")] / np.sqrt(2)
            names += [_own(k, f"{sensor} bias {axis}") for axis in AXES]
            units += [unit] * 3
            sizes += size.tolist()
    if several:
        for sensor in SENSORS:  # the part that stays, and what changes each time it is switched on
            sigmas[terms.columns_of(sensor, "bias")] /= np.sqrt(2)
    return Unknowns(
        names=tuple(names),
        units=tuple(units),
        expected=np.concatenate([expected, np.zeros(len(names))]),
        sigmas=np.concatenate([sigmas, sizes]),
    )


# --- moves ---------------------------------------------------------------------------------------


class _Paths:
    """Readings over all moves of a session, one after the other, ready to be integrated.

    Samples count in pairs; where a move has an odd number, nothing comes before its first.
    """

    def __init__(self, moves: Sequence[Move]) -> None:
        counts = [len(move.readings) for move in moves]
        self._pairs, self._at = _places(np.array(counts))
        self._first = np.cumsum(self._pairs) - self._pairs
        self._h = np.concatenate([np.diff(m.readings.t, prepend=m.t_from) for m in moves])[:, None]
        means = [m.readings.means(slice(0, n)) for m, n in zip(moves, counts, strict=True)]
        self._w, self._f = (np.concatenate(triad) for triad in zip(*means, strict=True))
        self._warmth = np.concatenate(
            [np.broadcast_to(m.warmth, n) for m, n in zip(moves, counts, strict=True)]
        )

    def rotations(self, gyro: TriadConstants) -> Array:
        """By the corrected readings (m, 3, 3): takes b at each move's end to b at its start."""
        w = inverse(gyro, self._w, self._f, self._warmth)
        return matrices(_products(self._steps(w))) @ _exponential(-self.left)

    def columns(self, name: str) -> Array:
        """Rotations at the ends (m, 3, 3 or 9) that a term makes, per unit of it."""
        own = terms.columns("gyro", name, self._w, self._f, self._warmth) * self._h[:, :, None]
        sums = self._paired(own.reshape(len(own), -1)).sum(axis=1).reshape(len(self._to_end), 3, -1)
        return np.add.reduceat(self._to_end @ sums, self._first, axis=0)

    @cached_property
    def left(self) -> Array:
        """What two samples at a time leave of each rotation (m, 3) [rad], seen at its end.

        By pairs of twice the length, whose error is 16 times as large: L. F. Richardson (1911).
        """
        sums = self._paired(self._w * self._h).sum(axis=1)
        pairs, at = _places(self._pairs)
        coarse = np.zeros((2 * int(pairs.sum()), 3))
        coarse[at] = sums
        steps = coarse.reshape(-1, 2, 3)
        q = quaternions(rotation_vectors(steps[:, 0], steps[:, 1]))
        C = matrices(_products(np.split(q, np.cumsum(pairs)[:-1])))
        fine = matrices(_products(self._steps(self._w)))
        return _logarithm(np.swapaxes(fine, 1, 2) @ C) / (2**4 - 1)

    @cached_property
    def turned(self) -> Array:
        """Integrals (m, 3, 3) [s] over each move of the attitude in b at its end."""
        seconds = self._paired(self._h).sum(axis=1)
        return np.add.reduceat(self._to_end * seconds[:, :, None], self._first, axis=0)

    @cached_property
    def _to_end(self) -> Array:
        """B at a move's end (p, 3, 3) from b at the middle of each pair of samples."""
        found = []
        for q in self._steps(self._w):
            run = matrices(_running(q))
            middle = (run + np.concatenate([np.eye(3)[None], run[:-1]])) / 2
            found.append(run[-1].T @ middle)
        return np.concatenate(found)

    def _steps(self, w: Array) -> list[Array]:
        """Quaternions (p, 4) of every move's pairs at rates (n, 3)."""
        steps = self._paired(w * self._h)
        q = quaternions(rotation_vectors(steps[:, 0], steps[:, 1]))
        return np.split(q, self._first[1:])

    def _paired(self, rows: Array) -> Array:
        """Rows (n, k) of all moves as pairs (p, 2, k)."""
        found = np.zeros((2 * int(self._pairs.sum()), rows.shape[1]))
        found[self._at] = rows
        return found.reshape(-1, 2, rows.shape[1])


def _places(counts: IntArray) -> tuple[IntArray, IntArray]:
    """How many pairs some runs of rows have, `counts` long each, and where in them each row is."""
    pairs = (counts + 1) // 2
    first = 2 * (np.cumsum(pairs) - pairs)
    rows = [a + n % 2 + np.arange(n) for a, n in zip(first, counts, strict=True)]
    return pairs, np.concatenate(rows)


def _running(q: Array) -> Array:
    """Running products of quaternions (n, 4), by doubling."""
    done, step = q, 1
    while step < len(q):
        done = np.concatenate([done[:step], multiply(done[:-step], done[step:])])
        step *= 2
    return done


def _products(runs: Sequence[Array]) -> Array:
    """The product (m, 4) of each of some runs of quaternions (n, 4), pair by pair, all at once."""
    q, counts = np.concatenate(runs), np.array([len(run) for run in runs])
    while counts.max() > 1:
        odd = np.cumsum(counts)[counts % 2 == 1]
        q = np.insert(q, odd, [0.0, 0.0, 0.0, 1.0], axis=0)
        q, counts = multiply(q[0::2], q[1::2]), (counts + 1) // 2
    return q


def _exponential(vectors: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3)."""
    return matrices(quaternions(vectors))


def _logarithm(C: Array) -> Array:
    """Rotation vectors (n, 3) of matrices (n, 3, 3) that turn by less than a right angle."""
    twice = np.stack(
        [C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], axis=1
    )
    size = np.minimum(np.linalg.norm(twice, axis=1) / 2, 1.0)
    whole = np.where(size > 0, np.arcsin(size) / np.where(size > 0, size, 1.0), 1.0)
    return np.asarray(twice / 2 * whole[:, None])
