"""MATLAB's .mat: up to version 7 by scipy; 7.3 is HDF5."""

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError
from stand.recording.formats.table import ArrayTable, table_of

_HEADER = 128
_DEEPEST = 8  # structs within structs
_COMPRESSED, _MATRIX = 15, 14


def read_mat(path: Path, topic: str | None) -> ArrayTable:
    """Matrices by name, fields of structs as struct.field."""
    from scipy.io import loadmat

    _check_elements(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            variables = loadmat(path, squeeze_me=False, chars_as_strings=False)
    except MemoryError:
        raise
    except Exception as error:  # whatever scipy says to bytes that make no sense
        told = " ".join(str(error).split())[:100] or type(error).__name__
        raise StandError(f"{path}: not a whole MATLAB file: {told}") from error
    found: dict[str, NDArray[Any]] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _collect(name, value, found, 0)
    if not found:
        raise StandError(f"{path}: a MATLAB file without numbers: tables and objects are not read")
    return table_of(found, topic)


def _check_elements(path: Path) -> None:
    """Elements at the top must lie within the file, and be matrices."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        if order is None:
            raise StandError(f"{path}: damaged: the header of a MATLAB file")
        while file.tell() < size:
            tag = file.read(8)
            kind, length = struct.unpack(f"{order}II", tag) if len(tag) == 8 else (0, size)
            if kind not in (_COMPRESSED, _MATRIX) or length > size - file.tell():
                raise StandError(f"{path}: cut off or damaged at byte {file.tell() - len(tag)}")
            file.seek(length, 1)


def _collect(name: str, value: Any, found: dict[str, NDArray[Any]], depth: int) -> None:
    """Numbers of a variable, and those of the fields of a struct."""
    if not isinstance(value, np.ndarray) or depth > _DEEPEST:
        return
    if value.dtype.names is not None and value.size == 1:
        one = value.reshape(-1)[0]
        for field in value.dtype.names:
            _collect(f"{name}.{field}", one[field], found, depth + 1)
    elif value.dtype.kind in "fiub":
        found[name] = value
