"""How the carousel's attitude follows its readings: differences of the method itself."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.earth import Site
from alignment.gains import Answer
from alignment.information import Stretch
from alignment.information.model import sensor_inputs
from alignment.methods.carousel import SAME_AXIS, carousel_attitude, without_lag
from alignment.methods.harmonics import Harmonics, TurningVector, turning_vector
from alignment.methods.position_fit import local_vectors
from alignment.options import Options, Priors

_RATE_STEP, _FORCE_STEP = 1e-10, 1e-6  # rad/s, m/s^2: of differences; linear to 1e-5 of a gain
_LEAST_WALK = 1e-12  # rad/sqrt(s): weights need one
_NORTH = Rotation.identity()
_UNKNOWN = Priors()  # an attitude follows from readings alone


def carousel_gains(stretches: Sequence[Stretch], site: Site, options: Options) -> list[Answer]:
    """Stretches about one axis from one attitude together."""
    site.horizontal_rate()
    groups: list[list[int]] = []
    for k, stretch in enumerate(stretches):
        for group in groups:
            if _belongs(stretches[group[0]], stretch):
                group.append(k)
                break
        else:
            groups.append([k])
    return [_turned(stretches, tuple(group), site, options) for group in groups]


def _belongs(a: Stretch, b: Stretch) -> bool:
    apart = np.abs(a.axis_b - b.axis_b).max()
    return bool(apart <= SAME_AXIS) and (a.C_pb.inv() * b.C_pb).magnitude() < SAME_AXIS


def _turned(
    stretches: Sequence[Stretch], planned: tuple[int, ...], site: Site, options: Options
) -> Answer:
    group = tuple(stretches[k] for k in planned)
    nominal = np.array([_coefficients(s, site) for s in group])
    gain = np.empty((3, nominal.size))
    for i in range(nominal.size):
        step = np.zeros(nominal.size)
        step[i] = _RATE_STEP if i % 6 < 3 else _FORCE_STEP
        ahead, behind = (
            _attitude(nominal + s * step.reshape(nominal.shape), group, site, options)
            for s in (1, -1)
        )
        turned = Rotation.from_matrix(ahead @ behind.T).as_rotvec()
        gain[:, i] = site.plumb.apply(turned) / (2 * step[i])
    return Answer(label=group[0].label, stretches=group, planned=planned, gain=gain)


def _attitude(y: Array, group: Sequence[Stretch], site: Site, options: Options) -> Array:
    """``C_nb`` (3, 3) that the method finds from coefficients (s, 3, 6)."""
    priors, axis, rates = options.priors, group[0].axis_b, [s.rate for s in group]
    latitude, _ = local_vectors(site)
    assert latitude is not None
    parts = [
        (
            _vector(c[:, :3], axis, priors.gyro_walk, s.span.length),
            _vector(c[:, 3:], axis, priors.accel_walk, s.span.length),
        )
        for c, s in zip(y, group, strict=True)
    ]
    seen, felt = ([pair[k] for pair in parts] for k in range(2))
    gyros, accels = without_lag(seen, felt, rates, axis)
    return carousel_attitude(gyros, accels, axis, latitude, _UNKNOWN).C_nb


def _vector(c: Array, axis: Array, walk: float, length: float) -> TurningVector:
    scatter = np.eye(3) * max(walk, _LEAST_WALK) ** 2
    h = Harmonics(c[0], c[1], c[2], scatter, normal=np.diag([1.0, 2.0, 2.0]) / length)
    return turning_vector(h, axis)


def _coefficients(stretch: Stretch, site: Site) -> Array:
    """Constant, cosine and sine (3, 6) of what perfect sensors read."""
    w, f, _, project = sensor_inputs(stretch, _NORTH, site)
    return np.asarray(project @ np.concatenate([w, f], axis=1))
