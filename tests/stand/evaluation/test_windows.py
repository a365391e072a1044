"""Windows of a log: the cut, the scatter by hand, and sigmas that hold against it."""

from dataclasses import replace
from math import cos, degrees, exp, nan, pi, radians, sqrt
from pathlib import Path

import numpy as np
import pytest
from rocking import Angle, G, Motion
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import stand
from alignment import Dwell, ImuReadings, Options, Priors, Site, Turn
from alignment.information.drift import flicker
from alignment.methods.triad import triad
from stand.errors import StandError
from stand.evaluation.windows import (
    BASE_MOVES,
    BELOW,
    BEYOND,
    CAREFUL,
    COMMON,
    HIDDEN,
    NOISE_ONLY,
    ratio_of,
    scatter_to_json,
    scatters,
    windows_of,
)
from stand.report.windows import windows_table

W = 7.292115e-5  # rad/s
HERE = Site(radians(48.5), local_gravity=G)
STILL = Motion(yaw=Angle(0.7), pitch=Angle(0.02), roll=Angle(-0.05))
# Whole periods in 60 s, so that every window ends in one attitude.
ROCKING = Motion(
    yaw=Angle(0.7, amplitude=0.04, frequency=8 / 60),
    pitch=Angle(0.02, amplitude=0.09, frequency=12 / 60, phase=1.0),
    roll=Angle(-0.05, amplitude=0.07, frequency=10 / 60, phase=0.3),
)


def dwell_of(t, w, f, label="p", turn=None):
    return Dwell(label, float(2 * t[0] - t[1]), float(t[-1]), ImuReadings(t, w, f), None, turn)


# --- the cut --------------------------------------------------------------------------------------


def test_windows_follow_one_another_and_the_rest_is_left_out():
    t = 50 + np.arange(1, 1001) / 10
    w = np.column_stack([np.arange(1000.0)] * 3)
    parts = windows_of(dwell_of(t, w, w), 30.0)
    edges = [p.t_from for p in parts] + [parts[-1].t_to]
    assert edges == pytest.approx([50, 80, 110, 140])
    assert [len(p.window()) for p in parts] == [300, 300, 300]
    assert [p.window().w_ib_b[0, 0] for p in parts] == [0, 300, 600]
    assert {p.label for p in parts} == {"p"}


def test_the_last_window_may_be_short_by_a_fiftieth():
    t = np.arange(1, 996) / 10  # 99.5 s
    parts = windows_of(dwell_of(t, np.zeros((995, 3)), np.ones((995, 3))), 50.0)
    edges = [p.t_from for p in parts] + [parts[-1].t_to]
    assert edges == pytest.approx([0, 50, 99.5])
    assert len(windows_of(dwell_of(t, np.zeros((995, 3)), np.ones((995, 3))), 52.0)) == 1


def test_each_window_of_a_turn_has_its_own_angles():
    t = np.arange(1, 1001) / 10
    turn = Turn(np.array([0.0, 1, 0]), 0.2 * t)
    parts = windows_of(dwell_of(t, np.zeros((1000, 3)), np.ones((1000, 3)), "T", turn), 50)
    first, second = [part.turn.angle for part in parts if part.turn is not None]
    np.testing.assert_allclose(first, 0.2 * t[:500])
    np.testing.assert_allclose(second, 0.2 * t[500:])


def test_lengths_that_are_none():
    t = np.arange(1, 1001) / 10
    dwell = dwell_of(t, np.zeros((1000, 3)), np.ones((1000, 3)))
    for wrong in (0.0, -1.0, nan):
        with pytest.raises(StandError, match="must be lengths above 0 s"):
            scatters([dwell], HERE, Options(), ["triad"], [wrong])
    with pytest.raises(StandError, match=r"windows of 300 s: the longest stretch has 100\.0 s"):
        scatters([dwell], HERE, Options(), ["triad"], [300.0])


# --- the numbers ----------------------------------------------------------------------------------


def tilted(angles, seconds=40.0, hz=10):
    """A rest per angle [rad]: pitched by so much, X1 north."""
    n = round(seconds * hz)
    w, f = [], []
    for a in angles:
        c, s = np.cos(a), np.sin(a)
        north, up = np.array([c, -s, 0]), np.array([s, c, 0])
        w.append(np.tile(W * (np.cos(0.8) * north + np.sin(0.8) * up), (n, 1)))
        f.append(np.tile(G * up, (n, 1)))
    t = np.arange(1, n * len(angles) + 1) / hz
    return dwell_of(t, np.concatenate(w), np.concatenate(f))


def test_scatter_and_its_interval_by_hand():
    """Tilts of 1, 2, 6 mrad: mean 3, deviations -2, -1, 3: sqrt(14/2) mrad; chi-square of two
    degrees of freedom at 2.5 and 97.5 %: 0.05064 and 7.3778 (tables)."""
    dwell = tilted([1e-3, 2e-3, 6e-3])
    rows, refused = scatters([dwell], HERE, Options(), ["triad"], [40.0])
    assert not refused
    assert [row.quantity for row in rows] == ["heading", "roll", "pitch", "latitude"]
    pitch = rows[2]
    assert (pitch.method, pitch.label, pitch.seconds, pitch.count) == ("triad", "p", 40.0, 3)
    assert pitch.scatter == pytest.approx(sqrt(7) * 1e-3, rel=1e-6)
    assert pitch.low == pytest.approx(sqrt(14 / 7.3778) * 1e-3, rel=1e-4)
    assert pitch.high == pytest.approx(sqrt(14 / 0.05064) * 1e-3, rel=1e-3)
    # readings without noise: the scatter is none of it, and is said to be none
    assert pitch.remark == f"{NOISE_ONLY}; {BEYOND}"
    entry = scatter_to_json(pitch)
    assert entry["scatter_deg"] == pytest.approx(degrees(sqrt(7) * 1e-3), rel=1e-6)
    assert (entry["windows"], entry["quantity"], entry["seconds"]) == (3, "pitch", 40.0)


def test_what_is_common_to_all_windows_is_not_compared():
    """A bias of 0.5 m/s^2 tilts all windows alike, by 51 mrad, where they scatter by 2; noise of
    0.01 m/s^2 a sample leaves 0.01/sqrt(400)/9.81 = 51 urad of a mean of 400."""
    dwell, rng = tilted([1e-3, 2e-3, 6e-3, 3e-3]), np.random.default_rng(1)
    r = dwell.readings
    noisy = dwell_of(r.t, r.w_ib_b, r.f_b + 0.01 * rng.normal(size=r.f_b.shape))
    sheet = Options(priors=Priors(accel_bias=0.5))
    rows, _ = scatters([noisy], HERE, sheet, ["triad"], [40.0])
    pitch = rows[2]
    assert pitch.quantity == "pitch"
    assert pitch.sigma == pytest.approx(0.5 / G, rel=1e-3)
    assert pitch.changing == pytest.approx(51e-6, rel=0.3)  # of 30 ordinates each, four windows
    assert pitch.ratio == pytest.approx((pitch.scatter / pitch.changing) ** 2)
    assert pitch.remark == f"{COMMON}; {BEYOND}"
    assert scatter_to_json(pitch)["sigma_changing_deg"] == pytest.approx(degrees(pitch.changing))
    assert windows_table(rows).rows[2][7] == "± 0.003"


def test_what_rounding_leaves_is_common_to_all_windows():
    """Noise of 0.1 steps of 0.01 m/s^2: the mean of a level accelerometer may be off by 3 mm/s^2
    (step/sqrt(12)), 0.3 mrad, in all windows alike, whose scatter of nothing contradicts no sigma.
    With noise of a step none of it is left, and all of the sigma changes."""
    sigmas = []
    for noise in (0.001, 0.01):
        t, w, f, _ = STILL.readings(240.0, 10)
        w, f = white(ARW, noise / sqrt(10))(np.random.default_rng(5), w, f, 10)
        dwell = dwell_of(t, w, np.round(f / 0.01) * 0.01)
        rows, _ = scatters([dwell], HERE, Options(), ["triad"], [60.0])
        sigmas.append(next(row for row in rows if row.quantity == "pitch"))
    stuck, blurred = sigmas
    assert stuck.sigma == pytest.approx(0.01 / sqrt(12) / G, rel=0.1)
    assert stuck.changing < 0.1 * stuck.sigma
    assert COMMON in stuck.remark
    assert CAREFUL not in stuck.remark
    assert blurred.changing is None
    assert blurred.sigma == pytest.approx(0.01 / sqrt(600) / G, rel=0.6)


def test_an_answer_that_hangs_on_constant_errors_is_no_unit_better_than_its_sheet():
    """A filter weighs its start by biases of 2 mm/s^2 and axes 1 mrad off: without these it gives
    another tilt, so what of its 1 mrad of sigma changes from window to window is not known."""
    rng = np.random.default_rng(5)
    t, w, f, _ = STILL.readings(240.0, 10)
    w, f = white(ARW, 3e-6)(rng, w, f, 10)
    known = Priors(gyro_walk=ARW, accel_walk=3e-6, gyro_bias=1e-6, accel_bias=2e-3)
    known = replace(known, accel_misalignment=1e-3)
    dwell = dwell_of(t, w, f + np.array([0.0, 0.0, 2e-3]))
    rows, _ = scatters([dwell], HERE, Options(priors=known), ["fine"], [60.0])
    pitch = next(row for row in rows if row.quantity == "pitch")
    assert pitch.changing is None
    assert pitch.high < 0.1 * pitch.sigma
    assert pitch.remark == HIDDEN


def test_a_sheet_that_says_far_more_than_windows_show_is_named():
    """A walk of 1 m/s/sqrt(s) leaves 1/sqrt(60) m/s^2 of a minute: 13 mrad, where noise of 1e-4
    m/s^2 a sample makes windows scatter by micro radians."""
    rng = np.random.default_rng(5)
    t, w, f, _ = STILL.readings(240.0, 10)
    w, f = white(ARW, 3e-4)(rng, w, f, 10)
    sheet = Options(priors=Priors(gyro_walk=ARW, accel_walk=1.0))
    rows, _ = scatters([dwell_of(t, w, f)], HERE, sheet, ["inertial"], [60.0])
    pitch = next(row for row in rows if row.quantity == "pitch")
    assert pitch.changing is None  # nothing stated is common to windows
    assert pitch.sigma > 1 / sqrt(60) / G
    assert pitch.remark == f"{NOISE_ONLY}; {CAREFUL}"
    sheet = replace(sheet, priors=replace(sheet.priors, accel_instability=1e-6))
    rows, _ = scatters([dwell_of(t, w, f)], HERE, sheet, ["inertial"], [60.0])
    assert next(row for row in rows if row.quantity == "pitch").remark == BELOW


def test_a_drift_of_the_record_counts_in_its_windows():
    """1 mm/s^2 up from end to end, of windows that are a fifth: (1 - 1/5) 1e-3/sqrt(12)/G."""
    rng, n = np.random.default_rng(4), 3000
    t, w, f, _ = STILL.readings(300.0, 10)
    noise = 1e-4 * rng.normal(size=f.shape)  # 4e-6 of a mean of 600: nothing beside it
    f = f + noise + np.outer(np.arange(n) / n - 0.5, [1e-3, 0.0, 1e-3])
    w = w + 1e-7 * rng.normal(size=w.shape)
    found = {}
    for dwell in windows_of(dwell_of(t, w, f), 60.0):
        record = replace(dwell, readings=dwell.window())  # the window without the record
        for key, one in (("cut", dwell), ("alone", record)):
            (e,) = triad([one], HERE, Options())
            found.setdefault(key, []).append(e)
    # its own drift shows in each window too, and is counted as one: a fifth of the whole
    more = [a.covariance[0, 0] - b.covariance[0, 0] for a, b in zip(*found.values(), strict=True)]
    assert np.sqrt(more) == pytest.approx(0.8e-3 / sqrt(12) / G, rel=0.03)
    assert "the record around it drifts, accelerometers by 100 ug: counted" in found["cut"][0].flags
    assert not any("around" in flag for flag in found["alone"][0].flags)


def test_angles_scatter_on_the_circle():
    rows, _ = scatters([tilted([0.0, 0.0])], HERE, Options(), ["triad"], [40.0])
    assert rows[0].scatter < 1e-9
    south = [Motion(yaw=Angle(pi + d)).readings(40.0, 10)[1:3] for d in (-1e-3, 1e-3)]
    w, f = (np.concatenate(x) for x in zip(*south, strict=True))
    t = np.arange(1, len(w) + 1) / 10
    (heading, *_), _ = scatters([dwell_of(t, w, f)], HERE, Options(), ["triad"], [40.0])
    assert heading.scatter == pytest.approx(sqrt(2) * 1e-3, rel=1e-3)


def test_one_window_has_no_scatter_and_says_so():
    rows, _ = scatters([tilted([0.0, 0.01])], HERE, Options(), ["triad"], [80.0])
    assert np.isnan(rows[0].scatter)
    assert rows[0].ratio is None
    assert scatter_to_json(rows[0])["scatter_deg"] is None
    assert windows_table(rows).rows[0][5] == "one window"


def test_a_heading_that_no_window_tells_has_no_scatter():
    """Noise of 1 mrad/s hides Earth rate: null for machines, and in words."""
    dwell = tilted([0.0, 0.0])
    noise = 1e-3 * np.random.default_rng(2).normal(size=(len(dwell.readings), 3))
    r = dwell.readings
    noisy = dwell_of(r.t, r.w_ib_b + noise, r.f_b)
    rows, _ = scatters([noisy], HERE, Options(), ["triad"], [40.0])
    entry = scatter_to_json(rows[0])
    assert entry["windows"] == 2
    assert [entry[k] for k in ("scatter_deg", "scatter_low_deg", "scatter_high_deg")] == [None] * 3
    assert entry["variance_over_stated"] is None
    assert windows_table(rows).rows[0][5] == "not determined"
    assert scatter_to_json(rows[1])["scatter_deg"] is not None


def test_a_sigma_that_says_nothing_is_no_number():
    rng = np.random.default_rng(1)
    t, w, f, _ = STILL.readings(80.0, 10)
    noisy = dwell_of(t, w + 1e-3 * rng.normal(size=w.shape), f)
    (heading, *_), _ = scatters([noisy], HERE, Options(), ["triad"], [40.0])
    assert heading.sigma is None
    assert "not determined" in heading.remark
    assert windows_table([heading]).rows[0][6:8] == ("", "")


def test_a_sheet_takes_the_words_away_and_a_base_that_moves_is_named():
    rng = np.random.default_rng(2)
    t, w, f, _ = ROCKING.readings(120.0, 20)
    dwell = dwell_of(t, w + 1e-6 * rng.normal(size=w.shape), f)
    sheet = Options(priors=Priors(gyro_bias=1e-7))
    (row, *_), _ = scatters([dwell], HERE, sheet, ["inertial"], [60.0])
    assert row.remark == f"{BASE_MOVES}; {COMMON}"
    (row, *_), refused = scatters([dwell], HERE, Options(), ["inertial", "triad"], [60.0])
    assert row.remark == f"{NOISE_ONLY}; {BASE_MOVES}"
    assert [r.method for r in refused] == ["triad"]
    assert "2 of 2 windows of 60 s: the first: p: not at rest" in refused[0].reason


def test_noise_only_is_where_nothing_is_known_of_the_unit_but_its_noise():
    """Of each sensor alone: a sheet of accelerometers tells nothing of a heading."""
    both = {"gyro", "accel"}
    assert Priors().noise_only == both
    assert Priors(turn=1e-4, seat=1e-4, gyro_walk=1e-5, accel_walk=1e-4).noise_only == both
    for told in ("gyro_bias", "accel_scale", "gyro_random_walk", "accel_cubic"):
        assert Priors(**{told: 1e-6}).noise_only == both - {told.partition("_")[0]}, told
    assert not Priors(gyro_ramp=1e-9, accel_ramp=1e-9).noise_only


def test_positions_are_fitted_together_window_by_window():
    """The k-th windows of two stretches are one fit: a method for several positions answers."""
    rng = np.random.default_rng(3)
    dwells = []
    for label, start, yaw in (("a", 0.0, 0.3), ("b", 100.0, 0.3 + pi)):
        t, w, f, _ = Motion(yaw=Angle(yaw)).readings(80.0, 10, start)
        told = Motion(yaw=Angle(yaw)).state(np.zeros(1))[0][0]
        r = ImuReadings(t, w + 1e-7 * rng.normal(size=w.shape), f)
        dwells.append(Dwell(label, start, start + 80.0, r, Rotation.from_matrix(told)))
    rows, refused = scatters(dwells, HERE, Options(), ["two-position"], [40.0])
    assert not refused
    assert {row.count for row in rows} == {2}


# --- the promise ----------------------------------------------------------------------------------


def ratios(motion, seconds, count, hz, methods, noise, seed, site=HERE):
    """Variance of windows' estimates over the stated one, by method and kind of angle."""
    t, w, f, _ = motion.readings(seconds * count, hz)
    w, f = noise(np.random.default_rng(seed), w, f, hz)
    rows, refused = scatters([dwell_of(t, w, f)], site, Options(), methods, [seconds])
    assert not refused
    found: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if row.ratio is not None:
            kind = "tilt" if row.quantity in ("roll", "pitch") else row.quantity
            found.setdefault((row.method, kind), []).append(row.ratio)
    return {key: float(np.mean(values)) for key, values in found.items()}


def white(gyro, accel):
    def add(rng, w, f, hz):
        return (
            w + gyro * sqrt(hz) * rng.normal(size=w.shape),
            f + accel * sqrt(hz) * rng.normal(size=f.shape),
        )

    return add


def dithered(angle, gyro, accel):
    """Jitter of the angle [rad] beside white noise: a ring laser's."""

    def add(rng, w, f, hz):
        w, f = white(gyro, accel)(rng, w, f, hz)
        return w + np.diff(angle * rng.normal(size=(len(w) + 1, 3)), axis=0) * hz, f

    return add


def wandering(gyro, accel, walk):
    """Biases of gyros that walk [rad/s/sqrt(s)] beside white noise."""

    def add(rng, w, f, hz):
        w, f = white(gyro, accel)(rng, w, f, hz)
        return w + np.cumsum(walk / sqrt(hz) * rng.normal(size=w.shape), axis=0), f

    return add


def flickering(gyro, accel, gyro_plateau, accel_plateau):
    """White noise, and bias that flickers: sums of processes a decade apart, from 1 s to 3 h."""

    def add(rng, w, f, hz):
        w, f = white(gyro, accel)(rng, w, f, hz)
        return w + flicker_of(rng, len(w), hz, gyro_plateau), f + flicker_of(
            rng, len(f), hz, accel_plateau
        )

    return add


def flicker_of(rng, n, hz, plateau):
    total = np.zeros((n, 3))
    for one in flicker(plateau):
        kept = exp(-1 / (hz * one.time))
        driven = one.sigma * sqrt(1 - kept**2) * rng.normal(size=(n, 3))
        driven[0] = one.sigma * rng.normal(size=3)
        total += lfilter([1.0], [1.0, -kept], driven, axis=0)
    return total


AT_REST = ("triad", "single-gyro", "two-gyro", "inertial", "fine")
RT = radians(1.0) / 60  # deg/rt-h
ARW = radians(1.0) * W * cos(radians(48.5)) * sqrt(60)  # a degree of heading in 60 s


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "methods", "noise"),
    [
        (STILL, AT_REST, white(ARW, 3e-4)),
        (STILL, AT_REST, dithered(1e-5, ARW / 8, 1e-4)),
        (STILL, AT_REST, wandering(ARW, 3e-4, 3e-8)),
        (ROCKING, ("inertial", "fine"), white(ARW, 3e-4)),
        (ROCKING, ("inertial", "fine"), dithered(1e-5, ARW / 4, 3e-4)),
    ],
    ids=["white", "dithered", "wandering", "rocking", "rocking, dithered"],
)
def test_scatter_is_of_the_order_of_the_sigma(motion, methods, noise):
    """Of 20 windows of 60 s of two logs, without a data sheet: 38 degrees of freedom are good to a
    quarter."""
    both = [ratios(motion, 60.0, 20, 20, methods, noise, seed) for seed in (7, 8)]
    found = {key: (value + both[1][key]) / 2 for key, value in both[0].items()}
    assert len(found) >= 2 * len(methods)
    assert all(0.2 < value < 3 for value in found.values()), found


@pytest.mark.parametrize(
    ("motion", "noise"),
    [(STILL, wandering(ARW / 4, 1e-4, ARW / 1200)), (ROCKING, white(ARW / 4, 1e-4))],
    ids=["wandering", "rocking"],
)
def test_scatter_of_windows_of_five_minutes(motion, noise):
    """Ten of 300 s, in which a bias walks by half of what noise makes of its mean."""
    found = ratios(motion, 300.0, 10, 10, ("inertial", "fine"), noise, 1)
    assert len(found) == 4
    assert all(0.2 < value < 3 for value in found.values()), found


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise",
    [
        flickering(0.002 * RT, 0.0353 / 60, radians(0.002) / 3600, 1e-4),
        flickering(0.15 * RT, 0.07 / 60, radians(0.3) / 3600, 5e-4),
    ],
    ids=["navigation", "tactical"],
)
def test_flicker_of_a_base_that_rocks_is_stated(noise):
    """Twelve windows of 300 s of two logs without a sheet, heading and tilt: their squares were up
    to 9 times those stated, for orders that show no flicker have less of it than the answer."""
    both = [ratios(ROCKING, 300.0, 12, 10, ("inertial", "fine"), noise, seed) for seed in (1, 2)]
    found = {key: float(np.mean([one[key] for one in both])) for key in both[0]}
    assert len(found) == 4
    # means of 22 and 44 degrees of freedom
    assert all(0.2 < value < 2.5 for value in found.values()), found


LN100 = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "real" / "ln100"


@pytest.mark.slow
@pytest.mark.skipif(
    not (LN100 / "x_LN100_up.ins").exists(),
    reason=f"the ring-laser logs are not part of the project; none in {LN100}",
)
@pytest.mark.parametrize(
    ("method", "seconds"),
    [
        *((m, s) for m in ("triad", "single-gyro", "two-gyro") for s in (10, 20, 30, 60)),
        *((m, 100) for m in ("triad", "single-gyro")),
        *((m, s) for m in ("six-position", "rk4", "two-sample") for s in (30, 60)),
        *((m, s) for m in ("inertial", "fine") for s in (10, 20, 30, 60)),
    ],
)
def test_the_ring_lasers_windows_scatter_as_they_say(method, seconds):
    """Both logs, no data sheet: pooled squares of deviations over those stated, by kind of angle.

    Tilt: two angles of two logs, 5 to 30 windows, so 16 degrees of freedom at least. What settles
    for minutes shows in no window of 30 s (scatter was 4 to 8 sigmas); in the log it does.
    """
    sums: dict[str, list[tuple[float, float]]] = {}
    for name, up in (("up", [[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]), ("down", DOWN)):
        P = np.array(up) if method == "two-gyro" else np.eye(3)  # which wants Y1 up
        table = np.fromfile(LN100 / f"x_LN100_{name}.ins", dtype="<f8").reshape(-1, 7)
        t, w, f = table[:, 0], np.radians(table[:, 1:4]) @ P.T, table[:, 4:7] @ P.T
        rows, _ = scatters(
            [dwell_of(t, w, f)], Site(radians(51.14)), Options(), [method], [seconds]
        )
        for row in rows:
            kind = "tilt" if row.quantity in ("roll", "pitch") else row.quantity
            assert NOISE_ONLY in row.remark
            sums.setdefault(kind, []).append((row.scatter**2, row.sigma**2))
    ratios = {k: float(np.divide(*np.sum(rows, axis=0))) for k, rows in sums.items()}
    assert {"tilt"} < set(ratios)
    assert all(0.2 < ratio < 3 for ratio in ratios.values()), ratios


DOWN = [[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]


def test_a_gap_silences_the_window_that_it_is_in_and_no_other(tmp_path):
    """A log that a method refuses as a whole, cut at the gap's sides: three of four are told."""
    rng, t = np.random.default_rng(3), np.arange(1, 1201) / 10
    w = [4e-5, 5e-5, -3e-5] + 1e-7 * rng.standard_normal((1200, 3))
    f = [0.0, 9.81, 0.0] + 1e-4 * rng.standard_normal((1200, 3))
    whole = (t < 70) | (t > 72)
    path, names = tmp_path / "gap.csv", "t_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    table = np.column_stack([t, w, f])[whole]
    np.savetxt(path, table, delimiter=",", header=names, comments="")
    found = stand.align(path, method="inertial", latitude_deg=48.5, windows_s=(30,))
    assert found.scores == ()
    assert {(row.quantity, row.count) for row in found.windows} >= {("roll", 3), ("pitch", 3)}
    assert all("gap of 2" in one.reason for one in found.refusals)
    with pytest.raises(stand.StandError, match="gap of 2"):
        stand.align(path, method="inertial", latitude_deg=48.5)


def test_a_disturbed_window_counts_by_its_own_sigma_by_hand():
    """1, -1, 1, -1 urad of 1 urad each, and one 30 off of 30: (4 * 1 + 1) / 4 and a mean that is
    31 * 1e-6 / 900 off; by their root mean square, 13.5, it would be a tenth of that."""
    values = np.array([1.0, -1.0, 1.0, -1.0, 30.0]) * 1e-6
    sigmas = np.array([1.0, 1.0, 1.0, 1.0, 30.0]) * 1e-6
    assert ratio_of(values, sigmas) == pytest.approx(5 / 4, rel=1e-3)
    # sigmas that differ by chance are one: 4/3 of their mean square, 0.82
    chance = np.array([1.0, 0.6, 1.0, 0.8]) * 1e-6
    assert ratio_of(values[:4], chance) == pytest.approx(4 / 3 / 0.75, rel=1e-9)
    assert ratio_of(values[:4] + np.pi, chance) == pytest.approx(4 / 3 / 0.75, rel=1e-6)
    # twice the usual one is still one of them, more is not
    values = np.array([1.0, -1.0, 0.0]) * 1e-6
    still, moved = np.array([1.0, 1.0, 2.0]) * 1e-6, np.array([1.0, 1.0, 2.01]) * 1e-6
    assert ratio_of(values, still) == pytest.approx(2 / 2 / 2, rel=1e-9)
    assert ratio_of(values, moved) == pytest.approx(2 / 2, rel=1e-9)
    assert ratio_of(values[:1], still[:1]) is None
    assert ratio_of(values, None) is None
    assert ratio_of(np.array([0.0, np.nan]), still[:2]) is None
    assert ratio_of(values, np.zeros(3)) is None
