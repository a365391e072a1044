"""What a stated bias instability adds: closed forms and slopes of the estimators, by hand."""

from dataclasses import replace
from math import cos, radians, sqrt, tan

import numpy as np
import pytest
from rocking import G, Motion
from scipy.spatial.transform import Rotation
from test_inertial import CAROUSEL, QUIET, SLOW, STILL, dwell, errors, site

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.methods.fine import filtered
from alignment.methods.inertial import inertial
from alignment.methods.six_position import six_position

W = 7.292115e-5  # rad/s
LEVEL = Motion()  # X1 north, Y1 up, Z1 east


@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_later_samples_differ_from_the_offset_by_twice_the_plateau_squared(latitude):
    """Adjacent means differ by sqrt(2) of their Allan deviation: that is its definition."""
    lat = radians(latitude)
    motion = replace(LEVEL, latitude_deg=latitude)
    t, w, f, C = motion.readings(60.0, 10)
    stretch = Dwell("p", 0.0, 60.0, ImuReadings(t, w, f), Rotation.from_matrix(C))
    where = Site(lat, local_gravity=G)
    told = Options(priors=Priors(gyro_instability=3e-8, accel_instability=2e-4))
    P = six_position([stretch], where, told)[1].covariance
    assert P is not None
    tilt = sqrt(2) * 2e-4 / G
    heading = sqrt(2) * 3e-8 / (W * cos(lat))
    np.testing.assert_allclose(np.sqrt(P.diagonal()[:2]), tilt, rtol=1e-3)
    assert sqrt(P[2, 2]) == pytest.approx(np.hypot(heading, tan(lat) * tilt), rel=1e-3)
    assert P[0, 2] == pytest.approx(-tan(lat) * tilt**2, rel=1e-3)


@pytest.mark.parametrize("motion", [SLOW, CAROUSEL, STILL], ids=["rocking", "carousel", "still"])
@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_inertial_takes_a_plateau_for_a_line(motion, sensor):
    """By differencing: halves of the record whose means differ by sqrt(2), so ends by 2 sqrt(2)."""
    size = 1e-9 if sensor == "gyro" else 1e-5
    t, w, f, _ = motion.readings(60.0, 10.0, 100.0)
    line = 2 * sqrt(2) * size * ((t - 100.05) / 60 - 0.5)[:, None]
    assert np.diff([h.mean() for h in np.split(line, 2)]) == pytest.approx(sqrt(2) * size)
    base = inertial([dwell(t, w, f)], site(motion), Options(priors=QUIET))[0]
    slopes = []
    for axis in np.eye(3):
        rates, forces = (w + line * axis, f) if sensor == "gyro" else (w, f + line * axis)
        moved = inertial([dwell(t, rates, forces)], site(motion), Options(priors=QUIET))[0]
        slopes.append(errors(moved.C_nb.as_matrix()[None], base.C_nb.as_matrix())[0])
    told = Options(priors=replace(QUIET, **{f"{sensor}_instability": size}))
    wider = inertial([dwell(t, w, f)], site(motion), told)[0]
    want, got = np.array(slopes).T @ np.array(slopes), wider.covariance - base.covariance
    root = np.sqrt(want.diagonal())
    root = np.maximum(root, 1e-4 * root.max())
    # Sums over blocks against samples, and the slopes' own second order.
    np.testing.assert_allclose(got / np.outer(root, root), want / np.outer(root, root), atol=0.03)


def test_biases_of_the_filter_walk_by_thrice_the_plateau_squared():
    """A walk K has the Allan deviation K sqrt(T/3) over T; the plateau's, with K^2 T = 3 B^2.

    So noisy are the gyros and accelerometers that the record tells nothing of their biases.
    """
    t, w, f, _ = STILL.readings(60.0, 10.0, 100.0)
    priors = Priors(
        gyro_bias=1e-9,
        accel_bias=1e-6,
        gyro_instability=2e-9,
        accel_instability=3e-6,
        gyro_walk=1e-4,
        accel_walk=1e-1,
    )
    run = filtered(dwell(t, w, f), site(STILL), Options(priors=priors))
    assert run.names == ("gyro_bias", "accel_bias")
    np.testing.assert_allclose(run.sigmas[-1, 0], sqrt(1e-18 + 3 * 4e-18), rtol=1e-3)
    np.testing.assert_allclose(run.sigmas[-1, 1], sqrt(1e-12 + 3 * 9e-12), rtol=1e-3)
