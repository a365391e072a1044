"""[S2]: the orientation matrix corrected by satellites; formulas, its figure, and the rival."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, Priors
from alignment.arrays import Array
from alignment.methods.vectors import SOLUTIONS, Fixes, Matching, VectorOptions, channel, compare
from alignment.methods.vectors.channel import ACCEL, GYRO, PSI
from alignment.methods.vectors.fixes import joined
from alignment.methods.vectors.kalman import filtered
from alignment.methods.vectors.printed import corrected_vectors, cramer, invariants
from alignment.methods.vectors.rodrigues import (
    error_as_printed,
    error_carried,
    from_half_angles,
    integrated,
    kinematics,
    orientation_matrix,
    start_error,
    turn_of,
    variations,
)
from alignment.navigation import C_en, geodetic
from alignment.skew import components, cone, spread
from alignment.units import DEG, DEG_PER_HOUR
from stand.evaluation.published.row import Row, judged, solved
from stand.vehicle.scenario import fixes_of, load_drive, programmed, sense

RUNS, RATE_HZ = 8, 20
FIXES = (5, 30, 50)
START = 0.5 * DEG  # of the programmed attitude about each axis
ACCELERATION, PLACE, VELOCITY = 0.01, 5.0, 0.05  # m/s^2, m, m/s: as published
FLIGHT, FLIGHTS, INTERVAL = "high-dynamics", 24, 60.0
DRIFT = 10 * DEG_PER_HOUR  # of gyros, where residuals of a filter are asked for
EXACT = 1e-12
ROOM = 0.3  # of a root mean square over 24 flights, on a path whose turns bend the closed form

_row = partial(judged, "S2")


def rows(progress: Callable[[float], None]) -> list[Row]:
    """Every row of [S2]."""
    made = [*_parameter_rows(), *_error_rows(), *_invariant_rows()]
    progress(0.1)
    made += [*_flight_rows()]
    progress(0.4)
    made += [*_residual_rows()]
    progress(0.6)
    return [*made, *_fix_rows()]


# --- (1): parameters, matrix, norm ----------------------------------------------------------------


def _parameter_rows() -> list[Row]:
    rng = np.random.default_rng(0)
    angles = rng.uniform(-1.4, 1.4, (50, 3))  # roll, yaw, pitch
    q = from_half_angles(*angles.T)
    turns = Rotation.from_euler("YZX", angles[:, [1, 2, 0]])
    matrix = np.abs(orientation_matrix(turns.as_quat()) - turns.as_matrix()).max()
    halves = np.abs(orientation_matrix(q) - turns.as_matrix()).max()
    w, h = np.array([0.3, -0.2, 0.5]), 1e-5
    both = [(turns[0] * Rotation.from_rotvec(s * h * w)).as_quat() for s in (1, -1)]
    both[1] *= np.sign(both[0] @ both[1])
    rate = np.abs(np.abs((both[0] - both[1]) / (2 * h)) - np.abs(kinematics(q[0], w))).max()
    rates = np.tile([0.4, -0.3, 0.6], (1000, 1))
    always, often = integrated(q[0], rates, 0.5, 0.0)
    seldom, few = integrated(q[0], rates, 0.5, 1e-5)
    apart = (Rotation.from_quat(always[-1]).inv() * Rotation.from_quat(seldom[-1])).magnitude()
    skewed, gain = _skewed()
    return [
        _row(
            "formula (1)",
            "orientation matrix of Rodrigues-Hamilton parameters, 50 attitudes",
            "exact",
            f"within {matrix:.0e}",
            bool(matrix < EXACT),
            "rounding",
        ),
        _row(
            "start, half angles",
            "l0 ... l3 from half of pitch, yaw and roll",
            "signs damaged",
            f"within {halves:.0e} of the product of yaw, pitch, roll",
            bool(halves < EXACT),
            "with l0 = ccc - sss, l1 = ccs + ssc, l2 = csc + scs, l3 = scc - css",
        ),
        _row(
            "kinematics",
            "2 l' = W(w) l",
            "exact",
            f"within {rate:.0e} of numeric derivatives",
            bool(rate < 1e-9),
            "central differences of 1e-5 s",
        ),
        _row(
            "norm on a threshold",
            "attitude after 500 s where the norm is corrected beyond 1e-5 only, and at every step",
            "corrected when it leaves one considerably",
            f"{few} corrections against {often}: {apart:.0e} rad apart",
            bool(apart < 1e-10),
            "the norm scales the matrix and turns nothing",
        ),
        _row(
            "skewed accelerometers",
            "specific force from three accelerometers on a cone of 40 deg about Y1",
            "a skewed frame serves as well",
            f"within {skewed:.0e}; noise {gain[1]:.2f} times along Y1, {gain[0]:.2f} across",
            bool(skewed < EXACT),
            "three axes of 54.7 deg are square; others trade noise along the cone against across. "
            "A unit states its axes as `axes`",
        ),
    ]


def _skewed() -> tuple[float, Array]:
    """How far components come out, and what becomes of equal noise (3,)."""
    axes, f = cone(40 * DEG), np.array([[1.0, 9.8, -0.5], [-3.0, 4.0, 8.0]])
    off = float(np.abs(components(f @ axes.T, axes) - f).max())
    return off, np.sqrt(spread(axes).diagonal())


# --- errors of the parameters ---------------------------------------------------------------------


def _error_rows() -> list[Row]:
    angles, errors = np.array([0.3, -0.7, 0.4]), np.array([0.4, -0.3, 0.5]) * DEG
    q = from_half_angles(*angles)
    found = turn_of(q, start_error(angles, errors))
    wrong = Rotation.from_quat(from_half_angles(*(angles + errors)))
    exact = (wrong * Rotation.from_quat(q).inv()).as_rotvec()
    off = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    by_turn = {turn: _integral(turn * DEG) for turn in (0, 90, 180)}
    allowed = _turn_allowed(0.1)
    return [
        _row(
            "start, three angle errors",
            "start error of the parameters from errors of 0.4, -0.3, 0.5 deg of roll, yaw, pitch",
            "first order",
            f"within {off:.0e} of the whole turn",
            bool(off < 1e-3),
            "a drive states them as [start_error]",
        ),
        *(_integral_row(turn, *off_by, allowed) for turn, off_by in by_turn.items()),
    ]


def _integral_row(turn: int, printed: float, carried: float, allowed: float) -> Row:
    good = printed < 0.02
    return _row(
        f"error integral, turn of {turn} deg",
        "attitude error by a start error and a gyro error across the turn, by dl(t0) + 1/2 int "
        "W(dw) l dt",
        "exact to first order",
        f"off by {printed:.1%} of the error as printed, {carried:.1%} by the transition matrix",
        good,
        "no turn, nothing to carry"
        if not turn
        else "the term W(w) dl is missing: errors made before a turn are not turned along",
        nearest="" if good else f"turns of less than {allowed / DEG:.0f} deg keep it within 10 %",
    )


def _integral(turn: float) -> tuple[float, float]:
    """How far the integral is from the true error, a part of it: as printed, and carried."""
    T, n = 60.0, 1201
    t, rate, dw = np.linspace(0, T, n), np.array([0, turn / T, 0]), np.array([1e-7, 0, 0])
    begun = np.array([0.0, 0.0, 5e-6])
    true = Rotation.from_rotvec(np.outer(t, rate))
    wrong = Rotation.from_rotvec(begun) * Rotation.from_rotvec(np.outer(t, rate + dw))
    exact = (wrong[-1] * true[-1].inv()).as_rotvec()
    q, rates = _continuous(true.as_quat()), np.tile(dw, (n, 1))
    start = 0.5 * np.append(begun, 0.0)  # l0 = 1 there
    off = [
        float(np.linalg.norm(turn_of(q, f(t, q, rates, start))[-1] - exact) / np.linalg.norm(exact))
        for f in (error_as_printed, error_carried)
    ]
    return off[0], off[1]


def _continuous(q: Array) -> Array:
    """The same rotations without jumps of sign, from the identity on."""
    jumps = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
    return q * np.sign(q[0, 3]) * np.cumprod(np.append(1.0, jumps))[:, None]


def _turn_allowed(part: float) -> float:
    """The turn [rad] up to which the printed integral is right to a part of itself."""
    found = solved(lambda turn: _integral(turn)[0], part, 1e-3, np.pi)
    assert found is not None
    return found


# --- (2)-(7): invariants and vectors --------------------------------------------------------------


def _invariant_rows() -> list[Row]:
    dr, v = np.array([1200.0, 300.0, -80.0]), np.array([20.0, -5.0, 1.0])
    e, u = np.array([3.0, -2.0, 1.0]), np.array([0.4, 0.6, -1.0])
    names = ("J1 = |v|", "J2 = |dr|", "J3 = |dr x v|")
    left = [
        invariants(dr + s * e, v + s * u) - invariants(dr, v) - variations(dr, v, s * e, s * u)
        for s in (0.2, 0.1)
    ]
    ratio = left[0] / left[1]
    made = [
        _row(
            f"formula ({k + 2})",
            f"isochronous variation of {names[k]}: its remainder when the errors are halved",
            "first order",
            f"divides by {ratio[k]:.2f}",
            abs(ratio[k] - 4) < 0.2,
            "4 is second order left",
        )
        for k in range(3)
    ]
    dJ = 0.1
    _, moved, _ = corrected_vectors(dr, v, np.array([dJ, 0.0, 0.0]))
    changed = float(np.linalg.norm(moved) - np.linalg.norm(v)) / dJ
    turned = float(np.arccos(moved @ v / np.linalg.norm(moved) / np.linalg.norm(v)))
    C = Rotation.from_euler("YZX", [0.4, 0.2, -0.6]).as_matrix()
    vectors = np.stack([a / np.linalg.norm(a) for a in (dr, v, np.cross(dr, v))])
    solved = np.abs(cramer(vectors @ C, vectors) - C).max()
    nearly = np.stack([dr, dr + np.array([0.0, 0.0, 1.0]), np.cross(dr, v)])
    nearly /= np.linalg.norm(nearly, axis=1)[:, None]
    D = float(np.linalg.det(nearly))
    wrong = np.abs(cramer(nearly @ C + 1e-4 * np.eye(3), nearly) - C).max()
    return [
        *made,
        _row(
            "formula (5)",
            "change of |v| where dJ1/sqrt(3) is added to each axis, over dJ1; v 20, -5, 1 m/s",
            "1",
            f"{changed:.3f}, and the vector turns by {turned / DEG:.2f} deg for 0.1 m/s",
            abs(changed - 1) < 0.05,
            "it adds a vector along (1, 1, 1): cos(eps) of it changes the modulus, the rest turns",
            nearest="dJ along the vector itself, dJ v/|v|, changes |v| by dJ and turns nothing",
        ),
        _row(
            "formulas (6), (7)",
            "matrix by Cramer's rule from unit vectors of dr, v and c without errors",
            "exact",
            f"within {solved:.0e}",
            bool(solved < EXACT),
            "where the channels' vectors are one vector in two frames",
        ),
        _row(
            "condition D != 0",
            "the same with dr and v 0.05 deg apart and readings wrong by 1e-4",
            "solvable",
            f"D = {D:.1e}, the matrix is wrong by {wrong:.2g}",
            bool(wrong < 0.01),
            "a determinant is no measure of error",
            nearest="sigma about v = sigma_dr/(|dr| sin(angle)), which is refused above 3 deg here",
        ),
    ]


# --- figure 1 -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Position errors over a flight with corrections at `corrected` [s].

    `t` (k,) [s]; `closed` (k,): the root of sums of squares, reset by each correction; `by` name
    (k,): root mean square over the flights, about one axis, all [m].
    """

    t: Array
    corrected: Array
    closed: Array
    by: Mapping[str, Array]


RESET = "place and velocity alone"


@cache
def flight() -> Flight:
    """Figure 1 of [S2] on a path of high dynamics: closed form, corrections, and the solutions."""
    drive = load_drive(FLIGHT)
    seldom = drive.satellite.model_copy(update={"interval_s": INTERVAL})
    sensed = sense(drive.path, RATE_HZ)
    squares: dict[str, list[Array]] = {}
    t = corrected = np.zeros(0)
    priors = Priors(accel_bias=ACCELERATION)
    options = VectorOptions(
        priors=priors, attitude_sigma=1e-4 * DEG, correct_at=0.0, step=1.0, largest_sigma=20 * DEG
    )
    for seed in range(FLIGHTS):
        rng = np.random.default_rng(seed)
        bias = ACCELERATION * rng.standard_normal(3)
        readings = ImuReadings(sensed.t_ns * 1e-9, sensed.w_ib_b, sensed.f_b + bias)
        fixes = fixes_of(drive.path, seldom, rng)
        start = programmed(drive.path, 0.0, rng)
        corrected = fixes.t[1:]
        for name, solve in {RESET: _reset, **SOLUTIONS}.items():
            found = solve(readings, fixes, start, options)
            t = found.t
            off = found.position - drive.path.at(t).r_e
            squares.setdefault(name, []).append(np.mean(off**2, axis=1))
    since = t - np.append(0.0, corrected)[np.searchsorted(corrected, t, side="right")]
    closed = np.sqrt(PLACE**2 + (VELOCITY * since) ** 2 + (ACCELERATION * since**2 / 2) ** 2)
    by = {name: np.sqrt(np.mean(values, axis=0)) for name, values in squares.items()}
    return Flight(t, corrected, closed, by)


def _reset(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, options: VectorOptions | None
) -> Matching:
    """The inertial channel whose place and velocity are the satellites' at each fix, no more."""
    options = options or VectorOptions()
    latitude, longitude, _ = geodetic(fixes.position[0])
    record = joined(readings, fixes, C_nb0, C_en(latitude, longitude), options)
    strides = channel.steps(record)
    state, count = channel.begun(record, fixes, options), 1
    states, notes = [state], channel.Notes()
    for k in range(len(record.t) - 1):
        elapsed = float(record.t[k] - record.t[0])
        state = channel.carried(state, strides, k, elapsed, fixes, record.priors)
        if record.at_fix[k + 1]:
            state = replace(state, r=record.r_i[count], v=record.v_i[count])
            count += 1
        states.append(state)
        notes.add(bool(record.at_fix[k + 1]), np.zeros(3), "")
    return channel.shown(RESET, record, states, notes, options)


def _flight_rows() -> list[Row]:
    found = flight()
    made = []
    for k, time in enumerate(found.corrected, start=1):
        i = int(np.searchsorted(found.t, time))
        at = {name: curve[i - 1] for name, curve in found.by.items()}
        after, closed = found.by[RESET][i], found.closed[i - 1]
        reset, printed = at[RESET], at["printed"]
        made.append(
            _row(
                f"figure 1, before t{k}",
                f"sigma of place per axis {time:.0f} s into the flight, before the correction; "
                "a = 0.01 m/s^2, r0 = 5 m, v0 = 0.05 m/s",
                f"{closed:.1f} m by root of squares",
                f"{reset:.1f} m, {after:.1f} m after it: place and velocity corrected alone "
                f"({FLIGHTS} flights)",
                abs(reset / closed - 1) < ROOM and abs(after / PLACE - 1) < ROOM,
                "a t^2/2 since the last correction; that the accelerometers turn with the aircraft "
                "changes little",
            )
        )
        if k > 1:
            made.append(
                _row(
                    f"figure 1, matrix corrected, before t{k}",
                    "the same, the matrix corrected as printed at each fix before",
                    f"{closed:.1f} m",
                    f"{printed:.0f} m as printed; {at['observing']:.0f} in the observing form, "
                    f"{at['kalman']:.1f} by the Kalman filter",
                    abs(printed / closed - 1) < ROOM,
                    "the correction turns a matrix that was right by the velocity's error over "
                    "the speed, and gravity through it outweighs a",
                    nearest="place and velocity corrected alone, or a filter that weighs both",
                )
            )
    return made


# --- the rival ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Residual:
    """What the paper prints of one kind of state: a part of its start, `low` to `high`."""

    name: str
    key: str
    printed: str
    low: float
    high: float


RESIDUALS = (
    Residual("angles, roll and pitch", "level", "3 %", 0.025, high=0.035),
    Residual("angles, heading", "heading", "20...30 %", 0.2, high=0.3),
    Residual("accelerometer offsets", "accel", "10-30 %", 0.1, high=0.3),
    Residual("gyro drifts", "gyro", "20-50 %", 0.2, high=0.5),
)


def _residual_rows() -> list[Row]:
    """Residual errors of the Kalman filter in percent of their start."""
    parts = residuals()
    made = []
    for r in RESIDUALS:
        middle = float(np.median(parts[40, r.key]))
        inside = r.low <= middle <= r.high
        span = np.concatenate([parts[30, r.key], parts[50, r.key]])
        made.append(
            _row(
                f"Kalman filters, residual {r.name}",
                "sigma of a filter over that of the start after 40 fixes, the middle axis; weaving "
                "at 20 m/s, 0.5 deg, 0.01 m/s^2, 10 deg/h",
                r.printed,
                f"{middle:.0%}; {span.min():.0%} to {span.max():.0%} after 30 to 50",
                inside,
                "path, interval and noise decide: these are of a tuned filter on this path",
                nearest="" if inside else _fixes_for(r),
            )
        )
    return made


def _fixes_for(r: Residual) -> str:
    """How many fixes leave what is printed."""
    counts = [
        count
        for (count, key), values in residuals().items()
        if key == r.key and r.low <= np.median(values) <= r.high
    ]
    if not counts:
        return "no number of fixes up to 120 on this path"
    return f"{min(counts)} to {max(counts)} fixes on this path"


@cache
def residuals() -> dict[tuple[int, str], Array]:
    """By number of fixes and kind: sigma of the filter over the start's, of each axis."""
    drive = load_drive("weaving")
    sensed = sense(drive.path, RATE_HZ)
    priors = Priors(accel_bias=ACCELERATION, gyro_bias=DRIFT)
    rng = np.random.default_rng(0)
    errors = np.concatenate([DRIFT * rng.standard_normal(3), ACCELERATION * rng.standard_normal(3)])
    readings = ImuReadings(sensed.t_ns * 1e-9, sensed.w_ib_b + errors[:3], sensed.f_b + errors[3:])
    fixes = fixes_of(drive.path, drive.satellite, rng)
    start = programmed(drive.path, START, rng)
    record, states, _ = filtered(readings, fixes, start, VectorOptions(priors=priors, step=1.0))
    down = record.r_i[0] / np.linalg.norm(record.r_i[0])
    found: dict[tuple[int, str], Array] = {}
    for count, k in enumerate(np.flatnonzero(record.at_fix), start=1):
        P = states[k].P
        heading = float(np.sqrt(down @ P[PSI, PSI] @ down)) / START
        across = np.eye(3) - np.outer(down, down)
        level = np.sqrt(np.linalg.eigvalsh(across @ P[PSI, PSI] @ across)[1:]) / START
        found[count, "heading"], found[count, "level"] = np.array([heading]), level
        found[count, "accel"] = np.sqrt(np.diag(P[ACCEL, ACCEL])) / ACCELERATION
        found[count, "gyro"] = np.sqrt(np.diag(P[GYRO, GYRO])) / DRIFT
    return found


# --- fixes needed ---------------------------------------------------------------------------------


def _fix_rows() -> list[Row]:
    """Attitude error by number of fixes on a weaving path, in the published setting."""
    errors = by_fixes("weaving")
    before = np.sqrt(3) * START / DEG
    told = {
        name: ", ".join(f"{e:.2f}" for e in rms)
        + f" deg after {FIXES[0]}, {FIXES[1]}, {FIXES[2]} fixes"
        for name, rms in errors.items()
    }
    setting = f"weaving path, start wrong by {before:.2f} deg"
    command = "stand drive weaving --force"
    needed = errors["kalman"]
    return [
        _row(
            "method, correction of the matrix",
            f"the matrix corrected as printed; {setting}",
            "corrected at once",
            told["printed"],
            bool(errors["printed"][0] < before / 3),
            "matching of velocities and places that hold the start velocity and gravity does not "
            "observe attitude",
            nearest=f"what passed through the matrix, int C f dt, observes it: {told['observing']}",
            command=command,
        ),
        _row(
            "method, observing form",
            f"the matrix from what passed through it; {setting}",
            "corrected",
            told["observing"],
            bool(errors["observing"][2] < before / 3),
            "Wahba's problem over all fixes, by SVD",
            command=command,
        ),
        _row(
            "Kalman filters, transient",
            f"fixes until a Kalman filter has settled, which the paper's method is to "
            f"cure; {setting}",
            "30...50 satellite cycles",
            told["kalman"],
            bool(needed[0] > 2 * needed[1]),
            "that is the size of it on this path; path, interval and noise decide, so that the "
            "number is no property of filters: at 200 m/s with a fix every 3 s 5 fixes leave 0.04 "
            "deg",
            command=command,
        ),
    ]


def by_fixes(name: str) -> dict[str, Array]:
    """Root mean square of the whole attitude error [deg] after `FIXES`, by solution."""
    drive = load_drive(name)
    sensed = sense(drive.path, RATE_HZ)
    squares: dict[str, list[Array]] = {}
    priors = Priors(accel_bias=ACCELERATION)
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        bias = ACCELERATION * rng.standard_normal(3)
        readings = ImuReadings(sensed.t_ns * 1e-9, sensed.w_ib_b, sensed.f_b + bias)
        fixes = fixes_of(drive.path, drive.satellite, rng)
        start = programmed(drive.path, START, rng)
        truth = drive.path.at(fixes.t).C_nb
        found = compare(readings, fixes, start, truth, VectorOptions(step=1.0, priors=priors))
        for solution, curve in found.items():
            after = [int(np.searchsorted(curve.fixes, count)) for count in FIXES]
            squares.setdefault(solution, []).append(np.sum(curve.error[after] ** 2, axis=1))
    return {name: np.sqrt(np.mean(values, axis=0)) / DEG for name, values in squares.items()}
