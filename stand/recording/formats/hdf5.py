"""HDF5, and MATLAB 7.3 which is that, by h5py."""

from pathlib import Path
from typing import Any

import numpy as np

from stand.errors import StandError
from stand.recording.formats.extras import damaged, missing
from stand.recording.formats.table import ArrayTable, Values, table_of

_MOST = 10_000  # objects that are looked at


class _Field:
    """One field of a dataset whose items have several."""

    def __init__(self, dataset: Any, name: str) -> None:
        self._dataset, self._name = dataset, name
        self.shape: tuple[int, ...] = dataset.shape

    def __getitem__(self, key: Any) -> Any:
        return self._dataset[self._name][key]


def read_hdf5(path: Path, topic: str | None) -> ArrayTable:
    """Datasets by name, a group's as group.dataset; a unit is that of the attribute `units`."""
    try:
        import h5py
    except ImportError:
        raise missing(path, "HDF5", "h5py") from None
    try:
        with h5py.File(path, "r") as file:
            arrays = _datasets(file, h5py.Dataset)
            table = table_of(arrays, None if topic is None else topic.strip("/").replace("/", "."))
            columns = [table.column(k) for k in range(table.width)]
    except StandError:
        raise
    except Exception as error:  # whatever the library says to bytes that make no sense
        raise damaged(path, "HDF5 file", error) from error
    return ArrayTable(
        topic=table.topic,
        names=table.names,
        rows=table.rows,
        width=table.width,
        column=lambda k: columns[k],
        notes=table.notes,
    )


def _datasets(file: Any, kind: type) -> dict[str, Values]:
    found: dict[str, Values] = {}
    seen = 0

    def visit(name: str, item: Any) -> bool | None:
        nonlocal seen
        seen += 1
        if isinstance(item, kind) and not name.startswith("#"):
            own = name.replace("/", ".")
            if item.dtype.names:
                found.update({f"{own}.{field}": _Field(item, field) for field in item.dtype.names})
            elif item.dtype.kind in "fiubS" and item.size <= _stored(item):
                found[own + _unit(item)] = item
        return True if seen > _MOST else None

    file.visititems(visit)
    return found


def _stored(item: Any) -> float:
    """More numbers than that cannot be in a dataset: its bytes in the file, 1100 times expanded."""
    return 1100.0 * item.id.get_storage_size() / max(item.dtype.itemsize, 1)


def _unit(item: Any) -> str:
    for name in ("units", "unit", "Units", "Unit"):
        unit = item.attrs.get(name)
        unit = unit.decode(errors="replace") if isinstance(unit, bytes) else unit
        if isinstance(unit, (str, np.str_)):
            return f" [{unit}]"
    return ""
