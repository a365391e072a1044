"""What is stated of a log by whoever reads it, where the log does not say it itself."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from stand.errors import StandError, unknown
from stand.recording.axes import Axes, axes_of
from stand.recording.time_stamps import time_unit_ns
from stand.samples import Sampling

LARGEST_SCALE = 1e12  # of a count: what it makes of readings has limits of its own
STAMPS = ("header", "log")
SAMPLING = tuple(kind.value for kind in Sampling)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogForm:
    """How a log is to be read; what is not given is as the log says.

    Attributes
    ----------
    columns : str or None
        Of a table: names of its columns in order, out of t, sec, nanosec, week, tow and
        `CHANNELS`, '-' for one to skip; or ``name=column`` by header or number. None: as the
        headers say, if they are clear.
    gyro_unit, accel_unit : str or None
        As data sheets write them; of an angle or a speed: increments. None: as the header says.
    gyro_scale, accel_scale : float
        What one count is, in that unit.
    time_unit : str or None
        s, ms, us, ns, a number of them (100us), or iso; None: as the header or the first stamp
        says, or else seconds.
    rate_hz : float or None
        Of a log without a time.
    wrap : float or None
        Where a time that is a counter begins anew, in the time unit.
    file_format : str or None
        'csv' (any text), 'f8le' or another numpy type of binary rows; None: by the content.
    skip_bytes : int
        Before the first binary row.
    axes : str or None
        What X1, Y1, Z1 are of the log's axes (``x,-z,y``), or a convention's name; None: the same.
    stamps : str
        Of messages: those of their ``header``, or the times at which they were written, ``log``.
    frame : str or None
        Which frame_id, where messages of several share a topic.
    sampling : str
        What a sample is: the ``mean`` since the one before, or the ``instant`` at its stamp.

    Raises
    ------
    StandError
        A value that is not allowed.

    Examples
    --------
    >>> import stand
    >>> form = stand.LogForm(columns="t,gx,gy,gz,ax,ay,az", gyro_unit="dps", accel_unit="g")
    >>> stand.LogForm(axes="x,y,-z")
    Traceback (most recent call last):
        ...
    stand.errors.StandError: --axes x,y,-z: is left-handed, one sign must be the other: x,-y,-z?
    """

    columns: str | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    gyro_scale: float = 1.0
    accel_scale: float = 1.0
    time_unit: str | None = None
    rate_hz: float | None = None
    wrap: float | None = None
    file_format: str | None = None
    skip_bytes: int = 0
    axes: str | None = None
    stamps: str = "header"
    frame: str | None = None
    sampling: str = "mean"

    def __post_init__(self) -> None:
        if self.time_unit is not None:
            time_unit_ns(self.time_unit)
        if self.rate_hz is not None and not 1e-3 <= self.rate_hz <= 1e6:
            raise StandError(f"--rate {self.rate_hz:g}: must be 0.001 to 1e6 Hz")
        if self.wrap is not None and not (np.isfinite(self.wrap) and self.wrap > 0):
            raise StandError(f"--wrap {self.wrap:g}: must be above 0")
        if self.skip_bytes < 0:
            raise StandError(f"--skip-bytes {self.skip_bytes}: must be 0 or more")
        for sensor, scale in (("gyro", self.gyro_scale), ("accel", self.accel_scale)):
            if not (np.isfinite(scale) and scale > 0):
                raise StandError(f"--{sensor}-scale {scale:g}: must be above 0")
            if scale > LARGEST_SCALE:
                raise StandError(f"--{sensor}-scale {scale:g}: must be at most {LARGEST_SCALE:g}")
        if self.stamps not in STAMPS:
            raise unknown("--stamps", self.stamps, STAMPS)
        if self.sampling not in SAMPLING:
            raise unknown("--sampling", self.sampling, SAMPLING)
        if self.axes is not None:
            axes_of(self.axes)

    def turn(self) -> Axes | None:
        """Which of the log's axes are X1, Y1, Z1; None: as they are."""
        return None if self.axes is None else axes_of(self.axes)

    def instants(self, run: Mapping[str, str]) -> bool:
        """Whether samples are instants, of a log whose metadata of a `run` may say it."""
        said = run.get("sampling", self.sampling)
        if self.sampling not in (said, SAMPLING[0]):
            raise StandError(f"--sampling {self.sampling}: the recording says {said}")
        return said == Sampling.INSTANT.value

    def metadata(self, run: Mapping[str, str]) -> dict[str, str]:
        """What a log made of another, whose metadata had `run`, is to say of its samples."""
        return {"sampling": Sampling.INSTANT.value} if self.instants(run) else {}

    def without(self, names: tuple[str, ...]) -> "LogForm":
        """The same, but for these, which nobody stated."""
        kept = [field.name for field in fields(self) if field.name not in names]
        return LogForm(**{name: getattr(self, name) for name in kept})

    def refuse(self, path: object, names: tuple[str, ...], why: str) -> None:
        """`StandError` where one of these is given and says nothing of such a log."""
        for field in fields(self):
            if field.name in names and getattr(self, field.name) != field.default:
                option = {"rate_hz": "rate", "file_format": "format"}.get(field.name, field.name)
                raise StandError(f"{path}: --{option.replace('_', '-')}: {why}")


OF_TABLES = (
    "columns",
    "gyro_unit",
    "accel_unit",
    "gyro_scale",
    "accel_scale",
    "time_unit",
    "rate_hz",
    "wrap",
    "file_format",
    "skip_bytes",
)
OF_MESSAGES = ("stamps", "frame")
