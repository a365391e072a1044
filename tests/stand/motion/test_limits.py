"""Limits: peaks by hand, and one line that says what would do."""

import math

import numpy as np
import pytest

from alignment.units import DEG
from stand.errors import StandError
from stand.motion import limits
from stand.motion.limits import Peak, check, uses
from stand.motion.planner import plan
from stand.motion.polynomial import Motion
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import procedure_from
from stand.table.table import Table, load_table, table_from
from stand.toml_files import Source

STAND = describe(load_model())
TABLE = load_table("laboratory")
HEAD = 'title = "T"\n[site]\nlatitude_deg = 10\n[estimate]\nmethods = []\n'


def used(steps: str, torque=None) -> list[dict[str, Peak]]:
    procedure = procedure_from(Source("p", "p.toml", HEAD + steps))
    return [
        {peak.quantity: peak for peak in use.peaks}
        for use in uses(plan(procedure, STAND, TABLE), TABLE, torque)
    ]


def refusal(steps: str, torque=None) -> str:
    procedure = procedure_from(Source("p", "p.toml", HEAD + steps))
    with pytest.raises(StandError) as caught:
        check(procedure, plan(procedure, STAND, TABLE), TABLE, torque)
    return str(caught.value)


def sine(amplitude: float, frequency: float, axis: str = "base_roll") -> str:
    wave = f"{{ amplitude_deg = {amplitude}, frequency_hz = {frequency} }}"
    return (
        f'[[step]]\nkind = "sine"\nlabel = "rock"\naxes = {{ {axis} = {wave} }}\n'
        "duration_s = 20\nfade_s = 20\n"
    )


def rate(value: float, axis: str = "outer") -> str:
    return (
        f'[[step]]\nkind = "rate"\nlabel = "spin"\naxis = "{axis}"\nrate_deg_s = {value}\n'
        "duration_s = 10\n"
    )


def test_peaks_of_random_motions_are_those_of_a_fine_grid():
    """Half an octave of vibration, four pieces a period of its fastest wave: seventeen points of
    each miss a peak by (pi/64)^2 / 2 = 0.12 %; of torque, five points, by (pi/16)^2 / 2 = 1.9 %."""
    shaken = "{ rms_deg_s2 = 5.0, low_hz = 2.0, high_hz = 3.0 }"
    steps = "".join(
        f'[[step]]\nkind = "vibration"\nlabel = "shake {k}"\naxes = {{ outer = {shaken} }}\n'
        "duration_s = 3\nfade_s = 4\n"
        for k in range(12)
    )
    planned = plan(procedure_from(Source("p", "p.toml", HEAD + steps)), STAND, TABLE)
    for use in uses(planned, TABLE, lambda q, v, a: a):
        t = np.arange(use.step.t_from, use.step.t_to, 1e-3)
        _, rates, accelerations = planned.motion.joints(t)
        jerks = planned.motion.derivative().joints(t)[2]
        peaks = {peak.quantity: abs(peak.value) for peak in use.peaks}
        for quantity, x in (("rate", rates), ("acceleration", accelerations), ("jerk", jerks)):
            assert peaks[quantity] == pytest.approx(np.abs(x).max() / DEG, rel=1.3e-3)
        assert peaks["torque"] == pytest.approx(np.abs(accelerations).max(), rel=2e-2)


def test_peaks_of_a_sine_by_hand():
    peaks = used(sine(5, 0.5))[0]
    w = 2 * math.pi * 0.5
    # nine points on each tenth of a period miss a peak by at most (pi/80)^2 / 2 = 0.08 %
    for quantity, value in (("angle", 5), ("rate", 5 * w), ("acceleration", 5 * w**2)):
        assert abs(peaks[quantity].value) == pytest.approx(value, rel=1e-3)
        assert peaks[quantity].axis == "base_roll"
        assert 0 <= peaks[quantity].t <= 60
    assert abs(peaks["jerk"].value) == pytest.approx(5 * w**3, rel=2e-3)
    assert peaks["angle"].limit == pytest.approx(15, rel=1e-15)
    assert peaks["rate"].ratio == pytest.approx(5 * w / 30, rel=1e-3)


def test_moves_ride_on_their_limits_and_pass():
    steps = (
        '[[step]]\nkind = "move"\nlabel = "M"\n'
        "joints_deg = { outer = 179, inner = 170, base_yaw = 15 }\n"
    )
    (peaks,) = used(steps)
    assert max(p.ratio for p in peaks.values()) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize(
    ("steps", "line"),
    [
        # 30 deg/s allowed of 40 x 2 pi 0.15 = 37.7; travel 15 of 40 is the first to be named
        (
            sine(40, 0.15),
            'p.toml: step 1 "rock", base_roll: angle 40 deg at 21.667 s, table laboratory allows '
            "15; 0.375 of the angle would do",
        ),
        (
            rate(250),
            'p.toml: step 1 "spin", outer: rate 250 deg/s at 1.450 s, table laboratory allows '
            "200; a rate of 200 deg/s or less would do",
        ),
        (
            rate(-250, "middle"),
            'p.toml: step 1 "spin", middle: rate -250 deg/s at 1.450 s, table laboratory allows '
            "200; a rate of 200 deg/s or less would do",
        ),
    ],
)
def test_lines(steps, line):
    said = refusal(steps).replace("angle -40", "angle 40")
    # which of several equal peaks is met first depends on rounding: the time may be another
    assert said.split(" at ")[0] == line.split(" at ")[0]
    assert said.split(", table")[1] == line.split(", table")[1]


def test_the_change_that_is_advised_does():
    line = refusal(sine(10, 0.6))
    # jerk 10 (2 pi 0.6)^3 = 535.9 of 300; acceleration 142.1 of 60, the worst; rate 37.7 of 30
    assert 'step 1 "rock", base_roll: acceleration' in line
    slower, smaller = (
        float(x) for x in (line.split("; ")[1].split()[0], line.split("or ")[1].split()[0])
    )
    assert slower == pytest.approx(math.sqrt(142.12 / 60), abs=2e-3)
    assert smaller == pytest.approx(60 / 142.12, abs=2e-3)
    for steps in (sine(10, 0.6 / slower), sine(10 * smaller, 0.6)):
        assert max(p.ratio for p in used(steps)[0].values()) < 1.001


def test_how_much_slower_by_hand():
    """A time goes into rates once, into accelerations twice, into jerks three times."""
    w = 2 * math.pi * 0.6
    peaks = used(sine(10, 0.6))[0]
    for quantity, slower in (
        ("angle", 1.0),
        ("rate", 10 * w / 30),
        ("acceleration", math.sqrt(10 * w**2 / 60)),
        ("jerk", (10 * w**3 / 300) ** (1 / 3)),
    ):
        assert peaks[quantity].slower == pytest.approx(slower, rel=1e-3)
    assert used(sine(16, 0.1))[0]["angle"].slower == math.inf  # it turns as far, however slowly


MOVE = '[[step]]\nkind = "move"\nlabel = "{0}"\njoints_deg = {{ {1} }}\n'
DWELL = '[[step]]\nkind = "dwell"\nlabel = "d"\nduration_s = 5\n'


def test_a_rest_uses_nothing_of_the_moves_beside_it():
    """Neither of jerks that begin and end where it does, and of the angle where it stands."""
    steps = MOVE.format("a", "base_roll = -9") + DWELL + MOVE.format("b", "base_roll = 6")
    move, rest, back = used(steps)
    for quantity in ("rate", "acceleration", "jerk"):
        assert rest[quantity].ratio == pytest.approx(0.0, abs=1e-9)
        assert move[quantity].ratio > 0.1 < back[quantity].ratio
    assert (rest["angle"].value, rest["angle"].limit) == pytest.approx((-9, 15))
    assert rest["angle"].ratio == pytest.approx(0.6)
    assert back["angle"].value == pytest.approx(-9)  # where it comes from
    assert move["angle"].value == pytest.approx(-9)


def test_half_a_second_alone_is_looked_at():
    (still,) = used(DWELL.replace("= 5", "= 0.5"))
    assert [still[q].ratio for q in ("angle", "rate", "acceleration", "jerk")] == [0, 0, 0, 0]


def test_travel_has_two_ends():
    """-10 to 20 deg: 8 deg are most of the one side and little of the other."""
    lopsided = made("base_roll", "travel_deg = [-10.0, 20.0]\n")
    for angle, ratio in ((8, 0.4), (-8, 0.8), (0, 0.0)):
        steps = MOVE.format("a", f"base_roll = {angle}") + DWELL
        procedure = procedure_from(Source("p", "p.toml", HEAD + steps))
        *_, rest = uses(plan(procedure, STAND, lopsided), lopsided)
        (angles,) = [p for p in rest.peaks if p.quantity == "angle"]
        assert angles.ratio == pytest.approx(ratio, abs=1e-12)


def made(axis: str, more: str) -> Table:
    limits = "rate_deg_s = 30.0\nacceleration_deg_s2 = 60.0\njerk_deg_s3 = 300.0\n"
    text = f'title = "T"\nsource = "the test itself"\n[axis.{axis}]\n{limits}{more}'
    return table_from(Source("t", "t.toml", text))


def test_it_does_not_matter_how_many_pieces_are_looked_at_at_once(monkeypatch):
    steps = sine(5, 0.5) + rate(20)
    whole = used(steps)
    monkeypatch.setattr(limits, "CHUNK", 7)
    assert used(steps) == whole


def test_a_peak_that_lies_in_the_second_step():
    assert 'step 2 "rock"' in refusal(rate(10) + sine(5, 1.5))


def test_torque_is_set_against_the_motors(monkeypatch):
    """A made-up stand: 3 kg m^2 about the outer axis, 2 N m held there."""

    def torque(q, v, a):
        needed = np.zeros_like(a)
        needed[:, 3] = 3.0 * a[:, 3] + 2.0
        return needed

    allowed = np.full(6, 10.0)
    monkeypatch.setattr(type(TABLE), "torque", property(lambda self: allowed))
    wave = sine(20, 0.5, "outer")
    w2 = (2 * math.pi * 0.5) ** 2
    peak = used(wave, torque)[0]["torque"]
    needed = 3 * 20 * DEG * w2 + 2
    assert peak.value == pytest.approx(needed, rel=1e-3)
    assert peak.ratio == pytest.approx(needed / 10, rel=1e-3)
    # of 10 N m, 2 are needed to hold it: 8 are left for I w^2 A
    assert peak.slower == pytest.approx(math.sqrt((needed - 2) / 8), rel=1e-3)
    # sqrt(10.335/8) is 1.1366, up; 10/12.335 is 0.8107, down
    assert "outer: torque" in refusal(wave, torque)
    assert refusal(wave, torque).endswith("; 1.137 times slower, or 0.810 of the angle, would do")
    small = used(sine(10, 0.5, "outer"), torque)[0]["torque"]
    assert small.slower == 1.0
    assert small.ratio == pytest.approx((3 * 10 * DEG * w2 + 2) / 10, rel=1e-3)
    # a rest beside it needs what holds it
    assert used(DWELL + wave, torque)[0]["torque"].value == pytest.approx(2.0)
    # held and moved the other way it is the same
    other = used(wave, lambda q, v, a: -torque(q, v, a))[0]["torque"]
    assert (other.value, other.slower) == pytest.approx((-peak.value, peak.slower))
    allowed[3] = 1.5
    assert used(wave, torque)[0]["torque"].slower == math.inf
    assert "slower" not in refusal(wave, torque)


@pytest.mark.parametrize("axis", ["base_roll", "base_yaw"])
@pytest.mark.parametrize("frequency", [0.02, 0.6])
def test_a_step_is_refused_beyond_its_limits_and_only_there(axis, frequency):
    """Slow sines break the angle, quick ones acceleration or jerk: whatever tells that they do not,
    just within passes, just beyond not, and far within too."""
    full = max(peak.ratio for peak in used(sine(1.0, frequency, axis))[0].values())
    for part in (0.01, 0.3, 0.5, 0.7, 0.9, 0.999):
        steps = sine(part / full, frequency, axis)
        procedure = procedure_from(Source("p", "p.toml", HEAD + steps))
        check(procedure, plan(procedure, STAND, TABLE), TABLE)
    for part in (1.001, 1.1, 3.0):
        assert f'step 1 "rock", {axis}: ' in refusal(sine(part / full, frequency, axis))


def test_the_torque_of_a_step_well_within_its_other_limits_counts():
    line = refusal(sine(0.1, 0.1), lambda q, v, a: np.full(q.shape, 1e9))
    assert "torque 1e+09 N m" in line


def test_what_the_sizes_of_terms_tell_is_not_looked_over(monkeypatch):
    """Half a degree at 0.1 Hz; a jerk is looked over as the rate's acceleration."""
    procedure = procedure_from(Source("p", "p.toml", HEAD + sine(0.5, 0.1)))
    planned = plan(procedure, STAND, TABLE)
    monkeypatch.setattr(Motion, "derivative", lambda motion: pytest.fail("looked over"))
    check(procedure, planned, TABLE)
