"""What the data sheets of unit and table say, as errors to first order.

The unit's become `InstrumentErrors` of `alignment.information`. The table's are small rotations of
b at each attitude, worked out from the stand's own axes: what a class states of one axis turns and
leans it the same way in every position, so much of it cancels and some of it does not.
"""

from dataclasses import dataclass
from itertools import product
from math import sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray, set_owned
from alignment.information import GaussMarkov, InstrumentErrors, TriadErrors
from alignment.information.model import NODES
from stand.imu import ImuSpec
from stand.imu.filter import LAG, noise_variance
from stand.imu.preset import TriadSpec
from stand.imu.processes import plateau
from stand.rehearsal.known_errors import Size, StatedErrors
from stand.table.joints import JOINTS, StandModel

_NOTHING = 1e-15  # of a step squared: waves below it are none
_WAVES = 200  # harmonics of a staircase: those beyond hold 0.3 % of what rounding does
_MIXED = 16  # of which pairs are looked at: those beyond hold 4 % of it
_BLURRED = 60.0  # exp(-30) of a wave is none
# the axis toward which each one leans, as `stand.physics.geometry` builds it
_TOWARD = {"base_pitch": 0, "base_yaw": 1, "outer": 1, "middle": 3, "inner": 4}


def unit_of(imu: ImuSpec) -> InstrumentErrors:
    """The instrument's errors as standard deviations, but for `roundings_of` its samples."""
    delay = LAG / imu.gyro.bandwidth if np.isfinite(imu.gyro.bandwidth) else 0.0
    return InstrumentErrors(
        _triad(imu.gyro, imu), _triad(imu.accel, imu), float(delay + imu.clock.latency)
    )


def _triad(spec: TriadSpec, imu: ImuSpec) -> TriadErrors:
    height = spec.instability / plateau(imu.corners)
    return TriadErrors(
        noise=spec.noise,
        bias=spec.bias,
        ramp=spec.ramp,
        scale=spec.scale,
        asymmetry=spec.asymmetry,
        quadratic=spec.second_order,
        cubic=spec.nonlinearity / spec.full_scale**2,
        misalignment=spec.misalignment,
        non_orthogonality=spec.non_orthogonality,
        g_sensitivity=spec.g_sensitivity,
        g2_sensitivity=spec.g2_sensitivity,
        drift=tuple(GaussMarkov(height, corner) for corner in imu.corners) if height else (),
        random_walk=spec.random_walk,
    )


@dataclass(frozen=True, slots=True)
class Rounding:
    """Samples rounded to a `step`, by what noise of `dither` (standard deviation) leaves of it.

    Notes
    -----
    Rounding of x takes away ``sum_n (-1)^n q/(pi n) sin(2 pi n x / q)``. The mean over normal noise
    of sigma multiplies each wave by ``exp(-2 (pi n sigma / q)^2)``: what is left depends on where
    in a step x lies, and no time averages it out. All else is noise anew in each sample, the rest
    of ``q^2/12``. Where nobody knows in which part of a step x lies, as with a bias of many steps,
    two readings that are apart by d share ``cos(2 pi n d / q)`` of each wave, and as d is known to
    s only, that times ``exp(-2 (pi n s / q)^2)``. Where it is known better than to a third of a
    step, waves of different n go together as well. Source: B. Widrow and I. Kollar, Quantization
    Noise (2008), ch. 9.
    """

    step: float
    dither: float

    def _waves(self) -> tuple[Array, Array]:
        """Wave numbers (n,) per unit of a reading, and mean squares of each wave that is left."""
        n = np.arange(1, _WAVES + 1)
        turns = 2 * np.pi * n / self.step
        return turns, 2 / turns**2 * np.exp(-((turns * self.dither) ** 2))

    @property
    def noise(self) -> float:
        """Standard deviation of what is anew in each sample."""
        if not self.step:
            return 0.0
        return float(np.sqrt(max(self.step**2 / 12 - self._waves()[1].sum(), 0.0)))

    @property
    def steepness(self) -> float:
        """Root mean square of the scale factor error that is left for less than a step."""
        if not self.step:
            return 0.0
        turns, squares = self._waves()
        return float(np.sqrt(np.sum(squares * turns**2)))

    def shared(self, apart: Array, doubt: Array) -> Array:
        """Covariance (...) of what is left in two readings that are `apart`, known to `doubt`."""
        result = np.zeros_like(apart)
        if self.step:
            for turn, square in zip(*self._waves(), strict=True):
                if square < _NOTHING * self.step**2:
                    break
                result += square * np.cos(turn * apart) * np.exp(-((turn * doubt) ** 2) / 2)
        return result

    def moments(self, x: Array, known: Array) -> Array:
        """Mean products (k, k) of what is left in readings planned at `x` (k,).

        `known` (k, k): covariance of what they will be. Of normal y = x_i and z = x_j

        ``E sin(a y) sin(b z) = (cos(a x_i - b x_j) exp(-Var(a y - b z) / 2)
        - cos(a x_i + b x_j) exp(-Var(a y + b z) / 2)) / 2``,

        summed over all pairs of waves. The first with a = b is what `shared` has.
        """
        size = known.diagonal()
        squared = np.maximum(size[:, None] + size - 2 * known, 0.0)
        result = self.shared(x[:, None] - x, np.sqrt(squared))
        if not self.step:
            return result
        turns, squares = self._waves()
        heights = np.sqrt(2 * squares) * (-1.0) ** np.arange(1, _WAVES + 1)
        strong = np.flatnonzero(squares[:_MIXED] > _NOTHING * self.step**2)
        for n, m, sign in product(strong, strong, (1, -1)):
            if n == m and sign > 0:
                continue
            a, b = turns[n], sign * turns[m]
            blurred = a**2 * size[:, None] + b**2 * size - 2 * a * b * known
            if blurred.min() < _BLURRED:
                wave = np.cos(a * x[:, None] - b * x) * np.exp(-blurred / 2)
                result += sign * heights[n] * heights[m] / 2 * wave
        return result


def roundings_of(imu: ImuSpec, rate_hz: int) -> tuple[Rounding, Rounding]:
    """Of gyros and of accelerometers; increments carry their remainders on, and lose nothing."""
    gyro, accel = (
        Rounding(0.0 if imu.increments else spec.resolution, _sample_noise(spec, rate_hz))
        for spec in (imu.gyro, imu.accel)
    )
    return gyro, accel


def _sample_noise(spec: TriadSpec, rate_hz: int) -> float:
    """Standard deviation of one sample's white noise behind the low-pass."""
    return spec.noise * sqrt(rate_hz * noise_variance(spec.bandwidth, rate_hz))


@dataclass(frozen=True, slots=True, eq=False)
class Leaning:
    """An error of the table, and the `turns` (k, 3) of b at k poses per unit of it.

    `sigma` of its draws, or the value that is `known` of it.
    """

    source: str
    sigma: float
    turns: Array
    known: float = 0.0

    def __post_init__(self) -> None:
        set_owned(self, turns=(self.turns, (None, 3), float))


def leanings(
    stated: StatedErrors,
    model: StandModel,
    joints: Array,
    round_axis: IntArray | None = None,
    off: Array | None = None,
) -> list[Leaning]:
    """Every error that is stated, and how it turns b at joint angles (k, 6) [rad].

    ``C_true = C_nominal exp(turns)``. `round_axis` (k,): the axis that goes round evenly through a
    pose and others (-1: none does): a ripple too quick for `NODES` of them leaves nothing in a
    whole turn. `off` (k, 6): by how much axes stand beyond what they are told at each pose.
    """
    frames, axes, across, before = _chain(model, joints)
    rounds = np.full(len(joints), -1) if round_axis is None else round_axis
    found: list[Leaning] = []

    def add(source: str, size: Size, in_w: Array) -> None:
        if size.sigma or size.known:
            turns = np.einsum("kji,kj->ki", frames, in_w)
            found.append(Leaning(source, size.sigma, turns, size.known))

    for axis, (line, base, seat) in enumerate(
        zip(np.eye(3), stated.base(), stated.mounting(), strict=True)
    ):
        add("table tilt" if axis < 2 else "table azimuth", base, np.tile(line, (len(joints), 1)))
        add("mounting", seat, frames[:, :, axis])
    for i, name in enumerate(JOINTS):
        q = joints[:, i : i + 1]
        add("placement", stated.placement(i), axes[:, i])
        for order in (1, 2):
            waves = np.cos(order * q), np.sin(order * q)
            for size, wave in zip(stated.encoder(i, order), waves, strict=True):
                add("encoder", size, axes[:, i] * wave)
        if name in _TOWARD:
            toward = np.einsum("kij,j->ki", before[:, i], _built(model)[_TOWARD[name]])
            turned = np.cross(axes[:, i], toward)
            after = Rotation.from_rotvec(q * axes[:, i]).apply(turned)
            add("non-orthogonality", stated.non_orthogonality(i), turned - after)
        for size, cosine, sine in stated.wobble(i):
            c, s = cosine * np.cos(q) - sine * np.sin(q), cosine * np.sin(q) + sine * np.cos(q)
            add("wobble", size, across[:, i, 0] * c + across[:, i, 1] * s)
        n, waves = stated.ripple(i)
        slow = 1.0 if n < NODES / 2 else (rounds != i)[:, None]
        for size, cosine, sine in waves:
            wave = cosine * np.cos(n * q) - sine * np.sin(n * q)
            add("rate ripple", size, axes[:, i] * wave * slow)
    if off is not None and off.any():
        add("servo", Size(known=1.0), np.einsum("ki,kij->kj", off, axes))
    return found


def _built(model: StandModel) -> Array:
    """The hinges' axes (6, 3) in w at zero angles; every body is built parallel to w."""
    hinges = {b.joint.name: b.joint.axis for b in model.bodies if b.joint is not None}
    return np.array([hinges[name] for name in JOINTS])


def _chain(model: StandModel, joints: Array) -> tuple[Array, Array, Array, Array]:
    """At poses (k, 6): ``C_wb`` (k, 3, 3), axes (k, 6, 3) in w, two lines across each that turn
    with it (k, 6, 2, 3), and the turn (k, 6, 3, 3) of what carries each axis."""
    built, k = _built(model), len(joints)
    C = np.tile(np.eye(3), (k, 1, 1))
    axes, across, before = np.empty((k, 6, 3)), np.empty((k, 6, 2, 3)), np.empty((k, 6, 3, 3))
    for i, axis in enumerate(built):
        before[:, i], axes[:, i] = C, C @ axis
        C = C @ Rotation.from_rotvec(joints[:, i : i + 1] * axis).as_matrix()
        first = np.eye(3)[(int(np.abs(axis).argmax()) + 1) % 3]
        across[:, i, 0], across[:, i, 1] = C @ first, C @ np.cross(axis, first)
    return C @ Rotation.from_quat(model.imu_rotation).as_matrix(), axes, across, before
