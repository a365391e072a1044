"""Runs kept as they are made: a file with a line for each, so that a command goes on with them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stand.errors import StandError
from stand.folder import held
from stand.simulation.settings import Settings
from stand.versions import versions


def case_digest(settings: Settings) -> bytes:
    """SHA-256 of all that makes a case: texts, site, and what decides its runs."""
    site, made = settings.site, settings
    case = (
        made.procedure.text,
        made.imu.text,
        made.table.text,
        repr((site.latitude, site.height, site.local_gravity)),
        repr((made.rate_hz, made.motion.value, made.sampling.value, made.seed)),
        repr((made.without, made.true_table)),
    )
    return hashlib.sha256("\0".join(case).encode()).digest()


class Journal:
    """Runs of one case in order, a line of JSON each, after a line that says of what they are.

    A line that was not finished, by a command that was ended, does not count. Numbers come back
    to the last bit.

    Parameters
    ----------
    path : Path
        A new file, or the journal of the same case.
    what : str
        The command and what else it makes of a run, as its methods.
    settings : Settings

    Raises
    ------
    StandError
        The file is something else, or of another case or version; another command works on it; it
        cannot be written.
    """

    def __init__(self, path: Path, what: str, settings: Settings) -> None:
        self._path = path
        head = {"runs_of": what, "case": case_digest(settings).hex(), **versions()}
        self.runs: list[Any] = []
        try:
            if not path.exists() or not path.stat().st_size:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(json.dumps(head) + "\n", encoding="utf-8")
            self._read(head)
        except OSError as error:
            raise self._not_written(error) from error

    def _read(self, head: dict[str, str]) -> None:
        content = self._path.read_bytes()
        whole = content.rfind(b"\n") + 1
        try:
            first, *lines = content[:whole].decode().splitlines()
            before = dict(json.loads(first))
            if "runs_of" not in before:
                raise ValueError(first)
            self.runs = [json.loads(line) for line in lines]
        except (ValueError, TypeError) as error:
            raise StandError(f"--keep {self._path}: holds no runs of a command") from error
        for name, value in head.items():
            if before.get(name) != value:
                raise StandError(
                    f"--keep {self._path}: is of another {name.replace('_', ' ')}; choose another "
                    "file"
                )
        if whole < len(content):  # a command was ended amid a line
            with self._path.open("rb+") as file:
                file.truncate(whole)

    @contextmanager
    def adding(self) -> Iterator[Journal]:
        """While runs are added; no other command may."""
        with held(self._path) as ours:
            if not ours:
                raise StandError(f"--keep {self._path}: another command is at work there")
            yield self

    def add(self, run: Any) -> None:
        """Keep the next run: plain values of JSON."""
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(run) + "\n")
        except OSError as error:
            raise self._not_written(error) from error

    def _not_written(self, error: OSError) -> StandError:
        return StandError(f"--keep {self._path}: cannot write there: {error.strerror}")
