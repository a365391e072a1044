"""Catalogues: one TOML file per entry inside the package; a user's own file works as well.

This is the door for TOML: every fault in a file becomes one line that names file, place, value
and what is allowed.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails

from stand.errors import StandError, unknown
from stand.folder import refuse_no_file

LONGEST_SHOWN = 60  # characters of a wrong value
STEP_KINDS = (
    "'dwell', 'move', 'rate', 'sweep', 'sine', 'scorsby', 'coning', 'sway', 'vibration', 'profile'"
)
_SHAPES = {
    "tuple_type": "must be an array",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
}


class Entry(BaseModel):
    """Base of everything read from TOML: no unknown keys, no NaN or infinity, immutable.

    Strict: text or a boolean is not taken for a number.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, strict=True, defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: object) -> object:
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise ValueError(str(unknown("key", key, cls.model_fields)))
        return data


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
        return read_file(what, Path(name))
    if name not in ids(folder):
        own = f"{name}.toml"  # what `stand new` has written
        raise unknown(what, name, [*ids(folder), *([own] if Path(own).is_file() else [])])
    text = (files("stand") / folder / f"{name}.toml").read_text(encoding="utf-8")
    return Source(name, f"{name}.toml", text)


def read_file(what: str, path: Path) -> Source:
    """The text of a user's file; `StandError` where it cannot be read."""
    try:
        refuse_no_file(path)
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
    data = _data(source)
    return checked(source.name, data, model, _tuples(data))


ModelT = TypeVar("ModelT", bound=BaseModel)


def checked(name: str, data: Any, model: type[ModelT], taken: Any = None) -> ModelT:
    """Check what was read from a file against a model; `taken` is what the model is given instead.

    Raises
    ------
    StandError
        As `parse`; the line begins with `name`.
    """
    try:
        return model.model_validate(data if taken is None else taken)
    except ValidationError as error:
        raise StandError(_one_line(name, data, error.errors())) from error


def faults(source: Source, model: type[Entry]) -> list[tuple[str, str]]:
    """Every fault that `parse` would find: where, with the value, and what is allowed."""
    try:
        data = _data(source)
    except StandError as error:
        return [("", str(error).removeprefix(f"{source.name}: "))]
    try:
        model.model_validate(_tuples(data))
    except ValidationError as error:
        return [_fault(data, e) for e in error.errors()]
    return []


def _data(source: Source) -> dict:
    try:
        return tomllib.loads(source.text)
    except (ValueError, RecursionError) as error:  # syntax; thousands of digits or brackets
        raise StandError(f"{source.name}: not valid TOML: {error}") from error


def _tuples(value: Any) -> Any:
    """The same with tuples for TOML's arrays: strict checks take no list for a tuple."""
    if isinstance(value, dict):
        return {key: _tuples(v) for key, v in value.items()}
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _one_line(name: str, data: dict, errors: Sequence[ErrorDetails]) -> str:
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return ": ".join(part for part in (name, *_fault(data, errors[0])) if part) + more


def _fault(data: dict, error: ErrorDetails) -> tuple[str, str]:
    """Where, with the value; what is allowed."""
    place = _place(data, error["loc"])
    if error["type"].startswith("union_tag"):
        place += ", kind"
    if "tag" in (context := error.get("ctx", {})):
        place += f" = {_shown(context['tag'])}"
    elif error["type"] not in ("missing", "value_error", "union_tag_not_found"):
        place += f" = {_shown(error['input'])}"
    return place, _allowed(error)


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
    return ", ".join(parts)


def _shown(value: object) -> str:
    if isinstance(value, dict | tuple):
        return "a table" if isinstance(value, dict) else "an array"
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return type(value).__name__
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _allowed(error: ErrorDetails) -> str:
    """What pydantic says should be, in the words of TOML."""
    context = error.get("ctx", {})
    if error["type"] == "missing":
        return "required, but missing"
    if error["type"].startswith("union_tag"):
        return f"must be one of {context.get('expected_tags', STEP_KINDS)}"
    if error["type"] == "value_error":
        return str(context.get("error", error["msg"]))
    return _SHAPES.get(error["type"]) or error["msg"].replace("Input should", "must")


def table_of_text(source: Source) -> dict[str, Any]:
    """The plain values, tables and arrays of an entry's text, unchecked.

    Raises
    ------
    StandError
        It is not TOML.
    """
    return _data(source)


def keys_of_path(path: str) -> tuple[str, ...]:
    """The keys of a dotted path, as TOML writes it: ``step."X1 up".duration_s``.

    Raises
    ------
    StandError
        It is none.
    """
    try:
        (key, value), *more = tomllib.loads(f"{path} = 0").items()
        keys = [key]
        while isinstance(value, dict):
            ((key, value),) = value.items()
            keys.append(key)
    except ValueError as error:
        raise StandError(f"{path!r}: is no path of keys with dots between") from error
    if more or value != 0:
        raise StandError(f"{path!r}: is no path of keys with dots between")
    return tuple(keys)
