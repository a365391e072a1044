"""Calibrations made up for tests."""

from dataclasses import replace

import numpy as np

from alignment.calibration import (
    Calibration,
    Contribution,
    Gravity,
    Key,
    LeftOut,
    Residual,
    derived_of,
    parameters_of,
)
from stand.calibration.file import CalibrationRecord

DEG_H = np.pi / 180 / 3600
ARC_SECOND = np.pi / 180 / 3600


def a_record(toml="", **more):
    """Gyro biases of 8, -10 and 12 deg/h, each +- 1; an accelerometer axis leaning by 30 arcsec."""
    keys = [Key("gyro", "bias", n) for n in range(3)]
    keys += [Key("accel", "misalignment", i, j) for i in range(3) for j in range(3) if i != j]
    values = np.array([8 * DEG_H, -10 * DEG_H, 12 * DEG_H, *[15 * ARC_SECOND] * 6])
    P = np.diag([*[DEG_H**2] * 3, *[ARC_SECOND**2] * 6])
    calibration = Calibration(
        parameters=parameters_of(tuple(keys), values, P, np.full(9, np.inf)),
        covariance=P,
        chi_square=8.0,
        dof=9,
        gravity=Gravity(value=9.81),
        derived=derived_of(keys, values, P),
    )
    unit = {"id": "own", "title": "a unit <b>", "serial": "S1"} | ({"toml": toml} if toml else {})
    return replace(CalibrationRecord(calibration=calibration, unit=unit), **more)


def a_full_record():
    """The same with residuals, a budget, notes and what was left out, for pages."""
    record = a_record()
    c = record.calibration
    rows = tuple(Residual(f"rest {k}", "rate at rest", (0.1 * k, -0.5, 1.0)) for k in range(1, 9))
    c = replace(
        c,
        residuals=rows,
        notes=("12 rests: rank 9 of 9",),
        null_space=("what nobody can tell",),
        left_out=(LeftOut("rest 3", "bumped <i>"),),
        budget=(Contribution("noise", c.sigmas), Contribution("gravity", 1e-4 * c.sigmas)),
    )
    source = {"method": "hand-held", "recording": "log.csv"}
    return replace(record, calibration=c, source=source, hashes={"log.csv": "ab" * 32})
