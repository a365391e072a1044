"""The rules of the house, enforced on the source: who may import whom."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Each outside library has one door: a module or a folder.
DOORS = {
    "mujoco": ("stand.physics",),
    "mcap": ("stand.recording.mcap",),
    "rosbags": ("stand.recording.mcap.bag",),
    "rerun": ("stand.recording.review", "stand.recording.viewer"),
    "ruckig": ("stand.motion.moves",),
    "typer": ("stand.cli",),
    "rich": ("stand.cli", "stand.report.console"),
    "allantools": ("alignment.allan",),
    "matplotlib": ("stand.report",),
    "jinja2": ("stand.report",),
    "tomllib": ("stand.toml_files",),
}
OURS = ("alignment", "stand")

# The storeys of the stand: a module imports from its own storey and from lower ones.
STOREYS = (
    (
        "errors",
        "versions",
        "toml_files",
        "columns",
        "folder",
        "samples",
        "table",
        "procedure",
        "imu",
    ),
    ("motion", "physics", "vehicle", "simulation"),
    ("recording", "evaluation", "rehearsal"),
    ("report", "recorded_run", "recorded_drive", "api", "results", "cli", "__main__"),
)


def module_name(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, module: str) -> set[str]:
    """Every module a file imports anywhere, for type checkers alone included."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module.split(".")
                if path.name != "__init__.py":
                    package = package[:-1]
                package = package[: len(package) - node.level + 1]
                base = ".".join([*package, *([node.module] if node.module else [])])
            found |= {f"{base}.{alias.name}" for alias in node.names}
    return found


def graph(root: Path) -> dict[str, set[str]]:
    """Imports of every module of ours, by module name."""
    files = [path for package in OURS for path in sorted((root / package).rglob("*.py"))]
    return {module_name(p, root): imports(p, module_name(p, root)) for p in files}


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def trespassers(modules: dict[str, set[str]]) -> list[str]:
    """Breaches of rules 1 and 2, one line each."""
    found = []
    for module, wanted in sorted(modules.items()):
        for target in sorted(wanted):
            if within(module, "alignment") and within(target, "stand"):
                found.append(f"{module} imports {target}: estimators cannot see the stand")
            at_the_door = within(module, "stand.cli") or module == "stand.__main__"
            if within(target, "stand.cli") and not at_the_door:
                found.append(f"{module} imports {target}: nobody imports the command line")
            for library, doors in DOORS.items():
                at_door = any(within(module, door) for door in doors)
                if within(target, library) and not at_door:
                    found.append(f"{module} imports {target}: only {' and '.join(doors)} may")
    return found


def storey(module: str) -> int | None:
    """The storey of a module of the stand, from 0; None of the package's own face."""
    part = module.split(".")[1] if "." in module else ""
    return next((n for n, rooms in enumerate(STOREYS) if part in rooms), None)


def climbers(modules: dict[str, set[str]]) -> list[str]:
    """Imports from a higher storey, and modules that are on no storey, one line each."""
    found = []
    for module, wanted in sorted(modules.items()):
        if not within(module, "stand") or module == "stand":
            continue
        own = storey(module)
        if own is None:
            found.append(f"{module} is on no storey")
            continue
        for target in sorted(_ours(wanted, modules)):
            other = storey(target)
            if other is not None and other > own:
                found.append(f"{module} imports {target}: storey {own + 1} from {other + 1}")
    return found


def cycle(modules: dict[str, set[str]]) -> list[str]:
    """One import cycle among our modules, or nothing."""
    edges = {m: sorted(_ours(wanted, modules)) for m, wanted in modules.items()}
    state: dict[str, str] = {}

    def visit(module: str, trail: list[str]) -> list[str]:
        state[module] = "open"
        for target in edges[module]:
            if state.get(target) == "open":
                return [*trail[trail.index(target) :], target]
            if target not in state and (found := visit(target, [*trail, target])):
                return found
        state[module] = "done"
        return []

    for module in edges:
        if module not in state and (found := visit(module, [module])):
            return found
    return []


def _ours(wanted: set[str], modules: dict[str, set[str]]) -> set[str]:
    """The modules of ours that are meant: of `from a import b`, a.b if that is one, else a."""
    meant = {t if t in modules else t.rpartition(".")[0] for t in wanted}
    return {t for t in meant if t in modules}


def test_the_house_keeps_its_rules():
    modules = graph(ROOT)
    assert len(modules) > 30  # the search found the source at all
    assert trespassers(modules) == []
    assert climbers(modules) == []
    assert cycle(modules) == []


def test_alignment_stands_on_arrays_alone():
    allowed = {"alignment", "numpy", "scipy", "allantools"} | set(sys.stdlib_module_names)
    for module, wanted in graph(ROOT).items():
        if within(module, "alignment"):
            assert {target.split(".")[0] for target in wanted} <= allowed, module


@pytest.mark.parametrize(
    ("file", "line", "said"),
    [
        (
            "alignment/methods/triad.py",
            "from stand.motion.planner import plan",
            "cannot see the stand",
        ),
        ("alignment/methods/triad.py", "import stand", "cannot see the stand"),
        ("stand/motion/moves.py", "import mujoco.batch", "only stand.physics may"),
        ("stand/recorded_run.py", "from mcap.reader import make_reader", "recording.mcap may"),
        ("stand/recording/foreign.py", "import rerun as rr", "viewer may"),
        ("stand/evaluation/score.py", "from stand import cli", "nobody imports the command line"),
    ],
)
def test_each_breach_is_seen(tmp_path, file, line, said):
    path = tmp_path / file
    path.parent.mkdir(parents=True)
    path.write_text(f"def f():\n    {line}\n")
    assert any(said in breach for breach in trespassers(graph(tmp_path)))


@pytest.mark.parametrize(
    ("file", "line", "said"),
    [
        ("stand/table/table.py", "from stand.motion.plan import Plan", "storey 1 from 2"),
        ("stand/physics/truth.py", "from stand.recording.log import Log", "storey 2 from 3"),
        ("stand/evaluation/score.py", "import stand.report.page", "storey 3 from 4"),
        ("stand/imu/model.py", "from stand.api import settings", "storey 1 from 4"),
        ("stand/attic.py", "import math", "is on no storey"),
    ],
)
def test_a_climber_is_seen(tmp_path, file, line, said):
    targets = ("motion/plan", "recording/log", "report/page", "api")
    for path in (f"stand/{target}.py" for target in targets):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("")
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    {line}\n")
    assert any(said in breach for breach in climbers(graph(tmp_path)))


def test_a_cycle_is_seen(tmp_path):
    (tmp_path / "stand").mkdir()
    (tmp_path / "alignment").mkdir()
    for a, b in (("one", "two"), ("two", "three"), ("three", "one")):
        (tmp_path / "stand" / f"{a}.py").write_text(f"from stand import {b}\n")
    found = cycle(graph(tmp_path))
    assert found[0] == found[-1]
    assert set(found) == {"stand.one", "stand.two", "stand.three"}
