"""Instrument, table and stretches, and how each of their errors shows in the readings.

A stretch at rest is told by the means of its six channels; one that turns at constant rate by
constant, cosine and sine of each against the encoder's angle, over whole turns. Reported, to
first order in every error: ``(1 + s)(1 + M + N) x + a |x| + q x^2 + c x^3 + G f + G2 f^2 + b +
ramp t``, x the true rate or specific force; the same as the stand's instrument reports.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.constant_errors import BY_AXIS, ERRORS_OF
from alignment.cross import cross_matrix
from alignment.earth import Site
from alignment.errors import TooShort
from alignment.information.drift import GaussMarkov, Span, flicker, ramp_coefficients
from alignment.options import Priors
from alignment.units import DEG, DEG_PER_HOUR, MILLI_G, MRAD, PPM, STANDARD_GRAVITY

AXES = ("X1", "Y1", "Z1")
NODES = 24  # angles of a turn: harmonics up to 22 do not mix with the first
POSES = 256  # attitudes of stretches that are remembered: those of one procedure
WHOLE = 0.02  # a turn counts as whole from 98 % of it


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """What an estimator gets from one step of a procedure, as far as it is planned.

    Attributes
    ----------
    label : str
    start, duration : float
        In the recording's time [s]; of a turning one its whole turns count.
    C_pb : Rotation
        Attitude of b in a frame p that stays with the table, as the encoders say; of a turning
        one where its encoder angle is zero.
    rate : float
        Of turning about `axis_b` [rad/s], signed; 0 at rest.
    axis_b : (3,)
        Unit vector.
    angle : float
        Encoder angle when it starts [rad].
    disturbance : (6,)
        Standard deviation of what motion adds to the mean rates [rad/s] and forces [m/s^2] of a
        stretch that is not quite still, beyond what an estimator removes.

    Raises
    ------
    TooShort
        Less than a whole turn.
    """

    label: str
    start: float
    duration: float
    C_pb: Rotation
    rate: float = 0.0
    axis_b: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    angle: float = 0.0
    disturbance: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        set_owned(
            self,
            axis_b=(self.axis_b, (3,), float),
            disturbance=(self.disturbance, (6,), float),
        )
        if not self.duration > 0:
            raise ValueError(f"{self.label}: duration {self.duration} s, must be above 0")
        if abs(float(np.linalg.norm(self.axis_b)) - 1) > 1e-9:
            raise ValueError(f"{self.label}: axis_b must be a unit vector")
        if self.rate and self.span.length == 0:
            raise TooShort(
                f"{self.label}: {np.degrees(abs(self.rate)) * self.duration:.1f} deg, "
                "at least one whole turn is needed"
            )

    @property
    def span(self) -> Span:
        """The time that counts."""
        if not self.rate:
            return Span(self.start, self.duration)
        turn = 2 * np.pi / abs(self.rate)
        turns = int(self.duration / turn + WHOLE)
        return Span(self.start, turns * turn, self.rate, self.angle)


@dataclass(frozen=True, slots=True, eq=False)
class TriadErrors:
    """Three like sensors: standard deviations of their errors, per axis (a number: all alike).

    With u for rad/s or m/s^2. 0: there is none, or it is known; infinite: nothing is known of it.

    Attributes
    ----------
    noise : u/sqrt(Hz)
        White; infinite where there is no sensor on that axis.
    bias, ramp : u, u/s
    scale, asymmetry : a part of the value
    quadratic, cubic : 1/u, 1/u^2
    misalignment, non_orthogonality : rad
        Small rotation of the case from b; leaning together of axes Y-Z, Z-X, X-Y.
    g_sensitivity, g2_sensitivity : u/(m/s^2), u/(m/s^2)^2
        Of each sensor to each component of specific force.
    drift : tuple of GaussMarkov
        Bias instability, alike on all axes.
    random_walk : u/sqrt(s)
        Of the bias, from the recording's time 0; alike on all axes.
    """

    noise: ArrayLike = 0.0
    bias: ArrayLike = 0.0
    ramp: ArrayLike = 0.0
    scale: ArrayLike = 0.0
    asymmetry: ArrayLike = 0.0
    quadratic: ArrayLike = 0.0
    cubic: ArrayLike = 0.0
    misalignment: ArrayLike = 0.0
    non_orthogonality: ArrayLike = 0.0
    g_sensitivity: ArrayLike = 0.0
    g2_sensitivity: ArrayLike = 0.0
    drift: tuple[GaussMarkov, ...] = ()
    random_walk: float = 0.0

    def __post_init__(self) -> None:
        for name in (*BY_AXIS, "noise"):
            object.__setattr__(self, name, _sigmas(getattr(self, name), name))
        if not self.random_walk >= 0:
            raise ValueError(f"random_walk: {self.random_walk}, must not be negative")


@dataclass(frozen=True, slots=True, eq=False)
class InstrumentErrors:
    """An instrument; `lag` [s]: standard deviation of its delay beyond what is accounted for."""

    gyro: TriadErrors = field(default_factory=TriadErrors)
    accel: TriadErrors = field(default_factory=TriadErrors)
    lag: float = 0.0

    def __post_init__(self) -> None:
        _sigmas(self.lag, "lag")


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What is known of table and place: standard deviations.

    Attributes
    ----------
    attitude : (3,) rad
        Of the table's frame about north, east and down: azimuth and tilt. Infinite: it is what
        the procedure is to find.
    placement : (3,) rad
        About the axes of b, anew in each stretch; of a turning one it tilts the axis of turning.
    mounting : (3,) rad
        About the axes of b, the same throughout: how the instrument sits on the table.
    latitude, gravity : rad, m/s^2
    """

    attitude: ArrayLike = np.inf
    placement: ArrayLike = 0.0
    mounting: ArrayLike = 0.0
    latitude: float = 0.0
    gravity: float = 0.0

    def __post_init__(self) -> None:
        for name in ("attitude", "placement", "mounting"):
            object.__setattr__(self, name, _sigmas(getattr(self, name), name))
        _sigmas([self.latitude, self.gravity, 0.0], "latitude, gravity")


def assumed(priors: Priors, latitude_known: bool = True) -> tuple[InstrumentErrors, Setting]:
    """Instrument and table as a fit of positions takes them that is told `priors`.

    A bias of 0 there means that nobody knows it. The gains of this are the estimator's own, and
    what they make of another unit is `Information.contributions` with that gain.
    """
    unknown = 0.0 if latitude_known else np.inf
    return InstrumentErrors(
        _assumed_triad(priors, "gyro"), _assumed_triad(priors, "accel")
    ), Setting(placement=priors.turn, latitude=unknown, gravity=unknown)


def _assumed_triad(priors: Priors, sensor: str) -> TriadErrors:
    def prior(name: str) -> float:
        return getattr(priors, f"{sensor}_{name}")

    return TriadErrors(
        noise=prior("walk"),
        bias=prior("bias") or np.inf,
        ramp=prior("ramp"),
        drift=flicker(prior("instability")),
        random_walk=prior("random_walk"),
        **{name: prior(name) for name in ERRORS_OF[sensor]},
    )


def _sigmas(values: ArrayLike, name: str) -> Array:
    """Three standard deviations, read-only; infinite ones are welcome."""
    result = np.array(np.broadcast_to(np.asarray(values, dtype=float), (3,)))
    if not (result >= 0).all():
        raise ValueError(f"{name}: {values}, must not be negative nor NaN")
    result.flags.writeable = False
    return result


@dataclass(frozen=True, slots=True)
class Parameter:
    """One error: its source, its name, its standard deviation beforehand (SI), its unit.

    `unit` is the unit it is told in and `per` that unit in SI; `usual` (SI) is a size at which
    such errors matter, for weighing where nothing is known beforehand.
    """

    source: str
    label: str
    prior: float
    unit: str
    per: float
    usual: float

    @property
    def size(self) -> float:
        """What it is weighed with (SI): its prior, or its usual size."""
        if self.source == "table attitude" or not 0 < self.prior < np.inf:
            return self.usual
        return self.prior


_PAIRS = ("Y1-Z1", "Z1-X1", "X1-Y1")
_BY_SENSOR = ("g_sensitivity", "g2_sensitivity")
# unit, its size in SI, and a usual size in it: of gyros, of accelerometers
_UNITS = {
    "bias": (("deg/h", DEG_PER_HOUR, 10.0), ("mg", MILLI_G, 1.0)),
    "ramp": (("deg/h/h", DEG_PER_HOUR / 3600, 1.0), ("mg/h", MILLI_G / 3600, 1.0)),
    "scale": (("ppm", PPM, 1000.0),) * 2,
    "asymmetry": (("ppm", PPM, 100.0),) * 2,
    "quadratic": (("1/(deg/s)", 1 / DEG, 1e-6), ("mg/g^2", MILLI_G / STANDARD_GRAVITY**2, 0.1)),
    "cubic": (("1/(deg/s)^2", 1 / DEG**2, 1e-9), ("mg/g^3", MILLI_G / STANDARD_GRAVITY**3, 0.1)),
    "misalignment": (("mrad", MRAD, 1.0),) * 2,
    "non_orthogonality": (("mrad", MRAD, 1.0),) * 2,
    "g_sensitivity": (
        ("deg/h/g", DEG_PER_HOUR / STANDARD_GRAVITY, 1.0),
        ("mg/g", MILLI_G / STANDARD_GRAVITY, 1.0),
    ),
    "g2_sensitivity": (
        ("deg/h/g^2", DEG_PER_HOUR / STANDARD_GRAVITY**2, 1.0),
        ("mg/g^2", MILLI_G / STANDARD_GRAVITY**2, 0.1),
    ),
}


def _triad_parameters(triad: TriadErrors, sensor: str) -> list[Parameter]:
    found = []
    for name in BY_AXIS:
        unit, per, usual = _UNITS[name][sensor != "gyro"]
        source = f"{sensor} {name.replace('_', '-').replace('g2', 'g^2')}"
        if name in _BY_SENSOR:
            ends = [f"{a} by {b}" for a in AXES for b in AXES]
        else:
            ends = list(_PAIRS if name == "non_orthogonality" else AXES)
        sigmas = np.repeat(getattr(triad, name), len(ends) // 3)
        found += [
            Parameter(source, f"{source} {end}", float(s), unit, per=per, usual=usual * per)
            for end, s in zip(ends, sigmas, strict=True)
        ]
    return found


def parameters(
    stretches: Sequence[Stretch], unit: InstrumentErrors, setting: Setting
) -> list[Parameter]:
    """Every error there can be, in the order of the columns of `sensitivities`."""

    def three(
        source: str, names: Sequence[str], sigmas: ArrayLike, per: float, what: str
    ) -> list[Parameter]:
        values = np.asarray(sigmas).tolist()
        return [
            Parameter(source, name, s, what, per=per, usual=per)
            for name, s in zip(names, values, strict=True)
        ]

    about = [f"table about {axis}" for axis in ("north", "east", "down")]
    found = three("table attitude", about, setting.attitude, DEG, "deg")
    found += _triad_parameters(unit.gyro, "gyro")
    found += _triad_parameters(unit.accel, "accelerometer")
    found += three("lag", ["lag"], [unit.lag], 1e-3, "ms")
    found += three("latitude", ["latitude"], [setting.latitude], DEG, "deg")
    found += three("gravity", ["gravity"], [setting.gravity], MILLI_G, "mg")
    mounted = [f"mounting about {axis}" for axis in AXES]
    found += three("mounting", mounted, setting.mounting, MRAD, "mrad")
    for k, stretch in enumerate(stretches):
        placed = [f"placement {k + 1} ({stretch.label}) about {axis}" for axis in AXES]
        found += three("placement", placed, setting.placement, MRAD, "mrad")
    return found


@dataclass(frozen=True, slots=True, eq=False)
class ParameterColumns:
    """Where parameters stand, from the end of the two triads on."""

    lag: int
    latitude: int
    gravity: int
    mounting: slice
    placement: tuple[slice, ...]

    @classmethod
    def of(cls, found: Sequence[Parameter]) -> "ParameterColumns":
        """The places in `parameters`."""
        sources = [p.source for p in found]
        m, d = sources.index("mounting"), sources.index("placement")
        return cls(
            sources.index("lag"),
            sources.index("latitude"),
            sources.index("gravity"),
            slice(m, m + 3),
            tuple(slice(k, k + 3) for k in range(d, len(sources), 3)),
        )


def sensor_inputs(
    stretch: Stretch, C_np: Rotation, site: Site
) -> tuple[Array, Array, Array, Array]:
    """True rates and forces (k, 3) and C_bn (k, 3, 3) at k angles of a turn, at one of a rest.

    And the projection (h, k) that makes constant, cosine and sine of values there.
    """
    return _inputs(*_pose_of(stretch), C_np, site)


_Pose = tuple[Rotation, float, tuple[float, ...]]  # C_pb, rate and axis of a stretch


def _pose_of(stretch: Stretch) -> _Pose:
    return stretch.C_pb, stretch.rate, tuple(stretch.axis_b.tolist())


@lru_cache(maxsize=POSES)
def _inputs(
    C_pb: Rotation, rate: float, axis_b: tuple[float, ...], C_np: Rotation, site: Site
) -> tuple[Array, Array, Array, Array]:
    """As `sensor_inputs`; of the same `Rotation` worked out once, however often it is asked for."""
    k = NODES if rate else 1
    beta, axis = 2 * np.pi * np.arange(k) / k, np.array(axis_b)
    turned = Rotation.from_rotvec(-beta[:, None] * axis).as_matrix()
    C_bn = turned @ (C_np * C_pb).inv().as_matrix()
    w = C_bn @ site.w_ie_n + rate * axis
    project = np.stack([np.ones(k), 2 * np.cos(beta), 2 * np.sin(beta)])[: 3 if k > 1 else 1] / k
    return _locked(w), _locked(C_bn @ site.f_n), _locked(C_bn), _locked(project)


def _locked(array: Array) -> Array:
    array.flags.writeable = False
    return array


def sensitivities(
    stretch: Stretch, number: int, C_np: Rotation, site: Site, columns: ParameterColumns
) -> Array:
    """Of the stretch's coefficients (h, 6) to all p parameters: (h, 6, p), first order."""
    common = columns.lag, columns.latitude, columns.gravity, columns.mounting.start
    shared, placement, ramps = _shared_columns(*_pose_of(stretch), C_np, site, common)
    result = np.zeros((*shared.shape[:2], columns.placement[-1].stop))
    result[:, :, : shared.shape[2]] = shared
    result[:, :, columns.placement[number]] = placement
    ramp = ramp_coefficients(stretch.span)[:, None, None] * np.eye(3)
    for rows, first in zip((slice(0, 3), slice(3, 6)), ramps, strict=True):
        result[:, rows, first : first + 3] = ramp
    return result


@lru_cache(maxsize=POSES)
def _shared_columns(
    C_pb: Rotation,
    rate: float,
    axis_b: tuple[float, ...],
    C_np: Rotation,
    site: Site,
    common: tuple[int, int, int, int],
) -> tuple[Array, Array, tuple[int, int]]:
    """Of `sensitivities` those that do not depend on time: of what all stretches share (h, 6, q),
    of the own placement (h, 6, 3), and where the columns of ramps begin.

    `common`: the columns of lag, latitude and gravity, and the first of the mounting.
    """
    w, f, C_bn, project = _inputs(C_pb, rate, axis_b, C_np, site)
    lag, latitude, gravity, mounting = common
    J = np.zeros((len(w), 6, mounting + 3))
    J[:, :3, :3] = C_bn @ cross_matrix(site.w_ie_n)
    J[:, 3:, :3] = C_bn @ cross_matrix(site.f_n)
    at = 3
    for rows, x in ((slice(0, 3), w), (slice(3, 6), f)):
        for columns_of in BY_AXIS.values():
            part = columns_of(x, f)
            J[:, rows, at : at + part.shape[-1]] = part
            at += part.shape[-1]
        J[:, rows, mounting : mounting + 3] = cross_matrix(x)
        J[:, rows, lag] = rate * np.cross(axis_b, x)
    lat = site.known_latitude()
    J[:, :3, latitude] = C_bn @ (
        np.linalg.norm(site.w_ie_n) * np.array([-np.sin(lat), 0.0, -np.cos(lat)])
    )
    J[:, 3:, gravity] = f / site.gravity
    C_0n = C_bn[0]
    d = np.concatenate([cross_matrix(C_0n @ v) for v in (site.w_ie_n, site.f_n)])
    to_0 = C_bn @ C_0n.T
    placed = np.concatenate([to_0 @ d[:3], to_0 @ d[3:]], axis=1)
    shared = np.einsum("hk,kij->hij", project, J)
    placement = np.einsum("hk,kij->hij", project, placed)
    first = 3 + 3 * list(BY_AXIS).index("ramp")
    return _locked(shared), _locked(placement), (first, first + (at - 3) // 2)


def coefficient_weights(stretch: Stretch) -> Array:
    """Variance (h,) of constant, cosine and sine over that of the mean, for white noise."""
    return np.array([1.0, 2.0, 2.0] if stretch.rate else [1.0])


def white_variances(stretch: Stretch, unit: InstrumentErrors) -> Array:
    """Of the coefficients (h, 6), by white noise; infinite without a sensor."""
    density = np.concatenate([unit.gyro.noise, unit.accel.noise]) ** 2
    return coefficient_weights(stretch)[:, None] * density / stretch.span.length
