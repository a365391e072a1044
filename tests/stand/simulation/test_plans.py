"""Rests begin where a unit's readings no longer show the move before them, in runs and ahead."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.units import DEG_PER_HOUR
from stand.errors import StandError
from stand.imu import ImuSpec, load_imu
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import procedure_from, table_of
from stand.rehearsal.rehearse import prepared, rehearse
from stand.samples import Sampling
from stand.simulation.monte_carlo import Trials
from stand.simulation.plans import plan_of
from stand.simulation.settings import Settings, assembled
from stand.simulation.simulation import Simulation
from stand.toml_files import Source

STAND = describe(load_model())
PERFECT = load_imu("ideal")
# 163.8 deg at 60 deg/s, 60 deg/s^2, 240 deg/s^3 take 163.8/60 + 1 + 0.25 = 3.98 s
CASE = """title = "Late"
[site]
latitude_deg = 45
[estimate]
methods = ["triad"]
[move_limits]
rate_deg_s = 60
acceleration_deg_s2 = 60
jerk_deg_s3 = 240
[[step]]
kind = "dwell"
label = "A"
duration_s = 5
[[step]]
kind = "move"
label = "M"
joints_deg = {{ outer = {angle} }}
[[step]]
kind = "dwell"
label = "B"
duration_s = {rest}
"""
ARRIVAL = 8.98  # s; B begins at 9


def late(latency: float = 0.0, gyro: float = np.inf, accel: float = np.inf) -> ImuSpec:
    return replace(
        PERFECT,
        clock=replace(PERFECT.clock, latency=latency),
        gyro=replace(PERFECT.gyro, bandwidth=gyro),
        accel=replace(PERFECT.accel, bandwidth=accel),
    )


def settings_of(
    unit: ImuSpec, rate_hz: int, rest: float = 5.0, angle: float = 163.8, **told
) -> Settings:
    procedure = procedure_from(Source("late", "late.toml", CASE.format(rest=rest, angle=angle)))
    return assembled(procedure, unit, table_of(procedure), rate_hz=rate_hz, true_table=True, **told)


@pytest.mark.parametrize(
    ("unit", "rate_hz", "begins"),
    [
        (late(), 20, 9.0),
        (late(0.015), 20, 9.0),  # the latency is over by then
        (late(0.09), 20, 9.1),  # the first sample from 9.07 s on
        (late(0.09), 200, ARRIVAL + 0.09),
        (late(0.0901), 200, ARRIVAL + 0.095),
        # 3.11 over the slower bandwidth: exp(-3.11 * 2 pi / sqrt 2) is 1.0e-6; and a sample
        (late(0.0, 5.0), 200, ARRIVAL + 0.625 + 0.005),
        (late(0.09, 10.0, 5.0), 100, ARRIVAL + 0.09 + 0.63 + 0.01),
        (late(0.0, 300.0), 200, 9.0),  # over by then
    ],
)
def test_a_rest_begins_when_its_move_is_no_longer_seen(unit, rate_hz, begins):
    made = settings_of(unit, rate_hz)
    for planned in (Simulation(made).plan, prepared(made).plan, plan_of(made, STAND, 7)):
        first, _, second = planned.steps
        assert (first.steady_from, first.steady_to, second.steady_to) == (0.0, 5.0, 14.0)
        assert second.steady_from == pytest.approx(begins, abs=1e-9)
        assert second.t_from == 9.0


def test_plans_of_units_that_are_not_late_are_the_planners_own():
    made = settings_of(late(), 20)
    own = plan(made.procedure, STAND, made.table, 0)
    assert own.read_late(0.0, 20) is own


@pytest.mark.parametrize("sampling", Sampling)
@pytest.mark.parametrize("rate_hz", [2, 5, 200])
@pytest.mark.parametrize("unit", [late(0.09), late(0.0, 4.0, 6.0), late(0.05, 10.0, 3.0)])
def test_no_sample_of_a_rest_shows_the_move(unit, rate_hz, sampling):
    """Perfect sensors read the same throughout: to 0.2 % of Earth rate, and to 2 ug of force.

    A sample of half a second that began 90 ms too soon would have 240 (0.07)^3 / 6 deg of the
    move in it: 100 deg/h.
    """
    (first, second), _ = Trials(settings_of(unit, rate_hz, sampling=sampling)).readings(0)
    for dwell, least in ((first, 5.0), (second, 3.5)):
        readings = dwell.window()
        assert len(readings) >= least * rate_hz - 2
        w, f = readings.w_ib_b, readings.f_b
        assert np.abs(w - w[-1]).max() < 0.03 * DEG_PER_HOUR
        assert np.abs(f - f[-1]).max() < 2e-5


def test_the_sample_that_a_move_ends_in_counts_whole():
    """138 deg end at 8.55 s, and 3.11/9.9 s later is before 9 s; but to the filter the sample
    until then is a parabola, and the next one would show how that ended: by 2 deg/h."""
    made = settings_of(late(0.0, 9.9), 2, angle=138.0)
    assert made.unit.filtered
    (_, second), _ = Trials(made).readings(0)
    assert second.t_from == 9.5  # at the first sample from 8.55 + 3.11 / 9.9 + 0.5 s on
    w = second.window().w_ib_b
    assert len(w) == 9
    assert np.abs(w - w[-1]).max() < 0.03 * DEG_PER_HOUR


def test_a_rehearsal_tells_how_long_a_rest_is_not_to_be_had():
    *_, move, rest = rehearse(settings_of(late(0.09), 20)).duration.steps
    assert move.settling == pytest.approx(9.0 - ARRIVAL)
    assert (rest.settling, rest.dwell) == (pytest.approx(0.1), pytest.approx(4.9))


def test_a_rest_that_is_over_before_is_refused():
    """0.09 s late from 8.98 s, the next sample from 9.5 s on and three of them: 0.5 + 1.5 s."""
    kept, short = (settings_of(late(0.09), 2, rest) for rest in (2.0, 1.99))
    assert Simulation(kept).plan.steps[-1].steady_from == 9.5
    with pytest.raises(StandError) as caught:
        Simulation(short)
    told = "duration_s = 1.99: must be 2 or more at 2 Hz: latency and low-pass show the move"
    assert told in str(caught.value)
    (finding,) = rehearse(short).findings
    assert told in finding.text
