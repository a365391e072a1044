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
    "pyulog": ("stand.recording.formats.ulog",),
    "av": ("stand.report.encoding",),
    "h5py": ("stand.recording.formats.hdf5",),
    "pyarrow": (
        "stand.recording.formats.parquet",
        "stand.recording.export",
        "stand.campaigns.results",
    ),
    "dask": ("stand.simulation.cluster",),
    "distributed": ("stand.simulation.cluster",),
    "rerun": ("stand.recording.review", "stand.recording.viewer"),
    "ruckig": ("stand.motion.moves",),
    "typer": ("stand.cli",),
    "rich": ("stand.cli", "stand.report.console"),
    "matplotlib": ("stand.report",),
    "jinja2": ("stand.report",),
    "tomllib": ("stand.toml_files",),
}
OURS = ("alignment", "stand")

# The storeys of the stand: a module imports from its own storey and from lower ones.
STOREYS = (
    (
        "errors",
        "arguments",
        "bounds",
        "versions",
        "toml_files",
        "columns",
        "folder",
        "samples",
        "room",
        "threads",
        "unneeded",
        "table",
        "procedure",
        "imu",
    ),
    ("motion", "physics", "vehicle", "simulation"),
    ("recording", "evaluation", "rehearsal", "campaigns", "calibration", "proposal"),
    ("report", "recorded_run", "recorded_drive", "recovered", "api", "results", "cli", "__main__"),
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
    part = module.split(".")[1] if within(module, "stand") and "." in module else ""
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


# Files that are not converted yet: none may be added.
POSITIONAL = {
    "alignment/methods/fine.py",
    "alignment/methods/inertial.py",
    "alignment/methods/six_position.py",
    "alignment/methods/two_gyro.py",
    "stand/report/document.py",
}


def sources(root: Path) -> dict[str, ast.Module]:
    """Our modules as trees, by path."""
    return {
        path.relative_to(root).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for package in OURS
        for path in sorted((root / package).rglob("*.py"))
    }


def called(node: ast.expr) -> str:
    """The last word of what is called or named: C of C, of a.C and of C()."""
    if isinstance(node, ast.Call):
        return called(node.func)
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def wide(trees: dict[str, ast.Module]) -> set[str]:
    """Names of dataclasses and named tuples of more than four fields, inherited ones included."""
    nodes = [n for tree in trees.values() for n in ast.walk(tree) if isinstance(n, ast.ClassDef)]
    own = {n.name: sum(isinstance(s, ast.AnnAssign) for s in n.body) for n in nodes}
    bases = {n.name: [called(b) for b in n.bases] for n in nodes}

    def count(name: str) -> int:
        return own.get(name, 0) + sum(count(b) for b in bases.get(name, []) if b != name)

    made = {
        n.name
        for n in nodes
        if any(called(d) == "dataclass" for d in n.decorator_list) or "NamedTuple" in bases[n.name]
    }
    return {name for name in made if count(name) > 4}


def unnamed(trees: dict[str, ast.Module]) -> list[str]:
    """Fields beyond the fourth that are given without their name, one line a call.

    A starred sequence counts as one: it is in the fields' order as a whole.
    """
    classes = wide(trees)
    return [
        f"{file}:{n.lineno}: {called(n)} of {len(n.args)} fields by position"
        for file, tree in trees.items()
        for n in ast.walk(tree)
        if isinstance(n, ast.Call) and called(n) in classes and len(n.args) > 4
    ]


@pytest.mark.slow
def test_fields_beyond_the_fourth_are_named():
    trees = sources(ROOT)
    assert len(wide(trees)) > 50  # the search found the classes at all
    found = unnamed(trees)
    assert [line for line in found if line.split(":")[0] not in POSITIONAL] == []
    assert {line.split(":")[0] for line in found} == POSITIONAL


@pytest.mark.parametrize(
    ("made", "breach"),
    [
        ("Five(1, 2, 3, 4, 5)", True),
        ("module.Five(1, 2, 3, 4, 5)", True),
        ("Heir(1, 2, 3, 4, 5)", True),
        ("Five(1, 2, 3, 4, e=5)", False),
        ("Five(*values)", False),
        ("Four(1, 2, 3, 4)", False),
        ("function(1, 2, 3, 4, 5)", False),
    ],
)
def test_an_unnamed_field_is_seen(made, breach):
    fields = "".join(f"    {name}: int\n" for name in "abcd")
    source = (
        f"@dataclass(frozen=True)\nclass Four:\n{fields}"
        f"class Five(NamedTuple):\n{fields}    e: int\n"
        f"@dataclass\nclass Heir(Four):\n    e: int\n{made}\n"
    )
    assert bool(unnamed({"a.py": ast.parse(source)})) is breach


SPOKEN = {"told", "asked", "said", "felt"}
SPOKEN_STILL = {"told_at"}  # in files that are not converted yet: none may be added


def names(tree: ast.Module) -> set[str]:
    """What a module offers by name: functions, classes, fields, constants, arguments of them."""
    found: set[str] = set()
    rooms: list[ast.Module | ast.ClassDef] = [tree]
    while rooms:
        for node in rooms.pop().body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                if node.name.startswith("_") and not node.name.startswith("__"):
                    continue
                found.add(node.name)
            if isinstance(node, ast.ClassDef):
                rooms.append(node)
            elif isinstance(node, ast.FunctionDef):
                a = node.args
                found |= {arg.arg for arg in (*a.posonlyargs, *a.args, *a.kwonlyargs)}
            elif isinstance(node, ast.AnnAssign | ast.Assign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found |= {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)}
    return {name for name in found if not name.startswith("_")}


def spoken(tree: ast.Module) -> set[str]:
    """Names with what somebody told, asked, said or felt where the field has a noun."""
    return {name for name in names(tree) if SPOKEN & set(name.lower().split("_"))}


@pytest.mark.slow
def test_public_names_are_nouns_of_the_field():
    assert set().union(*map(spoken, sources(ROOT).values())) == SPOKEN_STILL


@pytest.mark.parametrize(
    ("source", "seen"),
    [
        ("def told_of(): pass", {"told_of"}),
        ("def f(a, *, felt=1): pass", {"felt"}),
        ("class C:\n    asked: int\n    def said(self): pass", {"asked", "said"}),
        ("TOLD = 1", {"TOLD"}),
        ("def _told(felt):\n    said = 1", set()),
        ("def f():\n    told = 1", set()),
    ],
)
def test_a_spoken_name_is_seen(source, seen):
    assert spoken(ast.parse(source)) == seen


def test_the_house_keeps_its_rules():
    modules = graph(ROOT)
    assert len(modules) > 30  # the search found the source at all
    assert trespassers(modules) == []
    assert climbers(modules) == []
    assert cycle(modules) == []


def test_alignment_stands_on_arrays_alone():
    allowed = {"alignment", "numpy", "scipy"} | set(sys.stdlib_module_names)
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
        ("stand/campaigns/campaign.py", "import distributed", "only stand.simulation.cluster may"),
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
