"""Headings as points of a circle: closed forms, first order where it holds, and fits by the run."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.earth import Site
from alignment.information import InstrumentErrors, Stretch, TriadErrors, information
from alignment.information.circle import NO_RIVAL, chord, circle_information, curvature, rival
from alignment.methods.position_fit import fit_positions
from alignment.methods.position_gains import known_to
from alignment.options import Options, Priors

DEG = np.pi / 180
SITE = Site(48.5 * DEG)
LEVEL = Rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))  # X1 north, Y1 up
NORTH = 9.96651 / 3600 * DEG  # rad/s at 48.5 deg


def rests(*attitudes: Rotation, seconds: float = 100.0) -> list[Stretch]:
    return [Stretch(str(k), k * seconds, seconds, C) for k, C in enumerate(attitudes)]


def turned(axis_n, degrees: float) -> Rotation:
    return Rotation.from_rotvec(np.array(axis_n) / np.linalg.norm(axis_n) * degrees * DEG) * LEVEL


def test_half_a_turn_about_down_knows_both_directions_alike():
    """Half the difference of two rests of 100 s: N / sqrt(200) of either component, by hand."""
    noise = 0.15 / 60 * DEG  # rad/sqrt(s)
    unit = InstrumentErrors(TriadErrors(noise=noise, bias=np.inf), TriadErrors(noise=1e-5))
    known = information(rests(LEVEL, turned([0, 0, 1], 180)), Rotation.identity(), SITE, unit)
    G = circle_information(known, SITE)
    assert pytest.approx(np.eye(2) * (NORTH / noise) ** 2 * 200, rel=1e-4, abs=1e-3) == G
    # its tangent is first order
    assert G[1, 1] ** -0.5 == pytest.approx(known.sigma("heading"), rel=1e-6)
    assert rival(G) is NO_RIVAL


def test_half_a_turn_about_north_knows_what_is_across_it_alone():
    """East and down change sides, north does not: of it a bias of 10 deg/h leaves 1 to 1."""
    noise, bias = 1e-9, 10 / 3600 * DEG
    unit = InstrumentErrors(TriadErrors(noise=noise, bias=bias), TriadErrors(noise=1e-5))
    known = information(rests(LEVEL, turned([1, 0, 0], 180)), Rotation.identity(), SITE, unit)
    G = circle_information(known, SITE)
    assert G[0, 0] == pytest.approx((NORTH / bias) ** 2, rel=1e-3)
    assert G[1, 1] == pytest.approx((NORTH / noise) ** 2 * 200, rel=1e-2)  # tilt takes the rest
    assert abs(G[0, 1]) < 1e-6 * np.sqrt(G[0, 0] * G[1, 1])


@pytest.mark.parametrize(("chi2", "taken"), [(16.0, 0.0227501), (25.0, 0.0062097)])
def test_the_opposite_heading_is_taken_as_often_as_normal_tails_say(chi2, taken):
    """Opposite is what lies beyond the circle's middle: Q(2) and Q(2.5) of the normal law."""
    sigma = 2 * DEG
    found = rival(np.diag([chi2 / 4, 1 / sigma**2]))
    assert found.apart == pytest.approx(np.pi)
    assert found.chi2 == pytest.approx(chi2)
    # 8100 = (180/2)^2; beside the middle the circle is steeper for both by a few per cent
    assert found.ratio == pytest.approx(np.sqrt(1 + taken * 8099), rel=0.05)


@pytest.mark.parametrize("sigma", [0.01, 1.0, 5.0])
def test_first_order_stands_where_both_directions_are_known(sigma):
    for size in (1.0, 0.3, 10.0):
        assert rival(np.diag([size, 1.0]) / (sigma * DEG) ** 2).ratio == pytest.approx(1, abs=0.02)


def test_where_the_circle_bends_within_a_sigma_its_tangent_is_too_wide():
    """North is known to 0.0061, east to 8 deg alone: ``1 - cos h`` tells h, all but its sign.

    Each of 2000 draws has its likeliest heading by a fine grid.
    """
    sigma, north = 8 * DEG, 0.0061
    found = rival(np.diag([1 / north**2, 1 / sigma**2]))
    h = np.linspace(-1, 1, 4001)
    d = np.stack([np.cos(h) - 1, np.sin(h)], axis=1)
    z = np.random.default_rng(3).normal(size=(2000, 2)) * [north, sigma]
    costs = (((z[:, None] - d) / [north, sigma]) ** 2).sum(axis=2)
    mean_square = float(np.mean(h[np.argmin(costs, axis=1)] ** 2))
    # the grid of `rival` is an eighth of a sigma wide; 2000 squares are known to 4 %
    assert found.ratio == pytest.approx(np.sqrt(mean_square) / sigma, rel=0.06)
    assert found.ratio < 0.6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "degrees", "least", "most"),
    [([0.6, 0.8, 0.0], 110.0, 1.2, 5.0), ([0.0, 0.3, 1.0], 150.0, 0.99, 1.05)],
)
def test_fits_err_as_the_circle_says(axis, degrees, least, most):
    """A stim300's noise, bias and g-sensitivity at latitude 7 deg: 600 pairs of positions.

    By first order both headings are good to some 5 deg; one of them is now and then 50 deg off.
    """
    site, runs = Site(7 * DEG), 600
    per_hour = DEG / 3600
    priors = Priors(
        gyro_bias=8 * per_hour, accel_bias=2e-3, gyro_g_sensitivity=1.0 * per_hour / 9.80665
    )
    noise = np.repeat([0.15 / 60 * DEG / np.sqrt(600), 1e-5], 3)
    C = np.array([LEVEL.as_matrix(), turned(axis, degrees).as_matrix()])
    rng = np.random.default_rng(3)
    felt = np.einsum("kji,tj->kti", C, [site.w_ie_n, site.f_n]).reshape(2, 6)
    means = felt + noise * rng.standard_normal((runs, 2, 6))
    means[..., :3] += priors.gyro_bias * rng.standard_normal((runs, 1, 3))
    means[..., 3:] += priors.accel_bias * rng.standard_normal((runs, 1, 3))
    G = priors.gyro_g_sensitivity * rng.standard_normal((runs, 3, 3))
    means[..., :3] += np.einsum("rij,kj->rki", G, felt[:, 3:])
    relative = np.array([np.eye(3), C[0].T @ C[1]])
    fit = fit_positions(means, np.tile(noise**2, (2, 1)), relative, site.latitude, 9.78, priors)
    turns = Rotation.from_matrix(fit.C_nb[:, 0] @ C[0].T).as_rotvec()[:, 2]
    stretches = [
        Stretch(s.label, s.start, s.duration, s.C_pb, disturbance=noise)
        for s in rests(*Rotation.from_matrix(C))
    ]
    known = known_to(stretches, site, Options(priors=priors))
    circle = circle_information(
        information(
            stretches,
            Rotation.identity(),
            site,
            InstrumentErrors(
                TriadErrors(bias=priors.gyro_bias, g_sensitivity=priors.gyro_g_sensitivity),
                TriadErrors(bias=priors.accel_bias),
            ),
        ),
        site,
    )
    assert known.sigma("heading") < 10 * DEG
    found, sigma = rival(circle), circle[1, 1] ** -0.5
    assert least < found.ratio < most
    # 600 squares, of heavy tails in the first case: 3 standard errors of sqrt(kurtosis/600)/2
    assert np.sqrt(np.mean(turns**2)) / sigma == pytest.approx(found.ratio, rel=0.15)


def test_what_a_circle_leaves_its_tangent_by_hand():
    """``E (1 - cos h)^2``: 3/4 sigma^4 of small headings, 3/2 all round, 0.354606 at 1 rad."""
    assert curvature(1.0) == pytest.approx(0.354606, rel=1e-5)
    assert curvature(0.01) == pytest.approx(0.75e-8, rel=1e-3)
    assert curvature(100.0) == pytest.approx(1.5, rel=1e-12)


def test_what_a_chord_has_by_hand():
    """``E sin(h)^2``: sigma^2 of small headings, 1/2 all round, 0.432332 at 1 rad."""
    assert chord(1.0) == pytest.approx(0.432332, rel=1e-5)
    assert chord(1e-6) == pytest.approx(1e-12, rel=1e-9)
    assert chord(100.0) == pytest.approx(0.5, rel=1e-12)


class Changed:
    """What readings tell, with some of it changed."""

    def __init__(self, known, **changes):
        self.known, self.changes = known, changes

    def __getattr__(self, name):
        return self.changes[name] if name in self.changes else getattr(self.known, name)


def test_an_error_that_nobody_knows_and_nothing_shows_changes_nothing():
    """A column of zeros is left out: no size to divide by."""
    unit = InstrumentErrors(TriadErrors(noise=1e-7, bias=np.inf), TriadErrors(noise=1e-5))
    known = information(rests(LEVEL, turned([0, 0, 1], 180)), Rotation.identity(), SITE, unit)
    J, prior = known.J.copy(), known.prior.copy()
    last = int(np.flatnonzero(np.isinf(prior))[-1])
    J[:, last], prior[last] = 0.0, 0.0
    found, gone = (
        circle_information(Changed(known, J=J, prior=p), SITE) for p in (known.prior, prior)
    )
    np.testing.assert_allclose(found, gone, rtol=1e-9, atol=1e-9 * found.max())
