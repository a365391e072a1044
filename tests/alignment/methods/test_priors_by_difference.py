"""What each stated prior adds to a covariance is what such an error does to the estimate.

Of every method and every constant error of unit and table: it is put into readings, as its
definition has it, and the estimates are differenced. What a covariance grows by per variance of the
prior is then ``J J^T``, at the method's own weights; where these are the best ones they move by
nothing to first order. What a method leaves out or folds is listed, so that nothing drops out
unseen.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
from rocking import LEVEL, Angle, G, Motion, W, earth_n, turn
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Priors, Site, Turn

DEG = np.pi / 180
LATITUDE = 48.5
HERE = Site(LATITUDE * DEG, local_gravity=G)
RATE = 10.0
UP = np.array([0.0, 1.0, 0.0])  # of b, where it is level
D, E, N = np.eye(3)[::-1]

# errors that turn an estimate by some 1e-6 rad: far from rounding, and the second order is as small
SIZES = {
    "gyro_bias": 1e-10, "accel_bias": 1e-5, "gyro_scale": 1e-6, "accel_scale": 1e-6,
    "gyro_asymmetry": 1e-6, "accel_asymmetry": 1e-6, "gyro_misalignment": 1e-6,
    "accel_misalignment": 1e-6, "gyro_non_orthogonality": 1e-6, "accel_non_orthogonality": 1e-6,
    "gyro_g_sensitivity": 1e-11, "gyro_g2_sensitivity": 1e-12, "accel_quadratic": 1e-7,
    "accel_cubic": 1e-8, "gyro_cubic": 300.0, "gyro_ramp": 1e-12, "accel_ramp": 1e-7, "turn": 1e-6,
    "seat": 1e-6,
}  # fmt: skip
TABLE = ("turn", "seat", "nominal", "azimuth")


def attitude(yaw, pitch, roll):
    parts = [turn(a, np.array([x * DEG]))[0] for a, x in ((D, yaw), (E, pitch), (N, roll))]
    return parts[0] @ parts[1] @ parts[2] @ LEVEL


def rest(C, start=0.0, seconds=40.0):
    n = round(seconds * RATE)
    t = start + np.arange(1, n + 1) / RATE
    return t, np.tile(C.T @ earth_n(LATITUDE), (n, 1)), np.tile(C.T @ [0, 0, -G], (n, 1)), C, None


def spun(rate, start):
    """Whole turns about the vertical, of X1 that begins at north: seen from above they are left."""
    t, w, f, _ = Motion(yaw=Angle(rate=rate * DEG), latitude_deg=LATITUDE).readings(36, RATE, start)
    return t, w, f, LEVEL, Turn(UP, -rate * DEG * (t - start))


def noisy(*stretches):
    """Noise beside which errors are small, for methods that take it from the readings."""
    rng = np.random.default_rng(5)
    return [
        (t, w + 1e-7 * rng.standard_normal(w.shape), f + 1e-2 * rng.standard_normal(f.shape), *rest)
        for t, w, f, *rest in stretches
    ]


ONE = [rest(attitude(25.0, 3.0, -4.0), 30.0)]  # half a minute after biases were switched on
ROUND = noisy(
    rest(attitude(25.0, 3.0, -4.0)), rest(attitude(115.0, -2.0, 5.0), 50.0),
    rest(attitude(205.0, 3.0, 80.0), 100.0), rest(attitude(-60.0, 50.0, 10.0), 150.0),
)  # fmt: skip
SPUN = noisy(spun(20.0, 0.0), spun(-20.0, 50.0))
STATED = Priors(gyro_walk=1e-8, accel_walk=1e-4, gyro_bias=1e-8, accel_bias=1e-3)
LOOSE = Priors(gyro_bias=1e-7, accel_bias=1e-2)
CASES = {
    "triad": (ONE, Priors()),
    "single-gyro": (ONE, Priors()),
    "two-gyro": (ONE, Priors()),
    "six-position": (ONE, Priors()),
    "rk4": (ONE, Priors()),
    "two-sample": (ONE, Priors()),
    "inertial": (ONE, STATED),
    "fine": (ONE, STATED),
    "two-position": (ROUND[:2], LOOSE),
    "multi-position": (ROUND, LOOSE),
    "carousel": (SPUN, LOOSE),
}
OTHERWISE = {"calibration", "vectors"}  # neither by attitudes of rests and turns
OFFSET = ("six-position", "rk4", "two-sample")

# of which a method says nothing: in a turn a bias' drift is by far less than what turns with it
# about an axis of b a cubic term is a scale error, which the phase of a harmonic does not feel
LEFT_OUT = {"carousel": {"gyro_ramp", "accel_ramp", "gyro_cubic"}}
# Of one attitude these are a bias or a scale error: of what size, where the method takes them so.
FOLDED = {
    "gyro_misalignment": ("gyro_bias", W),
    "gyro_non_orthogonality": ("gyro_bias", W / 2),
    "accel_non_orthogonality": ("accel_bias", G / 2),
    "gyro_g2_sensitivity": ("gyro_bias", G**2),
    "accel_quadratic": ("accel_scale", G),
    "accel_cubic": ("accel_scale", G**2),
    "gyro_cubic": ("gyro_bias", 0.0),  # Earth rate alone makes nothing of what sheets state
}
# The filter knows biases that walk: what a ramp comes to by the end, which may be a little more.
WALKED = ("gyro_ramp", "accel_ramp")


def put_into(name, t, w, f):
    """Changes (dw, df) of readings by each of the errors that a prior speaks of."""
    sensor, _, term = name.partition("_")
    x, eye = (w if sensor == "gyro" else f), np.eye(3)
    pairs = ((1, 2), (2, 0), (0, 1))
    made = {
        "bias": lambda: [np.ones_like(x) * e for e in eye],
        "scale": lambda: [x * e for e in eye],
        "asymmetry": lambda: [np.abs(x) * e for e in eye],
        "quadratic": lambda: [x**2 * e for e in eye],
        "cubic": lambda: [x**3 * e for e in eye],
        "ramp": lambda: [np.outer(t, e) for e in eye],
        "misalignment": lambda: [np.cross(e, x) for e in eye],
        # half of the angle to both axes of a pair
        "non_orthogonality": lambda: [
            (np.outer(x[:, k], eye[j]) + np.outer(x[:, j], eye[k])) / 2 for j, k in pairs
        ],
        "g_sensitivity": lambda: [np.outer(f[:, k], e) for e in eye for k in range(3)],
        "g2_sensitivity": lambda: [np.outer(f[:, k] ** 2, e) for e in eye for k in range(3)],
    }[term]()
    none = np.zeros_like(x)
    return [(d, none) if sensor == "gyro" else (none, d) for d in made]


def changed(stretches, name):
    """The same stretches with one error each, and by how much (3,) in b the first truly turns."""
    size, still = SIZES[name], np.zeros(3)
    if name not in TABLE:
        told = [put_into(name, t, w, f) for t, w, f, *_ in stretches]
        for each in zip(*told, strict=True):
            yield (
                [
                    (t, w + size * dw, f + size * df, *more)
                    for (t, w, f, *more), (dw, df) in zip(stretches, each, strict=True)
                ],
                still,
            )
        return
    # at one place after the other, or at all of them: a turn of b, which nobody tells
    places = [(k,) for k in range(len(stretches))] if name == "turn" else [range(len(stretches))]
    for own in places:
        for axis in size * np.eye(3):
            R = Rotation.from_rotvec(axis).as_matrix()
            yield (
                [
                    (t, w @ R, f @ R, *more) if k in own else (t, w, f, *more)
                    for k, (t, w, f, *more) in enumerate(stretches)
                ],
                axis if 0 in own else still,
            )


def estimated(method, stretches, priors):
    """The first stretch's attitude, with the offset of its own beginning where there is one."""
    dwells = [
        Dwell(f"d{k}", t[0] - 1 / RATE, t[-1], ImuReadings(t, w, f), Rotation.from_matrix(C), x)
        for k, (t, w, f, C, x) in enumerate(stretches)
    ]
    options = Options(priors=priors, verdicts=False)
    found = ESTIMATORS[method].estimate(dwells, HERE, options)
    return next(e for e in found if e.C_nb is not None and e.window != "same")


def grown(method, base, **sizes):
    """By how much a covariance grows with priors beside those there are."""
    stretches, priors = CASES[method]
    both = {name: float(np.hypot(getattr(priors, name), s)) for name, s in sizes.items()}
    return estimated(method, stretches, replace(priors, **both)).covariance - base.covariance


def agree(found, expected, what):
    """To a percent of each axis' sigma; an axis that others outdo by far to as much of theirs.

    Weights that are the best move by that where the error is a tenth of what noise leaves.
    """
    roots = np.sqrt(expected.diagonal())
    roots = np.maximum(roots, max(5e-2 * roots.max(), 3e-9))
    assert found / np.outer(roots, roots) == pytest.approx(
        expected / np.outer(roots, roots), abs=2e-2
    ), what


@pytest.mark.parametrize("method", CASES)
def test_what_a_prior_adds_is_what_its_error_does(method):
    stretches, priors = CASES[method]
    base = estimated(method, stretches, priors)
    for name, size in SIZES.items():
        if name in TABLE and method not in ("two-position", "multi-position"):
            continue
        found = grown(method, base, **{name: size})
        if name in LEFT_OUT.get(method, ()):
            assert np.abs(found).max() < 1e-20, name  # rad^2, of rounding
            continue
        if method == "fine" and name in FOLDED:
            other, times = FOLDED[name]
            agree(found, grown(method, base, **{other: size * times}), name)
            continue
        errors = []
        for off, truly in changed(stretches, name):
            moved = estimated(method, off, priors).C_nb * base.C_nb.inv()
            errors.append(moved.as_rotvec() - base.C_nb.apply(truly))
        J = np.array(errors)
        if method == "fine" and name in WALKED:
            ratio = np.sqrt(found[2, 2] / (J.T @ J)[2, 2])
            assert 1 < ratio < 1.3, name
            continue
        agree(found, J.T @ J, name)


@pytest.mark.parametrize("method", CASES)
def test_a_table_is_off_by_what_is_said_of_it(method):
    """One to one where attitudes are told; about the vertical a seat does nothing to what turns
    about it, and the base's azimuth is of heading alone. Without a table nothing of it counts."""
    base = estimated(method, *CASES[method])
    told = {"turn": (1, 1, 1), "seat": (1, 1, 1), "nominal": (1, 1, 0), "azimuth": (0, 0, 1)}
    by_hand = dict.fromkeys(OFFSET, told)
    by_hand["carousel"] = {"turn": (1, 1, 1), "seat": (1, 1, 0)}
    for name in TABLE:
        if name in SIZES and method in ("two-position", "multi-position"):
            continue
        expected = 1e-12 * np.diag(by_hand.get(method, {}).get(name, (0, 0, 0)))
        agree(grown(method, base, **{name: 1e-6}), expected, name)


DRIFTS = {
    "gyro_instability": 1e-10, "accel_instability": 1e-5, "gyro_random_walk": 1e-11,
    "accel_random_walk": 1e-6, "gyro_walk": 1e-8, "accel_walk": 1e-4, "lever_arm": 1.0,
}  # fmt: skip
WALKS = {"gyro_random_walk", "accel_random_walk"}
CHANGING = {
    "triad": WALKS,
    "single-gyro": WALKS,
    "two-gyro": WALKS,
    "six-position": {"gyro_instability", "accel_instability", *WALKS},
    "rk4": {"gyro_instability", "gyro_random_walk"},
    "two-sample": {"gyro_instability", "gyro_random_walk"},
    "two-position": set(DRIFTS) - {"gyro_walk", "accel_walk", "lever_arm"},
    "multi-position": set(DRIFTS) - {"gyro_walk", "accel_walk", "lever_arm"},
    "inertial": set(DRIFTS) - {"lever_arm"},
    "fine": set(DRIFTS),
}


@pytest.mark.parametrize("method", CASES)
def test_which_changes_a_method_counts(method):
    """What they come to has tests by hand of each method; here, that none drops out or comes in."""
    base = estimated(method, *CASES[method])
    counted = {n for n, s in DRIFTS.items() if np.abs(grown(method, base, **{n: s})).max() > 1e-24}
    assert counted == CHANGING.get(method, set())


def test_every_method_and_every_prior_has_its_place():
    assert set(CASES) | OTHERWISE == set(ESTIMATORS)
    assert {f.name for f in fields(Priors)} == {
        *SIZES, *DRIFTS, *TABLE, "gyro_axes", "accel_axes", "lag", "accel_later", "clock", "jitter",
        "places", "gyro_scale_ramp",
    }  # fmt: skip
