"""Strapdown integration of increments: two samples a step, coning and sculling corrected.

Attitude and velocity are carried in the inertial frame i that b had at the start. Nothing here
knows the Earth; quaternions are plain arrays (..., 4), order x, y, z, w.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.cross import cross
from alignment.errors import AlignmentError
from alignment.parts import in_parts, release
from alignment.quaternions import multiply, normalised, prefix_product
from alignment.readings import ImuReadings

_OF_A_CUBIC = 4  # means that it goes through
_NO_TURN = 1e-300  # rad: below any
_LEAST_KEPT = 0.1  # of a vector that turns by most of a circle in a block
_CHUNK = 32768  # samples integrated at once: they fit a cache, and bound memory
_LARGEST_STEP = 0.2  # rad in one sample: beyond, two samples no longer describe the turn


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """A record in the inertial frame i, in `m` blocks of some samples each.

    Attributes
    ----------
    t : (m + 1,) s
        Edges of the blocks; the first one is the start of the first sample's interval.
    q : (m + 1, 4)
        ``C_ib`` at the edges, as quaternions; the first is one.
    v : (m + 1, 3) m/s
        Integral of specific force in i up to the edges.
    p : (m, 3) m
        Integral of that over each block, by Simpson's rule over the steps of two samples.
    turned : (m, 3, 3) s
        Integral of ``C_ib`` over each block.
    dtheta, dv : (m, 3) rad, m/s
        Sums of the increments of each block, in b.
    """

    t: Array
    q: Array
    v: Array
    p: Array
    turned: Array
    dtheta: Array
    dv: Array

    @property
    def spans(self) -> Array:
        """Duration of each block (m,) [s]."""
        return np.diff(self.t)

    def until(self, end: int) -> "Carried":
        """The first `end` blocks."""
        edges, blocks = slice(end + 1), slice(end)
        return Carried(
            self.t[edges],
            self.q[edges],
            self.v[edges],
            self.p[blocks],
            turned=self.turned[blocks],
            dtheta=self.dtheta[blocks],
            dv=self.dv[blocks],
        )


def rotation_vectors(first: Array, second: Array) -> Array:
    """Rotation vector (m, 3) over two equal intervals with angle increments (m, 3) [rad].

    Notes
    -----
    ``a + b + 2/3 a x b``: P. G. Savage, Strapdown Inertial Navigation Integration Algorithm
    Design Part 1 (1998), the two-sample algorithm of R. B. Miller (1983). Under coning of half
    angle c at frequency w with samples every h it drifts by ``c^2 w (w h)^4 / 60`` rad/s, without
    the correction by ``c^2 w (w h)^2 / 12``.
    """
    return first + second + 2 / 3 * cross(first, second)


def velocity_vectors(
    first: Array, second: Array, v_first: Array, v_second: Array
) -> tuple[Array, Array]:
    """Velocity increments (m, 3) of two equal intervals, both in b at the start of the first.

    Of a force that stands still in inertial space, as gravity does, while b turns steadily it is
    exact, whatever the turn; else to third order in it.

    Notes
    -----
    The mean of a force that goes round in b by a is ``v = M(-a) u``, with ``M(a) x`` the integral
    of the turned x, so ``u = v + a x v/2 + c a x (a x v)`` of each interval, less what a rate that
    changes adds, and ``a x d/12``, ``b x d/12`` of what the force changes by, d, from one to the
    other. To second order that is two-sample sculling, ``s + 1/2 t x s + 2/3 (a x v + u x b)`` with
    ``t = a + b`` and ``s = u + v``: P. G. Savage, Part 2 (1998).
    """
    first, second, v_first, v_second = map(np.asfortranarray, (first, second, v_first, v_second))
    coned, changed = cross(first, second) / 12, (second - first) / 12
    a, b = first + coned, second + coned
    u, v = _stood(a, changed, v_first), _turned_by(a, _stood(b, changed, v_second))
    change = (v - u) / 12
    return u + cross(a, change), v + cross(b, change)


def _stood(angle: Array, changed: Array, felt: Array) -> Array:
    """What stands still (m, 3) while b turns by `angle`, by its integral in b: in b at the start.

    ``felt + (angle/2 - changed) x felt + c angle x (angle x felt)``, `changed` a twelfth of what
    the angle of an interval changes by, and ``c = (1 - x cot(x)) / (2 x)^2`` with
    ``x = |angle|/2``, or ``1/12 + angle^2/720 + ...``.
    """
    square = np.einsum("mi,mi->m", angle, angle)[:, None]
    turned = cross(angle / 2 - changed, felt)
    c = 1 / 6 + square * (1 / 360 + square / 15120)
    return felt + turned + c * cross(angle, turned)


def _turned_by(angle: Array, values: Array) -> Array:
    """Vectors (m, 3) turned by small rotation vectors `angle` (m, 3), to its sixth power."""
    square = np.einsum("mi,mi->m", angle, angle)[:, None]
    turned = cross(angle, values)
    sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
    versine = 1 / 2 - square / 24 * (1 - square / 30 * (1 - square / 56))
    return values + sine * turned + versine * cross(angle, turned)


def quaternions(rotation_vector: Array) -> Array:
    """Unit quaternions (m, 4) of rotation vectors (m, 3)."""
    square = np.einsum("ij,ij->i", rotation_vector, rotation_vector)
    half = 0.5 * np.sqrt(square)
    q = np.empty((len(half), 4))
    q[:, :3] = (0.5 * np.sinc(half / np.pi))[:, None] * rotation_vector
    q[:, 3] = np.cos(half)
    return q


def matrices(q: Array) -> Array:
    """Rotation matrices (m, 3, 3) of unit quaternions (m, 4)."""
    x, y, z, w = q.T
    C = np.empty((len(q), 3, 3))
    C[:, 0, 0] = 1 - 2 * (y * y + z * z)
    C[:, 1, 1] = 1 - 2 * (x * x + z * z)
    C[:, 2, 2] = 1 - 2 * (x * x + y * y)
    C[:, 0, 1], C[:, 1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
    C[:, 0, 2], C[:, 2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
    C[:, 1, 2], C[:, 2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return C


class Made(NamedTuple):
    """What sensors make of what is true: ``gain @ it + offset``, (3, 3) and (3,)."""

    offset: Array
    gain: Array

    def undone(self, values: Array) -> Array:
        """What is true (n, 3) of readings."""
        return np.asarray((values - self.offset) @ np.linalg.inv(self.gain).T)


def carry(
    readings: ImuReadings, block: float, gyro: Made | None = None, accel: Made | None = None
) -> Carried:
    """Attitude and velocity in i, summed over blocks of about `block` seconds.

    Parameters
    ----------
    readings : ImuReadings, n >= 2
    block : float
        [s]; an even number of samples, at least two. The first block takes what is left over.
    gyro, accel : Made or None
        Errors of the sensors to be taken out [rad/s], [m/s^2].

    Raises
    ------
    AlignmentError
        A sample turns by more than 0.2 rad: too fast for this sampling rate.
    """
    fastest = float(max(max(w.max(), -w.min()) for w in in_parts(readings.w_ib_b)))
    check_steps(fastest, readings.interval)
    n = len(readings)
    per = 2 * max(1, round(block / (2 * readings.interval)))
    m = -(-n // per)
    edges = np.maximum(np.arange(m + 1) * per - (m * per - n), 0)
    start_t = readings.t[0] - readings.interval
    t = np.concatenate([[start_t], readings.t[edges[1:] - 1]])
    out = Carried(
        t=t,
        q=np.tile([0.0, 0.0, 0.0, 1.0], (m + 1, 1)),
        v=np.zeros((m + 1, 3)),
        p=np.zeros((m, 3)),
        turned=np.zeros((m, 3, 3)),
        dtheta=np.zeros((m, 3)),
        dv=np.zeros((m, 3)),
    )
    step = max(1, _CHUNK // per)
    for first in range(0, m, step):
        blocks = slice(first, min(first + step, m))
        _carry_blocks(readings, start_t, edges, blocks, (gyro, accel), out)
        release(readings.t, readings.w_ib_b, readings.f_b)
    return out


def integrate(
    readings: ImuReadings, start: Rotation, w_ie_n: Array, offset: Array, ends: np.ndarray
) -> Rotation:
    """``C_nb`` (k rotations) after the first `ends` (k,) samples: the rival of Runge-Kutta.

    Parameters and frames as `alignment.methods.integration.integrate`.
    Steps hold two samples, so an odd
    number of samples before an end costs one step without coning correction.
    """
    q = np.empty((len(ends), 4))
    total = np.array([0.0, 0.0, 0.0, 1.0])
    before = 0
    start_t = readings.t[0] - readings.interval
    for k, end in enumerate(ends):
        for first in range(before, int(end), _CHUNK):
            part = slice(first, min(first + _CHUNK, int(end)))
            h = np.diff(readings.t[part], prepend=start_t if first == 0 else readings.t[first - 1])
            d = _in_pairs((readings.w_ib_b[part] - offset) * h[:, None])
            run = prefix_product(quaternions(rotation_vectors(d[:, 0], d[:, 1])))
            total = normalised(multiply(total, run[-1]))
        before = int(end)
        q[k] = total
    elapsed = readings.t[ends - 1] - start_t
    earth = Rotation.from_rotvec(-elapsed[:, None] * np.asarray(w_ie_n))
    return earth * start * Rotation.from_quat(q)


def _in_pairs(rows: Array) -> Array:
    """Rows (n, 3) as pairs (m, 2, 3); where n is odd, nothing comes before the first one."""
    if len(rows) % 2:
        rows = np.concatenate([np.zeros((1, 3)), rows])
    return rows.reshape(-1, 2, 3)


def check_steps(fastest: float, interval: float) -> None:
    """Raise where a rate [rad/s] turns by too much in a sample's `interval` [s]."""
    if fastest * interval > _LARGEST_STEP:
        raise AlignmentError(
            f"rate of {np.degrees(fastest):.0f} deg/s: {fastest * interval:.2f} rad in a "
            f"sample of {interval:.4g} s, at most {_LARGEST_STEP} can be integrated"
        )


def _carry_blocks(
    readings: ImuReadings,
    start_t: float,
    edges: np.ndarray,
    blocks: slice,
    made: tuple[Made | None, Made | None],
    out: Carried,
) -> None:
    """Fill `blocks` of `out`, whose edge before them is already known."""
    part = slice(edges[blocks.start], edges[blocks.stop])
    count = blocks.stop - blocks.start
    before = start_t if part.start == 0 else readings.t[part.start - 1]
    h = np.diff(readings.t[part], prepend=before)[:, None]
    w, f = (
        x if own is None else own.undone(x)
        for x, own in zip(readings.means(part), made, strict=True)
    )
    d, f, h = (_padded(x, count, blocks, edges) for x in (w * h, f * h, h))
    first, second = d[:, 0], d[:, 1]
    run = prefix_product(quaternions(rotation_vectors(first, second)))
    start = out.q[blocks.start]
    q = np.concatenate([start[None], multiply(start, run)])
    C = matrices(q)
    halves = velocity_vectors(first, second, f[:, 0], f[:, 1])
    u, dv = (np.einsum("nij,nj->ni", C[:-1], x) for x in (halves[0], halves[0] + halves[1]))
    v = np.cumsum(dv, axis=0) + out.v[blocks.start]
    span = h.sum(axis=1)
    per = len(span) // count
    edge = slice(blocks.start + 1, blocks.stop + 1)
    out.q[edge] = normalised(q[per::per])
    out.v[edge] = v[per - 1 :: per]
    out.p[blocks] = _paths(v - dv, u, dv, h).reshape(count, per, 3).sum(axis=1)
    mean = 0.5 * (C[:-1] + C[1:]).reshape(-1, 9) * span
    out.turned[blocks] = mean.reshape(count, per, 3, 3).sum(axis=1)
    out.dtheta[blocks] = d.reshape(count, -1, 3).sum(axis=1)
    out.dv[blocks] = f.reshape(count, -1, 3).sum(axis=1)


def _paths(v: Array, u: Array, dv: Array, h: Array) -> Array:
    """Integrals (m, 3) of velocities over steps of two intervals `h` (m, 2, 1): from `v`, by `u`
    in the first and `dv` in both, of the parabola through the three; a line where the first one
    is empty."""
    a, b = h[:, 0], h[:, 1]
    whole = a + b
    bent = np.zeros_like(dv)
    np.divide(u * b - (dv - u) * a, a * b * whole, out=bent, where=a > 0)
    line = v * whole + u * (whole / 2) + (dv * b) / 2
    return np.asarray(line + bent * (a**3 + b**3) / 6)


def _padded(rows: Array, count: int, blocks: slice, edges: np.ndarray) -> Array:
    """Rows as pairs (m, 2, k), with empty intervals before the first block of a record."""
    per = int(edges[-1] - edges[-2]) if len(edges) > 2 else -(-len(rows) // 2) * 2
    missing = count * per - len(rows)
    if missing:
        rows = np.concatenate([np.zeros((missing, rows.shape[1])), rows])
    return rows.reshape(-1, 2, rows.shape[1])


def changes_in_b(carried: Carried) -> Array:
    """How fast rates and forces in b change in each block (m, 6).

    Of a force ``C_bi (f_i' - w_i x f_i)``: gravity that turns in b is taken as it turns. A mean
    over a block that turns by a leaves ``sin(a/2)/(a/2)`` of what stands across the axis in i.
    """
    spans = carried.spans[:, None]
    C_ib = Rotation.from_quat(carried.q)
    turn_i = (C_ib[1:] * C_ib[:-1].inv()).as_rotvec()
    middle = Rotation.from_rotvec(turn_i / 2) * C_ib[:-1]
    force_i = np.diff(carried.v, axis=0) / spans
    change_i = _changes(force_i, carried.t) - cross(turn_i / spans, force_i)
    angle = np.linalg.norm(turn_i, axis=1, keepdims=True)
    axis = turn_i / np.maximum(angle, _NO_TURN)
    along = np.sum(axis * change_i, axis=1, keepdims=True) * axis
    kept = np.maximum(np.sinc(angle / (2 * np.pi)), _LEAST_KEPT)
    change_i = along + (change_i - along) / kept
    rate = _changes(carried.dtheta / spans, carried.t)
    return np.concatenate([rate, middle.inv().apply(change_i)], axis=1)


def rates_at_edges(carried: Carried) -> Array:
    """Rates in b (m + 1, 3) at the edges of blocks; of fewer than four that of the block before."""
    rates = carried.dtheta / carried.spans[:, None]
    if len(rates) < _OF_A_CUBIC:
        return np.concatenate([rates[:1], rates])
    return _at_edges(rates)


def _changes(means: Array, t: Array) -> Array:
    """How fast means (m, k) over even blocks between `t` (m + 1,) [s] change within each."""
    if len(means) < _OF_A_CUBIC:
        return np.zeros_like(means)
    return np.asarray(np.diff(_at_edges(means), axis=0) / np.diff(t)[:, None])


def _at_edges(u: Array) -> Array:
    """Values (m + 1, k) at the edges of even blocks of these means (m, k): of the cubic through
    the four means around each, and at the ends of the parabola through three."""
    inner = (7 * (u[1:-2] + u[2:-1]) - u[:-3] - u[3:]) / 12
    (first, second), (last, before) = (
        ((11 * v[0] - 7 * v[1] + 2 * v[2]) / 6, (2 * v[0] + 5 * v[1] - v[2]) / 6)
        for v in (u, u[::-1])
    )
    return np.concatenate([[first, second], inner, [before, last]])
