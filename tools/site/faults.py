"""The index of faults: every message in the source, with an example that a test has seen.

    python tools/site/faults.py           # runs the quick tests, adds to docs/site/faults.json
    python tools/site/faults.py tests     # all of them; or a folder: what is known stays
    python tools/site/faults.py tools/site/triggers.py   # wrong inputs, a line each: in seconds

What a message says is read from the source at each build; an example counts only while it still
fits its message, so that the page cannot show what is no longer said.
"""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "site" / "faults.json"
REMEDIES = ROOT / "docs" / "site" / "remedies.toml"
PACKAGES = ("alignment", "stand")
HOLE = "…"  # what the input puts into a message
LEAST_WORDS = 8  # letters of a message outside of its holes: else it is made elsewhere
# where a message begins to say what would do
REMEDY = re.compile(
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
        # near matches are named where there are any
        pattern = "(.*?)".join(parts).replace(
            "did\\ you\\ mean\\ (.*?)\\?\\ ", "(did you mean .*?)?"
        )
        return re.search(pattern, message) is not None

    @property
    def allowed(self) -> str:
        """The part of the message that says what is allowed; '' where none does."""
        found = REMEDY.search(self.template)
        return self.template[found.start() :] if found else ""

    def remedy(self, stated: Mapping[str, str]) -> str:
        """What would do, as markdown: the message says it, or `stated` does (`remedies`)."""
        if self.allowed:
            return f"`{_code(self.allowed)}`"
        own = f"{self.file} {self.template}"
        return next((text for pattern, text in stated.items() if re.search(pattern, own)), "")


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


def examples() -> dict[str, list[str]]:
    """Messages that tests have seen, by the file that made them."""
    text = EXAMPLES.read_text(encoding="utf-8") if EXAMPLES.is_file() else "{}"
    return json.loads(text)


def remedies() -> dict[str, str]:
    """What would do, by a pattern of the messages that do not say it; the first counts."""
    return tomllib.loads(REMEDIES.read_text(encoding="utf-8"))["remedies"]


def fault_page() -> str:
    """The index as markdown, by where the faults arise."""
    seen, stated = examples(), remedies()
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
            remedy = fault.remedy(stated)
            if remedy:
                lines.append(f"  Remedy: {remedy}")
            parts.append("\n\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _code(text: str) -> str:
    """Text that may stand between backticks."""
    return " ".join(text.replace("`", "'").split())


# --- examples, from the tests


def kept(seen: Mapping[str, Iterable[str]], known: Sequence[Fault]) -> dict[str, list[str]]:
    """One message of each fault that was seen, by file: the first that fits."""
    found: dict[str, dict[str, None]] = {}
    for fault in known:
        fitting = [message for message in seen.get(fault.file, ()) if fault.fits(message)]
        if fitting:
            found.setdefault(fault.file, {})[fitting[0]] = None
    return {file: list(messages) for file, messages in sorted(found.items())}


def _rank(message: str) -> tuple[bool, int, str]:
    """Short ones first, those with the folder of a test last."""
    return "pytest" in message, len(message), message


def _harvest(arguments: Sequence[str]) -> int:
    """Run tests with `recorder.py`; what they saw joins what is kept while it fits."""
    with TemporaryDirectory() as folder:
        places = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
        code = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "recorder", *arguments],
            cwd=ROOT, check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(places), "STAND_FAULTS": folder},
        ).returncode  # fmt: skip
        seen: dict[str, list[str]] = examples()
        for path in sorted(Path(folder).glob("*.json")):
            for file, messages in json.loads(path.read_text(encoding="utf-8")).items():
                seen[file] = [*seen.get(file, []), *sorted(messages, key=_rank)]
    text = json.dumps(kept(seen, faults()), indent=1, ensure_ascii=False)
    EXAMPLES.write_text(text + "\n", encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(_harvest(sys.argv[1:] or ["tests", "-m", "not slow"]))
