"""Catalogues: one TOML file per entry inside the package; a user's own file works as well.

This is the door for TOML: every fault in a file becomes one line that names file, place, value
and what is allowed.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from stand.errors import StandError, unknown


class Entry(BaseModel):
    """Base of everything read from TOML: no unknown keys, no NaN or infinity, immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


EntryT = TypeVar("EntryT", bound=Entry)


@dataclass(frozen=True, slots=True)
class Source:
    """Where an entry came from: its id (file name without ending), shown name and text."""

    id: str
    name: str
    text: str


def ids(folder: str) -> list[str]:
    """Ids of the entries of a catalogue, sorted."""
    entries = (files("stand") / folder).iterdir()
    return sorted(e.name.removesuffix(".toml") for e in entries if e.name.endswith(".toml"))


def find(folder: str, what: str, name: str) -> Source:
    """The text of a catalogue entry by id, or of a user's file by its path.

    Raises
    ------
    StandError
        Neither an id nor a file; near matches are named.
    """
    if name.endswith(".toml") or "/" in name or "\\" in name:
        return _read_file(what, Path(name))
    if name not in ids(folder):
        raise unknown(what, name, ids(folder))
    text = (files("stand") / folder / f"{name}.toml").read_text(encoding="utf-8")
    return Source(name, f"{name}.toml", text)


def _read_file(what: str, path: Path) -> Source:
    try:
        return Source(path.stem, str(path), path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StandError(f"{path}: cannot read this {what}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StandError(f"{path}: not UTF-8 text (byte {error.start})") from error


def parse(source: Source, model: type[EntryT]) -> EntryT:
    """Check the TOML text of an entry against its model.

    Raises
    ------
    StandError
        One line: file, place, key, value, what is allowed; how many further faults there are.
    """
    try:
        data = tomllib.loads(source.text)
    except tomllib.TOMLDecodeError as error:
        raise StandError(f"{source.name}: not valid TOML: {error}") from error
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise StandError(_one_line(source.name, data, error.errors())) from error


def _one_line(name: str, data: dict, errors: Sequence[ErrorDetails]) -> str:
    first = errors[0]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    place = _place(data, first["loc"])
    return f"{name}: {place}{_message(first)}{more}"


def _place(data: object, loc: Sequence[int | str]) -> str:
    """'step 3 "X1 up", duration_s' from ('step', 2, 'dwell', 'duration_s')."""
    parts: list[str] = []
    here = data
    for key in loc:
        if isinstance(key, int) and isinstance(here, list) and key < len(here):
            here = here[key]
            label = here.get("label") if isinstance(here, dict) else None
            parts[-1:] = [f"{parts[-1] if parts else 'item'} {key + 1}"]
            parts[-1] += f' "{label}"' if isinstance(label, str) else ""
        elif isinstance(here, dict) and key not in here and here.get("kind") == key:
            continue  # the tag of a step's kind, which pydantic adds to the path
        else:
            parts.append(str(key))
            here = here.get(key) if isinstance(here, dict) else None
    return ", ".join(parts) + ": " if parts else ""


def _message(error: ErrorDetails) -> str:
    kind, given = error["type"], error.get("input")
    context = error.get("ctx", {})
    if kind == "missing":
        return "required, but missing"
    if kind == "extra_forbidden":
        return f"unknown key (value {given!r})"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        known = context.get("expected_tags", "'dwell', 'move'")
        tag = context.get("tag")
        return f"kind = {tag!r}: must be one of {known}" if tag else f"kind: required, {known}"
    if kind == "value_error":
        return str(context.get("error", error["msg"]))
    shown = given if not isinstance(given, dict | list) else type(given).__name__
    return f"{shown!r}: {error['msg'][0].lower()}{error['msg'][1:]}"
