"""One key of a file by its path, changed: of a procedure, a unit, a table or the site.

``imu.gyro.angle_random_walk_deg_rt_h``, ``step.first.duration_s``, ``site.latitude_deg``: what
begins with ``imu`` or ``table`` is of those files, what is a `Settings` key is of no file, all else
is of the procedure. A step or a background goes by its label or by its number from 1; a value that
a data sheet states with kind and source keeps both.
"""

from copy import deepcopy
from typing import Any

from stand.errors import StandError, unknown
from stand.procedure.procedure import ProcedureEntry
from stand.toml_files import keys_of_path

SETTINGS = ("rate_hz", "motion", "true_table")
FILES = ("procedure", "imu", "table")
_STATED = "varied by a campaign"

Data = dict[str, Any]
Path = tuple[str, ...]


def place_of(path: str) -> tuple[str, Path]:
    """Of what file a path is, or 'settings', and the keys in it; none for a whole file.

    Raises
    ------
    StandError
        It is no path, or of nothing that there is.
    """
    first, *rest = keys_of_path(path)
    if first in FILES:
        return first, tuple(rest)
    if first in SETTINGS and not rest:
        return "settings", (first,)
    if first in ProcedureEntry.model_fields:
        return "procedure", (first, *rest)
    raise unknown("key", first, {*FILES, *SETTINGS, *ProcedureEntry.model_fields})


def changed(data: Data, path: Path, value: Any) -> Data:
    """The same table with another value at a path; what is not there is added.

    Raises
    ------
    StandError
        The path leads through what has no keys, or to a step that is not there.
    """
    new = deepcopy(data)
    here: Any = new
    for depth, key in enumerate(path[:-1]):
        here = _entered(here, key, path[:depth])
    _put(here, path, value)
    return new


def _entered(here: Any, key: str, before: Path) -> Any:
    if isinstance(here, list):
        return here[_index(here, key, before)]
    if not isinstance(here, dict):
        raise StandError(f"{'.'.join(before)}: is {here!r}, and has no keys")
    return here.setdefault(key, {})


def _put(here: Any, path: Path, value: Any) -> None:
    key, before = path[-1], path[:-1]
    if isinstance(here, list):
        here[_index(here, key, before)] = value
    elif not isinstance(here, dict):
        raise StandError(f"{'.'.join(before)}: is {here!r}, and has no keys")
    elif isinstance(here.get(key), dict) and "value" in here[key]:
        here[key]["value"] = value
    elif isinstance(here.get(key), dict | list) and not isinstance(value, list | tuple):
        raise StandError(f"{'.'.join(path)}: is a table or an array, must be one of its values")
    else:
        here[key] = value


def _index(items: list[Any], key: str, before: Path) -> int:
    """Which of several is meant, by label or by number from 1."""
    labels = [item.get("label") if isinstance(item, dict) else None for item in items]
    if labels.count(key) == 1:
        return labels.index(key)
    if labels.count(key) > 1:
        raise StandError(f"{'.'.join((*before, key))}: {labels.count(key)} have this label")
    if key.isdecimal() and 1 <= int(key) <= len(items):
        return int(key) - 1
    known = [label or str(number) for number, label in enumerate(labels, start=1)]
    raise unknown(before[-1] if before else "item", key, known)


def stated(data: Data, path: Path, value: Any) -> Any:
    """A value as a unit's file states it, where the key is not there yet: with kind and source."""
    term = len(path) == 2 and path[0] in ("gyro", "accel")
    here = data.get(path[0])
    if not term or (isinstance(here, dict) and path[1] in here):
        return value
    return {"value": value, "kind": "assumed", "source": _STATED}
