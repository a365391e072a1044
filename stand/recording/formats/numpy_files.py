"""NumPy's .npy and .npz: arrays, whose sizes are held against the file before they are made."""

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from stand.errors import StandError
from stand.recording.formats.extras import damaged
from stand.recording.formats.table import ArrayTable, table_of

_MOST_RATIO = 1100  # deflate expands to 1032 times at most
_HEADER = 1 << 16  # bytes of an array's header at most


def read_npy(path: Path, topic: str | None) -> ArrayTable:
    """One array: of fields by name, or a column each."""
    with path.open("rb") as file:
        array = _array(file, path.stat().st_size, str(path))
    return table_of(_fields({"": array}), topic)


def read_npz(path: Path, topic: str | None) -> ArrayTable:
    """Several arrays by name."""
    try:
        with zipfile.ZipFile(path) as archive:
            infos = {info.filename: info for info in archive.infolist()}
            if "xl/workbook.xml" in infos:
                raise StandError(f"{path}: is an Excel workbook: save it as CSV")
            arrays = {}
            for name, info in infos.items():
                if not name.endswith(".npy"):
                    continue
                size = info.file_size
                if size > _MOST_RATIO * max(info.compress_size, 1) or info.flag_bits & 1:
                    raise StandError(f"{path}: damaged: {name} cannot be of {size} bytes")
                if info.compress_size > path.stat().st_size:
                    raise StandError(f"{path}: damaged: {name} is longer than the file")
                with archive.open(info) as file:
                    arrays[name.removesuffix(".npy")] = _array(file, size, f"{path}: {name}")
    except StandError:
        raise
    except Exception as error:  # zipfile and the libraries behind it say what they like
        raise damaged(path, "npz", error) from error
    if not arrays:
        raise StandError(f"{path}: a zip file without arrays of NumPy")
    return table_of(_fields(arrays), topic)


def _array(file: Any, size: int, name: str) -> NDArray[Any]:
    """An array of `size` bytes with its header; objects are never made."""
    try:
        shape, fortran, kind = _header(file)
    except Exception as error:  # the header is Python's own words, and so are its faults
        raise damaged(name, "array of NumPy", error) from error
    if kind.hasobject:
        raise StandError(f"{name}: holds Python objects, must be numbers")
    count = math.prod(shape)
    if min((*shape, 1)) < 0 or not 0 < kind.itemsize * max(count, 1) <= size:
        raise StandError(f"{name}: damaged: {shape} of {kind.itemsize} bytes are not in {size}")
    data = file.read(count * kind.itemsize)
    if len(data) < count * kind.itemsize:
        raise StandError(f"{name}: cut off: {shape} of {kind.itemsize} bytes are not in it")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")


def _header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(file)
    if version == (1, 0):
        return npy.read_array_header_1_0(file, max_header_size=_HEADER)
    return npy.read_array_header_2_0(file, max_header_size=_HEADER)


def _fields(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays whose items have fields are as many arrays."""
    found: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        if array.dtype.names is None:
            found[name] = array
        else:
            found |= {
                f"{name}.{field}".lstrip("."): array[field]
                for field in array.dtype.names
                if array[field].dtype.names is None
            }
    return found
