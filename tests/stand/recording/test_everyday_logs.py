"""Inputs of everyday life in forms that nobody chose: other units, column orders, kinds of file."""

import numpy as np
import pytest
from written_logs import G, at_rest, mcap, ros1_bag, stamps

import stand
from alignment.errors import AlignmentError
from stand.errors import StandError
from stand.recording.log_form import LogForm

N = 6000  # 60 s at 100 Hz
ORDER = ["t", "gx", "gy", "gz", "ax", "ay", "az"]


class Kind:
    """How a log is written, and how it is to be read."""

    def __init__(self, name, write, form):
        self.name, self.write, self.form = name, write, form


def _npz(path, t_ns, w, f):
    """In mg and deg/h, accelerometers first, time last and in microseconds."""
    np.savez(path, accel_mg=f / 9.80665e-3, gyro_deg_h=np.degrees(w) * 3600, time_us=t_ns // 1000)
    return path.with_suffix(".npz") if path.suffix != ".npz" else path


def _csv(path, t_ns, w, f):
    """Decimal commas between semicolons, columns turned about, rates in dps, forces in g."""
    rows = np.c_[f[:, ::-1] / 9.80665, np.degrees(w[:, ::-1]), (t_ns - t_ns[0]) * 1e-6]
    lines = [";".join(f"{x:.12g}" for x in row).replace(".", ",") for row in rows]
    head = "Acc Z [g];Acc Y [g];Acc X [g];Gyro Z [dps];Gyro Y [dps];Gyro X [dps];time [ms]"
    path.write_text("\ufeffBench 7, static\r\n" + "\r\n".join([head, *lines]) + "\r\n", "utf-8")
    return path


def _mat(path, t_ns, w, f):
    """A matrix without names, lying, in single counts of 1e-7."""
    from scipy.io import savemat

    rows = np.c_[(t_ns - t_ns[0]) / 1e9, np.rint(w / 1e-10), f]
    with path.open("wb") as file:
        savemat(file, {"log": rows.T})
    return path


KINDS = [
    Kind("npz", _npz, LogForm()),
    Kind("csv", _csv, LogForm()),
    Kind(
        "mat",
        _mat,
        LogForm(columns=",".join(ORDER), gyro_unit="rad/s", gyro_scale=1e-10, accel_unit="m/s^2"),
    ),
    Kind("bag", ros1_bag, LogForm()),
]
EACH = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
ARRAYS = pytest.mark.parametrize("kind", KINDS[:3], ids=lambda kind: kind.name)


def read(kind, tmp_path, w, f, t_ns=None):
    t_ns = stamps(len(w)) if t_ns is None else t_ns
    return stand.read(kind.write(tmp_path / f"a.{kind.name}", t_ns, w, f), form=kind.form)


@ARRAYS
def test_heading_and_latitude(tmp_path, kind):
    """Decimal commas, header lines, counts, order of columns: heading 30, latitude 48.5."""
    (found,) = stand.align(read(kind, tmp_path, *at_rest(N))).estimates
    # 1e-7 rad/s over 6000 samples against 4.8e-5: 0.0015 deg
    assert np.degrees(found.heading) == pytest.approx(30.0, abs=0.01)
    assert np.degrees(found.latitude) == pytest.approx(48.5, abs=0.01)
    assert found.flags == ()


@ARRAYS
def test_degrees_taken_for_radians(tmp_path, kind):
    w, f = at_rest(N)
    log = read(kind, tmp_path, np.degrees(w), f)
    (found,) = stand.align(log).estimates
    assert any("deg/s for rad/s?" in flag for flag in found.flags)
    with pytest.raises(StandError, match=r"deg/s for rad/s\?"):
        stand.align(log, "inertial", latitude_deg=48.5)


@ARRAYS
def test_gravity_taken_for_a_number(tmp_path, kind):
    w, f = at_rest(N)
    log = read(kind, tmp_path, w, f / G)
    with pytest.raises(StandError, match=r"g for m/s\^2\?"):
        stand.align(log, "inertial", latitude_deg=48.5)


@ARRAYS
def test_a_latitude_of_the_wrong_sign(tmp_path, kind):
    log = read(kind, tmp_path, *at_rest(N, latitude_deg=-33.9))
    with pytest.raises(StandError, match=r"latitude -33\.9 .* stated is 33\.9: its sign"):
        stand.align(log, "fine", latitude_deg=33.9)


@ARRAYS
def test_bursts_and_repeats(tmp_path, kind):
    w, f = at_rest(N)
    t_ns = stamps(N)
    handed = np.repeat(t_ns[3::4], 4) + np.tile(np.arange(4) * 100_000, N // 4)
    log = read(kind, tmp_path, w, f, handed)
    assert [doubt for doubt in log.doubts if "1500 bursts of 4 samples" in doubt]
    twice = np.repeat(np.arange(N // 2), 2)
    log = read(kind, tmp_path, w[twice], f[twice])
    assert [doubt for doubt in log.doubts if "every value stands 2 times" in doubt]


@ARRAYS
def test_lost_samples(tmp_path, kind):
    w, f = at_rest(N)
    there = np.arange(N) % 8 != 0
    log = read(kind, tmp_path, w[there], f[there], stamps(N)[there])
    with pytest.raises(AlignmentError, match=r"749 gaps, one in 7.01 samples"):
        stand.allan(log)


@ARRAYS
def test_a_unit_in_the_hand(tmp_path, kind):
    """Turned to and fro about Y1 by 60 deg: no rest, for either command."""
    w, f = at_rest(N)
    angle = np.radians(60) * np.sin(2 * np.pi * np.arange(N) / 2000)
    w[:, 2] += np.gradient(angle) * 100
    f[:] = np.c_[G * np.sin(angle), G * np.cos(angle), 0 * angle] + 1e-4 * f
    log = read(kind, tmp_path, w, f)
    for ask in (stand.align, stand.allan):
        with pytest.raises((AlignmentError, StandError), match=r"not at rest"):
            ask(log)


@ARRAYS
def test_a_coarse_step(tmp_path, kind):
    """White noise of a sixth of the step: N cannot be told, whatever the file."""
    rng = np.random.default_rng(11)
    step = np.radians(0.0625)
    w = np.radians([0.31, -0.52, 0.12]) + step / 6.25 * rng.standard_normal((N, 3))
    f = np.array([0.5, 9.82, -0.3]) + 0.02 * rng.standard_normal((N, 3))
    found = stand.allan(read(kind, tmp_path, np.round(w / step) * step, f))
    assert "below resolution" in str(found)


def test_a_bag_like_an_mcap(tmp_path):
    """The kinds with messages: the same readings, the same answer to the last digit."""
    w, f = at_rest(1000)
    answers = []
    for write in (mcap, ros1_bag):
        log = stand.read(write(tmp_path / write.__name__, stamps(1000), w, f))
        (found,) = stand.align(log).estimates
        answers.append((found.heading, found.latitude, found.heading_sigma))
    assert answers[0] == answers[1]
    assert np.degrees(answers[0][0]) == pytest.approx(30.0, abs=0.02)
