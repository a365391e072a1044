"""[S4]: analytic and double gyrocompassing; budgets, the half turn term by term, worst cases."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles
from alignment.angles import Sequence as Turns
from alignment.arrays import Array
from alignment.earth import EARTH_RATE, normal_gravity
from alignment.information.budget import double_worst, levelling_worst
from alignment.information.half_turn import (
    Posture,
    TurnedErrors,
    better_turn,
    heading_limit,
    horizontal_readings,
    levelling_limit,
    pitch_terms,
    roll_terms,
    roll_terms_as_printed,
    yaw_by_pitch,
    yaw_terms,
)
from alignment.information.turns import time_needed
from alignment.methods.positions import half_turn_means
from alignment.methods.single_gyro import single_gyro_attitude
from alignment.methods.triad import triad_attitude
from alignment.noise import FLICKER_FLOOR
from alignment.units import (
    ARC_MINUTE,
    ARC_SECOND,
    DEG,
    DEG_PER_HOUR,
    DEG_PER_RT_HOUR,
    STANDARD_GRAVITY,
)
from stand.evaluation.published.row import Row, Verdict, judged, solved
from stand.imu import load_imu

CLASS = ("adis16488", "stim300", "hg4930", "hg1700", "ring-laser")  # from coarse to fine
TARGET = 1.3 * ARC_MINUTE
TILT, SCALE, GRAVITY = 5 * DEG, 0.002, 9.81
LATITUDE = 50 * DEG
CASE = "roll = pitch = 5 deg, K = 0.2 %"
# where term by term shows: no axis of symmetry
POSTURE = Posture(roll=12 * DEG, pitch=8 * DEG, yaw=55 * DEG, latitude=LATITUDE)
FIRST_ORDER = 0.02  # of itself: how far a first-order term may be from the exact error here

_row = partial(judged, "S4")


def rows(progress: Callable[[float], None]) -> list[Row]:
    """Every row of [S4]."""
    return [
        *_analytic_rows(),
        *_levelling_rows(),
        *_turn_rows(),
        *_pays_rows(),
        *_double_rows(),
        *_left_rows(),
        *_context_rows(),
    ]


def _minutes(*angles: float, digits: int = 1) -> str:
    return " or ".join(f"{angle / ARC_MINUTE:.{digits}f}'" for angle in angles)


# --- an instrument that is turned, exactly --------------------------------------------------------


def attitude(p: Posture) -> Rotation:
    """``C_nb`` of a posture."""
    return C_nb_from_angles(Turns.YAW_PITCH_ROLL, p.roll, p.yaw, p.pitch)


def read(p: Posture, errors: TurnedErrors, placed: float, turned: float, bias: Array) -> Array:
    """Rates and forces (6,) in a position turned about Y1 and placed wrong, with errors."""
    C_bn = (attitude(p) * Rotation.from_rotvec([0.0, turned + placed, 0.0])).inv()
    w = C_bn.apply(EARTH_RATE * np.array([np.cos(p.latitude), 0.0, -np.sin(p.latitude)]))
    f = C_bn.apply([0.0, 0.0, -GRAVITY]) * (1 + np.array(errors.scale))
    w[0] *= 1 + errors.gyro_scale
    f[1] += errors.accel_y
    return np.concatenate([w, f]) + bias


def analytic(p: Posture, m: Array, pitch: float | None = None) -> tuple[float, float, float]:
    """Roll, pitch by asin, yaw by X1's gyro [rad] from means (6,); `pitch` where it is known."""
    found = float(np.arcsin(m[3] / GRAVITY))
    th = found if pitch is None else pitch
    cosine = m[0] - EARTH_RATE * np.sin(p.latitude) * np.sin(th)
    yaw = np.arccos(cosine / (EARTH_RATE * np.cos(p.latitude) * np.cos(th)))
    return float(np.arctan2(-m[5], m[4])), found, float(yaw)


def turned_errors(p: Posture, errors: TurnedErrors, known_pitch: bool = False) -> Array:
    """Exact errors (3,) of roll, pitch, yaw after a half turn, by means of both positions."""
    first, second = (read(p, errors, errors.placement, a, np.zeros(6)) for a in (0.0, np.pi))
    m = half_turn_means(first, second)
    return np.array(analytic(p, m, p.pitch if known_pitch else None)) - [p.roll, p.pitch, p.yaw]


# --- (1)-(4), (8)-(10) ----------------------------------------------------------------------------


def _analytic_rows() -> list[Row]:
    m = read(POSTURE, TurnedErrors(), 0.0, 0.0, np.zeros(6))
    off = np.abs(np.array(analytic(POSTURE, m)) - [POSTURE.roll, POSTURE.pitch, POSTURE.yaw])
    up = m[3:] / np.linalg.norm(m[3:])
    latitude = abs(float(np.arcsin(m[:3] @ up / EARTH_RATE)) - LATITUDE)
    worst = float(max(off.max(), latitude))
    budgets = [
        ("formula (8), roll", "-(b_z cos ga + b_y sin ga)/(g cos th)", _by_bias(0)),
        ("formula (9), pitch", "b_x/(g cos th)", _by_bias(1)),
        ("formula (10), heading", "dw_x/(W cos lat cos th sin ps)", _by_rate()),
    ]
    return [
        _row(
            "formulas (1)-(4)",
            "roll, pitch, latitude and yaw without errors, roll 12, pitch 8, yaw 55 deg",
            "exact",
            f"within {worst / ARC_SECOND:.0e}''",
            worst < 1e-9,
            "level, then the horizontal part of X1's rate",
        ),
        *(
            _row(
                place,
                "bias term of the budget, 1e-3 m/s^2 and 0.01 deg/h",
                printed,
                f"{linear / ARC_SECOND:.3f}'' against {exact / ARC_SECOND:.3f}'' exactly",
                abs(exact / linear - 1) < FIRST_ORDER,
                "first order",
            )
            for place, printed, (linear, exact) in budgets
        ),
    ]


def _by_bias(k: int) -> tuple[float, float]:
    """Roll or pitch error by accelerometer biases: to first order, and exactly."""
    bias, p = np.array([0.0, 0, 0, 1e-3, 2e-3, -1e-3]), POSTURE
    exact = analytic(p, read(p, TurnedErrors(), 0.0, 0.0, bias))[k] - (p.roll, p.pitch)[k]
    roll = -(bias[5] * np.cos(p.roll) + bias[4] * np.sin(p.roll)) / (GRAVITY * np.cos(p.pitch))
    return (float(roll), bias[3] / (GRAVITY * np.cos(p.pitch)))[k], exact


def _by_rate() -> tuple[float, float]:
    p, dw = POSTURE, 0.01 * DEG_PER_HOUR
    exact = analytic(p, read(p, TurnedErrors(), 0.0, 0.0, np.eye(6)[0] * dw))[2] - p.yaw
    level = EARTH_RATE * np.cos(p.latitude) * np.cos(p.pitch) * np.sin(p.yaw)
    return -dw / level, exact  # heading is minus yaw


# --- the worst cases of levelling -----------------------------------------------------------------


def _levelling_rows() -> list[Row]:
    apart = levelling_worst(0.1, equal_scale=False, noise_sigmas=0)
    equal = levelling_worst(0.1, equal_scale=True, noise_sigmas=0)
    fine = levelling_worst(0.001, equal_scale=True, noise_sigmas=3)
    K = solved(lambda k: levelling_worst(0.1, False, 0, k)[2], 41 * ARC_MINUTE, 0.0, 0.1)
    K_asin = solved(lambda k: levelling_worst(0.1, True, 0, k)[1], 41 * ARC_MINUTE, 0.0, 0.1)
    bias = solved(lambda b: levelling_worst(b, True, 0)[2], 41 * ARC_MINUTE, 0.0, 1.0)
    tilt = solved(lambda t: levelling_worst(0.1, True, 0, SCALE, t)[2], 41 * ARC_MINUTE, 0.0, 0.3)
    sigmas = solved(lambda n: levelling_worst(0.001, True, n)[0], 0.46 * ARC_MINUTE, 0.0, 10.0)
    return [
        _row(
            "example, roll at 0.1 m/s^2",
            f"worst case, {CASE}",
            "39'",
            _minutes(float(apart[0]), float(equal[0])),
            True,
            "it comes out with scale errors of opposite sign (the second with equal ones)",
        ),
        _row(
            "example, pitch at 0.1 m/s^2",
            f"worst case, {CASE}",
            "41'",
            _minutes(float(equal[1]), float(equal[2])),
            False,
            "asin gives the first, atan2 with equal K the second (with the worst signs of K "
            f"{_minutes(float(apart[2]))})",
            nearest=f"41' needs K of {_percent(K)} with worst signs by atan2, "
            f"{_percent(K_asin)} by asin; or with equal K tilts of {_degrees(tilt)}, or "
            f"{bias:.3f} m/s^2",
        ),
        _row(
            "example, roll at 0.001 m/s^2",
            f"worst case, {CASE}, noise of a 60 s mean",
            "0.46'",
            _minutes(float(fine[0]), digits=3),
            False,
            "bias, equal K and three sigma of noise per axis give more; bias alone gives "
            + _minutes(float(levelling_worst(0.001, True, 0)[0]), digits=3),
            nearest="no assumption found"
            if sigmas is None
            else f"{sigmas:.1f} sigma of noise per axis instead of three",
        ),
        _row(
            "example, pitch at 0.001 m/s^2",
            f"worst case, {CASE}, noise of a 60 s mean",
            "0.5'",
            _minutes(float(fine[2]), digits=3),
            True,
            "it comes out, rounded, by atan2 with equal K and three sigma of noise per axis",
        ),
    ]


def _percent(part: float | None) -> str:
    return "no value" if part is None else f"{part * 100:.2g} %"


def _degrees(angle: float | None) -> str:
    return "no value" if angle is None else f"{angle / DEG:.2g} deg"


# --- (11)-(13), (15): term by term ----------------------------------------------------------------

_SIZES = {
    "bias": TurnedErrors(accel_y=0.02),
    "scale": TurnedErrors(scale=(0.002, 0.001, -0.002), gyro_scale=0.002),
    "placement": TurnedErrors(placement=10 * ARC_MINUTE),
}


def _turn_rows() -> list[Row]:
    p = POSTURE
    exact = {name: turned_errors(p, errors) for name, errors in _SIZES.items()}
    made = [_readings_row()]
    for k, (name, errors) in enumerate(_SIZES.items()):
        printed, own = (f(p, GRAVITY, errors)[k] for f in (roll_terms_as_printed, roll_terms))
        off = exact[name][0]
        in_tangent = np.tan(p.roll + off) - np.tan(p.roll)
        made.append(
            _row(
                f"formula (13), roll, {name}",
                f"roll after a half turn by {_told(name)}",
                _minutes(printed, digits=2),
                f"{_minutes(off, digits=2)} exactly; first order {_minutes(own, digits=2)}",
                bool(abs(printed / off - 1) < FIRST_ORDER),
                "the printed term is 1/cos^2(roll) too large",
                nearest=f"as the error of tan(roll) it holds: {_minutes(in_tangent, digits=2)} "
                "exactly",
            )
        )
    for k, name in enumerate(("scale", "placement")):
        printed, off = pitch_terms(p, _SIZES[name])[k], exact[name][1]
        made.append(_term_row("formula (13), pitch", name, printed, off, "by asin of X1 alone"))
    known = {n: turned_errors(p, e, known_pitch=True)[2] for n, e in _SIZES.items()}
    for k, name in enumerate(("scale", "placement")):
        printed = yaw_terms(p, _SIZES[name])[k]
        row = _term_row("formula (15), yaw", name, printed, known[name], "with the pitch known")
        made.append(row)
    placed = _SIZES["placement"]
    printed, off = yaw_terms(p, placed)[1], exact["placement"][2]
    by_pitch = yaw_by_pitch(p, pitch_terms(p, placed)[1])
    made.append(
        _row(
            "formula (15), yaw, levelled by the same turn",
            f"yaw after a half turn by {_told('placement')}, pitch from the accelerometers",
            _minutes(printed, digits=2),
            f"{_minutes(off, digits=2)} exactly",
            bool(abs(printed / off - 1) < FIRST_ORDER),
            "the placement tilts the levelling by sin(roll) D too, and (15) leaves that out",
            nearest=f"with (tan lat - cos ps tan th) sin ga D/sin ps it is "
            f"{_minutes(printed + by_pitch, digits=2)}",
        )
    )
    return made


def _told(name: str) -> str:
    return {
        "bias": "0.02 m/s^2 of Y1",
        "scale": "scale errors of 0.1 to 0.2 %",
        "placement": "10' of placement",
    }[name]


def _term_row(place: str, name: str, printed: float, exact: float, how: str) -> Row:
    return _row(
        f"{place}, {name}",
        f"{place.split(', ')[1]} after a half turn by {_told(name)}",
        _minutes(printed, digits=2),
        f"{_minutes(exact, digits=2)} exactly",
        bool(abs(printed / exact - 1) < FIRST_ORDER),
        f"first order, {how}",
    )


def _readings_row() -> Row:
    first, second = 10 * ARC_MINUTE, -5 * ARC_MINUTE
    found = np.transpose(horizontal_readings(POSTURE, GRAVITY, first, second))
    exact = [
        read(POSTURE, TurnedErrors(), placed, turned, np.zeros(6))[[3, 5]]
        for placed, turned in ((first, 0.0), (second, np.pi))
    ]
    off = np.abs(found - exact).max()
    return _row(
        "formulas (11), (12)",
        "forces on X1 and Z1 in both positions, placements of 10' and -5'",
        "first order in the placement",
        f"within {off:.1e} m/s^2",
        bool(off < GRAVITY * first**2 / 2),
        "the cosine of the placement is taken as 1",
    )


# --- (14), (16): when the turn pays ---------------------------------------------------------------


def _pays_rows() -> list[Row]:
    p = Posture(roll=TILT, pitch=TILT, yaw=90 * DEG, latitude=LATITUDE)
    bias = 10 * DEG_PER_HOUR
    limit = heading_limit(p, bias)
    crossing = heading_crossing(p, 0.05 * DEG_PER_HOUR)
    predicted = heading_limit(p, 0.05 * DEG_PER_HOUR)
    both = [better_turn(p, bias, part * limit) for part in (0.9, 1.1)]
    half, quarter = _turns_compared(p, 10 * ARC_MINUTE)
    small, large = levelling_limit(5e-5, GRAVITY), levelling_limit(5e-3, GRAVITY)
    return [
        _row(
            "formula (14), 5e-5 m/s^2",
            "placement below which a turn pays for levelling",
            "1''",
            f"{small / ARC_SECOND:.2f}''",
            round(small / ARC_SECOND) == 1,
            f"it is b/g; but placement acts through the tilt: at 5 deg a turn pays up to "
            f"{1 / np.tan(TILT):.0f} times that",
        ),
        _row(
            "formula (14), 5e-3 m/s^2",
            "placement below which a turn pays for levelling",
            "1.7'",
            _minutes(large, digits=2),
            abs(large / ARC_MINUTE - 1.7) < 0.1,
            "cut, not rounded; placement acts through the tilt, as above",
        ),
        _row(
            "formula (16)",
            "placement at which a turn stops paying for heading: gyro of 0.05 deg/h, X1 west, "
            "tilts 5 deg, latitude 50 deg",
            _minutes(predicted, digits=2),
            f"{_minutes(crossing, digits=2)} by exact evaluation of one position and of two",
            abs(crossing / predicted - 1) < 0.15,
            "the rate that the turn mixes in against the bias; what it does to the levelling is "
            "left out",
        ),
        _row(
            "rule, 90 or 180 deg",
            "which turn, at 0.9 and 1.1 of the placement of (16)",
            "180 while the turn adds less than the gyro's bias, else 90",
            f"{both[0]} and {both[1]} deg",
            both == [180, 90],
            f"as the rule says it. Of 10' of placement half a turn leaves {_minutes(half)}, a "
            f"quarter {_minutes(quarter)}; but a quarter takes the scale error 1:1 and doubles the "
            "noise",
        ),
    ]


def one_position_error(p: Posture, bias: float) -> float:
    """Heading error [rad] without a turn: X1's gyro of this bias, latitude and pitch known."""
    m = read(p, TurnedErrors(), 0.0, 0.0, np.eye(6)[0] * bias)
    cosine = (m[0] - EARTH_RATE * np.sin(p.latitude) * np.sin(p.pitch)) / (
        EARTH_RATE * np.cos(p.latitude) * np.cos(p.pitch)
    )
    return float("nan") if abs(cosine) > 1 else abs(float(np.arccos(cosine)) - p.yaw)


def heading_crossing(p: Posture, bias: float) -> float:
    """Placement [rad] at which half a turn is off by as much as none, exactly."""
    alone = one_position_error(p, bias)

    def after(placement: float) -> float:
        errors = TurnedErrors(placement=placement)
        return abs(float(turned_errors(p, errors, known_pitch=True)[2]))

    found = solved(after, alone, 0.0, 5 * DEG)
    return float("nan") if found is None else found


def _turns_compared(p: Posture, placement: float) -> tuple[float, float]:
    """Heading errors [rad] by a second placement that is off: half a turn, and a quarter.

    One gyro, latitude known, pitch and roll known. A quarter turn has two unknowns, azimuth and
    bias, of two readings.
    """
    C = attitude(p)
    w_n = EARTH_RATE * np.array([np.cos(p.latitude), 0.0, -np.sin(p.latitude)])
    errors = []
    for turn in (np.pi, np.pi / 2):
        first = C.inv().apply(w_n)[0]
        second = (C * Rotation.from_rotvec([0.0, turn + placement, 0.0])).inv().apply(w_n)[0]

        def left(yaw: float, turn: float = turn, read_: float = first - second) -> float:
            told = C_nb_from_angles(Turns.YAW_PITCH_ROLL, p.roll, yaw, p.pitch)
            after = told * Rotation.from_rotvec([0.0, turn, 0.0])
            return float(told.inv().apply(w_n)[0] - after.inv().apply(w_n)[0]) - read_

        found = solved(left, 0.0, p.yaw - 20 * DEG, p.yaw + 20 * DEG)
        errors.append(float("nan") if found is None else abs(found - p.yaw))
    return errors[0], errors[1]


def worst_heading(
    drifts: Sequence[float] | Array, placements: Sequence[float] | Array
) -> tuple[Array, Array]:
    """For the chart: worst-case heading [rad] without and with half a turn, tilts 5 deg, X1 west.

    `drifts` (d,) [rad/s] of X1's gyro, `placements` (k,) [rad]: results (d,) and (k,). NaN where
    no heading gives such a rate.
    """
    p = Posture(roll=TILT, pitch=TILT, yaw=90 * DEG, latitude=LATITUDE)
    alone = np.array([one_position_error(p, b) for b in drifts])
    turned = [
        max(
            abs(float(turned_errors(p, TurnedErrors(gyro_scale=k, placement=d))[2]))
            for d in (-placed, placed)
            for k in (-SCALE, SCALE)
        )
        for placed in placements
    ]
    return alone, np.array(turned)


# --- examples of heading --------------------------------------------------------------------------


def _double_rows() -> list[Row]:
    latitudes = 45 * DEG, 60 * DEG
    plain = [double_worst(latitude) for latitude in latitudes]
    scaled = [double_worst(latitude, SCALE) for latitude in latitudes]
    placed = solved(lambda d: double_worst(latitudes[0], placement=d), TARGET, 0.0, ARC_MINUTE)
    lower = solved(lambda lat: double_worst(lat), TARGET, 1 * DEG, 80 * DEG)
    days = [
        (time_needed(TARGET, latitudes[0], walk * DEG_PER_RT_HOUR) or np.inf) / 86400
        for walk in (0.15, 0.6)
    ]
    needed = np.tan(30 * ARC_MINUTE) * EARTH_RATE * np.cos(latitudes[0]) / DEG_PER_HOUR
    return [
        _row(
            "example, double gyrocompassing",
            "heading after a half turn, gyros of 10 deg/h, placement 1', tilts 5 deg, X1 west",
            "1.3'",
            f"{_minutes(plain[0])} (latitude 45 deg) to {_minutes(plain[1])} (60 deg)",
            False,
            "1' of placement and K tan(lat) tan(pitch) of scale error add up to more; with 0.2 % "
            f"of the accelerometers too it is {_minutes(scaled[0])} to {_minutes(scaled[1])}",
            nearest=f"{_minutes_or_none(placed)} of placement at latitude 45 deg, or latitude "
            f"{_degrees(lower)} with 1'",
        ),
        _row(
            "example, double gyrocompassing, noise",
            "the same with the white noise of such gyros, 0.15 to 0.6 deg/rt-h",
            "1.3'",
            f"{days[0]:.0f} to {days[1]:.0f} days at latitude 45 deg",
            False,
            "noise is not stated; white noise alone needs that long for 1.3', and bias instability "
            "ends it before",
            nearest=f"gyros of {_walk_for(3600.0):.1g} deg/rt-h reach it in an hour",
        ),
        _row(
            "example, simple analytic",
            "heading without a turn, gyros of 10 deg/h",
            "tens of arc minutes",
            f"no heading: 10 deg/h is {10 / (15.041067 * np.cos(latitudes[0])):.2f} of the "
            "horizontal Earth rate",
            False,
            "the bias is most of what is to be measured",
            nearest=f"30' needs gyros of {needed:.2f} deg/h",
        ),
    ]


def _minutes_or_none(angle: float | None) -> str:
    return "no value" if angle is None else _minutes(angle, digits=2)


def _walk_for(seconds: float) -> float:
    """Angle random walk [deg/rt-h] that leaves `TARGET` after so long at latitude 45 deg."""
    return TARGET * EARTH_RATE * np.cos(45 * DEG) * np.sqrt(seconds) / DEG_PER_RT_HOUR


# --- what does not cancel, and how long units of the catalogue need -------------------------------


def _left_rows() -> list[Row]:
    latitude = 48.5 * DEG
    needed = [f"{name} {_time(name, latitude)}" for name in CLASS]
    vertical = 10 * DEG_PER_HOUR * np.array([0.0, 1.0, 0.0])
    full, single = _half_turn_errors(vertical, np.zeros(3), LATITUDE)
    sensitive = DEG_PER_HOUR / STANDARD_GRAVITY * np.array([1.0, 0.0, 0.0])
    by_force, _ = _half_turn_errors(np.zeros(3), sensitive, latitude)
    allowed = TARGET / max(full) * 10
    return [
        _row(
            "example, double gyrocompassing, units",
            "heading after a half turn, by gyros of the catalogue at latitude 48.5 deg",
            "1.3'",
            "after " + ", ".join(needed),
            False,
            "gyros of 10 deg/h never come there: ADEV(T/2)/(sqrt2 W cos lat) ends above it. The "
            "times are by the terms that data sheets state",
            nearest="a ring laser",
        ),
        _row(
            "claim, constant biases cancel: Y1",
            "heading after a half turn: 10 deg/h of Y1, tilts of 5 deg, latitude 50 deg",
            "cancel",
            f"{full[36] / ARC_MINUTE:.0f}' (X1 south), {full[0] / ARC_MINUTE:.0f}' (north) with "
            f"three gyros, {max(single / ARC_SECOND, 1e-6):.0e}'' with one",
            False,
            "the turn leaves Y1's bias where it is, and the tilt turns it into heading",
            nearest=f"one gyro and a given latitude are immune; with three 1.3' needs Y1 of "
            f"{allowed:.2g} deg/h",
        ),
        _row(
            "claim, constant biases cancel: g-sensitivity",
            "heading after a half turn: 1 deg/h/g of X1's gyro, tilts of 5 deg, latitude 48.5 deg",
            "cancel",
            f"up to {max(by_force) / ARC_MINUTE:.0f}', as X1 points",
            False,
            "tilted, gravity changes sides with the instrument as Earth rate does",
            nearest=f"1.3' needs {TARGET / max(by_force):.2g} deg/h/g, or a level instrument",
        ),
    ]


def _time(name: str, latitude: float) -> str:
    gyro = load_imu(name).gyro
    seconds = time_needed(
        TARGET, latitude, gyro.noise, FLICKER_FLOOR * gyro.instability, gyro.random_walk
    )
    if seconds is None:
        return "never"
    days = seconds / 86400
    return f"{days:,.0f} days" if days >= 2 else f"{seconds / 3600:.2g} h"


def _half_turn_errors(
    bias: Array, g_sensitivity: Array, latitude: float
) -> tuple[list[float], float]:
    """Heading errors [rad] after a half turn about Y1 at roll and pitch of 5 deg.

    With three gyros, X1 north and then every 5 deg; and with X1's gyro and the latitude alone, X1
    to the west. `g_sensitivity` (3,) of each gyro to force along itself.
    """
    gravity = normal_gravity(latitude)
    w = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    turn = Rotation.from_rotvec([0.0, np.pi, 0.0])

    def means(yaw: float) -> tuple[Rotation, Array]:
        first = C_nb_from_angles(Turns.YAW_PITCH_ROLL, TILT, yaw, TILT)
        readings = []
        for C_nb in (first, first * turn):
            f = C_nb.apply([0.0, 0.0, -gravity], inverse=True)
            rate = C_nb.apply(w, inverse=True) + bias + g_sensitivity * f
            readings.append(np.concatenate([rate, f]))
        return first, half_turn_means(*readings)

    full = []
    for yaw in np.arange(0, 360, 5) * DEG:
        true, m = means(yaw)
        full.append(_apart(triad_attitude(m[:3], m[3:]), true))
    true, m = means(90 * DEG)
    C = single_gyro_attitude(m[:1], m[None, 3:], np.eye(3)[0], latitude, -1.0)
    return full, _apart(Rotation.from_matrix(C[0]), true)


def _apart(C_nb: Rotation, true: Rotation) -> float:
    """Difference of two headings [rad], without its sign."""
    x, y = C_nb.apply([1.0, 0.0, 0.0]), true.apply([1.0, 0.0, 0.0])
    return abs(float(np.arctan2(x[1] * y[0] - x[0] * y[1], x[0] * y[0] + x[1] * y[1])))


# --- context --------------------------------------------------------------------------------------


def _context_rows() -> list[Row]:
    equal = 10 * ARC_SECOND * EARTH_RATE * np.cos(45 * DEG) / DEG_PER_HOUR
    optic = 6 * ARC_MINUTE * EARTH_RATE * np.cos(45 * DEG) / DEG_PER_HOUR
    at = [abs(_at_azimuth(a * DEG)) for a in (90, 45)]
    return [
        Row(
            paper="S4",
            place="context, physical gyrocompass",
            quantity="azimuth of gyrocompasses that seek north mechanically",
            printed="10''",
            ours=f"an east gyro of {equal:.1g} deg/h at latitude 45 deg would be as good",
            verdict=Verdict.CONTEXT,
            reason="quoted; no such instrument is simulated here",
        ),
        Row(
            paper="S4",
            place="context, fibre-optic compass",
            quantity="azimuth of optical gyrocompasses",
            printed="6'",
            ours=f"an east gyro of {optic:.2g} deg/h at latitude 45 deg",
            verdict=Verdict.CONTEXT,
            reason="quoted; dw_E/(W cos lat)",
        ),
        _row(
            "recommendation, azimuth near +-90 deg",
            "heading error of a single gyro per rate error, X1 at 45 deg against 90 deg",
            "least at 90 deg",
            f"{at[1] / at[0]:.3f} times as large at 45 deg",
            at[1] > at[0],
            "1/sin(yaw)",
        ),
    ]


def _at_azimuth(yaw: float) -> float:
    p = Posture(0.0, 0.0, yaw, LATITUDE)
    return one_position_error(p, 0.001 * DEG_PER_HOUR)
