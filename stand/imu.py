"""The instrument: an IMU with the errors its data sheet states.

A preset is one TOML file in `imus/` (or a user's own), units in the key names, each value with
its kind and source. A term that is absent is zero: nobody stated it.

Per sensor: ``reported = (I + S + M) true + b + noise``, S diagonal (scale factor), M off-diagonal
(each axis leaning toward the two others), b the turn-on bias, all drawn once per seed with the
stated value as standard deviation, and white noise of density N: standard deviation
``N / sqrt(dt)`` per sample of length dt.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from alignment.arrays import Array, set_owned
from alignment.units import (
    DEG_PER_HOUR,
    DEG_PER_RT_HOUR,
    M_S_PER_RT_HOUR,
    MILLI_G,
    MRAD,
    PPM,
)
from stand import catalogue
from stand.samples import ImuBlock, TruthBlock


class Stated(catalogue.Entry):
    """A value as a data sheet states it; `unspecified`: the source does not say which kind."""

    value: Annotated[float, Field(ge=0)]
    kind: Literal["typical", "1 sigma", "maximum", "unspecified", "assumed"]
    source: Annotated[str, Field(min_length=1)]


class GyroEntry(catalogue.Entry):
    """Gyro triad."""

    turn_on_bias_deg_h: Stated | None = None
    angle_random_walk_deg_rt_h: Stated | None = None
    scale_factor_ppm: Stated | None = None
    misalignment_mrad: Stated | None = None


class AccelEntry(catalogue.Entry):
    """Accelerometer triad."""

    turn_on_bias_mg: Stated | None = None
    velocity_random_walk_m_s_rt_h: Stated | None = None
    scale_factor_ppm: Stated | None = None
    misalignment_mrad: Stated | None = None


class ImuEntry(catalogue.Entry):
    """A preset as its TOML file says it; `evidence` grades the sources.

    A: manufacturer's document. B: part of a manufacturer's page. C: third party. none: assumed.
    """

    title: str
    grade: str
    evidence: Literal["A", "B", "C", "none"]
    gyro: GyroEntry
    accel: AccelEntry


@dataclass(frozen=True, slots=True, eq=False)
class TriadSpec:
    """Errors of three like sensors in SI: standard deviations, and the noise density.

    `bias` [unit], `scale` [1], `misalignment` [rad], `noise` [unit / rt-Hz].
    """

    bias: float
    scale: float
    misalignment: float
    noise: float


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """A checked preset with its id and source text."""

    id: str
    title: str
    text: str
    entry: ImuEntry
    gyro: TriadSpec
    accel: TriadSpec


def load_imu(name: str) -> ImuSpec:
    """A preset by catalogue id or path; `StandError` where it is not right."""
    source = catalogue.find("imus", "imu", name)
    entry = catalogue.parse(source, ImuEntry)
    gyro, accel = entry.gyro, entry.accel
    return ImuSpec(
        source.id,
        entry.title,
        source.text,
        entry,
        TriadSpec(
            _si(gyro.turn_on_bias_deg_h, DEG_PER_HOUR),
            _si(gyro.scale_factor_ppm, PPM),
            _si(gyro.misalignment_mrad, MRAD),
            _si(gyro.angle_random_walk_deg_rt_h, DEG_PER_RT_HOUR),
        ),
        TriadSpec(
            _si(accel.turn_on_bias_mg, MILLI_G),
            _si(accel.scale_factor_ppm, PPM),
            _si(accel.misalignment_mrad, MRAD),
            _si(accel.velocity_random_walk_m_s_rt_h, M_S_PER_RT_HOUR),
        ),
    )


def _si(stated: Stated | None, unit: float) -> float:
    return 0.0 if stated is None else stated.value * unit


@dataclass(frozen=True, slots=True, eq=False)
class TriadErrors:
    """One unit's errors as drawn: ``matrix`` (3, 3) = I + S + M and ``bias`` (3,) in SI."""

    matrix: Array
    bias: Array

    def __post_init__(self) -> None:
        set_owned(self, matrix=(self.matrix, (3, 3), float), bias=(self.bias, (3,), float))


# One random stream per source, by number: a number is never given to another source.
_STREAMS = {
    ("gyro", "bias"): 0,
    ("gyro", "scale"): 1,
    ("gyro", "misalignment"): 2,
    ("gyro", "noise"): 3,
    ("accel", "bias"): 4,
    ("accel", "scale"): 5,
    ("accel", "misalignment"): 6,
    ("accel", "noise"): 7,
}


def stream(seed: int, sensor: str, source: str) -> np.random.Generator:
    """The random stream of one error source; the same for the same seed, whatever else is on."""
    key = (_STREAMS[sensor, source],)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def draw(spec: TriadSpec, seed: int, sensor: str) -> TriadErrors:
    """One unit's constant errors."""
    bias = spec.bias * stream(seed, sensor, "bias").standard_normal(3)
    scale = spec.scale * stream(seed, sensor, "scale").standard_normal(3)
    lean = spec.misalignment * stream(seed, sensor, "misalignment").standard_normal((3, 3))
    return TriadErrors(np.eye(3) + np.diag(scale) + lean * (1 - np.eye(3)), bias)


class Imu:
    """One unit, switched on: reports the truth with its errors, block after block.

    Parameters
    ----------
    spec : ImuSpec
    seed : int
        Same seed, same bytes, whatever the blocks' lengths.
    rate_hz : int
        Sample rate, which sets the noise of a sample.
    """

    def __init__(self, spec: ImuSpec, seed: int, rate_hz: int) -> None:
        self.gyro_errors = draw(spec.gyro, seed, "gyro")
        self.accel_errors = draw(spec.accel, seed, "accel")
        self.gyro_sigma = spec.gyro.noise * np.sqrt(rate_hz)
        self.accel_sigma = spec.accel.noise * np.sqrt(rate_hz)
        self._gyro_noise = stream(seed, "gyro", "noise")
        self._accel_noise = stream(seed, "accel", "noise")

    def report(self, truth: TruthBlock) -> ImuBlock:
        """The next block of samples; each block must be asked for once, in order."""
        shape = (len(truth), 3)
        w = truth.w_ib_b @ self.gyro_errors.matrix.T + self.gyro_errors.bias
        f = truth.f_b @ self.accel_errors.matrix.T + self.accel_errors.bias
        w += self.gyro_sigma * self._gyro_noise.standard_normal(shape)
        f += self.accel_sigma * self._accel_noise.standard_normal(shape)
        return ImuBlock(truth.t_ns, w, f)
