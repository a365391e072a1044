"""[S1]: azimuth of two gyros on a rocking base; formulas, conclusions, and what it leaves open."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.earth import EARTH_RATE
from alignment.information.sway_law import (
    DISTRIBUTIONS,
    azimuth_between_planes,
    azimuth_error,
    exact_rms,
    expansion,
    known_sway,
    level_bound,
    normal,
    rms_error,
    tilts_of_second,
)
from alignment.methods.two_gyro import Sway, azimuth, azimuth_as_published, sway_bound, sway_of
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from stand.evaluation.published.row import Row, Verdict, judged, solved
from stand.rehearsal.admissible import turned

LATITUDE = 48.5 * DEG
TILTED = (8 * DEG, -5 * DEG)  # mean tilts where the general bound is tried
SWAY = 0.5 * DEG
ROUNDING = 1e-12
DURATION, RATE_HZ = 300.0, 0.2  # of the record and the sway where real gyros are asked
REQUIRED = 0.1 * DEG
_SMALL = 0.05 * DEG  # so that second order stays below the bound of chance
_SAMPLES = 20_000

_row = partial(judged, "S1")


def rows(progress: Callable[[float], None]) -> list[Row]:
    """Every row of [S1]."""
    return [
        *_azimuth_rows(),
        *_expansion_rows(),
        *_bound_rows(),
        *_sample_rows(),
        *_distribution_rows(),
        *_conclusion_rows(),
        *_open_rows(),
    ]


def signals(azimuth_: Array, beta: Array, gamma: Array, latitude: float, theta: float) -> Array:
    """Earth rate (n, 2) along X1 and `theta` clockwise of it in the tilted platform's plane."""
    turns = np.stack(np.broadcast_arrays(-azimuth_, -beta, gamma), axis=-1)  # from NUE
    w_nue = EARTH_RATE * np.array([np.cos(latitude), np.sin(latitude), 0.0])
    w = Rotation.from_euler("YXZ", turns).apply(w_nue, inverse=True)
    return np.stack([w[:, 0], np.cos(theta) * w[:, 0] + np.sin(theta) * w[:, 2]], axis=1)


# --- (1)-(4) -------------------------------------------------------------------------------------


def _azimuth_rows() -> list[Row]:
    beta, gamma = np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.3, 0.3, 7))
    b, g = beta.ravel(), gamma.ravel()
    general = []
    for theta in (30 * DEG, 60 * DEG, 120 * DEG):
        f = signals(np.zeros_like(b), b, g, LATITUDE, theta)
        general.append(np.abs(azimuth_between_planes(f[:, 0], f[:, 1], b, g, LATITUDE, theta)))
    f = signals(np.zeros_like(b), b, g, LATITUDE, np.pi / 2)
    square = np.abs(azimuth_as_published(f[:, 0], f[:, 1], b, g, LATITUDE)).max()
    worst = float(np.max(general))
    a, tilt = np.linspace(-60, 60, 13) * DEG, np.full(13, DEG)
    f = signals(a, 0 * tilt, tilt, LATITUDE, np.pi / 2)
    off = float(np.abs(azimuth_as_published(f[:, 0], f[:, 1], 0 * tilt, tilt, LATITUDE) - a).max())
    ours = float(np.abs(azimuth(f[:, 0], f[:, 1], 0 * tilt, tilt, LATITUDE) - a).max())
    second = tilts_of_second(b, g)
    up = np.stack([np.sin(g) * np.cos(b), np.sin(b)], axis=1)  # of X1 and Z1
    apart = float(np.abs(np.sin(np.stack(second, axis=1)) - up).max())
    return [
        _row(
            "formula (1)",
            "azimuth with planes 30, 60, 120 deg apart, X1 north, tilts to 17 deg",
            "exact",
            f"within {worst / ARC_SECOND:.0e}''",
            worst < ROUNDING,
            "rebuilt as -atan((f2/f1 - cos theta)/sin theta) + sigma",
        ),
        _row(
            "formula (2)",
            "azimuth with planes square, X1 north, tilts to 17 deg",
            "exact",
            f"within {square / ARC_SECOND:.0e}''",
            bool(square < ROUNDING),
            "(1) with theta = 90 deg",
        ),
        _row(
            "formula (2), other azimuths",
            "the same to 60 deg of north, X1 raised by 1 deg",
            "exact",
            f"{off / DEG:.2f} deg",
            False,
            "sigma = atan(B/A) is the tilts' effect at north; elsewhere the tilt of X1 counts",
            nearest=f"with tan(lat) (bet cos a + gam sin a) for sigma {ours / DEG:.3f} deg are "
            "left, of second order",
        ),
        _row(
            "formula (3)",
            "the tilt of one gyro about its own axis is the other's out of the horizon, to 17 deg",
            "equal",
            f"the sines differ by {apart:.3f} at most",
            apart < 0.3**3 / 2 * 1.01,
            "gam1 = bet2 to the third order: sin gam cos bet beside sin gam",
        ),
        _row(
            "formula (4)",
            "bet = bet0 + xi, gam = gam0 + eta with zero means and small variances",
            "an assumption",
            f"at {SWAY / DEG:g} deg rms what (13) leaves out is {_beyond_first_order():.0e} of it",
            True,
            "second order, relatively: small is small enough",
        ),
    ]


def _beyond_first_order() -> float:
    xi = normal(SWAY)
    first = rms_error(known_sway(*TILTED, xi, xi), LATITUDE)
    return abs(exact_rms(*TILTED, xi, xi, LATITUDE) / first - 1)


# --- (5)-(15) ------------------------------------------------------------------------------------


def _expansion_rows() -> list[Row]:
    h, e = 1e-5, expansion(*TILTED, LATITUDE)
    (b, g) = TILTED
    by = [[expansion(b + s * h, g, LATITUDE) for s in (1, -1)]]
    by.append([expansion(b, g + s * h, LATITUDE) for s in (1, -1)])
    numeric = [(p.A - m.A) / (2 * h) for p, m in by] + [(by[0][0].B - by[0][1].B) / (2 * h)]
    slope = np.abs(np.array(numeric) - [e.A_beta, e.A_gamma, e.B_beta]).max()
    at = [np.arctan2(p.B, p.A) - np.arctan2(m.B, m.A) for p, m in by]
    of_atan = np.abs(np.array(at) / (2 * h) - e.slopes).max()
    ratio = _remainder()
    return [
        _row(
            "formulas (5)-(8)",
            "slopes of A and B by both tilts, at 8 and -5 deg",
            "first terms of Taylor's series",
            f"within {slope:.0e} of numeric derivatives",
            bool(slope < 1e-9),
            "central differences of 1e-5 rad",
        ),
        _row(
            "formulas (9), (10)",
            "slopes of atan(B/A) by both tilts, at 8 and -5 deg",
            "(A* z2 - B* z1)/(A*^2 + B*^2)",
            f"within {of_atan:.0e} of numeric derivatives",
            bool(of_atan < 1e-9),
            "central differences of 1e-5 rad",
        ),
        _row(
            "formula (11)",
            "azimuth error of a sample to first order: its remainder when the sway is halved",
            "first order",
            f"divides by {ratio:.2f}",
            abs(ratio - 4) < 0.3,
            "4 is second order left",
        ),
    ]


def _remainder() -> float:
    left = []
    for size in (1 * DEG, 0.5 * DEG):
        xi, eta = np.array([size]), np.array([-0.7 * size])
        f = signals(np.zeros(1), TILTED[0] + xi, TILTED[1] + eta, LATITUDE, np.pi / 2)
        exact = azimuth_as_published(f[:, 0], f[:, 1], *TILTED, LATITUDE)
        left.append(float(exact[0] + azimuth_error(*TILTED, xi, eta, LATITUDE)[0]))
    return left[0] / left[1]


def _bound_rows() -> list[Row]:
    xi, eta = normal(SWAY), normal(SWAY)
    sway = known_sway(*TILTED, xi, eta)
    exact, first = exact_rms(*TILTED, xi, eta, LATITUDE), rms_error(sway, LATITUDE)
    bound = sway_bound(sway, LATITUDE)
    level = known_sway(0.0, 0.0, xi, eta)
    near = level_bound(LATITUDE, xi.variance)
    own, cross = _by_latitude()
    chance = 3 / np.sqrt(2 * _SAMPLES)
    tilted = f"{SWAY / DEG:g} deg rms about both axes, base tilted by 8 and -5 deg"
    return [
        _row(
            "formulas (12), (13)",
            f"rms azimuth error, {tilted}",
            f"{first / DEG:.4f} deg by (13)",
            f"{exact / DEG:.4f} deg by quadrature of exact rotations",
            abs(exact / first - 1) < 1e-3,
            "first order; what is left is second order, relatively",
        ),
        _row(
            "formula (14)",
            f"bound of the rms azimuth error, {tilted}",
            f"{bound / DEG:.4f} deg",
            f"{exact / DEG:.4f} deg exactly: {exact / bound:.3f} of the bound",
            exact <= bound,
            "Cauchy-Bunyakovsky; reached where z1 and z2 sway against each other",
        ),
        _row(
            "formula (15)",
            "azimuth error of a sample over tan(lat) sqrt(D), X1 north, latitude 20 to 75 deg",
            "1",
            f"{min(own):.4f} to {max(own):.4f}; by (14) {sway_bound(level, LATITUDE) / near:.4f}",
            bool(np.abs(np.array(own) - 1).max() < chance),
            "it holds for the projection of the Earth rate alone, the sway's own rate left out",
        ),
        _row(
            "formula (15), sway about the other axis",
            "the same with sway of X1 alone",
            "0",
            f"{max(cross):.1g}",
            bool(max(cross) < chance),
            "X1 stays in the meridian; Earth rate alone",
        ),
    ]


def _by_latitude() -> tuple[list[float], list[float]]:
    """Standard deviation of samples over the bound, by both sways and by that of X1 alone."""
    rng = np.random.default_rng(0)
    own, cross = [], []
    for latitude in np.arange(20, 80, 5) * DEG:
        xi, eta = _SMALL * rng.standard_normal((2, _SAMPLES))
        bound = level_bound(latitude, float(np.var(xi, ddof=1)))
        for found, beta in ((own, xi), (cross, 0 * xi)):
            f = signals(np.zeros(1), beta, eta, latitude, np.pi / 2)
            off = azimuth_as_published(f[:, 0], f[:, 1], 0.0, 0.0, latitude)
            found.append(float(np.std(off, ddof=1) / bound))
    return own, cross


# --- (16) and known distributions ----------------------------------------------------------------


def _sample_rows() -> list[Row]:
    """[S1] (16): tilts and variances from accelerometers' samples."""
    rng = np.random.default_rng(1)
    drawn = np.stack(TILTED)[:, None] + SWAY * rng.standard_normal((2, _SAMPLES))
    turns = np.stack([np.zeros(_SAMPLES), -drawn[0], drawn[1]], axis=1)
    up = Rotation.from_euler("YXZ", turns).apply([0.0, STANDARD_GRAVITY, 0.0], inverse=True)
    found = sway_of(up)
    z_mean = np.abs([found.beta - TILTED[0], found.gamma - TILTED[1]]) / (SWAY / _SAMPLES**0.5)
    parts = np.array([found.variance_beta, found.variance_gamma]) / SWAY**2
    z_var = np.abs(parts - 1) * np.sqrt(_SAMPLES / 2)
    by_samples, known = rms_error(found, LATITUDE), rms_error(_sway(*TILTED, SWAY), LATITUDE)
    return [
        _row(
            "formula (16), means",
            f"bet0 and gam0 from {_SAMPLES} samples of tilts 8 and -5 deg, sway 0.5 deg rms",
            "means",
            f"{found.beta / DEG:.3f} and {found.gamma / DEG:.3f} deg",
            bool(z_mean.max() < 4),
            f"off by {z_mean.max():.1f} sigma of a mean at most",
        ),
        _row(
            "formula (16), variances",
            "D xi and D eta from the same samples",
            "unbiased",
            f"{parts[0]:.4f} and {parts[1]:.4f} of the true ones",
            bool(z_var.max() < 4),
            f"off by {z_var.max():.1f} sigma of a variance at most; `two-gyro` gives all four with "
            "each estimate",
        ),
        _row(
            "formula (16), then (13)",
            "rms azimuth error by these estimates",
            f"{known / DEG:.4f} deg with the true ones",
            f"{by_samples / DEG:.4f} deg",
            abs(by_samples / known - 1) < 4 / np.sqrt(2 * _SAMPLES) * 2,
            "samples of accelerometers that feel gravity alone",
        ),
    ]


def _sway(beta: float, gamma: float, rms: float) -> Sway:
    return known_sway(beta, gamma, normal(rms), normal(rms))


def _distribution_rows() -> list[Row]:
    made = []
    sizes = {"normal": SWAY, "uniform": SWAY * 3**0.5, "sine": SWAY * 2**0.5}
    for name, make in DISTRIBUTIONS.items():
        xi = make(sizes[name])
        exact = exact_rms(0.0, 0.0, xi, xi, LATITUDE)
        closed = rms_error(known_sway(0.0, 0.0, xi, xi), LATITUDE)
        made.append(
            _row(
                f"known distribution, {name}",
                f"rms azimuth error near level, {SWAY / DEG:g} deg rms, {name}",
                f"{closed / DEG:.4f} deg in closed form",
                f"{exact / DEG:.4f} deg by quadrature of exact rotations",
                abs(exact / closed - 1) < 1e-3,
                "the variance alone counts, to first order",
            )
        )
    return made


# --- conclusions ---------------------------------------------------------------------------------


def _conclusion_rows() -> list[Row]:
    law = level_bound(LATITUDE, SWAY**2)
    at = {lat: _level(_SMALL, lat * DEG) / np.tan(lat * DEG) for lat in (20, 70)}
    double = _level(2 * _SMALL, LATITUDE) / _level(_SMALL, LATITUDE)
    own, exceeds = real_gyros(SWAY, DURATION, LATITUDE), _exceeds()
    lost, kept = _dither()
    return [
        _row(
            "conclusion, tangent of latitude",
            "rms azimuth error over tan(lat), latitude 70 against 20 deg",
            "1",
            f"{at[70] / at[20]:.6f}",
            abs(at[70] / at[20] - 1) < 1e-4,
            "near level, by quadrature of exact rotations; on a tilted base the law is (13)",
        ),
        _row(
            "conclusion, root of the variance",
            "rms azimuth error where the variance is four times as large",
            "2",
            f"{double:.6f}",
            abs(double - 2) < 1e-4,
            "first order, by quadrature of exact rotations",
        ),
        _row(
            "conclusion, independent of the other axis",
            "error by sway of X1 alone: Earth rate, and real gyros",
            "practically none",
            "none of the Earth rate's projection; real gyros: all of the sway's own rate",
            False,
            "Z1's gyro, which tells east, feels the turning about Z1 that raises X1: its rate is "
            f"{exceeds:,.0f} times what the tilts turn of Earth rate",
            nearest="the sway's own rate taken out of the gyros' readings",
        ),
        _row(
            "conclusion, any gyros",
            f"mean of {DURATION:.0f} s, sway of {SWAY / DEG:g} deg at {RATE_HZ:g} Hz, latitude "
            "48.5 deg, by real gyros",
            f"{law / DEG:.2f} deg a sample",
            f"{own / DEG:.0f} deg",
            False,
            f"the sway's own rate is {exceeds:,.0f} times what the tilts turn of Earth rate, and "
            "its mean is what the base turned from start to end",
            nearest=f"a record of {_record_for(law) / 3600:.1f} h, over which that turn is as "
            "little",
        ),
        _row(
            "conclusion, any law of oscillation",
            "rms azimuth error, normal, uniform and sine sway of one variance",
            "equal",
            ", ".join(f"{v:.5f}" for v in _alike()) + " of the closed form",
            bool(np.ptp(_alike()) < 1e-3),
            "to first order; fourth moments tell them apart in the next",
        ),
        _row(
            "conclusion, vibration dither",
            "10 deg/h read in steps of 0.01 deg/s, at rest and with 0.5 deg rms at 0.2 Hz about "
            "the axis",
            "oscillation helps as a dither does",
            f"at rest {lost / DEG_PER_HOUR:.1f}, rocking {kept / DEG_PER_HOUR:.1f} deg/h",
            abs(kept / (10 * DEG_PER_HOUR) - 1) < 0.2 < abs(lost / (10 * DEG_PER_HOUR) - 1),
            "a turn of many steps averages their rounding over whole periods; the sway's own rate "
            "must cancel for that",
        ),
    ]


def _level(rms: float, latitude: float) -> float:
    return exact_rms(0.0, 0.0, normal(rms), normal(rms), latitude)


def real_gyros(sway: float, seconds: float, latitude: float) -> float:
    """Heading error [rad] of the mean of a record: what the base turned from start to end."""
    return float(np.sqrt(2) * sway / seconds / (EARTH_RATE * np.cos(latitude)))


def _exceeds() -> float:
    return 2 * np.pi * RATE_HZ / (EARTH_RATE * np.sin(LATITUDE))


def _record_for(error: float) -> float:
    """Seconds of a record in which real gyros are off by no more."""
    found = solved(lambda T: real_gyros(SWAY, T, LATITUDE), error, 1.0, 1e9)
    assert found is not None
    return found


def _alike() -> Array:
    sizes = {"normal": SWAY, "uniform": SWAY * 3**0.5, "sine": SWAY * 2**0.5}
    law = level_bound(LATITUDE, SWAY**2)
    made = [DISTRIBUTIONS[name](size) for name, size in sizes.items()]
    return np.array([exact_rms(0.0, 0.0, xi, xi, LATITUDE) / law for xi in made])


def _dither() -> tuple[float, float]:
    """Mean [rad/s] of rounded readings of 10 deg/h, at rest and while it rocks, whole periods."""
    true, step = 10 * DEG_PER_HOUR, 0.01 * DEG
    t = np.arange(30_000) / 100 + 0.0037  # 300 s: 60 periods; no sample on a zero
    amplitude = np.sqrt(2) * SWAY * 2 * np.pi * RATE_HZ
    rate = true + amplitude * np.cos(2 * np.pi * RATE_HZ * t)
    return tuple(float(np.mean(step * np.rint(w / step))) for w in (true + 0 * t, rate))  # pyright: ignore[reportReturnType]


# --- what the paper leaves open ------------------------------------------------------------------


def _open_rows() -> list[Row]:
    """Admissible rocking for a required error: by the law, and by real gyros."""
    by_law = REQUIRED / np.tan(LATITUDE)
    by_gyros = REQUIRED / real_gyros(1.0, DURATION, LATITUDE)
    return [
        Row(
            paper="S1",
            place="left open, admissible amplitude and frequency",
            quantity=f"rocking for {REQUIRED / DEG:g} deg of azimuth, {DURATION:.0f} s at latitude "
            "48.5 deg",
            printed="later work",
            ours=f"the law: {by_law / DEG:.3f} deg rms at any frequency; two real gyros: "
            f"{by_gyros / DEG:.4f} deg rms above {1 / DURATION:.3f} Hz",
            verdict=Verdict.CONTEXT,
            reason="what rocks more slowly than once in the record turns less from start to end; "
            "`stand rehearse` on a rocking base answers for every method, by frequency",
        )
    ]


def admissible(frequencies: Array, seconds: float) -> Array:
    """Rocking [rad rms] that leaves `REQUIRED` of azimuth to two real gyros, by frequency [Hz].

    What the base turns from start to end, `stand.rehearsal.admissible.turned`, is the error.
    """
    return np.asarray(
        REQUIRED * EARTH_RATE * np.cos(LATITUDE) * seconds / turned(frequencies, seconds)
    )
