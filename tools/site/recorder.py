"""A plugin of pytest: every fault's message, by the file that made it; see `faults.py`."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("alignment", "stand")
_PATHS = re.compile(r"/[\w./-]*/(?=[\w.-])")  # of the machine that made the examples
_seen: dict[str, set[str]] = {}


def pytest_configure() -> None:
    """Each fault is noted where it is made."""
    from alignment.errors import Fault

    make = Fault.__init__

    def noted(self: Fault, *arguments: object) -> None:
        make(self, *arguments)
        _note(str(self))

    Fault.__init__ = noted  # type: ignore[method-assign]


def pytest_sessionfinish() -> None:
    """One file of each process of the tests."""
    target = Path(os.environ["STAND_FAULTS"]) / f"{os.getpid()}.json"
    kept = {file: sorted(messages) for file, messages in _seen.items()}
    target.write_text(json.dumps(kept), encoding="utf-8")


def _note(message: str) -> None:
    """Keep a message with the first file of ours, from within, that is no `errors.py`."""
    frame = sys._getframe(2)
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(ROOT) and path.name != "errors.py" and path != Path(__file__):
            file = path.relative_to(ROOT)
            if file.parts[0] in PACKAGES:
                _seen.setdefault(file.as_posix(), set()).add(_PATHS.sub("", message))
            return
        frame = frame.f_back  # type: ignore[assignment]
