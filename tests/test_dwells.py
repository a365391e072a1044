"""Readings sorted by dwell while a run streams: whole samples only, whatever the blocks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stand.dwells import DwellCollector
from stand.plan import PlannedStep
from stand.samples import ImuBlock, TruthBlock

RATE = 10  # Hz
NOMINAL = Rotation.from_euler("z", 30, degrees=True)
C_NW = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]  # ENU to NED


def step(label: str, t_from: float, t_to: float) -> PlannedStep:
    return PlannedStep("dwell", label, t_from, t_to, np.zeros(6), NOMINAL)


def samples(n: int) -> tuple[TruthBlock, ImuBlock]:
    """Sample k ends at (k + 1) / 10 s and says k in every channel; its attitude is k degrees."""
    k = np.arange(n)
    w = k[:, None] + np.array([0.1, 0.2, 0.3])
    q = Rotation.from_rotvec(np.outer(k, [0, 0, np.pi / 180])).as_quat()
    zeros = np.zeros((n, 6))
    t_ns = (k + 1) * 100_000_000
    return TruthBlock(t_ns, -w, -w, q, zeros, zeros), ImuBlock(t_ns, w, w * 10)


def collected(dwells: list[PlannedStep], n: int, size: int):
    truth, imu = samples(n)
    collector = DwellCollector(dwells, RATE)
    for a in range(0, n, size):
        part = slice(a, a + size)
        collector.add(
            TruthBlock(*(getattr(truth, name)[part] for name in TruthBlock.__slots__)),
            ImuBlock(*(getattr(imu, name)[part] for name in ImuBlock.__slots__)),
        )
    return collector.finish()


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
