"""The steps of a procedure, and the motions that may go on behind them, as TOML says them.

Every motion of an axis is about the angle where the last `move` left it; motions on one axis add
up. Steps follow one another; a background runs behind several of them.
"""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from alignment.angles import Sequence
from stand import toml_files as catalogue
from stand.bounds import Acceleration, Amplitude, Angle, Duration, Jerk, PositiveAcceleration, Rate
from stand.errors import unknown
from stand.table.joints import JOINTS

FrequencyHz = Annotated[float, Field(ge=1e-4, le=200)]
Fade = Annotated[float, Field(ge=1e-2, le=3600)]


def _one_line_text(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError(f"{text!r}: must be printable text in one line")
    return text


def _known_joints(axes: dict) -> dict:
    for name in axes:
        if name not in JOINTS:
            raise ValueError(str(unknown("joint", name, JOINTS)))
    if not axes:
        raise ValueError(f"has none, must have one or more of {', '.join(JOINTS)}")
    return axes


def _base_axes(axes: dict) -> dict:
    for name in axes:
        if name not in JOINTS[:3]:
            raise ValueError(str(unknown("base axis", name, JOINTS[:3])))
    return axes


def _joint(name: str) -> str:
    if name not in JOINTS:
        raise ValueError(str(unknown("joint", name, JOINTS)))
    return name


Text = Annotated[str, AfterValidator(_one_line_text)]
Joint = Annotated[str, AfterValidator(_joint)]


class RampsEntry(catalogue.Entry):
    """Limits of a change of rate; never beyond the table's own."""

    acceleration_deg_s2: Acceleration | None = None
    jerk_deg_s3: Jerk | None = None


class LimitsEntry(RampsEntry):
    """Limits of a move, for every axis that moves; never beyond the table's own."""

    rate_deg_s: Rate | None = None


class AttitudeEntry(catalogue.Entry):
    """An instrument attitude: turns from north-up-east, by `sequence` (methods.md section 0)."""

    roll: Angle = 0.0
    yaw: Angle = 0.0
    pitch: Angle = 0.0
    sequence: Annotated[Sequence, Field(strict=False)] = Sequence.YAW_PITCH_ROLL


class DwellStep(catalogue.Entry):
    """Stand still (on a base that may rock behind it)."""

    kind: Literal["dwell"]
    label: Text
    duration_s: Duration


class MoveStep(LimitsEntry):
    """Go to joint angles (axes not named stay), or turn the gimbals to an attitude."""

    kind: Literal["move"]
    label: Text
    joints_deg: dict[str, Angle] | None = None
    attitude_deg: AttitudeEntry | None = None

    @model_validator(mode="after")
    def _one_target(self) -> "MoveStep":
        if (self.joints_deg is None) == (self.attitude_deg is None):
            has = "neither" if self.joints_deg is None else "both"
            raise ValueError(f"joints_deg, attitude_deg: has {has}, must have one of them")
        for name in self.joints_deg or {}:
            if name not in JOINTS:
                raise ValueError(f"joints_deg: {unknown('joint', name, JOINTS)}")
        return self


class TurningEntry(RampsEntry):
    """Constant rate for a time or for turns; ramps of limited jerk before and after it."""

    axis: Joint
    duration_s: Duration | None = None
    turns: Annotated[float, Field(gt=0, le=100000)] | None = None
    directions: Literal["one", "both"] = "one"

    @model_validator(mode="after")
    def _one_length(self) -> "TurningEntry":
        if (self.duration_s is None) == (self.turns is None):
            has = "neither" if self.turns is None else "both"
            raise ValueError(f"duration_s, turns: has {has}, must have one of them")
        return self


class RateStep(TurningEntry):
    """One constant rate (negative: backward); with directions = "both" there and back again."""

    kind: Literal["rate"]
    label: Text
    rate_deg_s: Angle

    @model_validator(mode="after")
    def _turns(self) -> "RateStep":
        if self.rate_deg_s == 0:
            raise ValueError("rate_deg_s = 0: must not be 0; a dwell stands still")
        return self


class SweepStep(TurningEntry):
    """Constant rates one after another."""

    kind: Literal["sweep"]
    label: Text
    rates_deg_s: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=1000)]

    @model_validator(mode="after")
    def _turns(self) -> "SweepStep":
        if 0 in self.rates_deg_s:
            raise ValueError("rates_deg_s: must not contain 0; a dwell stands still")
        return self


class WaveEntry(catalogue.Entry):
    """One sine: amplitude sin(2 pi frequency t + phase), t from where it is at full size."""

    amplitude_deg: Annotated[float, Field(gt=0, le=360)]
    frequency_hz: FrequencyHz
    phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class Waving(catalogue.Entry):
    """Fades in before `duration_s` and out after it; on its own a step lasts so much longer."""

    fade_s: Fade | None = None


class SineMotion(Waving):
    """Sines on any axes."""

    axes: Annotated[dict[str, WaveEntry], AfterValidator(_known_joints)]


class ScorsbyMotion(Waving):
    """The three base axes at once: one period, a quarter of it between roll and pitch."""

    amplitude_deg: Annotated[dict[str, Amplitude], AfterValidator(_base_axes)]
    period_s: Annotated[float, Field(ge=0.1, le=3600)]
    phase_deg: Annotated[dict[str, Angle], AfterValidator(_base_axes)] | None = None


class ConingMotion(Waving):
    """The instrument's `axis` goes round a cone: rotation vector of constant size, turning.

    By the three gimbals, about the attitude where they stand; negative frequency: the other way.
    """

    axis: Literal["X1", "Y1", "Z1"]
    half_angle_deg: Annotated[float, Field(gt=0, le=60)]
    frequency_hz: Annotated[float, Field(ge=-200, le=200)]

    @model_validator(mode="after")
    def _goes_round(self) -> "ConingMotion":
        if abs(self.frequency_hz) < 1e-4:
            raise ValueError(f"frequency_hz = {self.frequency_hz:g}: must be 1e-4 or more in size")
        return self


class SwayEntry(catalogue.Entry):
    """Random rocking of one axis: a resonance, or a density file.

    The angle's one-sided density is that of white noise through a resonator,
    1 / ((f0^2 - f^2)^2 + (2 damping f0 f)^2), up to `cutoff_hz` (5 f0 if absent), scaled to
    `rms_deg`; or that of `psd_file`: rows of frequency [Hz], density [deg^2/Hz], straight lines
    between them and nothing outside, scaled to `rms_deg` if given.
    """

    rms_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    frequency_hz: FrequencyHz | None = None
    damping: Annotated[float, Field(ge=1e-3, le=10)] = 0.1
    cutoff_hz: FrequencyHz | None = None
    psd_file: Text | None = None

    @model_validator(mode="after")
    def _one_spectrum(self) -> "SwayEntry":
        if (self.psd_file is None) == (self.frequency_hz is None):
            raise ValueError("frequency_hz, psd_file: must have one of them")
        for key in ("damping", "cutoff_hz"):
            if self.psd_file is not None and key in self.model_fields_set:
                raise ValueError(f"{key}: must not stand beside psd_file")
        if self.psd_file is None and self.rms_deg is None:
            raise ValueError("rms_deg: required beside frequency_hz")
        cutoff, f0 = self.cutoff_hz, self.frequency_hz
        if cutoff is not None and f0 is not None and cutoff <= f0:
            raise ValueError(f"cutoff_hz = {cutoff:g}: must be above frequency_hz = {f0:g}")
        return self


class SwayMotion(Waving):
    """Random rocking, Gaussian, zero mean; drawn anew by every seed."""

    axes: Annotated[dict[str, SwayEntry], AfterValidator(_known_joints)]


class VibrationEntry(catalogue.Entry):
    """Broad-band jitter of one axis: even density of angular acceleration between two bounds."""

    rms_deg_s2: PositiveAcceleration
    low_hz: FrequencyHz
    high_hz: FrequencyHz

    @model_validator(mode="after")
    def _band(self) -> "VibrationEntry":
        if self.high_hz <= self.low_hz:
            raise ValueError(f"high_hz = {self.high_hz:g}: must be above low_hz = {self.low_hz:g}")
        return self


class VibrationMotion(Waving):
    """Broad-band jitter, Gaussian, zero mean; drawn anew by every seed."""

    axes: Annotated[dict[str, VibrationEntry], AfterValidator(_known_joints)]


class ProfileMotion(catalogue.Entry):
    """Joint angles over time from a CSV file beside the procedure.

    Columns `time_s`, then `AXIS_deg`, and if wanted `AXIS_deg_s` and `AXIS_deg_s2`; angles are
    those of the joints, and begin where the axis stands.
    """

    file: Text


class SineStep(SineMotion):
    """Sines as a step."""

    kind: Literal["sine"]
    label: Text
    duration_s: Duration


class ScorsbyStep(ScorsbyMotion):
    """Scorsby motion as a step."""

    kind: Literal["scorsby"]
    label: Text
    duration_s: Duration


class ConingStep(ConingMotion):
    """Coning as a step."""

    kind: Literal["coning"]
    label: Text
    duration_s: Duration


class SwayStep(SwayMotion):
    """Random rocking as a step."""

    kind: Literal["sway"]
    label: Text
    duration_s: Duration


class VibrationStep(VibrationMotion):
    """Broad-band jitter as a step."""

    kind: Literal["vibration"]
    label: Text
    duration_s: Duration


class ProfileStep(ProfileMotion):
    """A profile as a step: as long as the file."""

    kind: Literal["profile"]
    label: Text


class Behind(catalogue.Entry):
    """Of a background: the labels of the first and last step it runs behind; absent: all."""

    first: Text | None = None
    last: Text | None = None


class SineBehind(SineMotion, Behind):
    """Sines behind steps."""

    kind: Literal["sine"]


class ScorsbyBehind(ScorsbyMotion, Behind):
    """Scorsby motion behind steps."""

    kind: Literal["scorsby"]


class SwayBehind(SwayMotion, Behind):
    """Random rocking behind steps."""

    kind: Literal["sway"]


class VibrationBehind(VibrationMotion, Behind):
    """Broad-band jitter behind steps."""

    kind: Literal["vibration"]


Step = Annotated[
    DwellStep
    | MoveStep
    | RateStep
    | SweepStep
    | SineStep
    | ScorsbyStep
    | ConingStep
    | SwayStep
    | VibrationStep
    | ProfileStep,
    Field(discriminator="kind"),
]
Background = Annotated[
    SineBehind | ScorsbyBehind | SwayBehind | VibrationBehind, Field(discriminator="kind")
]
