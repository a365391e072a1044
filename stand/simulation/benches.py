"""What a calibration is told of unit, table and gravity: from their data sheets."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Site
from alignment.arrays import Array, IntArray
from alignment.calibration.bench import LAG, MEASURED_GRAVITY, SENSORS, Bench, Leanings
from alignment.calibration.gravity import NORMAL_SIGMA
from alignment.calibration.result import Key
from alignment.units import ARC_SECOND
from stand.imu import ImuSpec, Temperature
from stand.imu.filter import LAG as FILTER_LAG
from stand.imu.filter import noise_variance
from stand.imu.instrument import slow_noise, unit_of
from stand.imu.priors import placement
from stand.physics.mjcf import describe, load_model
from stand.samples import Sampling
from stand.table.joints import JOINTS, StandModel
from stand.table.known_errors import StatedErrors, stated
from stand.table.leanings import joint_axes, leanings
from stand.table.table import Table

FIRST_GIMBAL = "outer"


@dataclass(frozen=True, slots=True, eq=False)
class TableLeanings:
    """How the errors of a table turn b, as `Bench.table`."""

    stated: StatedErrors
    model: StandModel

    def __call__(self, joints: Array, going_round: IntArray) -> Leanings:
        found = leanings(self.stated, self.model, joints, going_round)
        turns = np.array([one.turns for one in found]).reshape(len(found), len(joints), 3)
        return Leanings(
            tuple(one.name for one in found),
            np.array([one.sigma for one in found]),
            np.moveaxis(turns, 0, 2),
            np.swapaxes(joint_axes(self.model, joints), 1, 2),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Warmth:
    """A unit's temperature above its reference [K], as `Bench.warmth`."""

    temperature: Temperature
    reference: float

    def __call__(self, t: Array) -> Array:
        return self.temperature.at(t) - self.reference


def bench_of(
    imu: ImuSpec | None,
    table: Table | None,
    site: Site,
    sampling: Sampling = Sampling.MEAN,
    rate_hz: float = 200.0,
    *,
    ideal: bool = True,
    joints_known: bool = True,
    temperature: Temperature | None = None,
) -> Bench:
    """What data sheets say.

    Parameters
    ----------
    imu : ImuSpec or None
        None: nothing is known of the unit.
    table : Table or None
        None: no error of the table is stated.
    site : Site
        Whose gravity was measured, or is the normal one.
    sampling : Sampling
    rate_hz : float
        Of the samples.
    ideal : bool
        Whether joints follow the plan; a servo has its own ripple.
    joints_known : bool
        Whether the stretches have the joints' angles; else only attitudes were told.
    temperature : Temperature, optional
        Of the unit over the recording, where it is known.
    """
    gravity = NORMAL_SIGMA if site.local_gravity is None else MEASURED_GRAVITY
    more = {} if imu is None else _of_unit(imu, rate_hz, sampling)
    more |= _of_table(table, ideal) if table is not None and joints_known else {}
    if table is not None and not joints_known:
        turn, seat, nominal, azimuth = placement(table)
        more |= {"placement": turn, "seat": seat, "tilt": nominal, "azimuth": azimuth}
    if imu is not None and temperature is not None:
        more["warmth"] = Warmth(temperature, imu.reference_temperature)
    return Bench(gravity_sigma=gravity, means=sampling is Sampling.MEAN, **more)


def _of_unit(imu: ImuSpec, rate_hz: float, sampling: Sampling) -> dict:
    pair = (imu.gyro, imu.accel)
    lag = np.array([FILTER_LAG / t.bandwidth if np.isfinite(t.bandwidth) else 0.0 for t in pair])
    lag += imu.clock.latency
    dither = [
        t.noise * np.sqrt(rate_hz * noise_variance(t.bandwidth, rate_hz, sampling)) for t in pair
    ]
    return {
        "dither": np.array(dither),
        "known": tuple(
            (Key(sensor, one.term, one.axis, one.toward), one.value, one.sigma)  # pyright: ignore
            for sensor, triad in zip(SENSORS, pair, strict=True)
            for one in triad.known
        ),
        "unit": unit_of(imu, slow_noise(imu, rate_hz, sampling)),
        "lag": lag,
        "lag_sigma": np.maximum(lag, LAG),
        "temperature_bias": np.array([t.bias_temperature for t in pair]),
        "temperature_scale": np.array([t.scale_temperature for t in pair]),
        "places": imu.places,
        "steps": np.array([0.0 if imu.increments else t.resolution for t in pair]),
    }


def _of_table(table: Table, ideal: bool) -> dict:
    model = describe(load_model(table.model))
    steps = [table.entry.axis[joint].errors.encoder_step_arc_s for joint in JOINTS]
    return {
        "table": TableLeanings(stated(table, None, ideal), model),
        "joint_noise": np.array(steps) * ARC_SECOND / np.sqrt(12),
        "arm": _arm(model),
    }


def _arm(model: StandModel) -> Array:
    """The unit's point from where the gimbals' axes cross, in b [m]."""
    bodies = {body.name: body for body in model.bodies}
    place, C = model.imu_position.copy(), Rotation.from_quat(model.imu_rotation)
    body = bodies[model.imu_body]
    while True:
        turn = Rotation.from_quat(body.rotation)
        if body.joint is not None and body.joint.name == FIRST_GIMBAL:
            return np.asarray(C.inv().apply(place))
        place, C = body.position + turn.apply(place), turn * C
        body = bodies[body.parent]
