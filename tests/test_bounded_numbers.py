"""Every number of every file has a lower and an upper bound: found by walking the models."""

import json
import re
import time
from types import UnionType
from typing import Annotated, Union, get_args, get_origin

import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, Field

from stand.calibration.file import CalibrationEntry
from stand.campaigns.sweep import SweepEntry
from stand.errors import StandError
from stand.imu.preset import ImuEntry, imu_from
from stand.procedure.procedure import ProcedureEntry, procedure_from
from stand.recording.metadata import (
    DriveRecord,
    EstimateRecord,
    InterruptedRecord,
    RunRecord,
    ScheduleRecord,
    SettledRecord,
    Sigmas,
    SiteRecord,
)
from stand.simulation.step_record import records_from_json
from stand.table.table import TableEntry
from stand.toml_files import Source, find, parse
from stand.vehicle.scenario import DriveEntry, drive_from

TOML = (ProcedureEntry, ImuEntry, TableEntry, DriveEntry, SweepEntry)
RECORDS = (
    *(RunRecord, SiteRecord, ScheduleRecord, SettledRecord, InterruptedRecord, EstimateRecord),
    *(Sigmas, DriveRecord, CalibrationEntry),
)
SOON_S = 2.0


def bounds(metadata):
    """Whether there is a lower and an upper one among what pydantic was told of a number."""
    told = [m for one in metadata for m in (one, *(getattr(one, "metadata", None) or ()))]
    return any(isinstance(m, Ge | Gt) for m in told), any(isinstance(m, Le | Lt) for m in told)


def numbers(kind, name, metadata=()):
    """(name, has a lower, has an upper bound) of every number within a type."""
    origin = get_origin(kind)
    if origin is Annotated:
        inner, *more = get_args(kind)
        yield from numbers(inner, name, (*metadata, *more))
    elif kind in (int, float):
        yield (name, *bounds(metadata))
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        for key, field in kind.model_fields.items():
            yield from numbers(field.annotation, f"{kind.__name__}.{key}", tuple(field.metadata))
    elif origin is not None or isinstance(kind, UnionType):
        # what is said of an array or a table is not said of its numbers
        one_of = origin is Union or isinstance(kind, UnionType)
        for inner in get_args(kind):
            yield from numbers(inner, name, metadata if one_of else ())


@pytest.mark.parametrize("model", [*TOML, *RECORDS], ids=lambda m: m.__name__)
def test_every_number_has_both_bounds(model):
    found = dict.fromkeys(numbers(model, ""))
    assert found or model is ImuEntry
    allowed = {"SettledRecord.root"}  # infinity: never
    assert [f for f in found if not all(f[1:]) and f[0] not in allowed] == []


def test_the_walk_finds_what_lacks_them():
    class Inner(BaseModel):
        a: tuple[float, ...] = ()
        b: Annotated[dict[str, Annotated[float, Field(ge=0)]] | None, "said"] = None

    class Outer(BaseModel):
        inner: Inner | None = None
        c: Annotated[int, Field(ge=0, le=1)] = 0

    assert list(numbers(Outer, "")) == [
        ("Inner.a", False, False),
        ("Inner.b", True, False),
        ("Outer.c", True, True),
    ]


HEAD = 'title = "t"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = []\n'
DWELL = '[[step]]\nkind = "dwell"\nlabel = "a"\nduration_s = 9\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + "[payload]\noffset_m = [1e308, 0, 0]\n" + DWELL, "offset_m.* = 1e+308: must be"),
        (HEAD + "[temperature]\ntime_s = [0, 1e308]\ntemperature_C = [0, 1]\n" + DWELL, "time_s"),
        (HEAD + DWELL.replace("9", "1e9"), "duration_s = 1000000000.0: must be less than or"),
        (HEAD + "[move_limits]\njerk_deg_s3 = 1e308\n" + DWELL, "jerk_deg_s3 = 1e+308: must be"),
    ],
)
def test_numbers_of_a_procedure_that_nothing_reaches(text, said):
    begin = time.monotonic()
    with pytest.raises(StandError, match=said.replace("+", r"\+")):
        procedure_from(Source("p", "p.toml", text))
    assert time.monotonic() - begin < SOON_S


@pytest.mark.parametrize(
    ("folder", "name", "read", "key"),
    [
        ("imus", "stim300", imu_from, "value"),
        ("tables", "laboratory", lambda source: parse(source, TableEntry), "torque_Nm"),
        ("trajectories", "weaving", drive_from, "duration_s"),
    ],
)
@pytest.mark.parametrize("value", ["1e308", "-1e308", "1e13"])
def test_numbers_of_the_catalogues_kinds(folder, name, read, key, value):
    pattern, source = rf"({key} = )[\d.]+", find(folder, "", name)
    text, count = re.subn(pattern, rf"\g<1>{value}", source.text, count=1)
    assert count == 1
    said = re.escape(f"{key} = {float(value)!r}: must be")
    begin = time.monotonic()
    with pytest.raises(StandError, match=said) as told:
        read(Source(name, f"{name}.toml", text))
    assert str(told.value).startswith(f"{name}.toml: ")
    assert time.monotonic() - begin < SOON_S


@pytest.mark.parametrize("key", ["t_from_s", "settled_after_s", "label"])
def test_a_result_is_not_believed(recorded, key):
    """A number beyond all, or no number: the same kind of line as of TOML."""
    axes = dict.fromkeys(("base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner"), 0.0)
    step = {"label": "a", "kind": "dwell", "t_from_s": 0.0, "t_to_s": 1.0, "rests": True}
    step |= dict.fromkeys(
        ("following_max_arc_s", "following_rms_arc_s", "saturated_s", "torque_percent"), axes
    )
    step |= {"settled_after_s": 0.5}
    assert len(records_from_json("r.json", json.dumps({"steps": [step]}))) == 1
    with pytest.raises(StandError, match=rf"r\.json: .*{key} = 1e\+308: must"):
        records_from_json("r.json", json.dumps({"steps": [step | {key: 1e308}]}))
