"""What there is to do, in batches: whoever does them, here, on all cores or on a cluster.

A batch is several runs of one case. A recipe, pickled, makes what makes a run by its seed, once in
every process. A batch ends when its time is up: what it has not made goes back, so that what is
made is soon told, however long a run takes. A batch whose process was ended is halved until the
seed is alone that ends it.
"""

import os
import pickle
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple

from alignment.errors import Fault
from stand.errors import StandError

BATCH_S = 0.5  # of work in a batch: one costs a cluster 6 ms of a processor, and a second 10 ms
LARGEST = 256  # runs in a batch, however short they are
FIRST = 4  # of a case of which nothing is known yet
TRIES = 2  # of a run alone, before it is named: its process may have been ended by somebody else
MOST_LOST = 10  # runs that may end their process: with more it is not they that are wrong

Trial = Callable[[int], Any]


@dataclass(frozen=True, slots=True)
class Together:
    """A trial that makes several runs at once, `at_once` at most, where that is faster.

    `several` gives of each seed what it would give of it alone.
    """

    several: Callable[[Sequence[int]], list[Any]]
    at_once: int

    def __call__(self, seed: int) -> Any:
        """A run alone."""
        (found,) = self.several((seed,))
        return found


class RunFailed(RuntimeError):
    """A bug in a run: not a fault of the input. The message names the seed that shows it."""


class Task(NamedTuple):
    """Runs of one case: `recipe` is a pickled callable that gives what makes a run by its seed."""

    case: int
    recipe: bytes
    seeds: Iterable[int]


class Batch(NamedTuple):
    """Some runs of one case; `tries`: how often a single one has ended its process."""

    case: int
    recipe: bytes
    seeds: tuple[int, ...]
    tries: int = 0


class Done(NamedTuple):
    """What the first seeds of a batch came to; `seconds` of work, making ready left out."""

    case: int
    seeds: tuple[int, ...]
    results: list[Any]
    seconds: float


class Lost(NamedTuple):
    """A run that ended its process each time it was made."""

    case: int
    seed: int


class Supply:
    """The batches that are still to be done, in order of the tasks."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._tasks: Iterator[Task] = iter(tasks)
        self._task: Task | None = None
        self._seeds: Iterator[int] = iter(())
        self._again: deque[Batch] = deque()
        self._seconds: dict[int, float] = {}  # of a run, by case
        self._lost = 0

    def take(self) -> Batch | None:
        """The next batch; None where there is none at present."""
        if self._again:
            return self._again.popleft()
        while True:
            if self._task is not None:
                size = self._size(self._task.case)
                seeds = tuple(islice(self._seeds, size))
                if seeds:
                    return Batch(self._task.case, self._task.recipe, seeds)
            self._task = next(self._tasks, None)
            if self._task is None:
                return None
            self._seeds = iter(self._task.seeds)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to be done."""
        batch = self.take()
        if batch is not None:
            self.put_back(batch)
        return batch is None

    def _size(self, case: int) -> int:
        seconds = self._seconds.get(case)
        if seconds is None:
            return FIRST
        return max(1, min(LARGEST, int(BATCH_S / max(seconds, 1e-6))))

    def took(self, batch: Batch, done: Done) -> None:
        """Learn how long runs take; what a batch has not made is to be done again."""
        if done.seeds:
            self._seconds[batch.case] = done.seconds / len(done.seeds)
        rest = batch.seeds[len(done.seeds) :]
        if rest:
            self._again.appendleft(batch._replace(seeds=rest))

    def put_back(self, batch: Batch) -> None:
        """A batch that nobody has begun."""
        self._again.appendleft(batch)

    def lost(self, batch: Batch) -> Lost | None:
        """A batch whose process was ended: halved, to be done again; the seed that ends it.

        Raises
        ------
        StandError
            More than `MOST_LOST` runs do.
        """
        count, last = len(batch.seeds), max(batch.seeds)
        if count > 1:
            parts = batch.seeds[: count // 2], batch.seeds[count // 2 :]
            self._again.extendleft(batch._replace(seeds=part) for part in reversed(parts))
            return None
        if batch.tries + 1 < TRIES:
            self._again.appendleft(batch._replace(tries=batch.tries + 1))
            return None
        self._lost += 1
        if self._lost > MOST_LOST:
            raise StandError(
                f"{self._lost} runs have ended their process, the last with seed {last}: "
                "out of memory?"
            )
        return Lost(batch.case, last)


Engine = Callable[[Supply], Generator[Done | Lost | None]]


# --- where runs are made -------------------------------------------------------------------------

_one_at_a_time = threading.Lock()  # what makes runs is no thing to share between threads


@lru_cache(maxsize=2)  # of the case that is at work, and of the one before, of which some may come
def _made_ready(recipe: bytes) -> Trial:
    return pickle.loads(recipe)()


def share(batch: Batch) -> Done:
    """The runs of a batch that there is time for, one at least.

    Raises
    ------
    StandError, RunFailed
        As `made_or_named`.
    """
    with _one_at_a_time:
        trial = _made_ready(batch.recipe)
        begin = time.perf_counter()
        results: list[Any] = []
        for some in made_in_order(trial, batch.seeds):
            results += some
            if time.perf_counter() - begin > BATCH_S:
                break
        spent = time.perf_counter() - begin
    return Done(batch.case, batch.seeds[: len(results)], results, spent)


def answer(batch: Batch) -> "Done | Failure":
    """As `share`, for another process: what is raised is told."""
    try:
        return share(batch)
    except BaseException as error:
        return failure_of(error)


def here(supply: Supply) -> Generator[Done | Lost | None]:
    """All of it in this process."""
    while (batch := supply.take()) is not None:
        done = share(batch)
        supply.took(batch, done)
        yield done


def made_in_order(make: Trial, seeds: Iterable[int]) -> Iterator[list[Any]]:
    """Runs of the seeds in order, some at once: as many as may be, and are made in `BATCH_S`.

    Raises
    ------
    StandError, RunFailed
        As `made_or_named`, once the runs before the one that failed are told.
    """
    order, size = iter(seeds), 1
    while some := tuple(islice(order, size)):
        begin = time.perf_counter()
        yield from _several(make, some)
        if isinstance(make, Together):
            each = max(time.perf_counter() - begin, 1e-6) / len(some)
            size = max(1, min(make.at_once, int(BATCH_S / each)))


def _several(make: Trial, seeds: Sequence[int]) -> Iterator[list[Any]]:
    """Together; one by one where one is alone, or is why together it does not go."""
    if isinstance(make, Together) and len(seeds) > 1:
        found = None
        with suppress(Exception):  # a bug shows again, with its seed
            found = make.several(seeds)
        if found is not None:
            yield found
            return
    yield from ([made_or_named(make, seed)] for seed in seeds)


def made_or_named(make: Trial, seed: int) -> Any:
    """A run; a fault of it is told with its seed, and a bug keeps its traceback."""
    try:
        return make(seed)
    except Fault as error:
        raise StandError(f"run with seed {seed}: {error}") from error
    except (OSError, MemoryError):  # of the machine
        raise
    except Exception as error:
        raise RunFailed(f"run with seed {seed}: {type(error).__name__}: {error}") from error


class Failure(NamedTuple):
    """What was raised in another process, with its traceback as text."""

    error: BaseException
    text: str

    def reraise(self) -> None:
        """Raise it here: a bug with the traceback from there as its cause."""
        if isinstance(self.error, RunFailed):
            raise self.error from _Elsewhere(self.text)
        raise self.error


class _Elsewhere(Exception):
    """A traceback of another process, as text."""

    def __str__(self) -> str:
        return f'\n"""\n{self.args[0]}"""'


def failure_of(error: BaseException) -> Failure:
    """What another process may be told of an error."""
    text = "".join(traceback.format_exception(error))
    kept = isinstance(error, Fault | RunFailed | OSError | MemoryError)
    plain = error if kept else RunFailed(f"{type(error).__name__}: {error}")
    plain.__cause__ = plain.__context__ = plain.__traceback__ = None
    return Failure(plain, text)


def recipe_of(ready: Callable[[], Trial]) -> bytes:
    """What makes a run, as it travels to other processes."""
    return pickle.dumps(ready)


def processes_for(runs: int) -> int:
    """How many processes pay: a core each, and some runs each."""
    return max(1, min(os.cpu_count() or 1, runs // LEAST_SHARE))


LEAST_SHARE = 8  # runs below which a process of its own does not pay
