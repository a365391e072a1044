"""The index of faults: every message in the source, with an example that a test has seen.

    python tools/site/faults.py    # runs the quick tests and writes docs/site/faults.json

What a message says is read from the source at each build; an example counts only while it still
fits its message, so that the page cannot show what is no longer said.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "site" / "faults.json"
PACKAGES = ("alignment", "stand")
HOLE = "…"  # what the input puts into a message
LEAST_WORDS = 8  # letters of a message outside of its holes: else it is made elsewhere
# where a message begins to say what would do
REMEDIES = re.compile(
    r"(must|known:|did you mean|allowed|at least|at most|choose|install|needs?\b|leave|would do"
    r"|--\w|give |name |use )"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A message of the source: `template` with `HOLE` for what the input puts in."""

    file: str
    kind: str
    template: str

    def fits(self, message: str) -> bool:
        """Whether a message is one of this template."""
        parts = [re.escape(part) for part in self.template.split(HOLE)]
        return re.search("(.*?)".join(parts), message) is not None

    @property
    def remedy(self) -> str:
        """The part of the message that says what is allowed."""
        found = REMEDIES.search(self.template)
        return self.template[found.start() :] if found else ""


def faults() -> list[Fault]:
    """Every fault that the source raises, in order of its files."""
    found: dict[tuple[str, str], Fault] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            for kind, template in _raised(ast.parse(path.read_text(encoding="utf-8"))):
                found.setdefault((file, template), Fault(file, kind, template))
    return list(found.values())


def _raised(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Kind and template of every fault that is made in a module."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(
            node.func, "id", "")  # fmt: skip
        if name == "unknown" and node.args:
            template = f"unknown {_text(node.args[0])} {HOLE}"
            yield "StandError", f"{template}: did you mean {HOLE}? known: {HOLE}"
        elif _is_fault(name) and node.args:
            template = _text(node.args[0])
            if len(template.replace(HOLE, "")) >= LEAST_WORDS:
                yield name, template


KINDS = ("AlignmentError", "Fault", "NoDriver", "NotAtRest", "PoleError", "Saturated", "StandError",
         "TooShort")  # fmt: skip


def _is_fault(name: str) -> bool:
    return name in KINDS


def _text(node: ast.expr) -> str:
    """The text that an expression makes, with holes for what is not known of it."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return " ".join(node.value.split()) if node.value.strip() else node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(v.value if isinstance(v, ast.Constant) else HOLE for v in node.values)  # type: ignore[misc]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _text(node.left) + _text(node.right)
    return HOLE


def fault_page() -> str:
    """The index as markdown, by where the faults arise."""
    text = EXAMPLES.read_text(encoding="utf-8") if EXAMPLES.is_file() else "{}"
    seen: dict[str, list[str]] = json.loads(text)
    groups: dict[str, list[Fault]] = {}
    for fault in faults():
        groups.setdefault("/".join(fault.file.split("/")[:2]).removesuffix(".py"), []).append(fault)
    parts = [
        "# Faults and their remedies",
        "A fault of the input is one line on stderr, `stand: ...`, and exit code 2; in Python it "
        "is a `stand.StandError`, or an `AlignmentError` where a method does not answer. What "
        f"comes with a traceback is a bug. `{HOLE}` stands for what the input puts in; examples "
        "are lines that the tests have seen, and stand here while they fit the source.",
    ]
    for group, own in groups.items():
        parts.append(f"## `{group}`")
        for fault in own:
            parts.append(f"`{_code(fault.template)}`")
            lines = [f": {fault.kind}, `{fault.file}`."]
            example = next((m for m in seen.get(fault.file, []) if fault.fits(m)), "")
            if example:
                lines.append(f"  Seen: `{_code(example)}`")
            if fault.remedy:
                lines.append(f"  Remedy: `{_code(fault.remedy)}`")
            parts.append("\n\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _code(text: str) -> str:
    """Text that may stand between backticks."""
    return " ".join(text.replace("`", "'").split())


# --- examples, from the tests


class Recorder:
    """A plugin of pytest: every fault's message, by the file that made it."""

    def __init__(self) -> None:
        self.seen: dict[str, set[str]] = {}

    def pytest_configure(self) -> None:
        from alignment.errors import Fault as Known

        recorder, make = self, Known.__init__

        def noted(self: Known, *arguments: object) -> None:
            make(self, *arguments)
            recorder.note(str(self))

        Known.__init__ = noted  # type: ignore[method-assign]

    def note(self, message: str) -> None:
        """Keep a message with the first file of ours, from within, that is no `errors.py`."""
        frame = sys._getframe(2)
        while frame is not None:
            path = Path(frame.f_code.co_filename)
            if path.is_relative_to(ROOT) and path.name != "errors.py" and path != Path(__file__):
                if path.relative_to(ROOT).parts[0] in PACKAGES:
                    file = path.relative_to(ROOT).as_posix()
                    self.seen.setdefault(file, set()).add(_PATHS.sub("", message))
                return
            frame = frame.f_back  # type: ignore[assignment]

    def pytest_sessionfinish(self) -> None:
        kept = {}
        for fault in faults():
            fitting = sorted((m for m in self.seen.get(fault.file, ()) if fault.fits(m)), key=_rank)
            if fitting:
                kept.setdefault(fault.file, {})[fitting[0]] = None
        EXAMPLES.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({k: list(v) for k, v in sorted(kept.items())}, indent=1,
                          ensure_ascii=False)  # fmt: skip
        EXAMPLES.write_text(text + "\n", encoding="utf-8")


_PATHS = re.compile(r"/[\w./-]*/(?=[\w.-])")  # of the machine that made the examples


def _rank(message: str) -> tuple[bool, int, str]:
    """Short ones first, those with the folder of a test last."""
    return "pytest" in message, len(message), message


_IN_PYTEST = """
import sys
sys.path.insert(0, "tools/site")
import faults, pytest
sys.exit(pytest.main([*sys.argv[1:], "-q", "-p", "no:cacheprovider"], plugins=[faults.Recorder()]))
"""


def _main() -> int:
    """In a process of its own, in which this module is no script: examples are by its name."""
    arguments = sys.argv[1:] or ["tests", "-m", "not slow"]
    command = [sys.executable, "-c", _IN_PYTEST, *arguments]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(_main())
