"""The .rrd as a file: encoded in memory, written, read back."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from stand.errors import StandError

DEADLINE_S = 20.0
"""For rerun to encode what it was given, which takes a fraction of a second."""


def open_stream(run_id: str) -> tuple[rr.RecordingStream, rr.BinaryStream]:
    """A stream into memory, and where its bytes can be read at the end.

    Not into the file: rerun writes that in a thread of its own, and where this fails (the disk is
    full) it says so on the terminal, then either waits for ever or leaves a file without its end.
    """
    stream = rr.RecordingStream("imu_test_stand", recording_id=run_id, send_properties=False)
    if not rr.is_enabled(stream):
        raise StandError("rerun is switched off: unset the environment variable RERUN")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream, stream.binary_stream()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Faults of the disk and of rerun's encoder are told with the file's name."""
    try:
        yield
    except OSError as error:
        raise StandError(f"{path}: cannot be written: {error.strerror}") from error
    except (RuntimeError, RerunWarning) as error:
        raise StandError(f"{path}: cannot be written: {error}") from error


def check(path: Path, size: int, chunks: int) -> None:
    """The file has all its bytes, its footer and at least the `chunks` that were sent."""
    there = path.stat().st_size
    if there != size:
        raise StandError(f"{path}: cannot be written: {there} bytes are there, must be {size}")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RerunWarning)  # of a file without footer
        found = sum(1 for _ in RrdReader(path).stream())
    if found < chunks:
        raise StandError(f"{path}: cannot be written: {found} chunks, must be {chunks} or more")
