"""Parquet, by pyarrow."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError
from stand.recording.formats.extras import damaged, missing
from stand.recording.formats.table import ArrayTable


def read_parquet(path: Path, topic: str | None) -> ArrayTable:
    """The columns of a table; those that are asked for are read."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise missing(path, "Parquet", "pyarrow") from None
    if topic is not None:
        raise StandError(f"{path}: --topic: is for logs with topics, this is a table")
    try:
        with pq.ParquetFile(path, memory_map=False) as file:
            schema = file.schema_arrow
            names = tuple(schema.names)
            rows = file.metadata.num_rows
    except (pa.ArrowException, OSError, ValueError) as error:
        raise damaged(path, "Parquet file", error) from error

    def column(k: int) -> NDArray[Any]:
        try:
            found = pq.read_table(path, columns=[names[k]]).column(0)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise damaged(f"{path}: column {names[k]}", "Parquet file", error) from error
        if found.null_count:
            raise StandError(
                f"{path}: column {names[k]}: {found.null_count} of {rows} values are missing"
            )
        return np.asarray(found.to_numpy())

    return ArrayTable(topic="", names=names, rows=rows, width=len(names), column=column)
