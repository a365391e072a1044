"""What messages say beside their readings: whose they are, when they came, that they have none."""

import numpy as np
import pytest
from written_logs import at_rest, mcap, ros1_bag, stamps

import stand
from stand.errors import StandError
from stand.recording.entrance import read_imu
from stand.recording.log_form import LogForm
from stand.recording.mcap import cdr
from stand.recording.mcap.decode import frame_ids

N = 1600  # 16 s at 100 Hz
W, F = at_rest(N)
T_NS = stamps(N)
WRITERS = pytest.mark.parametrize("write", [mcap, ros1_bag])


@WRITERS
def test_two_units_on_one_topic(tmp_path, write):
    """Interleaved, turned by 180 deg about Y1: their mean would be neither's attitude."""
    turned = np.array([-1.0, 1.0, -1.0])
    which = np.arange(N) % 2 == 1
    w, f = np.where(which[:, None], W * turned, W), np.where(which[:, None], F * turned, F)
    path = write(tmp_path / "a", T_NS, w, f, frames=("left", "right"))
    with pytest.raises(StandError, match=r"/imu/raw: messages of left, right \(frame_id\) share"):
        stand.read(path)
    with pytest.raises(StandError, match=r"unknown frame_id 'middle': known: left, right"):
        read_imu(path, form=LogForm(frame="middle"))
    for frame, heading in (("left", 30.0), ("right", 210.0)):
        log = stand.read(path, form=LogForm(frame=frame))
        assert len(log.imu) == N // 2
        (found,) = stand.align(log).estimates
        # 1e-7 rad/s over 800 samples against 4.8e-5 rad/s of the horizontal Earth rate: 0.004 deg
        assert np.degrees(found.heading) % 360 == pytest.approx(heading, abs=0.03)


@WRITERS
def test_a_unit_that_says_it_has_no_rates(tmp_path, write):
    """covariance[0] = -1: refused where there is nothing, said where there is something."""
    path = write(tmp_path / "a", T_NS[:200], 0 * W, F, none=(-1.0, 0.0))
    with pytest.raises(StandError, match=r"angular_velocity_covariance\[0\] = -1 and angular_vel"):
        stand.read(path)
    path = write(tmp_path / "b", T_NS[:200], W, F, none=(0.0, -1.0))
    log = stand.read(path)
    told = "linear_acceleration_covariance[0] = -1 says that there is no linear_acceleration"
    assert [doubt for doubt in log.doubts if told in doubt]
    (found,) = stand.align(log).estimates
    assert any(told in flag for flag in found.flags)


@WRITERS
def test_header_or_log(tmp_path, write):
    """A unit whose clock counts 1.024 as fast as the computer's: both ways, and said."""
    header = T_NS[0] + (T_NS - T_NS[0]) * 1024 // 1000
    path = write(tmp_path / "a", header, W, F, log_ns=T_NS)
    log = read_imu(path)
    np.testing.assert_array_equal(log.t_ns, header)
    # 1599 steps of 10.24 and of 10 ms
    assert log.doubts == (
        "the header stamps span 16.3738 s, the messages were written in 15.99 s: which clock is "
        "right? (--stamps log)",
    )
    log = read_imu(path, form=LogForm(stamps="log"))
    np.testing.assert_array_equal(log.t_ns, T_NS)


@WRITERS
def test_headers_that_nobody_filled(tmp_path, write):
    path = write(tmp_path / "a", 0 * T_NS[:300], W, F, log_ns=T_NS)
    with pytest.raises(StandError, match=r"the header stamps are all 0: --stamps log takes when"):
        read_imu(path)
    np.testing.assert_array_equal(read_imu(path, form=LogForm(stamps="log")).t_ns, T_NS[:300])


def test_headers_that_say_they_are_right_are_not_doubted(tmp_path):
    """Arrival jitters by milliseconds and is a little late: that is what it does."""
    late = T_NS + np.random.default_rng(3).integers(0, 4_000_000, N)
    assert read_imu(mcap(tmp_path / "a", T_NS, W, F, log_ns=np.sort(late))).doubts == ()


def test_beyond_so_many_units_a_message_is_of_none():
    """33 frame_ids are told apart: messages of others count for nobody, not for one of these."""
    zero = np.zeros((1, 3))
    rows = [
        cdr.imu_messages(np.array([k]), zero, zero, frame_id=f"f{k:02d}").tobytes()
        for k in range(40)
    ]
    data = np.frombuffer(b"".join(rows), np.uint8)
    names, which = frame_ids(data, np.arange(40) * len(rows[0]))
    assert names == [f"f{k:02d}" for k in range(33)]
    assert which.tolist() == [*range(33), *[-1] * 7]


def test_a_frame_id_without_a_byte_is_no_name():
    """Some write an empty text without its end: a length of 0."""
    row = cdr.imu_messages(np.array([7]), np.zeros((1, 3)), np.zeros((1, 3)), frame_id="a")
    data = np.frombuffer(row.tobytes() * 3, np.uint8).copy()
    size = len(row.tobytes())
    for start in (0, 2 * size):
        data[start + 12 : start + 16] = 0  # behind four bytes of encapsulation and the stamp
    names, which = frame_ids(data, np.arange(3) * size)
    assert (names, which.tolist()) == (["", "a"], [0, 1, 0])
