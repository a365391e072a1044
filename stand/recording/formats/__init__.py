"""Files whose kind is known by their content and that are tables: one module per kind."""

from collections.abc import Callable, Mapping
from pathlib import Path

from stand.recording.formats.table import ArrayTable

READERS: Mapping[str, Callable[[Path, str | None], ArrayTable]] = {}
"""By the kind: takes the file, and which group of columns, to a table."""
