"""The rows of a campaign: parts as they come, then one file, of the same bytes in any order.

A part is written beside and renamed: it is whole or not there. Whole runs lie in it, so what is
in a part is done. Parts are gathered by the dozens, that there are never many of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from stand.campaigns.trial import Run
from stand.errors import StandError
from stand.folder import write_file

FILE, PARTS = "results.parquet", "parts"
GATHERED = 64  # parts of a size that become one of the next
WORDS = ("method", "window", "place", "quantity", "refusal")
NUMBERS = ("estimate", "error", "sigma")
PLACES = ("case", "seed", "method", "window", "place", "quantity")
COLUMNS = (*PLACES, *NUMBERS, "refusal", "noise_only")

Columns = dict[str, NDArray[Any]]


def arrow() -> Any:
    """The library that writes Parquet.

    Raises
    ------
    StandError
        It is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise StandError(
            "campaign: results are Parquet, by pyarrow: pip install 'imu-test-stand[campaign]'"
        ) from None
    return pyarrow


def _schema(pa: Any) -> Any:
    """Errors and sigmas have 7 digits, so that 100 000 rows take a megabyte; estimates have all."""
    word = pa.dictionary(pa.int32(), pa.string())
    kinds = {"case": pa.int32(), "seed": pa.int64(), "estimate": pa.float64()}
    kinds["noise_only"] = pa.bool_()
    kinds |= dict.fromkeys(WORDS, word) | {"error": pa.float32(), "sigma": pa.float32()}
    return pa.schema([(name, kinds[name]) for name in COLUMNS])


class NotWritten(StandError):
    """Rows that could not be kept: the disk is full, or may not be written."""


class Results:
    """The rows in a folder."""

    def __init__(self, folder: Path) -> None:
        self.file, self._parts = folder / FILE, folder / PARTS
        self._arrow = arrow()

    def files(self) -> list[Path]:
        """Where rows are: parts, and what was whole before them."""
        whole = [self.file] if self.file.exists() else []
        return [*whole, *sorted(self._parts.glob("*.parquet"))]

    def known(self) -> dict[int, set[int]]:
        """The seeds of the runs that are there, by case."""
        found: dict[int, set[int]] = {}
        for file in self.files():
            table = self._read(file, ["case", "seed"])
            pairs = np.stack([table["case"].to_numpy(), table["seed"].to_numpy()], axis=1)
            for case, seed in np.unique(pairs.astype(np.int64), axis=0).tolist():
                found.setdefault(case, set()).add(seed)
        return found

    def add(self, runs: Sequence[Run]) -> None:
        """Keep some runs: they are there when this returns, or not at all.

        Raises
        ------
        NotWritten
            They cannot be written.
        """
        if runs:
            self._write(self._part(0), self._table(runs))
            self._gather()

    def finish(self) -> None:
        """All rows as one file, in order; its bytes do not depend on who made them when."""
        files = self.files()
        if files == [self.file]:
            return
        rows = self._in_order(self._joined(files))
        self._write(self.file, rows)
        for part in files:
            if part != self.file:
                part.unlink()
        for left in self._parts.iterdir():  # of a client that was ended while it wrote
            left.unlink()
        self._parts.rmdir()

    def columns(self, names: Iterable[str] = COLUMNS) -> Columns:
        """The rows there are, by column: words as objects, numbers as float64 or int64, or bool."""
        names = list(names)
        files = self.files()
        if not files:
            return {name: np.empty(0, object if name in WORDS else float) for name in names}
        table = self._plain(self._in_order(self._joined(files)))
        return {name: _array(table[name]) for name in names}

    def table(self) -> Any:
        """The rows there are, as a table of pyarrow, in order."""
        return self._in_order(self._joined(self.files()))

    # --- files

    def _part(self, level: int) -> Path:
        return self._parts / f"{level}-{uuid4().hex}.parquet"

    def _gather(self) -> None:
        level = 0
        while len(parts := sorted(self._parts.glob(f"{level}-*.parquet"))) >= GATHERED:
            self._write(self._part(level + 1), self._joined(parts))
            for part in parts:
                part.unlink()
            level += 1

    def _read(self, file: Path, names: list[str] | None = None) -> Any:
        try:
            table = self._arrow.parquet.read_table(file, columns=names, memory_map=False)
        except (self._arrow.ArrowException, OSError, ValueError) as error:
            raise StandError(f"{file}: is no results of a campaign: {error}") from error
        if table.column_names != (names or list(COLUMNS)):
            raise StandError(f"{file}: is no results of a campaign: other columns")
        return table

    def _joined(self, files: Sequence[Path]) -> Any:
        """The rows of some files, of a run that is in several once."""
        pa = self._arrow
        tables, seen = [], np.empty(0, np.int64)
        for file in files:
            table = self._read(file)
            key = _run_of(table)
            new = ~np.isin(key, seen)
            seen = np.union1d(seen, key)
            tables.append(table if new.all() else table.filter(pa.array(new)))
        return pa.concat_tables(tables) if tables else self._table([])

    def _in_order(self, table: Any) -> Any:
        """By case, seed, method, window, place, quantity; words numbered in that order."""
        order = [(name, "ascending") for name in PLACES]
        plain = self._plain(table).sort_by(order).combine_chunks()
        return plain.cast(_schema(self._arrow))

    def _plain(self, table: Any) -> Any:
        """The same with its words spelled out."""
        pa = self._arrow
        kinds = [(f.name, pa.string() if f.name in WORDS else f.type) for f in table.schema]
        return table.cast(pa.schema(kinds))

    def _table(self, runs: Sequence[Run]) -> Any:
        pa = self._arrow
        rows = [(run.case, run.seed, *row) for run in runs for row in run.rows]
        columns = dict(zip(COLUMNS, zip(*rows, strict=True), strict=True)) if rows else {}
        arrays = []
        for kind in _schema(pa):
            values = columns.get(kind.name, ())
            if kind.name in WORDS:
                words = [value or None for value in values] if kind.name == "refusal" else values
                arrays.append(pa.array(words, pa.string()).dictionary_encode().cast(kind.type))
            elif kind.name in NUMBERS:
                numbers = np.array(values, float)
                arrays.append(pa.array(numbers, kind.type, mask=np.isnan(numbers)))
            else:
                arrays.append(pa.array(values, kind.type))
        return pa.table(arrays, schema=_schema(pa))

    def _write(self, path: Path, table: Any) -> None:
        sink = self._arrow.BufferOutputStream()
        self._arrow.parquet.write_table(
            table,
            sink,
            compression="zstd",
            compression_level=6,
            use_dictionary=["case", *WORDS],
            column_encoding={
                "seed": "DELTA_BINARY_PACKED", **dict.fromkeys(NUMBERS, "BYTE_STREAM_SPLIT")
            },
        )  # fmt: skip
        try:
            write_file(path, sink.getvalue().to_pybytes())
        except StandError as error:
            raise NotWritten(str(error)) from error


def _run_of(table: Any) -> NDArray[np.int64]:
    """A number for the run of each row, of its own: seeds are below 2^40 where there are cases."""
    case, seed = table["case"].to_numpy(), table["seed"].to_numpy()
    return (case.astype(np.int64) << 40) ^ seed.astype(np.int64)


def _array(column: Any) -> NDArray[Any]:
    plain = column.to_numpy()
    if plain.dtype == bool:
        return plain
    if plain.dtype == object:
        return np.array([word or "" for word in plain], object)
    return plain.astype(float if plain.dtype.kind == "f" else np.int64)


def per_run(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Case and seed (m, 2) of every run there is."""
    return np.unique(np.stack([columns["case"], columns["seed"]], axis=1), axis=0)
