"""What a record says of itself, held against what it must be: Earth's rate, gravity, a latitude."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment import DEFAULT_METHOD, ESTIMATORS, Dwell, ImuReadings, Options, Site
from alignment.earth import EARTH_RATE
from alignment.errors import AlignmentError
from alignment.units import DEG, DEG_PER_HOUR, MICRO_G, MILLI_G, STANDARD_GRAVITY

SLIP = 0.05  # relative, to one of the known mix-ups of units: noise and bias of a poor gyro
RATE_UNITS = {"deg/s": DEG, "deg/h": DEG_PER_HOUR, "mdps": 1e-3 * DEG}
FORCE_UNITS = {"g": STANDARD_GRAVITY, "mg": MILLI_G, "ug": MICRO_G}
FORCE_MOST = 1.5  # times gravity, or so much less: no accelerometer at rest is off by that
NEAR_EARTH = 0.1  # relative: a mean rate so near is not mostly bias, and its direction tells
NEAR = 1.0 * DEG  # of latitude: small biases, a coarse site
FAR = 5.0 * DEG
SIGMAS = 5.0


def rate_slip(rate: float) -> str | None:
    """The unit in which a mean rate [rad/s] would be Earth's, in words."""
    times = rate / EARTH_RATE
    unit = _fitting(rate, EARTH_RATE, RATE_UNITS)
    return f"{times:.1f} times Earth's: {unit} for rad/s?" if unit else None


def force_slip(force: float) -> str | None:
    """The unit in which a mean specific force [m/s^2] would be gravity, in words."""
    unit = _fitting(force, STANDARD_GRAVITY, FORCE_UNITS)
    return f"specific force {force:.4g}: {unit} for m/s^2?" if unit else None


def _fitting(value: float, wanted: float, units: dict[str, float]) -> str | None:
    return next((u for u, si in units.items() if abs(value * si / wanted - 1) < SLIP), None)


@dataclass(frozen=True, slots=True)
class Doubts:
    """Of one rest: `doubtful` may be meant; `wrong` cannot be, for a method that takes the readings
    for Earth's rate and gravity at the stated latitude."""

    doubtful: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()


def doubts_of(dwell: Dwell, site: Site, options: Options) -> Doubts:
    """What speaks against the units, signs and site of readings at rest; nothing of others.

    Notes
    -----
    The direction of the mean rate against the vertical gives a latitude that no common factor of
    the gyros changes. It is held against the stated one where the mean rate is Earth's in some
    unit: a unit that is mostly bias says nothing.
    """
    if dwell.turn is not None or dwell.fixes is not None:
        return Doubts()
    part = dwell.window()
    rate = float(np.linalg.norm(part.w_ib_b.mean(axis=0)))
    force = float(np.linalg.norm(part.f_b.mean(axis=0)))
    try:
        (found, *_) = ESTIMATORS[DEFAULT_METHOD].estimate([_in_si(dwell, rate)], site, options)
    except AlignmentError:
        return Doubts()
    told, wrong = [], []
    times = force / STANDARD_GRAVITY
    if not 1 / FORCE_MOST < times < FORCE_MOST:
        slip = force_slip(force) or f"specific force {force:.4g} m/s^2, gravity is 9.8: in counts?"
        wrong.append(slip)
    slip = rate_slip(rate)
    known = found.latitude is not None and found.latitude_sigma is not None
    if slip is not None and not known:
        told.append(f"mean rate {slip}")
    elif known and (slip is not None or abs(rate / EARTH_RATE - 1) < NEAR_EARTH):
        assert found.latitude is not None
        assert found.latitude_sigma is not None
        agrees, doubt, certain = _latitude(found.latitude, found.latitude_sigma, site.latitude)
        if slip is not None:
            (wrong if agrees else told).append(f"mean rate {slip}")
        if doubt is not None:
            (wrong if certain else told).append(doubt)
    return Doubts(tuple(told), tuple(wrong))


def _in_si(dwell: Dwell, rate: float) -> Dwell:
    """The dwell with its rates in the unit in which their mean [rad/s] would be Earth's."""
    unit = _fitting(rate, EARTH_RATE, RATE_UNITS)
    if unit is None:
        return dwell
    r = dwell.readings
    return replace(dwell, readings=ImuReadings(r.t, r.w_ib_b * RATE_UNITS[unit], r.f_b))


def _latitude(found: float, sigma: float, stated: float | None) -> tuple[bool, str | None, bool]:
    """Whether the record's own latitude is the stated one, what to say if not, and how surely."""
    if stated is None:
        return False, None, False
    near, far = NEAR + SIGMAS * sigma, FAR + 2 * SIGMAS * sigma
    agrees = abs(found - stated) < near < FAR
    if abs(found - stated) < far:
        return agrees, None, False
    told = (
        f"the record itself gives latitude {found / DEG:.1f} +- {sigma / DEG:.1g} deg, stated is "
    )
    told += f"{stated / DEG:.4g}: "
    if abs(found + stated) < near:
        return False, told + "its sign, or that of the accelerometers, is wrong", True
    return False, told + "another site, or gyro biases", False


def together(found: Sequence[Doubts]) -> tuple[str, ...]:
    """What is wrong with a record: what every rest that says anything of it says."""
    speaking = [d for d in found if d.doubtful or d.wrong]
    if not speaking or not all(d.wrong for d in speaking):
        return ()
    return speaking[0].wrong
