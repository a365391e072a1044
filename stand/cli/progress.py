"""Progress for a person, JSON for a machine."""

from __future__ import annotations

import json
import shlex
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


class Stopped(Exception):
    """Ctrl-C ended the work early, and what was done is told."""


def tell_left_behind(target: Path) -> None:
    """Say what an interrupted writer of this target has left there."""
    from stand.errors import printable
    from stand.folder import left_of

    for left in left_of(target):
        told = f"{left.path}: of an interrupted run; stand recover {shlex.quote(str(target))}"
        print(f"stand: {printable(told)} brings back what is whole", file=sys.stderr)


def print_json(value: Any) -> None:
    print(json.dumps(value, indent=1, allow_nan=False))


class _Bar:
    """A progress bar on stderr, drawn only for a person."""

    def __init__(self, title: str) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        from stand.report.console import console

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TimeRemainingColumn(),
            console=console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task(title, total=1.0)

    def __enter__(self) -> Callable[[float], None]:
        self._progress.start()
        return lambda done: self._progress.update(self._task, completed=done)

    def __exit__(self, *exc: object) -> None:
        self._progress.stop()


def progress(title: str, quiet: bool) -> AbstractContextManager[Callable[[float], None]]:
    if quiet or not sys.stderr.isatty():
        return nullcontext(lambda done: None)
    return _Bar(title)


def working(what: str, quiet: bool) -> AbstractContextManager[Any]:
    if quiet or not sys.stderr.isatty():
        return nullcontext()
    from stand.report.console import console

    return console(stderr=True).status(what)
