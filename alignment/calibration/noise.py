"""Covariance of the readings of a session, by what makes it: white noise, drifts, rounding.

Gyros and accelerometers drift alike on all axes and independently; what drifts in a move is the
same as in the stations beside it.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from alignment.arrays import Array, IntArray
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.model import Model
from alignment.calibration.session import Poses
from alignment.information.drift import Span, gauss_markov, ramp_coefficients, random_walk
from alignment.information.model import TriadErrors, coefficient_weights

# of the model itself, at each coefficient: second orders of table and unit that are left out
FLOOR = {"gyro": 2e-10, "accel": 1e-6, "move": 1e-9}  # rad/s (4e-5 deg/h), m/s^2 (0.1 ug), rad
DRIFTS = INSTABILITY, WALK, RAMP = "bias instability", "random walk", "ramp"
ENCODER = "encoder steps"
MENDED = 0.3  # of what a move's integration was mended by, that may be left
ALIKE = 0.2  # of a step, within which means are rounded alike
NAMES = {"gyro": "gyro", "accel": "accelerometer"}

Parts = dict[str, Array]


def noise_parts(model: Model) -> Parts:
    """Covariances (m, m) of all readings by source; sessions are independent."""
    each = [_of_session(model, k) for k in range(len(model.sessions))]
    names = dict.fromkeys(name for parts in each for name in parts)
    sizes = [len(next(iter(parts.values()))) for parts in each]
    return {
        name: np.asarray(
            block_diag(*(p.get(name, np.zeros((n, n))) for p, n in zip(each, sizes, strict=True)))
        )
        for name in names
    }


def _of_session(model: Model, k: int) -> Parts:
    poses, bench = model.poses[k], model.bench
    spans = [s.stretch.span for s in poses.session.stations]
    moves = [Span(m.t_from, m.length) for m in poses.session.moves]
    paths = model.paths(k)
    weights = np.concatenate([coefficient_weights(s.stretch) / s.stretch.span.length
                              for s in poses.session.stations])  # fmt: skip
    found: Parts = {}
    sizes = [3 * len(weights), 3 * len(moves), 3 * len(weights)]
    edges = np.cumsum([0, *sizes])
    gyro, accel = slice(0, edges[2]), slice(edges[2], edges[3])

    def add(name: str, own: slice, part: Array) -> None:
        whole = found.setdefault(name, np.zeros((edges[3], edges[3])))
        whole[own, own] += part

    drifts = Drifts([*spans, *moves])
    rows = np.concatenate([np.tile(np.eye(3), (len(weights), 1, 1)), paths])
    for index, (sensor, own) in enumerate(zip(SENSORS, (gyro, accel), strict=True)):
        triad: TriadErrors = getattr(bench.unit, sensor)
        label, noise = NAMES[sensor], np.asarray(triad.noise)
        white = np.repeat(weights, 3) * np.tile(noise**2, len(weights))
        if sensor == "gyro":
            turned = [path_noise(m.length, noise) for m in poses.session.moves]
            white = np.concatenate([white, *turned]) if turned else white
        add(f"{label} white noise", own, np.diag(white))
        first = slice(own.start, own.start + 3 * len(weights))
        add(f"{label} rounding", first, _rounded(poses, bench, index))
        mixed = rows if sensor == "gyro" else rows[: len(weights)]
        for name, covariance in drifts.of(triad).items():
            part = covariance if sensor == "gyro" else covariance[: len(weights), : len(weights)]
            add(f"{label} {name}", own, _mixed(mixed, part))
    mended = (MENDED * model.integration(k).ravel()) ** 2
    add("integration of the moves", slice(edges[1], edges[2]), np.diag(mended))
    floor = np.repeat([FLOOR["gyro"], FLOOR["move"], FLOOR["accel"]], sizes) ** 2
    found["model"] = np.diag(floor)
    if bench.joint_noise.any() and poses.leanings.axes.shape[2]:
        found[ENCODER] = _joints(model, k, edges[3])
    if bench.table is None:
        found["turning of the axes"] = np.diag(_uneven(model, k, edges[3]))
    return {name: part for name, part in found.items() if part.any()}


def path_noise(length: float, noise: Array) -> Array:
    """Variances (3,) of a move's rotation by white noise; densities of unlike axes are averaged."""
    return np.full(3, length * np.mean(noise**2))


def _mixed(rows: Array, covariance: Array) -> Array:
    """Covariance of ``rows[a] @ drift_a``: (n, 3, 3) of drifts (n, n) alike on three axes."""
    n = len(rows)
    whole = np.einsum("ab,aik,bjk->aibj", covariance, rows, rows)
    return whole.reshape(3 * n, 3 * n)


class Drifts:
    """Covariances of slow processes over stretches, each worked out once."""

    def __init__(self, spans: Sequence[Span]) -> None:
        self._spans = spans
        self._known: dict[float, Array] = {}

    def of(self, triad: TriadErrors) -> Mapping[str, Array]:
        """(h, h) of bias instability, random walk and ramp, those that there are."""
        found: dict[str, Array] = {}
        for process in triad.drift:
            if process.time not in self._known:
                self._known[process.time] = gauss_markov(self._spans, process.time)
            part = process.sigma**2 * self._known[process.time]
            found[INSTABILITY] = found.get(INSTABILITY, 0.0) + part
        if triad.random_walk:
            found[WALK] = triad.random_walk**2 * random_walk(self._spans)
        ramp = np.asarray(triad.ramp)
        if ramp.any():
            times = np.concatenate([ramp_coefficients(span) for span in self._spans])
            found[RAMP] = float(np.mean(ramp**2)) * np.outer(times, times)
        return found


def _rounded(poses: Poses, bench: Bench, sensor: int) -> Array:
    """Covariance (3 h, 3 h) by rounding: what it adds to each sample, and the means' own errors.

    With little noise on it the mean errs by up to ``(step/pi) exp(-2 pi^2 sigma^2/step^2)``, its
    square half of that on average: Widrow, Kollar and Liu, IEEE Trans. Instrum. Meas. 45 (1996).
    Means of like values err alike.
    """
    step, dither = float(bench.steps[sensor]), float(bench.dither[sensor])
    weights = [coefficient_weights(s.stretch) for s in poses.session.stations]
    count = len(np.concatenate(weights))
    if step == 0.0:
        return np.zeros((3 * count, 3 * count))
    lengths = np.array([s.stretch.span.length for s in poses.session.stations])
    samples = np.repeat(lengths / poses.session.interval, [len(w) for w in weights])
    found = np.diag(np.repeat(np.concatenate(weights) * step**2 / 12 / samples, 3))
    bias = step / np.pi * np.exp(-2 * np.pi**2 * (dither / step) ** 2)
    x = (poses.w, poses.f)[sensor]
    means = np.array([x[a:b].mean(axis=0) for a, b in pairwise(poses.edges.tolist())])
    first = np.cumsum([0, *(len(w) for w in weights)])[:-1]
    for axis in range(3):
        alike = np.abs(means[:, None, axis] - means[None, :, axis]) < ALIKE * step
        own = 3 * first + axis
        found[np.ix_(own, own)] += bias**2 / 2 * _grouped(alike)
    return found


def _grouped(alike: np.ndarray) -> np.ndarray:
    """The same (n, n), made transitive: each with all that are like one of its like."""
    group = np.arange(len(alike))
    for k in range(len(alike)):
        group[np.isin(group, group[alike[k]])] = group[k]
    return group[:, None] == group[None, :]


def _uneven(model: Model, k: int, size: int) -> Array:
    """Variances (m,) of turns on a table of which only attitudes are known.

    Once a turn its axis wobbles, and its encoder errs, by as much as an attitude does: rates by
    that times the rate, forces by that times gravity at most.
    """
    poses, rows = model.poses[k], model.rows()[k]
    found = np.zeros(size)
    for station, own in zip(poses.session.stations, rows, strict=False):
        rate = station.stretch.rate
        if rate:
            there, half = own - rows[0][0], len(own) // 2
            found[there[3:half]] = (model.bench.placement * rate) ** 2
            found[there[half:]] = (model.bench.placement * poses.site.gravity) ** 2
    return found


def _joints(model: Model, k: int, size: int) -> Array:
    """Covariance by the joints' angles about what encoders say: of each rest, and of moves' ends.

    A rest's are in the moves beside it; where an axis goes round, each end has its own, and the
    mean rate that of both ends.
    """
    poses, rows = model.poses[k], model.rows()[k]
    found = np.zeros((size, size))
    stations, moves = poses.session.stations, poses.session.moves
    start, axes = rows[0][0], poses.leanings.axes * model.bench.joint_noise
    ends = axes[poses.edges[-1] :]
    to_end = np.swapaxes(poses.expected, 1, 2)
    beside: list[list[tuple[IntArray, Array]]] = [[] for _ in stations]
    for m in range(len(moves)):
        own = rows[len(stations) + m] - start
        beside[moves[m].first].append((own, to_end[m] @ ends[2 * m]))
        beside[moves[m].last].append((own, -ends[2 * m + 1]))
    for n, station in enumerate(stations):
        if station.stretch.rate:
            for own, turns in beside[n]:
                found[np.ix_(own, own)] += turns @ turns.T
            own = rows[n][:3] - start
            ends_of = axes[poses.edges[n], :, station.going_round] / station.stretch.span.length
            found[np.ix_(own, own)] += 2 * np.outer(ends_of, ends_of)
            continue
        at = poses.edges[n]
        own = np.concatenate([np.cross(x[at], axes[at].T) for x in (poses.w, poses.f)], axis=1).T
        there = np.concatenate([rows[n] - start, *(place for place, _ in beside[n])])
        whole = np.concatenate([own, *(-turns for _, turns in beside[n])])
        found[np.ix_(there, there)] += whole @ whole.T
    return found
