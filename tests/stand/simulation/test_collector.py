"""Readings sorted by stretch while a run streams: whole samples only, whatever the blocks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stand.motion.plan import PlannedStep, Turning
from stand.physics.mjcf import describe, load_model
from stand.samples import ImuBlock, TruthBlock
from stand.simulation.collector import DwellCollector

RATE = 10  # Hz
NOMINAL = Rotation.from_euler("z", 30, degrees=True)
C_NW = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]  # ENU to NED


def step(label: str, t_from: float, t_to: float, turning: Turning | None = None) -> PlannedStep:
    """A step that is steady from `t_from` to `t_to`, with half a second of ramps around that."""
    kind, ramp = ("dwell", 0.0) if turning is None else ("rate", 0.5)
    times = (t_from - ramp, t_to + ramp, t_from, t_to)
    return PlannedStep(0, kind, label, *times, np.zeros(6), NOMINAL, turning)


def samples(n: int) -> tuple[TruthBlock, ImuBlock]:
    """Sample k ends at (k + 1) / 10 s and says k in every channel; its attitude is k degrees.

    Encoders stand at 10 k + axis, which is not where the joints are.
    """
    k = np.arange(n)
    w = k[:, None] + np.array([0.1, 0.2, 0.3])
    q = Rotation.from_rotvec(np.outer(k, [0, 0, np.pi / 180])).as_quat()
    zeros = np.zeros((n, 6))
    t_ns = (k + 1) * 100_000_000
    encoders = 10.0 * k[:, None] + np.arange(6)
    return TruthBlock(t_ns, -w, -w, q, zeros, zeros, encoders, zeros), ImuBlock(t_ns, w, w * 10)


def collected(dwells: list[PlannedStep], n: int, size: int, begins=None):
    truth, imu = samples(n)
    collector = DwellCollector(dwells, RATE)
    for a in range(0, n, size):
        part = slice(a, a + size)
        collector.add(
            TruthBlock(*(getattr(truth, name)[part] for name in TruthBlock.__slots__)),
            ImuBlock(*(getattr(imu, name)[part] for name in ImuBlock.__slots__)),
        )
    return collector.finish(begins)


@pytest.mark.parametrize("size", [1, 3, 7, 20, 100])
def test_samples_and_attitude_of_each_dwell(size):
    dwells, attitudes = collected([step("A", 0.0, 2.0), step("B", 3.0, 5.0)], 60, size)
    assert [d.label for d in dwells] == ["A", "B"]
    first, second = dwells
    np.testing.assert_allclose(first.readings.t, np.arange(1, 21) / 10, rtol=1e-15)
    # B begins at 3 s: its first whole sample is number 30, from 3.0 to 3.1 s
    np.testing.assert_allclose(second.readings.t, np.arange(31, 51) / 10, rtol=1e-15)
    np.testing.assert_array_equal(second.readings.w_ib_b[0], [30.1, 30.2, 30.3])
    np.testing.assert_array_equal(second.readings.f_b[-1], np.array([49.1, 49.2, 49.3]) * 10)
    # the truth at the end of each: samples 19 and 49
    for C_nb, angle in zip(attitudes, (19, 49), strict=True):
        hand = C_NW @ Rotation.from_euler("z", angle, degrees=True).as_matrix()
        np.testing.assert_allclose(C_nb.as_matrix(), hand, rtol=0, atol=1e-15)
    assert first.nominal is NOMINAL
    assert (second.t_from, second.t_to) == (3.0, 5.0)


@pytest.mark.parametrize(
    ("t_from", "t_to", "first", "count"),
    [
        (0.3, 2.25, 0.4, 19),  # 0.3 is a sample's end; 2.25 cuts one short
        (0.34, 2.3, 0.5, 19),  # 0.34 lies within a sample, which is left out
        (1.0, 1.2, 1.1, 2),
    ],
)
def test_samples_that_straddle_an_edge_are_left_out(t_from, t_to, first, count):
    (dwell,), _ = collected([step("A", t_from, t_to)], 60, 9)
    assert dwell.readings.t[0] == pytest.approx(first, rel=1e-15)
    assert len(dwell.readings) == count
    assert len(dwell.window()) == count


def test_dwells_that_touch_share_no_sample():
    (a, b), _ = collected([step("A", 1.0, 2.0), step("B", 2.0, 4.0)], 60, 7)
    assert a.readings.t[-1] == pytest.approx(2.0, rel=1e-15)
    assert b.readings.t[0] == pytest.approx(2.1, rel=1e-15)
    assert (len(a.readings), len(b.readings)) == (10, 20)


def test_readings_are_read_only():
    (dwell,), _ = collected([step("A", 1.0, 2.0)], 30, 7)
    with pytest.raises(ValueError, match="read-only"):
        dwell.readings.w_ib_b[0] = 0.0


@pytest.mark.parametrize("size", [1, 7, 100])
def test_a_turning_stretch_has_the_encoder_angles_of_its_axis(size):
    turning = Turning(4, 0.1, np.array([0.0, 0.6, 0.8]))
    (dwell,), _ = collected([step("turn", 1.0, 2.0, turning)], 60, size)
    assert dwell.turn is not None
    np.testing.assert_array_equal(dwell.turn.axis_b, [0.0, 0.6, 0.8])
    np.testing.assert_allclose(dwell.readings.t, np.arange(11, 21) / 10, rtol=1e-15)
    np.testing.assert_array_equal(dwell.turn.angle, 10.0 * np.arange(10, 20) + 4)


def test_a_dwell_counts_once_settled_and_never_if_never():
    turning = Turning(2, 0.1, np.array([0.0, 1.0, 0.0]))
    steps = [step("A", 0.0, 2.0), step("B", 3.0, 4.0), step("C", 4.5, 5.5, turning)]
    begins = {"A": 0.75, "B": None, "C": 5.0}
    (first, last), attitudes = collected(steps, 60, 13, begins)
    assert (first.label, first.t_from, first.t_to) == ("A", 0.75, 2.0)
    # the first whole sample after 0.75 s is from 0.8 to 0.9 s
    np.testing.assert_allclose(first.readings.t, np.arange(9, 21) / 10, rtol=1e-15)
    assert (last.label, len(attitudes)) == ("C", 2)
    np.testing.assert_allclose(last.readings.t, np.arange(51, 56) / 10, rtol=1e-15)
    np.testing.assert_array_equal(last.turn.angle, 10.0 * np.arange(50, 55) + 2)


def test_the_true_attitude_of_a_moving_stretch_at_any_sample():
    truth, imu = samples(60)
    collector = DwellCollector([step("A", 0.0, 2.0), step("B", 3.0, 5.0)], RATE, moving=["B"])
    collector.add(truth, imu)
    assert collector.true_at("A", np.array([1.0])) is None
    found = collector.true_at("B", np.array([3.1, 4.0, 5.0]))
    # sample k ends at (k + 1) / 10 s and is turned by k degrees about up
    for C_nb, degrees in zip(found, (30, 39, 49), strict=True):
        turned = Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
        np.testing.assert_allclose(C_nb.as_matrix(), np.array(C_NW) @ turned, atol=1e-14)


def test_what_lies_in_a_file_has_the_bits_of_what_lies_in_memory(monkeypatch, tmp_path):
    truth, imu = samples(60)

    def answers():
        steps = [step("A", 0.0, 2.0), step("B", 3.0, 5.0)]
        collector = DwellCollector(steps, RATE, moving=["B"], folder=tmp_path)
        for part in (slice(0, 7), slice(7, 45), slice(45, 60)):
            collector.add(truth.part(part), imu.part(part))
        track = collector.true_at("B", np.array([2.0, 3.1, 4.05, 5.0, 9.0]))
        dwells, attitudes = collector.finish({"B": 3.5})
        kept = [a for d in dwells for a in (d.readings.t, d.readings.w_ib_b, d.readings.f_b)]
        found = [*kept, track.as_quat(), *(C.as_quat() for C in attitudes)]
        return [a.tobytes() for a in found], len(dwells[1].readings)

    whole = answers()
    monkeypatch.setattr("stand.room.IN_MEMORY", 0)
    assert answers() == whole
    assert whole[1] == 15  # of 2 s at 10 Hz, from half a second later on


@pytest.mark.parametrize("size", [1, 3, 7, 20, 100])
@pytest.mark.parametrize("axis", [None, 4])
def test_encoders_tell_where_the_axes_stood_by_their_second_half(size, axis):
    """Samples 30 to 49: the second ten say 10 k + axis, on the mean 445 + axis milliradians; the
    one that turns counts for nothing."""
    truth, imu = samples(60)
    truth = replace(truth, encoders=truth.encoders * 1e-3)
    turning = None if axis is None else Turning(axis, 1.0, np.array([0.0, 1.0, 0.0]))
    stand = describe(load_model())
    collector = DwellCollector([step("A", 3.0, 5.0, turning)], RATE, stand=stand)
    for a in range(0, 60, size):
        part = slice(a, a + size)
        collector.add(
            TruthBlock(*(getattr(truth, name)[part] for name in TruthBlock.__slots__)),
            ImuBlock(*(getattr(imu, name)[part] for name in ImuBlock.__slots__)),
        )
    (dwell,), _ = collector.finish()
    assert dwell.joints is not None
    by_hand = 0.445 + 1e-3 * np.arange(6)
    if axis is not None:
        by_hand[axis] = 0.0
    np.testing.assert_allclose(dwell.joints.angles, by_hand, rtol=1e-12)
    assert dwell.joints.going_round == (-1 if axis is None else axis)
