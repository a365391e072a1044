"""Moves between rests: how gyros turn the vertical of one into that of the next.

Source: D. Tedaldi, A. Pretto, E. Menegatti (ICRA 2014), equations (11) to (13); integrated here as
rotation vectors of each sample with coning to the sample before, J. E. Bortz (1971).
"""

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.calibration.apply import inverse
from alignment.calibration.constants import TriadConstants, columns, slope
from alignment.calibration.result import Key
from alignment.cross import cross
from alignment.quaternions import multiply, normalised, prefix_product
from alignment.readings import ImuReadings
from alignment.strapdown import matrices, quaternions

_CHUNK = 20_000  # samples at once: bounds the memory of derivatives


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """Samples between rests, move after move.

    `w`, `f` (n, 3) as read, `dt` (n,) [s]; `first` (m,) the first sample of each move, `rests`
    (m, 2) the rests before and after it, `spans` (m,) [s] from the one to the other.
    """

    w: Array
    f: Array
    dt: Array
    first: IntArray
    rests: IntArray
    spans: Array

    @property
    def samples(self) -> list[slice]:
        """Of each move."""
        ends = [*self.first[1:].tolist(), len(self.dt)]
        return [slice(a, b) for a, b in zip(self.first.tolist(), ends, strict=True)]


def moves_of(readings: ImuReadings, rests: list[tuple[float, float]], without: set[int]) -> Moves:
    """The samples between each rest (from, to) [s] and the next, but of moves `without`."""
    dt = np.diff(readings.t, prepend=readings.t[0] - readings.interval)
    parts, pairs = [], []
    for k in range(len(rests) - 1):
        a, b = np.searchsorted(readings.t, [rests[k][1] + 1e-9, rests[k + 1][0] + 1e-9])
        if k not in without and b > a:
            parts.append(slice(int(a), int(b)))
            pairs.append((k, k + 1))
    felt = [readings.means(part) for part in parts] or [(np.zeros((0, 3)),) * 2]
    w, f = (np.concatenate(triad) for triad in zip(*felt, strict=True))
    lengths = np.array([part.stop - part.start for part in parts], int)
    return Moves(
        w=w,
        f=f,
        dt=np.concatenate([dt[part] for part in parts] or [np.zeros(0)]),
        first=np.cumsum(lengths) - lengths,
        rests=np.array(pairs, int).reshape(-1, 2),
        spans=np.array([dt[part].sum() for part in parts]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """What gyros say of moves.

    `C` (m, 3, 3): b at a move's end to b at its begin. `by` (m, 3, p): small rotation about b at
    the end by which each parameter of the gyros, as a correction of the truth, turns that.
    """

    C: Array
    by: Array


def turned(moves: Moves, gyro: TriadConstants, force: Array, keys: list[Key]) -> Turned:
    """Integrate every move with a triad's constants; `force` (n, 3) as corrected."""
    found = [_few(moves, part, gyro, force, keys) for part in _chunks(moves)]
    return Turned(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _chunks(moves: Moves) -> list[list[slice]]:
    """Whole moves, some samples at a time."""
    chunks: list[list[slice]] = []
    size = _CHUNK
    for part in moves.samples:
        if size + part.stop - part.start > _CHUNK:
            chunks.append([])
            size = 0
        chunks[-1].append(part)
        size += part.stop - part.start
    return chunks


def _few(
    moves: Moves, parts: list[slice], gyro: TriadConstants, force: Array, keys: list[Key]
) -> tuple[Array, Array]:
    whole = slice(parts[0].start, parts[-1].stop)
    first = np.array([part.start - whole.start for part in parts])
    last = np.array([part.stop - whole.start - 1 for part in parts])
    f = force[whole]
    w = inverse(gyro, moves.w[whole], f)
    q = prefix_product(quaternions(_vectors(w, moves.dt[whole], first)))
    before = np.concatenate([[[0.0, 0.0, 0.0, 1.0]], q[:-1]])
    origin = np.repeat(before[first], last - first + 1, axis=0)
    C = matrices(_difference(before[first], q[last]))
    middle = matrices(normalised(_difference(origin, before) + _difference(origin, q)))
    # what a correction of a parameter takes from the true rate, turned to the begin and summed
    slopes = np.linalg.solve(slope(gyro, w), columns(keys, gyro, w, f))
    sums = np.add.reduceat(-middle @ slopes * moves.dt[whole][:, None, None], first, axis=0)
    return C, np.swapaxes(C, 1, 2) @ sums


def _vectors(w: Array, dt: Array, first: IntArray) -> Array:
    """Rotation vectors (n, 3) of samples, coning to the one before; a move's first has none."""
    angle = w * dt[:, None]
    before = np.roll(angle, 1, axis=0)
    before[first, :] = 0.0
    return angle + cross(before, angle) / 12


def _difference(origin: Array, q: Array) -> Array:
    """``origin^-1 q`` of unit quaternions (n, 4), of the nearer sign."""
    found = multiply(origin * np.array([-1.0, -1.0, -1.0, 1.0]), q)
    return np.asarray(np.where(found[:, 3:] < 0, -found, found))
