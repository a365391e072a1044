"""Files that are compressed as a whole: zstd, lz4, gzip."""

import gzip
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard

from stand.errors import StandError

_BLOCK = 1 << 20
_WINDOW = 1 << 27  # bytes that zstd may look back, as its own tool allows
_MOST_RATIO = 500  # logs come to a tenth; more is no log but a trap
_ALWAYS = 64 << 20  # bytes that are not counted so


def _zstd(file: BinaryIO) -> Any:
    return zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(
        file, read_across_frames=True
    )


_OPEN: dict[str, Callable[[BinaryIO], Any]] = {
    "zstd": _zstd,
    "lz4": lambda file: lz4.frame.open(file, "rb"),
    "gzip": lambda file: gzip.GzipFile(fileobj=file),
}


def expand(path: Path, kind: str, out: Path) -> None:
    """Write what a compressed file holds to `out`.

    Raises
    ------
    StandError
        Damaged, cut off, or far larger than any log compresses to.
    """
    most = max(_ALWAYS, _MOST_RATIO * path.stat().st_size)
    total = 0
    try:
        with path.open("rb") as file, closing(_OPEN[kind](file)) as whole, out.open("wb") as target:
            while block := whole.read(_BLOCK):
                total += len(block)
                if total > most:
                    raise StandError(
                        f"{path}: expands to more than {most} bytes, {_MOST_RATIO} times its size: "
                        "no log does"
                    )
                target.write(block)
    except (zstandard.ZstdError, RuntimeError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise StandError(f"{path}: damaged: {kind} cannot expand it: {error}") from error
