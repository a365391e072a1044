"""Earth rate and gravity against numbers written by hand (methods.md section 0)."""

from math import atan, atan2, cos, hypot, inf, nan, pi, radians, sin, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.earth import EARTH_RATE, Site, earth_rate_n, normal_gravity
from alignment.errors import AlignmentError, PoleError
from alignment.units import (
    ARC_MINUTE,
    ARC_SECOND,
    DEG_PER_HOUR,
    DEG_PER_RT_HOUR,
    M_S_PER_RT_HOUR,
    MICRO_G,
    MILLI_G,
)

# latitude [deg], north and up rate [deg/h], gravity [m/s^2]
TABLE = [
    (0.0, 15.04107, 0.0, 9.7803253),
    (45.0, 10.63564, 10.63564, 9.8061978),
    (48.5, 9.96651, 11.26509, 9.8093587),
    (-33.0, 12.61450, -8.19195, 9.7956607),
    (90.0, 0.0, 15.04107, 9.8321849),
]
RATE_ROUNDING = 0.51e-5  # deg/h: half of the table's last digit, and rounding of the test
GRAVITY_ROUNDING = 0.51e-7  # m/s^2: likewise


def test_units_by_hand():
    # One ulp each: the constants are products of a few exact numbers.
    assert pytest.approx(4.84813681109536e-6, rel=1e-15) == DEG_PER_HOUR
    assert pytest.approx(4.84813681109536e-6, rel=1e-15) == ARC_SECOND
    assert pytest.approx(2.908882086657216e-4, rel=1e-15) == ARC_MINUTE
    assert pytest.approx(2.908882086657216e-4, rel=1e-15) == DEG_PER_RT_HOUR
    assert pytest.approx(1 / 60, rel=1e-15) == M_S_PER_RT_HOUR
    assert pytest.approx(9.80665e-3, rel=1e-15) == MILLI_G
    assert pytest.approx(9.80665e-6, rel=1e-15) == MICRO_G


@pytest.mark.parametrize(("latitude", "north", "up", "gravity"), TABLE)
def test_table_of_rates_and_gravity(latitude, north, up, gravity):
    site = Site(radians(latitude))
    rate = site.w_ie_n / DEG_PER_HOUR
    np.testing.assert_allclose(rate, [north, 0.0, -up], rtol=0, atol=RATE_ROUNDING)
    np.testing.assert_allclose(earth_rate_n(radians(latitude)), site.w_ie_n, rtol=0, atol=0)
    assert site.gravity == pytest.approx(gravity, abs=GRAVITY_ROUNDING)
    np.testing.assert_allclose(site.f_n, [0, 0, -gravity], rtol=0, atol=GRAVITY_ROUNDING)


def test_earth_rate_points_up_at_the_north_pole_and_down_at_the_south_pole():
    # cos(pi/2) leaves 6e-17 of the rate, far below its last given digit.
    np.testing.assert_allclose(earth_rate_n(pi / 2), [0, 0, -7.292115e-5], rtol=0, atol=1e-18)
    np.testing.assert_allclose(earth_rate_n(-pi / 2), [0, 0, 7.292115e-5], rtol=0, atol=1e-18)
    assert EARTH_RATE == 7.292115e-5


@pytest.mark.parametrize("latitude", [0.0, 45.0, -33.0, 90.0])
def test_gravity_falls_with_height(latitude):
    step = 1.0  # m; the second difference, 3 g (h/a)^2, is 7e-13 and cancels in a central one
    lat = radians(latitude)
    gradient = (normal_gravity(lat, step) - normal_gravity(lat, -step)) / (2 * step)
    # -3.086e-6 1/s^2 is the mean; it varies with latitude by 2 f = 0.1 % of 2 g/a either way.
    assert gradient == pytest.approx(-3.086e-6, abs=0.003e-6)


def exact_normal_gravity(latitude, height):
    """Normal gravity in closed form at any height, by ellipsoidal coordinates.

    NIMA TR8350.2 equations 4-5 to 4-18; nothing is expanded in height here.
    """
    a, f, gm, w = 6378137.0, 1 / 298.257223563, 3.986004418e14, 7.292115e-5
    b, e2 = a * (1 - f), f * (2 - f)
    E = sqrt(a * a - b * b)
    normal_radius = a / sqrt(1 - e2 * sin(latitude) ** 2)
    x = (normal_radius + height) * cos(latitude)
    z = (normal_radius * (1 - e2) + height) * sin(latitude)
    excess = x * x + z * z - E * E
    u = sqrt(0.5 * excess * (1 + sqrt(1 + 4 * E * E * z * z / excess**2)))
    beta = atan2(z * sqrt(u * u + E * E), u * x)

    def q(v):
        return 0.5 * ((1 + 3 * v * v / E**2) * atan(E / v) - 3 * v / E)

    slope = 3 * (1 + u * u / E**2) * (1 - u / E * atan(E / u)) - 1
    r2 = u * u + E * E
    scale = sqrt(r2 / (u * u + E * E * sin(beta) ** 2))
    inward = gm / r2 + w**2 * a * a * E / r2 * slope / q(b) * (0.5 * sin(beta) ** 2 - 1 / 6)
    along_u = scale * (w**2 * u * cos(beta) ** 2 - inward)
    turn = a * a / sqrt(r2) * q(u) / q(b) - sqrt(r2)
    return hypot(along_u, scale * w**2 * turn * sin(beta) * cos(beta))


@pytest.mark.parametrize("latitude", [0.0, 45.0, 48.5, -33.0, 90.0])
@pytest.mark.parametrize("height", [0.0, 200.0, 1000.0, 5000.0])
def test_gravity_against_the_closed_form(latitude, height):
    lat = radians(latitude)
    # On the ellipsoid the constants' last digits and q's cancellation (1e-11). Above it what the
    # second order leaves out: the flattening in the linear term, 1.1e-10 per m at the equator.
    bound = 2e-11 + 1.2e-10 * height
    assert normal_gravity(lat, height) == pytest.approx(
        exact_normal_gravity(lat, height), abs=bound
    )


def test_local_gravity_overrides_the_model():
    assert Site(radians(48.5), local_gravity=9.81234).gravity == 9.81234
    assert Site(None, local_gravity=9.81234).gravity == 9.81234
    assert Site(radians(48.5), height=200.0).gravity == normal_gravity(radians(48.5), 200.0)


def test_horizontal_rate_is_refused_at_the_poles():
    # 9.966513 deg/h to its seven digits: 15.041067 cos 48.5 deg
    assert Site(radians(48.5)).horizontal_rate() / DEG_PER_HOUR == pytest.approx(9.966513, abs=1e-6)
    assert Site(radians(-33)).horizontal_rate() > 0
    assert Site(radians(89.9)).horizontal_rate() > 0  # 0.06 deg is 1e-3 of the rate
    for pole in (90.0, -90.0, 89.95):
        with pytest.raises(PoleError, match=r"within 0\.06 deg of a pole"):
            Site(radians(pole)).horizontal_rate()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"latitude": 48.5}, "latitude: 48.5 rad, must be within -pi/2 to pi/2"),
        ({"latitude": nan}, "latitude: nan rad"),
        ({"latitude": 0.8, "height": inf}, "height: inf m, must be finite"),
        ({"latitude": 0.8, "local_gravity": 981.0}, "local_gravity: 981.0 m/s^2, must be between"),
        ({"latitude": 0.8, "local_gravity": nan}, "local_gravity: nan"),
    ],
)
def test_a_site_out_of_range_is_refused(values, message):
    with pytest.raises(ValueError) as caught:
        Site(**values)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "use",
    [
        Site.known_latitude,
        Site.horizontal_rate,
        lambda site: site.gravity,
        lambda site: site.w_ie_n,
    ],
)
def test_an_unknown_latitude_is_refused_where_it_is_needed(use):
    with pytest.raises(AlignmentError, match="latitude: not known, but this method needs it"):
        use(Site(None))


def test_an_unsure_heading_leaves_open_which_way_the_plumb_line_leans():
    """By hand: the zenith leans 3e-4 rad north, which is a turn about -E; heading off by 0.01 rad
    is a turn about an axis that leans, 3e-6 about N, and by (1 - cos h) about E: 3 s^4/4."""
    site = Site(0.8, deflection=(3e-4, 0.0))
    found = site.about_n(np.diag([0.0, 0.0, 1e-4]))
    assert found[0, 0] == pytest.approx(9e-12 * (1 - 1e-4), rel=1e-6)  # sin h is less than h
    assert found[1, 1] == pytest.approx(9e-8 * 0.75e-8, rel=1e-3)
    assert abs(found[0, 2]) == pytest.approx(3e-8 * (1 - 0.5e-4), rel=1e-6)
    same = np.diag([1.0, 2.0, 3.0])
    assert Site(0.8).about_n(same) is same


@pytest.mark.parametrize("sigma", [0.1, 0.5, 3.0])
def test_tilts_of_an_unsure_heading_are_those_of_many_turns(sigma):
    """Turns by h about a plumb line that leans 200" north and 300" east move the vertical in n."""
    site = Site(0.8, deflection=(200 / 206265, 300 / 206265))
    h = sigma * np.random.default_rng(3).standard_normal(200_000)
    turns = site.plumb * Rotation.from_rotvec(h[:, None] * [0, 0, 1]) * site.plumb.inv()
    down = turns.apply([0.0, 0.0, 1.0])
    tilt = np.stack([-down[:, 1], down[:, 0]], axis=1)
    found = site.about_n(np.diag([0.0, 0.0, sigma**2]))[:2, :2]
    # fourth moments of 200 000 draws: a few parts in a thousand; lean to the second order, 1e-3
    np.testing.assert_allclose(found, tilt.T @ tilt / len(h), rtol=0.02, atol=2e-2 * found.trace())
    assert site.about_n(np.zeros((2, 3, 3))).shape == (2, 3, 3)
