"""Pictures into a film: the one door to PyAV."""

# PyAV is an extra: it need not be installed where types are checked.
# pyright: reportMissingImports=false

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError, unknown

if TYPE_CHECKING:
    from av import VideoFrame

Image = NDArray[np.uint8]
LEVELS = 6  # of each colour of a GIF: 6 x 6 x 6 colours and 40 greys
BITS = 6  # of each part of a colour that choose among those
MISSING = "is not installed: pip install 'imu-test-stand[film]'"


@dataclass(frozen=True, slots=True)
class Kind:
    """How a kind of file is written: `rate` pictures a second, at most."""

    container: str
    codec: str
    pixels: str
    rate: Fraction
    options: Mapping[str, str] = field(default_factory=dict)
    container_options: Mapping[str, str] = field(default_factory=dict)


KINDS: Mapping[str, Kind] = {
    ".mp4": Kind(
        container="mp4", codec="libx264", pixels="yuv420p", rate=Fraction(25),
        options={"crf": "20", "preset": "veryfast", "tune": "animation"},
        container_options={"movflags": "+faststart"},
    ),
    # a GIF counts hundredths of a second
    ".gif": Kind(container="gif", codec="gif", pixels="pal8", rate=Fraction(25, 2)),
    ".webp": Kind(
        container="webp", codec="libwebp_anim", pixels="yuv420p", rate=Fraction(25, 2),
        options={"quality": "70", "compression_level": "3"}, container_options={"loop": "0"},
    ),
}  # fmt: skip


def kind_of(path: Path) -> Kind:
    """How the file of that name is written.

    Raises
    ------
    StandError
        Its ending is none of `KINDS`.
    """
    if path.suffix.lower() not in KINDS:
        raise unknown(f"--out {path}: kind of film", path.suffix.lower(), KINDS)
    return KINDS[path.suffix.lower()]


def require_encoder() -> None:
    """`StandError` where PyAV is not installed: before anything is drawn."""
    try:
        import av  # noqa: F401
    except ModuleNotFoundError as error:
        raise StandError(f"av {MISSING}") from error


def encode(path: Path, images: Iterable[Image], kind: Kind, rate: Fraction) -> int:
    """Write a film.

    Parameters
    ----------
    path : Path
        The file, whatever its ending.
    images : iterable of (height, width, 3) uint8
        All of one size, even in both; taken one by one.
    kind : Kind
    rate : Fraction
        Pictures a second.

    Returns
    -------
    int
        How many pictures there were.
    """
    import av

    images = iter(images)
    first = list(islice(images, 1))
    count = 0
    options = dict(kind.container_options)
    with av.open(str(path), "w", format=kind.container, container_options=options) as file:
        stream: Any = file.add_stream(kind.codec, rate=rate, options=dict(kind.options))
        stream.height, stream.width = first[0].shape[:2]
        stream.pix_fmt = kind.pixels
        stream.time_base = 1 / rate
        for count, image in enumerate(chain(first, images), 1):
            frame = _frame(image, kind.pixels)
            frame.pts, frame.time_base = count - 1, 1 / rate
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return count


def decode(path: Path) -> tuple[list[Image], float]:
    """The pictures of a film, and how long it takes [s]."""
    import av

    with av.open(str(path)) as file:
        frames = list(file.decode(video=0))
    images = [np.asarray(frame.to_ndarray(format="rgb24"), np.uint8) for frame in frames]
    step = frames[1].time - frames[0].time if len(frames) > 1 else 0.0
    return images, frames[-1].time - frames[0].time + step


def _frame(image: Image, pixels: str) -> VideoFrame:
    from av import VideoFrame

    if pixels != "pal8":
        return VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
    indexed: Any = (_indices(image), _palette())
    return VideoFrame.from_ndarray(indexed, format="pal8")


# One palette for all films: no picture flickers against the one before.
_GREYS = 256 - LEVELS**3
_DROPPED = 8 - BITS


def _palette() -> NDArray[np.uint8]:
    """(256, 4) alpha, red, green, blue."""
    steps = np.arange(LEVELS) * 255 // (LEVELS - 1)
    cube = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    greys = np.repeat(np.linspace(0, 255, _GREYS).round()[:, None], 3, axis=1)
    colours = np.concatenate([cube, greys]).astype(np.uint8)
    return np.column_stack([np.full(256, 255, np.uint8), colours])


def _indices(image: Image) -> NDArray[np.uint8]:
    """Of each point the colour of the palette: looked up, by the first `BITS` bits of each part."""
    cell = (image[..., 0] >> _DROPPED).astype(np.uint32)
    for part in (1, 2):
        cell <<= BITS
        cell |= image[..., part] >> _DROPPED
    return _nearest().take(cell)


@cache
def _nearest() -> NDArray[np.uint8]:
    """Of each cell (2^(3 BITS),) the nearest colour of the cube, or the grey where that is nearer.

    To find it for each point of a picture took 20 times as long as to look it up: half of a GIF.
    """
    level = np.arange(1 << BITS)
    value = level << _DROPPED | level >> (BITS - _DROPPED)  # black and white stay what they are
    wide = np.stack(np.meshgrid(value, value, value, indexing="ij"), axis=-1).reshape(-1, 3)
    step = (wide * (LEVELS - 1) + 127) // 255
    cube = (step[:, 0] * LEVELS + step[:, 1]) * LEVELS + step[:, 2]
    mean = wide.mean(axis=1)
    off_cube = np.abs(wide - step * (255 // (LEVELS - 1))).sum(axis=1)
    off_grey = np.abs(wide - mean[:, None]).sum(axis=1)
    grey = LEVELS**3 + (mean * (_GREYS - 1) / 255).round().astype(int)
    return np.where(off_grey < off_cube, grey, cube).astype(np.uint8)
