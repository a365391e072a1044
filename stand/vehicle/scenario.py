"""Drives: a path, satellite fixes with their errors and outages, as TOML; and readings of them."""

from collections.abc import Iterator
from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from alignment import ImuReadings
from alignment.angles import C_nb_from_angles, Sequence, angles_from_C_nb
from alignment.arrays import Array
from alignment.methods.vectors import Fixes
from alignment.units import DEG
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu import Imu
from stand.samples import ImuBlock, Sensed
from stand.vehicle.path import Change, Path, Start

LONGEST = 14400.0
"""Of a drive [s]: its readings are held at once, and its place is integrated in steps of 0.5 s."""
MOST_TURNS = 5000
"""Of all legs' headings together: at each the integration begins anew."""
MOST_FIXES = 50_000
"""Of a drive: solutions go from fix to fix in Python."""
FASTEST = 3000.0
"""m/s: beyond what flies within the atmosphere."""

Duration = Annotated[float, Field(ge=0.01, le=LONGEST)]  # shorter is a jolt, not a manoeuvre
Speed = Annotated[float, Field(ge=0, le=FASTEST)]
Angle = Annotated[float, Field(ge=-36000, le=36000)]  # 100 turns, as in procedures
Slope = Annotated[float, Field(ge=-60, le=60)]
Time = Annotated[float, Field(ge=0, le=1e9)]

FOLDER = "trajectories"
_BLOCK = 8192  # samples given to the unit at once


class StartEntry(catalogue.Entry):
    """Where and how the drive begins."""

    latitude_deg: Annotated[float, Field(ge=-89.9, le=89.9)]
    longitude_deg: Annotated[float, Field(ge=-180, le=360)] = 0.0
    height_m: Annotated[float, Field(ge=-1000, le=20000)] = 0.0
    heading_deg: Angle = 0.0
    speed_m_s: Speed = 0.0
    climb_deg: Slope = 0.0
    roll_deg: Slope = 0.0

    def start(self) -> Start:
        """The same in SI."""
        return Start(
            latitude=self.latitude_deg * DEG,
            longitude=self.longitude_deg * DEG,
            height=self.height_m,
            heading=self.heading_deg * DEG,
            speed=self.speed_m_s,
            climb=self.climb_deg * DEG,
            roll=self.roll_deg * DEG,
        )


class Leg(catalogue.Entry):
    """A stretch over which values go smoothly to what is said here; what is not said stays.

    `turn_deg` is by how much the heading grows. `weave_deg` with `weaves`: the heading swings to
    both sides, so many times, and ends where it began.
    """

    label: Annotated[str, Field(min_length=1)]
    duration_s: Duration
    speed_m_s: Speed | None = None
    climb_deg: Slope | None = None
    roll_deg: Slope | None = None
    turn_deg: Angle = 0.0
    weave_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    weaves: Annotated[int, Field(ge=0, le=1000)] = 0

    @model_validator(mode="after")
    def _either(self) -> "Leg":
        if self.turn_deg and self.weaves:
            raise ValueError("turn_deg and weaves: a leg turns or weaves, not both")
        if bool(self.weave_deg) != bool(self.weaves):
            raise ValueError("weave_deg and weaves: both or neither")
        return self

    def headings(self, before: float) -> list[Change]:
        """What the heading does, from `before` [rad]."""
        if not self.weaves:
            return [Change(self.duration_s, before + self.turn_deg * DEG)]
        quarter = self.duration_s / (4 * self.weaves)
        swings = [self.weave_deg * DEG * (-1) ** k for k in range(2 * self.weaves)]
        durations = [quarter, *[2 * quarter] * (len(swings) - 1)]
        changes = [Change(d, before + s) for d, s in zip(durations, swings, strict=True)]
        return [*changes, Change(quarter, before)]


class StartErrorEntry(catalogue.Entry):
    """How wrong the programmed start is in this drive: errors of the three angles."""

    roll_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    heading_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0


class SatelliteEntry(catalogue.Entry):
    """How often fixes come, how wrong they are, and when none come.

    White noise of every component, a drift correlated over `drift_time_s`, and outages as pairs
    of times.
    """

    interval_s: Annotated[float, Field(ge=0.01, le=3600)] = 1.0
    # from a thousandth of a millimetre to what is no fix any more
    position_noise_m: Annotated[float, Field(ge=1e-6, le=1e5)] = 5.0
    velocity_noise_m_s: Annotated[float, Field(ge=1e-9, le=1e3)] = 0.05
    position_drift_m: Annotated[float, Field(ge=0, le=1e5)] = 0.0
    velocity_drift_m_s: Annotated[float, Field(ge=0, le=1e3)] = 0.0
    drift_time_s: Annotated[float, Field(ge=1e-3, le=1e7)] = 100.0
    outages_s: Annotated[tuple[tuple[Time, Time], ...], Field(max_length=1000)] = ()

    @model_validator(mode="after")
    def _outages_last(self) -> "SatelliteEntry":
        for a, b in self.outages_s:
            if b <= a:
                raise ValueError(f"outages_s: [{a:g}, {b:g}] must end after it begins")
        return self

    def times(self, duration: float) -> Array:
        """When fixes come [s]; one at an outage's end has come through."""
        count = int(duration / self.interval_s + 1e-9)
        t = np.arange(count + 1) * self.interval_s
        lost = np.zeros(len(t), bool)
        for a, b in self.outages_s:
            lost |= (t >= a) & (t < b)
        return t[~lost]


class DriveEntry(catalogue.Entry):
    """A drive as its TOML file says it."""

    title: Annotated[str, Field(min_length=1)]
    description: Annotated[str, Field(min_length=1)]
    start: StartEntry
    start_error: StartErrorEntry | None = None
    leg: Annotated[tuple[Leg, ...], Field(min_length=1)]
    satellite: SatelliteEntry = SatelliteEntry()

    @model_validator(mode="after")
    def _bounded(self) -> "DriveEntry":
        duration = sum(leg.duration_s for leg in self.leg)
        turns = sum(2 * leg.weaves + 1 for leg in self.leg)
        fixes = duration / self.satellite.interval_s
        for what, found, most in (
            ("leg: together they take {:g} s", duration, LONGEST),
            ("leg: together they turn {} times", turns, MOST_TURNS),
            ("satellite: {:.0f} fixes", fixes, MOST_FIXES),
        ):
            if found > most:
                raise ValueError(f"{what.format(found)}, must be at most {most:g}")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A checked drive: its id and text, the path, the satellites.

    `start_error` (3,): errors of roll, yaw, pitch [rad] of the programmed start where they are
    stated; else each run draws a start.
    """

    id: str
    title: str
    text: str
    path: Path
    satellite: SatelliteEntry
    start_error: Array | None = None


def load_drive(name: str) -> Drive:
    """A drive by catalogue id or path of a file; `StandError` where it is not right."""
    return drive_from(catalogue.find(FOLDER, "trajectory", name))


def drive_from(source: catalogue.Source) -> Drive:
    """Check a drive's text and build its path."""
    entry = catalogue.parse(source, DriveEntry)
    try:
        path = path_of(entry.start.start(), entry.leg)
    except StandError as error:
        raise StandError(f"{source.name}: {error}") from error
    drive = Drive(
        id=source.id,
        title=entry.title,
        text=source.text,
        path=path,
        satellite=entry.satellite,
        start_error=_start_error(entry.start_error),
    )
    if len(entry.satellite.times(path.duration)) < 2:
        raise StandError(f"{source.name}: satellite: fewer than 2 fixes in {path.duration:g} s")
    return drive


def _start_error(entry: StartErrorEntry | None) -> Array | None:
    """Errors of roll, yaw, pitch [rad]: heading grows as yaw falls."""
    if entry is None:
        return None
    return DEG * np.array([entry.roll_deg, -entry.heading_deg, entry.pitch_deg])


def path_of(start: Start, legs: Ordered[Leg]) -> Path:
    """The path through the legs."""
    speed, heading, climb, roll = ([] for _ in range(4))
    last = {"speed": start.speed, "heading": start.heading, "climb": start.climb}
    last["roll"] = start.roll
    for leg in legs:
        turns = leg.headings(last["heading"])
        last["heading"] = turns[-1].value
        heading += turns
        for changes, name, value, unit in (
            (speed, "speed", leg.speed_m_s, 1.0),
            (climb, "climb", leg.climb_deg, DEG),
            (roll, "roll", leg.roll_deg, DEG),
        ):
            last[name] = last[name] if value is None else value * unit
            changes.append(Change(leg.duration_s, last[name]))
    return Path(start, speed, heading, climb, roll)


def sense_blocks(path: Path, rate_hz: int) -> Iterator[Sensed]:
    """What perfect sensors report along the path, means over samples, some seconds at a time."""
    count = int(path.duration * rate_hz + 1e-6)
    size = max(_BLOCK // rate_hz, 1) * rate_hz
    for first in range(0, count, size):
        last = min(first + size, count)
        w, f = path.means(np.arange(first, last + 1) / rate_hz)
        yield Sensed(np.arange(first + 1, last + 1) * (10**9) // rate_hz, w, f)


def sense(path: Path, rate_hz: int) -> Sensed:
    """The same along the whole path."""
    blocks = list(sense_blocks(path, rate_hz))
    names = ("t_ns", "w_ib_b", "f_b")
    return Sensed(*(np.concatenate([getattr(b, name) for b in blocks]) for name in names))


def reported(sensed: Sensed, unit: Imu) -> ImuBlock:
    """What a unit reports of it."""
    blocks = []
    for k in range(0, len(sensed.t_ns), _BLOCK):
        part = slice(k, k + _BLOCK)
        own = Sensed(sensed.t_ns[part], sensed.w_ib_b[part], sensed.f_b[part])
        blocks.append(unit.report(own))
    return joined(blocks)


def joined(blocks: Ordered[ImuBlock]) -> ImuBlock:
    """Blocks that follow one another as one."""
    columns = ([getattr(block, name) for block in blocks] for name in ImuBlock.__slots__)
    return ImuBlock(*map(np.concatenate, columns))


def readings_of(block: ImuBlock) -> ImuReadings:
    """The same as estimators take it."""
    return ImuReadings(block.t_ns * 1e-9, block.w_ib_b, block.f_b)


def fixes_of(path: Path, satellite: SatelliteEntry, rng: np.random.Generator) -> Fixes:
    """Fixes along the path with their errors, outages left out."""
    t = satellite.times(path.duration)
    motion = path.at(t)

    def errors(noise: float, drift: float) -> Array:
        white = noise * rng.standard_normal((len(t), 3))
        return white + drift * gauss_markov(t, satellite.drift_time_s, rng)

    return Fixes(
        t=t,
        position=motion.r_e + errors(satellite.position_noise_m, satellite.position_drift_m),
        velocity=motion.v_e + errors(satellite.velocity_noise_m_s, satellite.velocity_drift_m_s),
        position_sigma=satellite.position_noise_m,
        velocity_sigma=satellite.velocity_noise_m_s,
        position_drift=satellite.position_drift_m,
        velocity_drift=satellite.velocity_drift_m_s,
        drift_time=satellite.drift_time_s,
    )


def gauss_markov(t: Array, correlation: float, rng: np.random.Generator) -> Array:
    """A stationary first-order process of variance one at times `t`: (m, 3)."""
    x = rng.standard_normal((len(t), 3))
    keep = np.exp(-np.diff(t) / correlation)
    for k, a in enumerate(keep, start=1):
        x[k] = a * x[k - 1] + np.sqrt(1 - a**2) * x[k]
    return x


def programmed(path: Path, sigma: float, rng: np.random.Generator) -> Rotation:
    """A start attitude as programmed: wrong by `sigma` [rad] about each axis of n."""
    error = Rotation.from_rotvec(sigma * rng.standard_normal(3))
    return error * path.at(np.zeros(1)).C_nb[0]


def started(drive: Drive, sigma: float, rng: np.random.Generator) -> Rotation:
    """The programmed start of a drive: by the three angle errors it states, else as drawn.

    Source: [S2], initial errors as three angles.
    """
    drawn = programmed(drive.path, sigma, rng)
    if drive.start_error is None:
        return drawn
    C_nb = drive.path.at(np.zeros(1)).C_nb[0]
    roll, yaw, pitch = angles_from_C_nb(Sequence.YAW_PITCH_ROLL, C_nb) + drive.start_error
    return C_nb_from_angles(Sequence.YAW_PITCH_ROLL, roll, yaw, pitch)
