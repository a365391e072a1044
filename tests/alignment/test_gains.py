"""How answers follow their readings: by hand, level with X1 north, Y1 up, Z1 east at 48.5 deg."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Options, Priors, Site
from alignment.errors import AlignmentError
from alignment.gains import Answer, by_increments, each_alone
from alignment.information import Stretch
from alignment.units import DEG, DEG_PER_HOUR

SITE = Site(48.5 * DEG)
NORTH_RATE = 9.96651 * DEG_PER_HOUR  # methods.md section 0
G = 9.8093587
LEVEL = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
Y1 = np.array([0.0, 1.0, 0.0])
HALF_TURN = LEVEL * Rotation.from_rotvec(np.pi * Y1)
REST = Stretch("rest", 10.0, 30.0, LEVEL)
TURNED = Stretch("turned", 50.0, 30.0, HALF_TURN)
GYRO, ACCEL = slice(0, 3), slice(3, 6)


def answers(name, *stretches, priors=None):
    gains = ESTIMATORS[name].gains
    assert gains is not None
    return gains(stretches, SITE, Options(priors=priors or Priors()))


@pytest.mark.parametrize("name", ["triad", "single-gyro"])
def test_heading_by_the_eastern_gyro(name):
    """An eastern rate that is read too high turns the estimate to the west: -1/(W cos lat)."""
    (answer,) = answers(name, REST)
    assert answer.gain[2, GYRO] == pytest.approx([0, 0, -1 / NORTH_RATE], rel=1e-6, abs=1e-6)
    # Z1 east reads +: it seems lowered, which is a turn about north by 1/g
    assert abs(answer.gain[0, 5]) == pytest.approx(1 / G, rel=1e-6)
    assert abs(answer.gain[1, 3]) == pytest.approx(1 / G, rel=1e-6)
    assert answer.planned == (0,)


def test_offsets_cancel_what_stays():
    (answer,) = answers("six-position", REST)
    assert [s.start for s in answer.stretches] == [10.0, 20.0]
    assert [s.duration for s in answer.stretches] == [10.0, 20.0]
    assert answer.planned == (0, 0)
    stays = np.tile(np.arange(1.0, 7.0), 2)
    assert (answer.gain @ stays).tolist() == [0, 0, 0]
    later = answer.gain[:, 6:]
    assert later[2, GYRO] == pytest.approx([0, 0, -1 / NORTH_RATE], rel=1e-6, abs=1e-6)
    assert answers("six-position", Stretch("short", 0.0, 10.0, LEVEL)) == []


def test_integration_carries_a_rate_for_its_time():
    """20 s of a rate about Y1, which is up, that the first 10 s did not have: 20 s about -D."""
    (answer,) = answers("rk4", REST)
    later = np.concatenate([np.zeros(6), Y1, np.zeros(3)])
    assert answer.gain @ later == pytest.approx([0, 0, -20], abs=1e-14)


def test_half_a_turn_cancels_horizontal_biases():
    """X1 and Z1 change sides: their constant errors leave no heading, half of a change does."""
    priors = Priors(gyro_walk=1e-5, accel_walk=1e-3)
    for name in ("two-position", "multi-position"):
        answer = answers(name, REST, TURNED, priors=priors)[0]
        assert answer.planned == (0, 1)
        per_gyro = answer.gain[2].reshape(2, 6)[:, GYRO]
        assert np.abs(per_gyro.sum(axis=0)[[0, 2]]).max() * NORTH_RATE < 1e-6
        assert per_gyro[:, 2] * NORTH_RATE == pytest.approx([-0.5, 0.5], abs=1e-6)
        assert {label for label in answer.biases if "gyro" in label} >= {
            "gyro bias X1",
            "gyro bias Z1",
        }


def test_a_turn_sees_the_harmonic_alone():
    """Two turns about Y1: constant errors of X1 and Z1, and of Y1, leave no heading."""
    turn = Stretch("turn", 0.0, 60.0, LEVEL, 2 * np.pi / 30, Y1)
    (answer,) = answers("carousel", turn, priors=Priors(gyro_walk=1e-5))
    heading = answer.gain[2].reshape(3, 6)[:, GYRO]  # constant, cosine, sine
    assert np.abs(heading[0, [0, 2]]).max() * NORTH_RATE < 1e-4  # differences are linear to 1e-5
    # the harmonic of both gyros holds north twice: half of each counts
    assert np.abs(heading[1:]).max() * NORTH_RATE == pytest.approx(0.5, rel=1e-4)


def test_what_cannot_be_answered_is_said():
    with pytest.raises(AlignmentError, match="30 deg or more apart"):
        answers("multi-position", REST)
    with pytest.raises(AlignmentError, match="no two successive"):
        answers("two-position", REST, REST)


def test_arrays_are_owned():
    gain = np.zeros((3, 6))
    (answer,) = each_alone([REST], lambda C_nb: gain)
    gain[0, 0] = 1.0
    assert answer.gain[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        answer.gain[0, 0] = 1.0
    with pytest.raises(ValueError, match="window_gain"):
        Answer(label="", stretches=(REST,), planned=(0,), gain=gain, window_gain=np.zeros((3, 12)))


def test_rounded_increments_leave_what_both_ends_of_a_mean_do():
    """q^2/6 over T squared, however often a step comes; of a gain that grows by a tenth a block
    each edge has its own where steps are many, and where there are none three parts of the record
    have theirs together: 40 edges, of which the ends bring 1 and the rest a tenth each."""
    spans, q = np.ones(39), 1e-3
    even = np.ones((39, 1, 3)) / 39
    grows = np.tile(np.arange(1, 40)[:, None, None] / 10, (1, 1, 3))
    for counts, apart in ((1e3, 40), (0.0, 4)):
        moved = np.full((39, 3), counts * q)
        ends = np.full(3, q**2 / 12)
        of_mean = by_increments(even, spans, moved, ends)
        assert of_mean[0, 0] == pytest.approx(3 * q**2 / 6 / 39**2, rel=1e-9)
        own = np.append(np.full(39, -0.1), 3.9)
        parts = own if apart == 40 else own.reshape(-1)[:39].reshape(3, 13).sum(axis=1)
        parts = parts if apart == 40 else np.append(parts, 3.9)
        want = 3 * q**2 / 12 * np.sum(parts**2)
        assert by_increments(grows, spans, moved, ends)[0, 0] == pytest.approx(want, rel=1e-9)
