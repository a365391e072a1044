"""A procedure's data as TOML text."""

import json
from collections.abc import Mapping
from enum import Enum
from typing import Any


def toml_of(data: Mapping[str, Any]) -> str:
    """TOML of a table of plain values, tables and arrays of tables.

    The outermost tables get headings of their own, those within are inline.
    """
    plain = {k: v for k, v in data.items() if not isinstance(v, Mapping) and not _tables(v)}
    parts = ["\n".join(f"{k} = {_value(v)}" for k, v in plain.items())]
    for key, value in data.items():
        if isinstance(value, Mapping):
            parts.append(_headed(f"[{key}]", value))
        elif _tables(value):
            parts += [_headed(f"[[{key}]]", one) for one in value]
    return "\n\n".join(part for part in parts if part) + "\n"


def _tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)


def _headed(heading: str, table: Mapping[str, Any]) -> str:
    return "\n".join([heading, *(f"{k} = {_value(v)}" for k, v in table.items())])


def _value(value: Any) -> str:
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return json.dumps(value)
