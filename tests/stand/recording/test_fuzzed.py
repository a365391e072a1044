"""20 000 damaged logs and texts of every kind, more of them by `make fuzz`; and any bytes."""

from pathlib import Path

import fuzzed
import fuzzed_texts
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

# about a millisecond each; most of what a person gets from others, and of what is quick
LOGS = {"text": 2500, "MCAP": 4500, "bag": 300, "npy": 400, "npz": 400, "mat": 300}
TEXTS = {"TOML": 1000, "planned": 100, "metadata": 2500, "result": 4500, "columns": 3500}

QUICK = 500  # of a kind in quick tests, the rest in slow ones

# What a damaged file begins with, so that the rest is taken for what it says
HEADS = {
    "MCAP": b"\x89MCAP0\r\n",
    "bag": b"#ROSBAG V2.0\n",
    "npy": b"\x93NUMPY\1\0",
    "npz": b"PK\3\4",
    "mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM",
    "zstd": b"\x28\xb5\x2f\xfd",
    "lz4": b"\x04\x22\x4d\x18",
    "gzip": b"\x1f\x8b\x08",
    "parquet": b"PAR1",
    "ulog": b"ULog\x01\x12\x35\x01",
    "text": b"t,gx\n",
}


def test_there_are_20_000_of_them() -> None:
    assert sum(LOGS.values()) + sum(TEXTS.values()) == 20_000


def damaged_logs(folder: Path, kind: str, cases: range) -> None:
    found = fuzzed.run(kind, len(cases), folder, seed=11, first=cases.start)
    assert found["read"] + found["refused"] == len(cases)
    assert found["refused"] > len(cases) // 4  # the damage is such that it shows


def damaged_texts(folder: Path, kind: str, cases: range) -> None:
    found = fuzzed.run(kind, len(cases), folder, seed=12, first=cases.start)
    assert found["refused"] > len(cases) // 8


@pytest.mark.parametrize("kind", LOGS)
def test_damaged_logs_are_read_or_refused(tmp_path: Path, kind: str) -> None:
    damaged_logs(tmp_path, kind, range(LOGS[kind])[:QUICK])


@pytest.mark.parametrize("kind", fuzzed_texts.KINDS)
def test_damaged_texts_are_taken_or_refused(tmp_path: Path, kind: str) -> None:
    damaged_texts(tmp_path, kind, range(TEXTS[kind])[:QUICK])


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in LOGS if LOGS[kind] > QUICK])
def test_all_other_damaged_logs_are_read_or_refused(tmp_path: Path, kind: str) -> None:
    damaged_logs(tmp_path, kind, range(LOGS[kind])[QUICK:])


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in TEXTS if TEXTS[kind] > QUICK])
def test_all_other_damaged_texts_are_taken_or_refused(tmp_path: Path, kind: str) -> None:
    damaged_texts(tmp_path, kind, range(TEXTS[kind])[QUICK:])


@settings(max_examples=150, suppress_health_check=list(HealthCheck), deadline=None)
@given(head=st.sampled_from(sorted(HEADS)), tail=st.binary(max_size=120))
def test_any_bytes_behind_a_known_beginning(tmp_path: Path, head: str, tail: bytes) -> None:
    path = tmp_path / "a"
    path.write_bytes(HEADS[head] + tail)
    with fuzzed.limited():
        assert (
            fuzzed.outcome(path, fuzzed.FORM if head == "npy" else fuzzed.CLEAR, True) == "refused"
        )


def test_the_damage_is_the_same_each_time_and_differs_from_case_to_case() -> None:
    data = bytes(1000)
    cases = [fuzzed.damaged(data, np.random.default_rng([0, k])) for k in range(50)]
    assert cases == [fuzzed.damaged(data, np.random.default_rng([0, k])) for k in range(50)]
    assert len(set(cases)) > 40
