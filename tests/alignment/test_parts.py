"""Records that are longer than memory: in parts the same bits, and the memory comes back."""

import mmap
import tempfile
from pathlib import Path

import numpy as np
import pytest

from alignment import noise, parts, sampling, saturation, strapdown
from alignment.arrays import owned
from alignment.readings import ImuReadings

N = 5003


@pytest.fixture
def values():
    return 5.0 + np.random.default_rng(0).standard_normal((N, 3))


@pytest.fixture
def small(monkeypatch):
    """Parts of 512 rows; a record is still held as a whole where all is needed at once."""
    monkeypatch.setattr(parts, "PART", 512)


def mapped(shape):
    with tempfile.TemporaryFile() as file:
        size = int(np.prod(shape)) * 8
        file.truncate(size)
        return np.ndarray(shape, float, mmap.mmap(file.fileno(), size))


def resident_kb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("RssFile")))


def test_a_mean_in_parts_has_the_bits_of_one(small, values):
    assert parts.mean(values).tobytes() == values.mean(axis=0).tobytes()


@pytest.mark.parametrize("blocks", [1, 2, 7, 1000, N])
def test_sums_in_parts_have_the_bits_of_one(small, values, blocks):
    edges = np.arange(blocks + 1) * N // blocks
    whole = np.add.reduceat(values, edges[:-1], axis=0)
    assert parts.sums_between(values, edges).tobytes() == whole.tobytes()


def test_excerpts_are_all_or_spread_evenly(monkeypatch, values):
    (whole,) = parts.excerpts(values)
    assert whole is values
    monkeypatch.setattr(parts, "MOST", 1000)
    monkeypatch.setattr(parts, "_EXCERPT", 100)
    some = parts.excerpts(values)
    assert [len(one) for one in some] == [100] * 10
    np.testing.assert_array_equal(some[0], values[:100])
    np.testing.assert_array_equal(some[-1], values[-100:])


def rounded(values):
    """A channel that is rounded, and clipped on one side only."""
    return np.minimum(np.rint(values * 20) / 20, 6.5)


def answers(values):
    t = np.arange(1, N + 1) / 100.0
    t[3000:] += 1.0  # a gap
    readings = ImuReadings(t, rounded(values) * 1e-3, values)
    with pytest.raises(saturation.Saturated) as clipped:
        saturation.saturation_doubt("rest", readings)
    carried = strapdown.carry(readings, 0.5)
    found = [
        noise.mean_variance(values),
        noise.block_means(values, 50),
        carried.q,
        carried.v,
        np.array([sampling.step_of(rounded(values[:, k])) for k in range(3)]),
    ]
    return [one.tobytes() for one in found], noise.gap_doubt(readings), str(clipped.value)


def test_answers_do_not_depend_on_the_parts(monkeypatch, values):
    whole = answers(values)
    monkeypatch.setattr(parts, "PART", 512)
    assert answers(values) == whole
    assert whole[1] == ("gap of 1.01 s after 30.000 s",)


def test_of_excerpts_the_answers_are_nearly_those_of_all(monkeypatch, values):
    noise.check_rest(ImuReadings(np.arange(N) / 100, 1e-3 * values, values), "rest")
    whole, told, clipped = answers(values)
    monkeypatch.setattr(parts, "MOST", 1000)
    monkeypatch.setattr(parts, "_EXCERPT", 100)
    some, told_of_some, clipped_of_some = answers(values)
    assert (told_of_some, clipped_of_some) == (told, clipped)
    assert some[:-1] == whole[:-1]  # sums are of all rows
    steps = [np.frombuffer(one[-1]) for one in (some, whole)]
    np.testing.assert_allclose(*steps, rtol=1e-12)  # 0.05, from fewer levels


def test_stamps_that_go_back_are_found_at_the_edge_of_a_part(small, values):
    t = np.arange(N) / 100.0
    t[512] = t[511]
    with pytest.raises(ValueError, match=r"t: sample 512 at 5\.11\d* s does not come after 5\.11"):
        ImuReadings(t, values, values)


def test_what_is_mapped_is_taken_as_it_is_and_given_back():
    rows = 2 * parts.PART
    array = mapped((rows, 3))
    array[:] = 1.0
    array.flags.writeable = False
    parts.release(array)
    before = resident_kb()
    assert owned(array, "f", (None, 3)) is array
    np.testing.assert_array_equal(parts.mean(array), [1.0, 1.0, 1.0])
    # 48 MB lie in the file; what stays is less than a part, 24 MB
    assert resident_kb() - before < 24_000
    array.sum()
    assert resident_kb() - before > 40_000
    parts.release(array)
    assert resident_kb() - before < 1_000


def test_few_rows_and_equal_rows_of_a_file_are_those_of_an_array(tmp_path):
    values = np.arange(5000.0 * 2).reshape(5000, 2)
    values.tofile(tmp_path / "values")
    mapped = np.memmap(tmp_path / "values", float, "r", shape=values.shape)
    rows = np.arange(0, 5000, 2)  # more than are taken at once
    np.testing.assert_array_equal(parts.taken(mapped, rows), values[rows])
    other = values.copy()
    assert parts.equal(mapped, other)
    other[-1, 1] += 1.0
    assert not parts.equal(mapped, other)
    assert not parts.equal(mapped, values[:-1])
