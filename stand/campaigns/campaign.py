"""A campaign at work: runs as they are made, kept every second, gone on with where they ended."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from stand.campaigns.folder import alone, default_folder, opened
from stand.campaigns.results import NotWritten, Results
from stand.campaigns.sweep import Case, Sweep
from stand.campaigns.trial import ENDED, Row, Run, predicted, ready
from stand.folder import write_file
from stand.rehearsal.result import Prediction
from stand.simulation.parallel import pool
from stand.simulation.work import Done, Engine, Lost, Supply, Task, here, processes_for, recipe_of

PREDICTIONS = "predictions.json"
EVERY_S = 1.0  # between what is kept
SLOW_S = 0.5  # of a run: each is kept at once

Progress = Callable[[float], None]


class Size(NamedTuple):
    """What a campaign comes to: `known` runs are there already; seconds of one core, bytes."""

    cases: int
    runs: int
    known: int
    seconds: float
    rows: int
    size: int


def engine_of(runs: int, workers: int | None) -> Engine:
    """Processes of this machine, as many as pay; of one, this process."""
    workers = processes_for(runs) if workers is None else workers
    return here if workers == 1 else partial(pool, workers=workers)


class Campaign:
    """The runs of a sweep: iterate over them as they are made.

    Whatever ends the iteration, what was made is kept; `done` of `total` runs are there.

    Parameters
    ----------
    sweep : Sweep
    out : path, optional
        Its folder; else one of its own among the recordings.
    resume : bool
        Go on with the campaign that is there: of what it holds nothing is made again.
    engine : callable, optional
        Who makes the runs; else processes of this machine.
    workers : int, optional
        How many processes; else as many as there are cores.

    Raises
    ------
    StandError
        The folder is another campaign's, or holds something else.
    """

    def __init__(
        self,
        sweep: Sweep,
        out: Path | None = None,
        *,
        resume: bool = False,
        engine: Engine | None = None,
        workers: int | None = None,
    ) -> None:
        self.sweep, self.folder = sweep, out or default_folder(sweep)
        self.results: Results = opened(self.folder, sweep, resume)
        self._known = self.results.known()
        self.cases = len(sweep.values)
        self.total = self.cases * sweep.entry.runs
        wanted = sweep.seeds
        self.done = sum(sum(s in wanted for s in seeds) for seeds in self._known.values())
        self._engine = engine or engine_of(self.total - self.done, workers)
        self._predictions: dict[int, list[dict[str, Any]]] = {}
        self.lost: list[Lost] = []

    def __iter__(self) -> Generator[Run]:
        with alone(self.folder):
            yield from self._runs()
            self.results.finish()
            if self._predictions:
                self._write_predictions()

    def _runs(self) -> Generator[Run]:
        kept: list[Run] = []
        last = time.monotonic()
        with closing(self._engine(Supply(self._tasks()))) as found:
            try:
                for done in found:
                    fresh = self._fresh(done)
                    kept += fresh
                    slow = isinstance(done, Done) and done.seconds > SLOW_S * len(done.seeds)
                    if kept and (slow or time.monotonic() - last > EVERY_S):
                        self.results.add(kept)
                        kept, last = [], time.monotonic()
                    self.done += len(fresh)
                    yield from fresh
            except NotWritten:
                raise
            except BaseException:
                self.results.add(kept)
                raise
            self.results.add(kept)

    def _fresh(self, done: Done | Lost | None) -> list[Run]:
        """The runs in what an engine says; predictions are put aside."""
        if done is None:
            return []
        if done.case < 0:
            if isinstance(done, Done):
                self._predictions[-done.case] = [_plain(p) for p in done.results[0]]
            return []
        if isinstance(done, Lost):
            self.lost.append(done)
            return [Run(done.case, done.seed, (Row(refusal=ENDED),))]
        made = zip(done.seeds, done.results, strict=True)
        return [Run(done.case, seed, rows) for seed, rows in made]

    def _tasks(self) -> Iterator[Task]:
        """The runs that are missing; then what `rehearse` says of every case, as case -n."""
        for case in self.sweep.cases():
            known = self._known.get(case.number, set())
            seeds = [seed for seed in self.sweep.seeds if seed not in known]
            if seeds:
                yield Task(case.number, recipe_of(partial(ready, case.settings)), seeds)
        if not (self.folder / PREDICTIONS).exists():
            for case in self.sweep.cases():
                yield Task(-case.number, recipe_of(partial(predicted, case.settings)), (0,))

    def _write_predictions(self) -> None:
        cases = range(1, self.cases + 1)
        ordered = {str(case): self._predictions.get(case, []) for case in cases}
        write_file(self.folder / PREDICTIONS, json.dumps(ordered) + "\n")


def _plain(p: Prediction) -> dict[str, Any]:
    """A prediction for a file: root mean square in SI, null where there is none."""
    return {
        "method": p.method,
        "window": p.window,
        "place": p.label,
        "quantity": p.quantity,
        "rms": p.rms,
        "reason": p.reason,
    }


def size_of(sweep: Sweep, known: int = 0) -> Size:
    """What a campaign comes to, by one run of its first, its middle and its last case each."""
    count = len(sweep.values)
    numbers = sorted({1, (count + 1) // 2, count})
    seconds = rows = 0.0
    for number in numbers:
        case: Case = sweep.case(number)
        trial = ready(case.settings)
        trial(case.settings.seed)  # what is made once
        begin = time.process_time()
        rows += len(trial(case.settings.seed + 1)) / len(numbers)
        seconds += (time.process_time() - begin) / len(numbers)
    runs = count * sweep.entry.runs
    return Size(
        cases=count,
        runs=runs,
        known=known,
        seconds=seconds * (runs - known),
        rows=int(rows * runs),
        size=int(BYTES_A_ROW * rows * runs),
    )


BYTES_A_ROW = 14  # of the results, measured
