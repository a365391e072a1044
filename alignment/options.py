"""Choices of the methods, apart from the readings and the site."""

from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace

from alignment.angles import SequenceRule
from alignment.skew import Axes

SENSORS = ("gyro", "accel")
_NOISE = ("gyro_walk", "accel_walk")
DRIFTS = ("instability", "random_walk", "ramp")
_CHANGING = (
    *_NOISE,
    *(f"{s}_{d}" for s in ("gyro", "accel") for d in DRIFTS),
    "gyro_scale_ramp",
    "lever_arm",
)
_DESIGN = ("gyro_axes", "accel_axes")


@dataclass(frozen=True, slots=True)
class Priors:
    """What is known of instrument and table before the readings: standard deviations, SI.

    A constant error that cannot be told apart from the answer enters the covariance by its prior;
    0 means that it is left out, and the covariance is that of noise alone.

    Attributes
    ----------
    gyro_bias, accel_bias : float
        Turn-on bias of each axis [rad/s], [m/s^2].
    gyro_scale, accel_scale : float
        Scale factor error, a part of the value.
    gyro_instability, accel_instability : float
        Height of the Allan deviation's plateau [rad/s], [m/s^2]: how biases drift in a record.
    gyro_walk : float
        Angle random walk [rad/sqrt(s)]; 0: taken from the readings where a method needs it.
    accel_walk : float
        Velocity random walk [m/s/sqrt(s)]; likewise.
    turn : float
        Placement of the table at one position [rad].
    seat : float
        Constant rotation of the instrument against the table's frame [rad], each axis: the axes
        about which the table turns are off by as much in b.
    nominal, azimuth : float
        How far the attitudes the table is told are off as a whole [rad], about each level axis and
        about down: where its base stands.
    lever_arm : float
        Uncertainty of the instrument's place from the point that stays [m].
    places : float
        How far the accelerometers lie from where b has its origin [m], along each axis: what turns
        pulls each of them outward by its own place.
    lag : float
        By how much readings come later than their stamps [s], as a low-pass and a bus make them: an
        attitude at the end of a motion is that of as long before.
    accel_later : float
        How much later than the gyros' the accelerometers' come [s]; with a sign, as `lag`.
    clock : float
        Part by which the unit's clock runs fast: readings of a time t are of ``clock t`` later.
    jitter : float
        By how much the time of each sample trembles [s]: noise wherever readings change.
    gyro_random_walk, accel_random_walk : float
        Of the bias [rad/s/sqrt(s)], [m/s^2/sqrt(s)], since time 0 of the stamps.
    gyro_ramp, accel_ramp : float
        Steady change of the bias [rad/s^2], [m/s^3], since time 0 of the stamps.
    gyro_scale_ramp : float
        Steady change of the gyros' scale factor error [1/s], as warmth makes it.
    gyro_misalignment, accel_misalignment : float
        Small rotation of each triad's case from b [rad], about each axis.
    gyro_non_orthogonality, accel_non_orthogonality : float
        Leaning together of each pair of a triad's axes [rad].
    gyro_asymmetry, accel_asymmetry : float
        Scale factor error by the sign of the value, a part of its size.
    gyro_g_sensitivity, gyro_g2_sensitivity : float
        Of each gyro to each component of specific force [rad/s per m/s^2], and to its square.
    accel_quadratic, accel_cubic, gyro_cubic : float
        Of each axis [1/(m/s^2)], [1/(m/s^2)^2], [1/(rad/s)^2].
    gyro_axes, accel_axes : three unit vectors in b, or None
        Along which a triad's sensors feel where it is skewed by design; their readings come as
        components in b, so equal errors of the sensors are neither equal nor independent there.
    """

    gyro_bias: float = 0.0
    accel_bias: float = 0.0
    gyro_scale: float = 0.0
    accel_scale: float = 0.0
    gyro_instability: float = 0.0
    accel_instability: float = 0.0
    gyro_walk: float = 0.0
    accel_walk: float = 0.0
    turn: float = 0.0
    seat: float = 0.0
    nominal: float = 0.0
    azimuth: float = 0.0
    lever_arm: float = 0.0
    places: float = 0.0
    lag: float = 0.0
    clock: float = 0.0
    jitter: float = 0.0
    gyro_random_walk: float = 0.0
    accel_random_walk: float = 0.0
    gyro_ramp: float = 0.0
    accel_ramp: float = 0.0
    gyro_scale_ramp: float = 0.0
    gyro_misalignment: float = 0.0
    accel_misalignment: float = 0.0
    gyro_non_orthogonality: float = 0.0
    accel_non_orthogonality: float = 0.0
    gyro_asymmetry: float = 0.0
    accel_asymmetry: float = 0.0
    gyro_g_sensitivity: float = 0.0
    gyro_g2_sensitivity: float = 0.0
    accel_quadratic: float = 0.0
    accel_cubic: float = 0.0
    gyro_cubic: float = 0.0
    accel_later: float = 0.0
    gyro_axes: Axes | None = None
    accel_axes: Axes | None = None

    @property
    def noise_only(self) -> frozenset[str]:
        """Of which of `SENSORS` nothing but noise is known: both without a data sheet.

        Sigmas of what they tell are of noise alone: `of_noise_alone`.
        """
        names = [f.name for f in fields(self) if f.name not in (*_NOISE, *_DESIGN)]
        return frozenset(
            sensor
            for sensor in SENSORS
            if not any(getattr(self, name) for name in names if name.startswith(f"{sensor}_"))
        )

    @property
    def changing(self) -> "Priors":
        """What differs from time to time: noise and drifts; no constant of unit or table."""
        constant = {f.name: 0.0 for f in fields(self) if f.name not in (*_CHANGING, *_DESIGN)}
        return replace(self, **constant)


def of_noise_alone(quantity: str, noise_only: Collection[str]) -> bool:
    """Whether the sigma of a quantity is of noise alone, by `Priors.noise_only`.

    Accelerometers tell roll, pitch and tilt, gyros whatever is about the vertical: heading, yaw,
    latitude. Biases are their sensors' own.
    """
    by_accel = quantity.startswith(("roll", "pitch", "tilt", "accel"))
    return SENSORS[by_accel] in noise_only


@dataclass(frozen=True, slots=True)
class Options:
    """What a person may choose.

    `offset_window` [s]: how much of each dwell gives the zero offsets. `rule`: which order of
    turns each position is read by. `priors`: what is known of instrument and table. `bench`: what a
    calibration is told instead, an `alignment.calibration.bench.Bench`. `verdicts`: whether
    estimates say what their turns were worth, which takes as long as a fit and changes no number.
    """

    offset_window: float = 10.0
    rule: SequenceRule = SequenceRule.REGULAR
    priors: Priors = field(default_factory=Priors)
    bench: object | None = field(default=None, repr=False)
    verdicts: bool = True
