"""Logs of a unit that a hand turns from rest to rest, with what it felt."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

import stand
from alignment import ImuReadings
from alignment.earth import EARTH_RATE

LATITUDE = np.radians(48.5)
G = 9.8088  # as measured there


def truth(attitudes, rate_hz=50, rest_s=6.0, move_s=3.0, latitude=LATITUDE, g=G):
    """Means (n, 3) of rate and force, and ends of samples (n,), from rest to rest.

    Turns are about an axis that stays, beginning and ending softly.
    """
    steps, turns = round(move_s * rate_hz), [Rotation.from_quat(q) for q in attitudes]
    part = np.arange(1, steps + 1) / steps
    soft = part**3 * (10 - 15 * part + 6 * part**2)
    path = [turns[0]] * (round(rest_s * rate_hz) + 1)
    for one, other in pairwise(turns):
        by = (one.inv() * other).as_rotvec()
        path += [one * Rotation.from_rotvec(by * s) for s in soft]
        path += [other] * round(rest_s * rate_hz)
    C = Rotation.concatenate(path)
    dt = 1 / rate_hz
    earth = EARTH_RATE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    still = Rotation.from_rotvec(np.tile(earth * dt, (len(path) - 1, 1)))
    # b at a sample's begin to b at its end, in inertial space
    w = (C[:-1].inv() * still * C[1:]).as_rotvec() / dt
    middle = C[:-1] * Rotation.from_rotvec((C[:-1].inv() * C[1:]).as_rotvec() / 2)
    f = middle.inv().apply([0, 0, -g])
    return np.arange(1, len(w) + 1) * dt, w, f


def anyhow(count, seed):
    """Attitudes (count, 4) as a hand would take: each face and edge up, then any."""
    rng = np.random.default_rng(seed)
    return Rotation.random(count, random_state=rng).as_quat()


def log_of(unit, attitudes, **how):
    """What a unit of `stand.unit` reports, and the truth."""
    t, w, f = truth(attitudes, unit.rate_hz, **how)
    told = unit.report(t, w, f)
    return ImuReadings(t, told.w_ib_b, told.f_b), w, f


def unit_of(sheet, seed, rate_hz=50):
    """A unit of the catalogue whose sensors are in one place and whose clock is right."""
    return stand.unit(
        sheet,
        rate_hz=rate_hz,
        seed=seed,
        without=["size-effect", "clock-offset", "jitter", "latency"],
    )
