"""Commented TOML files to begin with, made from the very models that check them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from alignment.estimators import DEFAULT_METHOD, ESTIMATORS
from stand.errors import unknown
from stand.imu.bands import ACCEL_BANDS, GYRO_BANDS
from stand.imu.preset import ImuEntry, Stated
from stand.procedure.procedure import ProcedureEntry
from stand.procedure.steps import Background, Step
from stand.proposal.wanted import WantedEntry
from stand.table.joints import JOINTS
from stand.table.table import TableEntry
from stand.toml_files import Entry

_FITTED = next(name for name, method in ESTIMATORS.items() if method.fits_positions)
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
LONGEST = 96  # characters of a line of comment
_SOURCE = "document, revision, page"
# Values that show what a key is for, by the key; others are the default, or lie in the bounds.
# whose parts must fit one another
_WHOLE: Mapping[str, Any] = {
    "known": (
        {
            "sensor": "accel",
            "term": "misalignment",
            "axis": "X1",
            "toward": "Y1",
            "value": -31.0,
            "unit": "arcsec",
            "sigma": 0.4,
        },
    )
}
_SAMPLES: Mapping[str, Any] = MappingProxyType(
    {
        "travel_deg": (-90.0, 90.0),
        "rate_deg_s": 60.0,
        "acceleration_deg_s2": 100.0,
        "jerk_deg_s3": 500.0,
        "torque_Nm": 20.0,
        "bandwidth_hz": 20.0,
        "integral_s": 0.1,
        "static_Nm": 0.0,
        "bristle_Nm_rad": 1e4,
        "latitude_deg": 48.5,
        "gravity_m_s2": 9.80812,
        "methods": (DEFAULT_METHOD, _FITTED),
        "duration_s": 60.0,
        "turns": 3.0,
        "axis": "outer",
        "rates_deg_s": (1.0, -1.0),
        "joints_deg": {"outer": 90.0},
        "amplitude_deg": {"base_roll": 2.0, "base_pitch": 2.0},
        "phase_deg": {"base_roll": 0.0},
        "period_s": 6.0,
        "half_angle_deg": 1.0,
        "frequency_hz": 0.2,
        "high_hz": 50.0,
        "low_hz": 5.0,
        "file": "angles.csv",
        "psd_file": "density.csv",
        "first": "first",
        "last": "second",
        "fade_s": 2.0,
        "time_s": (0.0, 3600.0),
        "temperature_C": (20.0, 30.0),
        "model": "my-stand.xml",
        "part": "stim300",
        "grade": "tactical MEMS",
        "revision": "A",
        "method": _FITTED,
        "rms_deg": 1.0,
        "max_time_s": 1800.0,
        "most_turns": 20.0,
        "turn_rates_deg_s": (50.0, 100.0),
        "cutoff_hz": 2.0,
    }
)


def template(what: str, name: str) -> str:
    """The text of a new file.

    Parameters
    ----------
    what : str
        One of `TEMPLATES`.
    name : str
        Its title.

    Raises
    ------
    StandError
        There is no such template.
    """
    if what not in TEMPLATES:
        raise unknown("template", what, TEMPLATES)
    lines = [
        f"# A new {what}: every key there is. What is behind a # may be left out, and is then",
        "# as it says here.",
        "",
        *TEMPLATES[what](name),
    ]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)) + "\n"


def _imu(name: str) -> Iterator[str]:
    given = {"title": name, "grade": "tactical MEMS", "evidence": "A"}
    yield from _section(ImuEntry, "", given)


def _table(name: str) -> Iterator[str]:
    given = {"title": name, "source": _SOURCE}
    yield from _section(TableEntry, "", given, skip=("axis",))
    axis = TableEntry.model_fields["axis"]
    (_, model) = get_args(axis.annotation)
    for joint in JOINTS:
        yield ""
        if joint == "outer":
            yield from _section(model, "axis.outer", {})
            continue
        yield "# An axis that is left out is not there."
        required = [n for n, f in model.model_fields.items() if f.is_required()]
        yield f"# [axis.{joint}]"
        yield from (f"# {n} = {_toml(_SAMPLES[n])}" for n in required)


def _procedure(name: str) -> Iterator[str]:
    yield from _section(ProcedureEntry, "", {"title": name}, skip=("step", "background"))
    for kind, label in (("dwell", "first"), ("move", "half a turn"), ("dwell", "second")):
        model = _kinds(Step)[kind]
        given: dict[str, Any] = {"kind": kind, "label": label}
        if kind == "move":
            given["attitude_deg"] = {
                "roll": 0.0,
                "yaw": 180.0,
                "pitch": 0.0,
                "sequence": "yaw-pitch-roll",
            }
        yield from ("", "[[step]]", *_keys(model, given))
    yield from ("", "# Other kinds of steps:")
    for kind, model in _kinds(Step).items():
        if kind not in ("dwell", "move"):
            yield from _other("step", kind, model, {"label": kind})
    yield from ("", "# Motions behind several steps:")
    for kind, model in _kinds(Background).items():
        yield from _other("background", kind, model, {})


def _requirement(name: str) -> Iterator[str]:
    yield from _section(WantedEntry, "", {"title": name}, skip=("require",))
    require = WantedEntry.model_fields["require"].annotation
    yield ""
    yield from _section(require, "require", {"heading_deg": 0.1})  # pyright: ignore


TEMPLATES: Mapping[str, Callable[[str], Iterator[str]]] = MappingProxyType(
    {"imu": _imu, "table": _table, "procedure": _procedure, "requirement": _requirement}
)


def _other(what: str, kind: str, model: type[Entry], given: dict[str, Any]) -> Iterator[str]:
    """A step or background of another kind, all of it behind #."""
    yield ""
    yield from _comment(model.__doc__)
    yield f"# [[{what}]]"
    for line in _keys(model, {"kind": kind, **given}):
        yield line if line.startswith("#") else f"# {line}"


def _kinds(union: Any) -> dict[str, type[Entry]]:
    """The models of a union of steps by their kind."""
    return {_literals(m.model_fields["kind"])[0]: m for m in get_args(get_args(union)[0])}


def _section(
    model: type[Entry], path: str, given: Mapping[str, Any], skip: tuple[str, ...] = ()
) -> Iterator[str]:
    """A table of TOML with all its keys, then the tables in it."""
    yield from _comment(model.__doc__)
    if path:
        yield f"[{path}]"
    yield from _keys(model, given, skip)
    for name, field in model.model_fields.items():
        inner = _inner(field)
        if name in skip or inner is None or name in given:
            continue
        place = f"{path}.{name}" if path else name
        lines = list(_section(inner, place, {}))
        if field.is_required():
            yield from ("", *lines)
        else:
            yield from ("", *(x if x.startswith("#") or not x else f"# {x}" for x in lines))


def _keys(
    model: type[Entry], given: Mapping[str, Any], skip: tuple[str, ...] = ()
) -> Iterator[str]:
    """A line per key that is no table: those that must be there, and the others behind #."""
    for name, field in model.model_fields.items():
        if name in skip or (_inner(field) is not None and name not in given):
            continue
        value = given[name] if name in given else _sample(name, field)
        told = _bounds(field)
        line = f"{name} = {_toml(value)}" + (f"   # {told}" if told else "")
        yield line if field.is_required() or name in given else f"# {line}"


def _inner(field: FieldInfo) -> type[Entry] | None:
    """The model of a key that is a table of its own; not of a stated value, which is inline."""
    for kind in _parts(field.annotation):
        if isinstance(kind, type) and issubclass(kind, Entry) and kind.__name__ != "AttitudeEntry":
            return None if _is_stated(kind) else kind
    return None


def _is_stated(kind: Any) -> bool:
    """Whether it is a value with its source, which stands in one line."""
    return (
        isinstance(kind, type)
        and issubclass(kind, Entry)
        and "source" in kind.model_fields
        and ("value" in kind.model_fields)
    )


def _parts(annotation: Any) -> list[Any]:
    """What a type may be, without None, names and bounds."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _parts(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return [p for a in get_args(annotation) if a is not type(None) for p in _parts(a)]
    return [annotation]


def _marks(annotation: Any, found: list[Any]) -> list[Any]:
    """All bounds in a type."""
    if get_origin(annotation) is Annotated:
        for mark in get_args(annotation)[1:]:
            found += mark.metadata if isinstance(mark, FieldInfo) else [mark]
    if get_origin(annotation) in (Annotated, Union, UnionType):
        for part in get_args(annotation):
            _marks(part, found)
    return found


def _bounds(field: FieldInfo) -> str:
    """What is allowed, in words."""
    words = _literals(field)
    if words:
        return " or ".join(map(str, words)) if len(words) > 1 else ""
    told = []
    for mark in [*field.metadata, *_marks(field.annotation, [])]:
        for kind, text in ((Ge, "at least"), (Gt, "above"), (Le, "at most"), (Lt, "below")):
            if isinstance(mark, kind):
                bound: Any = getattr(mark, kind.__name__.lower())
                told.append(f"{text} {bound:g}")
    return ", ".join(dict.fromkeys(told))


def _literals(field: FieldInfo) -> tuple[Any, ...]:
    return next((get_args(p) for p in _parts(field.annotation) if get_origin(p) is Literal), ())


def _sample(name: str, field: FieldInfo) -> Any:
    """A value that the key may have."""
    kinds = _parts(field.annotation)
    if any(isinstance(k, type) and issubclass(k, Stated) for k in kinds):
        return {"value": _typical(name), "kind": "typical", "source": _SOURCE}
    stated = next((kind for kind in kinds if _is_stated(kind)), None)
    if stated is not None:
        (kind,) = _parts(stated.model_fields["value"].annotation)
        value = _IDENTITY if get_origin(kind) is tuple else 90.0
        known = {"value": value, "kind": "typical", "source": _SOURCE}
        return {key: known[key] for key in stated.model_fields if key in known}
    default = None if field.is_required() else field.get_default(call_default_factory=True)
    if default is not None and not isinstance(default, Entry) and default not in ("", (), {}):
        return default
    if name in _WHOLE:
        return _WHOLE[name]
    literals = _literals(field)
    if literals:
        return literals[0]
    for kind in kinds:
        member = get_args(kind)[-2 if get_origin(kind) is tuple else -1] if get_args(kind) else None
        if isinstance(member, type) and issubclass(member, Entry):
            one = {key: _sample(key, own) for key, own in member.model_fields.items()}
            return (one,) if get_origin(kind) is tuple else {"base_pitch": one}
    known = _SAMPLES.get(name)
    is_table = any(get_origin(kind) is dict for kind in kinds)
    if known is not None and isinstance(known, dict) == is_table:
        return known
    return next((_plain(kind, field) for kind in kinds if kind is not dict), "")


def _plain(kind: Any, field: FieldInfo) -> Any:
    if kind is str:
        return ""
    if kind is int:
        return 1
    if get_origin(kind) is tuple:
        members = [a for a in get_args(kind) if a is not Ellipsis]
        return tuple(0.0 for _ in members)
    return 1.0 if kind is float else {}


def _typical(key: str) -> float:
    """Between the ends of what sheets of tactical units state; else one."""
    band = GYRO_BANDS.get(key) or ACCEL_BANDS.get(key)
    if band is None:
        return 1.0
    low, high = band.of("tactical")
    return float(f"{(max(low, high / 1e4) * high) ** 0.5:.2g}")


def _comment(doc: str | None) -> Iterator[str]:
    """The first paragraphs of a docstring as comment."""
    for line in (doc or "").strip().splitlines():
        text = line.strip().replace("`", "")
        yield f"# {text}" if text else "#"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{k} = {_toml(v)}' for k, v in value.items())} }}"
    return _toml(value.value) if isinstance(value, Enum) else repr(value)
