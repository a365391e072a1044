"""Small bugs, put in one by one: which of them do the tests notice? `make mutants`.

A sample of each area's mutants, made by the operators of mutmut and one of ours, the same for a
seed. For each of them run the tests that pass its line, the quick ones first, until one fails.
`docs/mutants.md` is written of it, with the reasons that `mutants.toml` has for survivors.

Notes
-----
What no mutant touches: words, annotations, decorators, assertions, ``zip(strict=True)``; nor is a
value made None or an argument left out, which every test notices. Tests marked slow are not run.
"""

import argparse
import difflib
import gc
import importlib
import inspect
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import zip_longest
from multiprocessing import get_context
from pathlib import Path
from types import CodeType, FunctionType

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider
from mutmut.mutation import mutators

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "build" / "mutants"
AREAS = {
    "estimators": ("alignment/methods",),
    "information": ("alignment/information",),
    "rehearsal": ("stand/rehearsal",),
    "simulation": ("stand/simulation", "stand/motion", "stand/physics", "stand/imu"),
    "recording": ("stand/recording",),
}
BUDGET = 20.0  # s of tests, for one mutant
PATIENCE = 3  # times as long on the processor: it runs for ever
WAIT = 900  # s: it waits for ever
OURS = 70  # exit status of a fault of this file
OTHERS = ("numpy", "scipy.optimize", "scipy.spatial.transform", "scipy.stats", "scipy.interpolate")
OTHERS += ("mujoco", "ruckig", "mcap", "lz4.frame", "zstandard", "allantools", "jinja2")
OTHERS += ("pydantic", "typer.testing", "rich.table", "rich.progress", "pytest")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One bug: a file, the first and last line of what is changed, and the changed text."""

    area: str
    file: str
    lines: tuple[int, int]
    before: str
    after: str
    code: str


@dataclass(frozen=True, slots=True)
class Found:
    """What became of a mutant; `by`: the test that noticed, '' where none did."""

    area: str
    file: str
    line: int
    before: str
    after: str
    tests: int
    by: str


Task = tuple[Mutant, list[str]]  # with its tests, the first to be run first


# --- mutants -------------------------------------------------------------------------------------


def dropped(node: cst.BinaryOperation) -> Iterable[cst.BaseExpression]:
    """Of a sum, a difference or a product what stands before the sign."""
    if isinstance(node.operator, cst.Add | cst.Subtract | cst.Multiply | cst.Divide):
        yield node.left.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])


_LEFT_OUT = {"operator_string", "operator_assignment", "operator_arg_removal"}
OPERATORS = [
    *((kind, make) for kind, make in mutators.mutation_operators if make.__name__ not in _LEFT_OUT),
    (cst.BinaryOperation, dropped),
]


class _Places(cst.CSTVisitor):
    METADATA_DEPENDENCIES = (PositionProvider,)

    def __init__(self) -> None:
        self.found: list[tuple[cst.CSTNode, cst.CSTNode, tuple[int, int]]] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.Annotation | cst.Decorator | cst.Assert):
            return False
        if isinstance(node, cst.Arg) and node.keyword and node.keyword.value == "strict":
            return False
        for kind, make in OPERATORS:
            if isinstance(node, kind):
                at = self.get_metadata(PositionProvider, node, None)
                for other in make(node):
                    if at is not None:
                        self.found.append((node, other, (at.start.line, at.end.line)))
        return True


def places_of(file: str) -> Iterator[tuple[cst.Module, cst.CSTNode, cst.CSTNode, tuple[int, int]]]:
    """All of one file that can be changed, in the order of the text."""
    wrapper = MetadataWrapper(cst.parse_module((ROOT / file).read_text(encoding="utf-8")))
    places = _Places()
    wrapper.visit(places)
    for node, other, lines in places.found:
        yield wrapper.module, node, other, lines


def difference(code: str, changed: str) -> tuple[str, str]:
    """The lines that differ, each in one."""
    rows = list(difflib.ndiff(code.splitlines(), changed.splitlines()))
    was, now = ([r[2:].strip() for r in rows if r.startswith(sign)] for sign in ("- ", "+ "))
    return " ".join(was), " ".join(now)


def sample(area: str, seed: int, each: int) -> list[Mutant]:
    """Some of an area's mutants, by a seed: a file weighs as much as can be changed in it."""
    files = sorted(
        path.relative_to(ROOT).as_posix()
        for folder in AREAS[area]
        for path in (ROOT / folder).rglob("*.py")
    )
    places = [(file, *place) for file in files for place in places_of(file)]
    random.Random(f"{seed} {area}").shuffle(places)
    mutants: list[Mutant] = []
    for file, module, node, other, lines in places:
        if len(mutants) == each:
            break
        code, changed = module.code, module.deep_replace(node, other).code
        try:
            compile(changed, file, "exec")
        except SyntaxError:
            continue
        before, after = difference(code, changed)
        if before != after:
            mutants.append(Mutant(area, file, lines, before, after, changed))
    return mutants


# --- which test runs which line ------------------------------------------------------------------


class Map:
    """A pytest plugin: lines and seconds of each test."""

    def __init__(self, folder: Path) -> None:
        import coverage

        self._folder, self._times = folder, {}
        self._coverage = coverage.Coverage(
            data_file=folder / "coverage", source=["alignment", "stand"], config_file=False
        )
        self._coverage.start()

    def pytest_runtest_logstart(self, nodeid, location) -> None:
        self._coverage.switch_context(nodeid)
        self._times[nodeid] = -sum(os.times()[:4])  # of processors: the machine may be busy

    def pytest_runtest_logfinish(self, nodeid, location) -> None:
        self._times[nodeid] += sum(os.times()[:4])
        self._coverage.switch_context("")

    def pytest_unconfigure(self) -> None:
        self._coverage.stop()
        data = self._coverage.get_data()
        lines, imported = {}, {}
        for path in data.measured_files():
            file = Path(path).resolve().relative_to(Path.cwd()).as_posix()
            by_line = data.contexts_by_lineno(path)
            lines[file] = {line: [t for t in tests if t] for line, tests in by_line.items()}
            imported[file] = [line for line, tests in by_line.items() if "" in tests]
        text = json.dumps({"times": self._times, "lines": lines, "imported": imported})
        (self._folder / "map.json").write_text(text, encoding="utf-8")


def mapped(folder: Path) -> dict:
    """The map of all quick tests, made in a process of its own."""
    command = [sys.executable, __file__, "--map-into", str(folder)]
    subprocess.run(command, check=True, cwd=ROOT)
    return json.loads((folder / "map.json").read_text(encoding="utf-8"))


def tests_of(mutant: Mutant, found: dict) -> list[str]:
    """Those that pass the mutant's line, of its own folder and quick ones first; then the others
    of the same files, for what a fixture has run; as many as `BUDGET` allows."""
    times, lines = found["times"], found["lines"].get(mutant.file, {})
    first, last = mutant.lines
    own = {t for line in range(first, last + 1) for t in lines.get(str(line), ())}
    before = [n for n in map(int, lines) if n < first]
    if not own and before:
        own = set(lines[str(max(before))])
    if not own:  # at import
        own = {t for tests in lines.values() for t in tests}
    folder = "tests/" + mutant.file.rpartition("/")[0]

    def cheap(test: str) -> tuple[bool, float, str]:
        return not test.startswith(folder), times[test], test

    files = {t.partition("::")[0] for t in own}
    beside = {t for t in times if t.partition("::")[0] in files} - own
    chosen, spent = [], 0.0
    for test in (*sorted(own, key=cheap), *sorted(beside, key=cheap)):
        if spent + times[test] <= BUDGET or not chosen:
            chosen.append(test)
            spent += times[test]
    return chosen


# --- runs ----------------------------------------------------------------------------------------


def copied(to: Path) -> Path:
    """What git tracks, in a folder of its own."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name)
    return to


def functions(code: CodeType) -> Iterator[CodeType]:
    """Bodies of a module's functions and methods, in the order of the text; not those in bodies."""
    for one in code.co_consts:
        if isinstance(one, CodeType):
            at_once = not one.co_flags & inspect.CO_OPTIMIZED  # a class
            if not at_once and not one.co_name.endswith(("comp>", "genexpr>")):
                yield one
            else:
                yield from functions(one)


def shell(code: CodeType) -> tuple[object, ...]:
    """All else of a module or a class: what its import runs."""
    own = set(functions(code))
    kept = [
        (type(c), shell(c) if isinstance(c, CodeType) else c)
        for c in code.co_consts
        if c not in own
    ]
    return code.co_code, code.co_names, kept


def by_import(mutant: Mutant, found: dict) -> bool:
    """Whether a module that is imported already has run the line, or a test's module on its way."""
    imported = found["imported"].get(mutant.file, ())
    if any(line in imported for line in range(mutant.lines[0], mutant.lines[1] + 1)):
        return True
    was, now = (compile(text, mutant.file, "exec") for text in (original(mutant), mutant.code))
    return shell(was) != shell(now) or any(
        one.co_freevars != other.co_freevars
        for one, other in zip(functions(was), functions(now), strict=True)
    )


def original(mutant: Mutant) -> str:
    """The file as it is."""
    return (ROOT / mutant.file).read_text(encoding="utf-8")


def patch(own: Sequence[FunctionType], path: str, mutant: Mutant) -> None:
    """Put a mutant's bodies into the functions of a module that is imported from `path`."""
    was, now = (compile(text, path, "exec") for text in (original(mutant), mutant.code))
    new = {
        (one.co_qualname, one.co_firstlineno): other
        for one, other in zip(functions(was), functions(now), strict=True)
        if one != other
    }
    for one in own:
        key = one.__code__.co_qualname, one.__code__.co_firstlineno
        one.__code__ = new.get(key, one.__code__)


def into(log: Path) -> None:
    """What a process prints goes into a new file."""
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(file, 1)
    os.dup2(file, 2)


def forked(copy: Path, mutant: Mutant, stamp: int, run: Callable[[], int]) -> tuple[int, str]:
    """What a process of its own comes to, with the mutant in the copy: its status and its log."""
    path = copy / mutant.file
    path.write_text(mutant.code, encoding="utf-8")
    os.utime(path, (stamp, stamp))  # compiled code goes by the time of its source
    child = os.fork()
    if not child:
        os.setsid()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        into(copy / "log")
        most = round(PATIENCE * BUDGET)
        resource.setrlimit(resource.RLIMIT_CPU, (most, most))
        signal.alarm(WAIT)
        code = 1
        try:
            code = run()
        except Exception:
            traceback.print_exc()
            code = OURS
        finally:
            os._exit(code)
    try:
        _, status = os.waitpid(child, 0)
    finally:
        _end(child)  # with what a test may have left
    shutil.copy2(ROOT / mutant.file, path)
    os.utime(path)
    log = (copy / "log").read_text(encoding="utf-8", errors="replace")
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == OURS:
        raise SystemExit(log)
    return status, log


class Warm:
    """A pytest plugin: all tests are imported once, and each mutant is a fork that runs its own."""

    def __init__(self, copy: Path, queue: list[Task], told: Callable[..., None]) -> None:
        self._copy, self._queue, self._told = copy, queue, told

    def pytest_runtest_logreport(self, report) -> None:
        if report.failed:
            with (self._copy / "log").open("a", encoding="utf-8") as log:
                log.write(f"\nFAILED {report.nodeid}\n")

    def pytest_runtestloop(self, session) -> bool:
        from _pytest.main import pytest_runtestloop

        items = {item.nodeid: item for item in session.items}
        own: dict[str, list[FunctionType]] = {}
        for one in gc.get_objects():
            if isinstance(one, FunctionType):
                own.setdefault(one.__code__.co_filename, []).append(one)
        gc.collect()
        gc.freeze()  # pages that nobody writes are shared by the forks

        def run() -> int:
            path = str(self._copy / mutant.file)
            patch(own.get(path, []), path, mutant)
            session.items = [items[test] for test in tests]
            with suppress(session.Failed):
                pytest_runtestloop(session)
            return int(session.testsfailed > 0)

        for stamp, (mutant, tests) in enumerate(self._queue, start=1_000_000_000):
            self._told(mutant, tests, *forked(self._copy, mutant, stamp, run))
        return True


def worked(copy: Path, queue: list[Task], found: dict, told: Callable[..., None]) -> None:
    """Each of a queue in turn: bodies of functions in one process that has imported all, what an
    import runs in a process that imports it anew."""
    os.setsid()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.path.insert(0, str(copy))
    os.environ["PYTHONPATH"] = str(copy)
    os.environ["PYTEST_DEBUG_TEMPROOT"] = str(copy.parent)
    os.chdir(copy)
    import pytest

    quiet = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-m", "not slow"]
    warm = [task for task in queue if not by_import(task[0], found)]

    child = os.fork()
    if not child:
        into(copy / "warm")
        os._exit(pytest.main([*quiet, "-p", "no:randomly"], plugins=[Warm(copy, warm, told)]))
    _, status = os.waitpid(child, 0)
    if status:
        raise SystemExit((copy / "warm").read_text(encoding="utf-8", errors="replace"))
    cold = [task for task in queue if task not in warm]
    for stamp, (mutant, tests) in enumerate(cold, start=1_100_000_000):
        run = partial(pytest.main, [*quiet, *tests])
        told(mutant, tests, *forked(copy, mutant, stamp, run))


def result_of(m: Mutant, tests: list[str], status: int, log: str) -> Found:
    """What came of it."""
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", log, re.M)
    by = ""
    if status:
        by = failed[1] if failed else "time" if os.WIFSIGNALED(status) else "import"
    return Found(m.area, m.file, m.lines[0], m.before, m.after, len(tests), by)


def tried(mutants: list[Mutant], found: dict, jobs: int) -> Iterator[Found]:
    """Each in turn, `jobs` at a time; before them the code as it is, which no test may refuse."""
    for name in OTHERS:
        importlib.import_module(name)
    as_it_is = [replace(m, after=m.before, code=original(m)) for m in mutants[:1]]
    tasks = [(m, tests_of(m, found)) for m in (*as_it_is, *mutants)]
    results = get_context("fork").SimpleQueue()

    def told(*task) -> None:
        results.put(result_of(*task))

    running, left = [], jobs
    with tempfile.TemporaryDirectory() as root:
        try:
            for k in range(jobs):
                copy = copied(Path(root) / str(k))
                child = os.fork()
                if not child:
                    code = 1
                    try:
                        worked(copy, tasks[k::jobs], found, told)
                        code = 0
                    finally:
                        results.put(None)
                        os._exit(code)
                running.append(child)
            while left:
                result = results.get()
                if result is None:
                    left -= 1
                elif result.before != result.after:
                    yield result
                elif result.by:
                    raise SystemExit(f"without a bug: {result.by} fails")
        finally:
            for child in running:
                if left:  # it was interrupted
                    with suppress(ProcessLookupError):
                        os.killpg(child, signal.SIGTERM)
                os.waitpid(child, 0)


def _end(child: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)


# --- words ---------------------------------------------------------------------------------------


def page(results: list[Found], reasons: list[dict[str, str]], seed: object) -> str:
    """docs/mutants.md."""
    why = {(r["file"], r["before"], r["after"]): r["reason"] for r in reasons}
    rows, left = [], []
    for area in AREAS:
        own = [r for r in results if r.area == area]
        open_ones = [r for r in own if not r.by]
        same = [r for r in open_ones if (r.file, r.before, r.after) in why]
        real = len(own) - len(same)
        noticed = len(own) - len(open_ones)
        share = f"{100 * noticed / real:.0f} %" if real else ""
        rows.append(f"| {area} | {len(own)} | {len(same)} | {noticed} of {real} | {share} |")
        for r in open_ones:
            reason = why.get((r.file, r.before, r.after), "not noticed")
            left.append(f"- {r.file}:{r.line}: {reason}\n  - `{r.before}`\n  - `{r.after}`")
    return PAGE.format(seed=seed, rows="\n".join(rows), left="\n".join(left) or "none")


PAGE = """# Bugs that the tests notice

`make mutants` puts small bugs into the code, one at a time (a sign, a factor, a limit, a term left
out), and runs the quick tests that pass the changed line, until one fails. It makes this page of
it; `tests/benchmarks/mutants.toml` holds why some bugs make no difference. Words, annotations and
checks of types are left alone. Which bugs is drawn by a seed, here {seed}:
`make mutants ARGS="--seed 5 --each 60"` draws others, `--areas recording` those of one area.

| area | bugs | of them make no difference | noticed | |
|---|---|---|---|---|
{rows}

## What passed

{left}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=40, help="mutants of an area")
    parser.add_argument("--areas", nargs="*", default=list(AREAS), choices=AREAS)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--map", type=Path, help="a map made before, of the same code")
    parser.add_argument("--map-into", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.map_into:
        import pytest

        args = ["-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:randomly"]
        sys.exit(pytest.main(args, plugins=[Map(asked.map_into)]))
    OUT.mkdir(parents=True, exist_ok=True)
    found = json.loads(asked.map.read_text(encoding="utf-8")) if asked.map else mapped(OUT)
    samples = [sample(area, asked.seed, asked.each) for area in asked.areas]
    mutants = [m for together in zip_longest(*samples) for m in together if m]
    results = []
    # Ctrl-C: the page tells of those that were tried
    with (OUT / "results.jsonl").open("w", encoding="utf-8") as kept, suppress(KeyboardInterrupt):
        for result in tried(mutants, found, asked.jobs):
            results.append(result)
            print(f"{len(results)}/{len(mutants)} {result.file}:{result.line} {result.by or '-'}")
            kept.write(json.dumps(asdict(result)) + "\n")
            kept.flush()
    reasons = tomllib.loads((Path(__file__).with_suffix(".toml")).read_text(encoding="utf-8"))
    text = page(results, reasons.get("same", []), asked.seed)
    (ROOT / "docs" / "mutants.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
