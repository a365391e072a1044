"""A sweep: what is run, what is varied in it, and every case that comes of that.

One TOML file. A case is one value of everything that is varied; its runs differ in their seed. All
cases have the same seeds: a difference between two of them is of what was varied, not of the draw.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from alignment.arrays import Array
from alignment.earth import Site
from stand import toml_files as catalogue
from stand.arguments import MOST_RUNS
from stand.bounds import LARGEST_STATED
from stand.campaigns.keys import FILES, changed, place_of, stated
from stand.errors import StandError, located, whole
from stand.imu import ImuSpec, imu_from
from stand.motion.polynomial import MotionKind
from stand.physics.mjcf import contents_of
from stand.procedure.procedure import Procedure, procedure_from
from stand.rehearsal.wording import toml_of
from stand.simulation.settings import HIGHEST_RATE_HZ, Settings, assembled, one_of
from stand.table.table import Table, table_from
from stand.toml_files import Source

MOST_CASES = 100_000
LAST_SEED = 2**39  # with the most runs below 2^40: a case and a seed are one whole number
DIGITS = 12  # of values that a range makes: 0.001, not 0.0010000000000000002

Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(ge=-LARGEST_STATED, le=LARGEST_STATED)]
Whole = Annotated[int, Field(ge=-(10**9), le=10**9)]
Value = bool | Whole | Number | str


class RangeEntry(catalogue.Entry):
    """Values between two ends, `count` of them, evenly or by equal factors.

    `digits`: to how many the values are rounded.
    """

    low: Number
    high: Number
    count: Annotated[int, Field(ge=2, le=MOST_CASES)] | None = None
    scale: Literal["linear", "log"] = "linear"
    digits: Annotated[int, Field(ge=1, le=DIGITS)] = DIGITS

    @model_validator(mode="after")
    def _increases(self) -> RangeEntry:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g}: must be below high = {self.high:g}")
        if self.scale == "log" and self.low <= 0:
            raise ValueError(f"low = {self.low:g}: must be above 0 on a logarithmic scale")
        return self

    def at(self, part: Array) -> list[float]:
        """Values at parts (n,) of the way, 0 to 1."""
        if self.scale == "log":
            values = self.low * (self.high / self.low) ** part
        else:
            values = self.low + (self.high - self.low) * part
        return [float(f"{value:.{self.digits}g}") for value in values]


class VaryEntry(catalogue.Entry):
    """One thing that is varied: one key, or several that take the same value."""

    key: Text | tuple[Text, ...]
    values: tuple[Value, ...] | None = None
    range: RangeEntry | None = None
    name: Text | None = None

    @field_validator("values", mode="before")
    @classmethod
    def _are_values(cls, values: Any) -> Any:
        """One line for each that is none of the kinds there are, not one for each kind."""
        for number, value in enumerate(values if isinstance(values, list | tuple) else (), start=1):
            if not isinstance(value, bool | int | float | str):
                raise ValueError(f"number {number} must be a number, a text, true or false")
            if not isinstance(value, str) and not abs(value) <= LARGEST_STATED:
                raise ValueError(f"{value!r} must be -{LARGEST_STATED:g} to {LARGEST_STATED:g}")
        return values

    @model_validator(mode="after")
    def _one_source(self) -> VaryEntry:
        if (self.values is None) == (self.range is None):
            raise ValueError("values or range: must have one of them")
        for name, there in (("key", self.keys), ("values", self.values)):
            if there == ():
                raise ValueError(f"{name}: has none, must have one or more")
        return self

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys, as a sequence."""
        return (self.key,) if isinstance(self.key, str) else self.key

    @property
    def label(self) -> str:
        """What it is called: its name, or its first key."""
        return self.name or self.keys[0]

    def listed(self) -> tuple[Value, ...]:
        """Its values, one after the other."""
        if self.values is not None:
            return self.values
        assert self.range is not None
        return tuple(self.range.at(np.linspace(0, 1, self.range.count or 2)))

    def sampled(self, part: Array) -> list[Value]:
        """Values at parts (n,) of the way, 0 to 1: of a list each as often."""
        if self.range is not None:
            return list(self.range.at(part))
        values = self.listed()
        return [values[min(int(p * len(values)), len(values) - 1)] for p in part]


class SweepEntry(catalogue.Entry):
    """A sweep as its TOML file says it.

    `combine`: every value with every other, the first with the first and so on, or `samples` drawn
    by a Latin hypercube.
    """

    title: Text
    procedure: Text
    imu: Text = "stim300"
    table: Text | None = None
    rate_hz: Annotated[int, Field(ge=1, le=HIGHEST_RATE_HZ)] = 50
    motion: Literal["ideal", "servo"] = "ideal"
    true_table: bool = False
    methods: tuple[Text, ...] | None = None
    without: tuple[Text, ...] = ()
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)] = 100
    seed: Annotated[int, Field(ge=0, le=LAST_SEED)] = 0
    combine: Literal["product", "zip", "latin-hypercube"] = "product"
    samples: Annotated[int, Field(ge=2, le=MOST_CASES)] | None = None
    vary: tuple[VaryEntry, ...] = ()

    @model_validator(mode="after")
    def _combined(self) -> SweepEntry:
        drawn = self.combine == "latin-hypercube"
        if drawn and (self.samples is None or not self.vary):
            raise ValueError("samples, vary: a latin-hypercube must have both")
        if not drawn and self.samples is not None:
            raise ValueError("samples: must have combine = 'latin-hypercube'")
        for number, one in enumerate(self.vary, start=1):
            counted = one.range is None or one.range.count is not None
            if not drawn and not counted:
                raise ValueError(f"vary {number}, range, count: required, but missing")
        lengths = {len(one.listed()) for one in self.vary}
        if self.combine == "zip" and len(lengths) > 1:
            told = ", ".join(str(len(one.listed())) for one in self.vary)
            raise ValueError(f"vary: have {told} values, must have as many each to be zipped")
        keys = [key for one in self.vary for key in one.keys]
        if len(set(keys)) < len(keys):
            raise ValueError("vary: a key is varied twice, must be once")
        return self


@dataclass(frozen=True, slots=True)
class Case:
    """One value of everything that is varied; `number` counts from 1."""

    number: int
    values: tuple[Value, ...]
    settings: Settings


@dataclass(frozen=True)
class Sweep:
    """A sweep and the texts of all files it names, by kind and name.

    Raises
    ------
    StandError
        It is not right: file, place, value and what is allowed, in one line.
    """

    source: Source
    entry: SweepEntry
    inputs: Mapping[tuple[str, str], Source]
    _texts: dict[tuple[str, str], Any] = field(default_factory=dict, repr=False)

    @property
    def labels(self) -> tuple[str, ...]:
        """What is varied, by its name."""
        return tuple(one.label for one in self.entry.vary)

    @cached_property
    def values(self) -> tuple[tuple[Value, ...], ...]:
        """The values of every case."""
        vary = self.entry.vary
        if self.entry.combine == "zip":
            return tuple(zip(*(one.listed() for one in vary), strict=True)) if vary else ((),)
        if self.entry.combine == "product":
            return tuple(product(*(one.listed() for one in vary)))
        parts = _hypercube(len(vary), self.entry.samples or 0, self.entry.seed)
        columns = [one.sampled(part) for one, part in zip(vary, parts.T, strict=True)]
        return tuple(zip(*columns, strict=True))

    @property
    def seeds(self) -> range:
        """The seeds of the runs of every case."""
        return range(self.entry.seed, self.entry.seed + self.entry.runs)

    def cases(self) -> Iterator[Case]:
        """All cases in order."""
        return (self.case(number) for number in range(1, len(self.values) + 1))

    def case(self, number: int) -> Case:
        """One case by its number, from 1."""
        if not 1 <= whole("case", number, 1) <= len(self.values):
            raise StandError(f"case = {number}: must be 1 to {len(self.values)}")
        values = self.values[number - 1]
        with located(f"{self.source.name}: {self.in_words(number)}"):
            return Case(number, values, self._settings(values))

    def in_words(self, number: int) -> str:
        """'case 3 (dwell [s] = 60, ...)'."""
        parts = zip(self.labels, self.values[number - 1], strict=True)
        told = ", ".join(f"{label} = {shown(value)}" for label, value in parts)
        return f"case {number}" + (f" ({told})" if told else "")

    def _settings(self, values: Sequence[Value]) -> Settings:
        entry = self.entry
        names = {"procedure": entry.procedure, "imu": entry.imu, "table": entry.table}
        fields: dict[str, Any] = {"rate_hz": entry.rate_hz, "motion": entry.motion}
        fields["true_table"] = entry.true_table
        edits: list[tuple[str, tuple[str, ...], Value]] = []
        for one, value in zip(entry.vary, values, strict=True):
            for key in one.keys:
                kind, path = place_of(key)
                if kind == "settings":
                    fields[path[0]] = value
                elif path:
                    edits.append((kind, path, value))
                elif isinstance(value, str):
                    names[kind] = value
                else:
                    raise StandError(f"{key} = {value!r}: must be an id or a TOML file")
        files: dict[str, Any] = {}
        for kind in FILES:
            name = names[kind]
            if kind == "table" and name is None:
                name = files["procedure"].entry.table
            own = tuple((path, value) for of, path, value in edits if of == kind)
            files[kind] = self._file(kind, str(name), own)
        return _assembled(files, fields, entry)

    def _file(self, kind: str, name: str, edits: tuple[tuple[tuple[str, ...], Value], ...]) -> Any:
        """A procedure, unit or table with what is changed in it; the last of each are kept."""
        source = self._source(kind, name)
        if edits:
            data = catalogue.table_of_text(source)
            for path, value in edits:
                given = stated(data, path, value) if kind == "imu" else value
                data = changed(data, path, given)
            source = Source(source.id, source.name, toml_of(data))
        kept = self._texts.get((kind, source.name))
        if kept is None or kept[0] != source.text:
            kept = self._texts[kind, source.name] = source.text, _PARSED[kind](source)
        return kept[1]

    def _source(self, kind: str, name: str) -> Source:
        try:
            return self.inputs[kind, name]
        except KeyError:
            raise StandError(f"{kind} {name}: is not among the inputs of this campaign") from None


_PARSED: Mapping[str, Any] = {"procedure": procedure_from, "imu": imu_from, "table": table_from}
_CATALOGUES = {"procedure": "procedures", "imu": "imus", "table": "tables"}


def _assembled(files: Mapping[str, Any], fields: Mapping[str, Any], entry: SweepEntry) -> Settings:
    procedure: Procedure = files["procedure"]
    imu: ImuSpec = files["imu"]
    table: Table = files["table"]
    site: Site = procedure.entry.site.site()
    return assembled(
        procedure,
        imu,
        table,
        site,
        fields["rate_hz"],
        motion=one_of("motion", fields["motion"], MotionKind),
        true_table=fields["true_table"],
        methods=entry.methods,
        without=entry.without,
        seed=entry.seed,
    )


def _hypercube(dimensions: int, samples: int, seed: int) -> Array:
    from scipy.stats.qmc import LatinHypercube

    return LatinHypercube(dimensions, rng=np.random.default_rng(seed)).random(samples)


def shown(value: Value) -> str:
    """A value as it is read."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


# --- reading ---


def load_sweep(path: str | Path) -> Sweep:
    """A sweep from its file, and all that it names: ids, or files beside it."""
    return sweep_from(catalogue.read_file("sweep", Path(path)))


def sweep_from(source: Source) -> Sweep:
    """A sweep from its text."""
    entry = catalogue.parse(source, SweepEntry)
    with located(source.name):
        inputs = dict(_inputs(entry, Path(source.name).parent))
    found = Sweep(source, entry, inputs)
    check(found)
    return found


def check(found: Sweep) -> None:
    """Refuse a sweep of which a case is not right."""
    if len(found.values) > MOST_CASES:
        raise StandError(f"{found.source.name}: {len(found.values)} cases: at most {MOST_CASES}")
    for _ in found.cases():
        pass
    if found.entry.combine != "latin-hypercube":
        _refuse_twins(found)


def _refuse_twins(found: Sweep) -> None:
    """Two cases of the same values have the same runs, and would count for twice as many."""
    seen: dict[tuple[Any, ...], int] = {}
    for number, values in enumerate(found.values, start=1):
        first = seen.setdefault(tuple((isinstance(v, bool), v) for v in values), number)
        if first != number:
            raise StandError(
                f"{found.source.name}: {found.in_words(number)}: is case {first} once more, "
                "values must differ"
            )


def count_of(entry: SweepEntry) -> int:
    """How many cases there are, without making them."""
    if entry.combine == "latin-hypercube":
        return entry.samples or 0
    lengths = [len(one.listed()) for one in entry.vary]
    return min(lengths, default=1) if entry.combine == "zip" else prod(lengths)


def _inputs(entry: SweepEntry, folder: Path) -> Iterator[tuple[tuple[str, str], Source]]:
    """The texts of all procedures, units and tables of any case."""
    names: dict[str, list[str]] = {"procedure": [entry.procedure], "imu": [entry.imu]}
    names["table"] = [] if entry.table is None else [entry.table]
    for one in entry.vary:
        for kind, path in map(place_of, one.keys):
            if kind in FILES and not path:
                names[kind] = [str(value) for value in one.listed()]
    for name in dict.fromkeys(names["procedure"]):
        source = _found("procedure", name, folder)
        yield ("procedure", name), source
        if not names["table"]:
            table = procedure_from(source).entry.table
            yield ("table", table), _found("table", table, Path())
    for kind in ("imu", "table"):
        for name in dict.fromkeys(names[kind]):
            yield (kind, name), _found(kind, name, folder)


def _found(kind: str, name: str, folder: Path) -> Source:
    """An entry of a catalogue, or a file by its path from the sweep's folder."""
    if name.endswith(".toml") or "/" in name or "\\" in name:
        return catalogue.read_file(kind, folder / name)
    return catalogue.find(_CATALOGUES[kind], kind, name)


# --- identity ---


def identity(found: Sweep, versions: Mapping[str, str]) -> dict[str, str]:
    """What the results of a campaign depend on, each by its name: texts by their hashes.

    How many runs there are is not among it: more of them go on where fewer ended.
    """
    plain = found.entry.model_dump(exclude={"title", "runs", "vary"})
    keys = {f"sweep, {key}": json.dumps(value) for key, value in plain.items()}
    for number, one in enumerate(found.entry.vary, start=1):
        told = one.model_dump(exclude={"name"}, exclude_none=True)
        keys[f"sweep, vary {number}"] = json.dumps(told)
    for (kind, name), source in found.inputs.items():
        keys[f"{kind} {name}"] = sha256(source.text.encode())
        for file, content in _beside(kind, source):
            keys[f"{kind} {name}, {file}"] = sha256(content)
    return keys | dict(versions)


def _beside(kind: str, source: Source) -> Iterator[tuple[str, bytes]]:
    """Files that a procedure or a table reads besides its own: profiles, an MJCF."""
    folder = Path(source.name).parent
    if kind == "procedure":
        for step in procedure_from(source).entry.step:
            file = getattr(step, "file", None)
            if file is not None and (folder / file).is_file():
                yield file, (folder / file).read_bytes()
    if kind == "table" and (model := table_from(source).model) is not None:
        yield from contents_of(model).items()


def sha256(content: bytes) -> str:
    """Of these bytes."""
    return hashlib.sha256(content).hexdigest()
