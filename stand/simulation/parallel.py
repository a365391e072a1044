"""Many runs on all cores: one result per seed, in the order of the seeds, a few held at a time."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from alignment.errors import Fault
from stand.errors import StandError

LEAST_SHARE = 8  # runs below which a process of its own does not pay
_LARGEST_CHUNK = 8  # runs handed to a process at once
_AHEAD = 4  # chunks per process that are asked for before they are fetched
# of linear algebra: with a process per core, threads of its own would only wait for one another
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

_QUIET = "ignore::UserWarning:multiprocessing.resource_tracker"
_HEARD_S = 0.1  # after which an interrupt that was noted is acted upon

T = TypeVar("T")
Trial = Callable[[int], Any]


def campaign(
    ready: Callable[[], Callable[[int], T]],
    seeds: Sequence[int],
    workers: int | None = None,
    trial: Callable[[int], T] | None = None,
) -> Generator[T]:
    """Every seed's result in order; close it to end early.

    Parameters
    ----------
    ready : callable
        Makes what makes a run by its seed; pickled to every process, which calls it once.
    seeds : sequence of int
    workers : int, optional
        Processes, which change nothing but the time; if not given, as many as there are cores
        and as pay.
    trial : callable, optional
        What `ready` made already in this process.

    Raises
    ------
    StandError
        A run met a known fault, told with its seed; or a process was ended from outside.
    RunFailed
        A bug in a run, with its seed; its cause is what was raised, or in another process that
        traceback as text.
    """
    if workers is None:
        workers = max(1, min(os.cpu_count() or 1, len(seeds) // LEAST_SHARE))
    if workers == 1:
        make = trial or ready()
        yield from (_made_or_named(make, seed) for seed in seeds)
        return
    size = max(1, min(_LARGEST_CHUNK, len(seeds) // (8 * workers)))
    chunks = (seeds[k : k + size] for k in range(0, len(seeds), size))
    context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
    before = set(multiprocessing.active_children())
    with (
        _interrupts_noted() as noted,
        ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(ready,)) as pool,
    ):
        try:
            coming: deque[Future[list[T]]] = deque()
            _hand_out(pool, coming, islice(chunks, _AHEAD * workers))
            while coming:
                found = _awaited(coming.popleft(), noted)
                _hand_out(pool, coming, islice(chunks, 1))
                yield from found
        except BrokenProcessPool as error:
            raise StandError(
                "a process that made runs was ended from outside (out of memory? or a script that "
                "does not keep its work behind if __name__ == '__main__'?)"
            ) from error
        except BaseException:  # Ctrl-C, or a run that failed: nobody waits for the rest
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise


def _hand_out(
    pool: ProcessPoolExecutor, coming: deque[Future[list[Any]]], chunks: Iterable[Sequence[int]]
) -> None:
    """Ask for chunks. Any of them may start a process: the pool does so as they are needed."""
    with _interrupts_wait(), _environment_of_processes():
        coming.extend(pool.submit(_share, chunk) for chunk in chunks)


def _awaited(future: Future[T], noted: Sequence[int]) -> T:
    """Its result; `KeyboardInterrupt` where an interrupt was noted."""
    while not future.done() and not noted:
        wait([future], timeout=_HEARD_S)
    if noted:
        raise KeyboardInterrupt
    return future.result()


class RunFailed(RuntimeError):
    """A bug in a run: not a fault of the input. The message names the seed that shows it."""


def _made_or_named(make: Callable[[int], T], seed: int) -> T:
    """A run; a fault of it is told with its seed, and a bug keeps its traceback."""
    try:
        return make(seed)
    except Fault as error:
        raise StandError(f"run with seed {seed}: {error}") from error
    except (OSError, MemoryError):  # of the machine
        raise
    except Exception as error:
        raise RunFailed(f"run with seed {seed}: {type(error).__name__}: {error}") from error


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Ctrl-C waits; processes started meanwhile never hear it, and say nothing at it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _interrupts_noted() -> Iterator[list[int]]:
    """Ctrl-C, and SIGTERM where it is taken for that, only make a note meanwhile.

    Raised wherever it comes, it may come within a callback of the pool or of the garbage
    collector, where Python prints it and goes on.
    """
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    heard = {number: handler for number, handler in before.items() if callable(handler)}
    for number in heard:
        signal.signal(number, lambda n, _: noted.append(n))
    try:
        yield noted
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)


@contextmanager
def _environment_of_processes() -> Iterator[None]:
    """Processes started meanwhile have one thread for linear algebra, if nobody asked for more.

    And the one of Python's that clears up behind a command that is killed says nothing of it.
    """
    own = dict.fromkeys(_THREADS, "1") | {"PYTHONWARNINGS": _QUIET}
    unset = [name for name in own if name not in os.environ]
    os.environ.update({name: own[name] for name in unset})
    try:
        yield
    finally:
        for name in unset:
            del os.environ[name]


_trial: Trial | None = None  # of a process that makes runs


def _begin(ready: Callable[[], Trial]) -> None:
    """A process made ready: it ends with its parent."""
    global _trial
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _trial = ready()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _share(seeds: Sequence[int]) -> list[Any]:
    assert _trial is not None
    return [_made_or_named(_trial, seed) for seed in seeds]
