"""Many runs on all cores: processes of this machine, and results in the order of the seeds."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from stand.errors import StandError
from stand.simulation.work import (
    Batch,
    Done,
    Engine,
    Failure,
    Lost,
    RunFailed,
    Supply,
    Task,
    answer,
    made_in_order,
    processes_for,
    recipe_of,
)
from stand.threads import VARIABLES

__all__ = ["RunFailed", "campaign", "interrupts_noted", "pool"]

_AHEAD = 2  # batches that a process has: the one at work, and the next
_QUIET = "ignore::UserWarning:multiprocessing.resource_tracker"
_HEARD_S = 0.1  # after which an interrupt that was noted is acted upon
_LEAVES_S = 5.0  # a process that is ended takes no longer, or is killed

T = TypeVar("T")


def campaign(
    ready: Callable[[], Callable[[int], T]],
    seeds: Sequence[int],
    workers: int | None = None,
    trial: Callable[[int], T] | None = None,
    engine: Engine | None = None,
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
    engine : callable, optional
        Who makes them, instead of processes of this machine.

    Raises
    ------
    StandError
        A run met a known fault, told with its seed; or ended its process.
    RunFailed
        A bug in a run, with its seed; its cause is what was raised, or in another process that
        traceback as text.
    """
    workers = processes_for(len(seeds)) if workers is None else workers
    if engine is None and workers == 1:
        make = trial or ready()
        for some in made_in_order(make, seeds):
            yield from some
        return
    supply = Supply([Task(0, recipe_of(ready), seeds)])
    found = engine(supply) if engine is not None else pool(supply, workers)
    early: dict[int, T] = {}
    order = iter(seeds)
    seed = next(order, None)
    try:
        for done in found:
            if isinstance(done, Lost):
                raise StandError(
                    f"run with seed {done.seed}: ended the process that made it (out of memory?)"
                )
            if done is None:
                continue
            early |= zip(done.seeds, done.results, strict=True)
            while seed in early:
                yield early.pop(seed)
                seed = next(order, None)
    finally:
        found.close()


def pool(supply: Supply, workers: int) -> Generator[Done | Lost | None]:
    """Batches as processes of this machine make them; all of them end with it.

    A process that was ended is replaced, and its batch done again (`Supply.lost`).

    Raises
    ------
    StandError, RunFailed
        As `campaign`.
    KeyboardInterrupt
        Ctrl-C, or SIGTERM where it is taken for that.
    """
    if supply.empty:
        return
    crew: list[_Worker] = []
    unborn = 0
    try:
        with interrupts_noted() as noted:
            while True:
                while len(crew) < workers:
                    crew.append(_Worker())
                for worker in crew:
                    worker.fill(supply)
                at_work = {w.connection: w for w in crew if w.held}
                if not at_work:
                    return
                heard = wait(list(at_work), timeout=_HEARD_S)
                if noted:
                    raise KeyboardInterrupt
                if not heard:
                    yield None  # time goes by: what is made is to be kept
                for worker in (at_work[c] for c in heard if isinstance(c, Connection)):
                    try:
                        found = worker.receive()
                    except (EOFError, OSError):  # it was ended
                        unborn = 0 if worker.born else unborn + 1
                        _refuse_stillborn(unborn, workers)
                        crew.remove(worker)
                        yield from _taken_over(supply, worker)
                        continue
                    if isinstance(found, Failure):
                        found.reraise()
                    elif found is not None:
                        batch, done = found
                        supply.took(batch, done)
                        yield done
    finally:
        for worker in crew:
            worker.dismiss()
        for worker in crew:
            worker.leave()


def _taken_over(supply: Supply, worker: "_Worker") -> Iterator[Lost]:
    """What a process that was ended held: only what it was at may be to blame."""
    worker.leave()
    at, *waiting = worker.held
    for batch in reversed(waiting):
        supply.put_back(batch)
    if not worker.born:
        supply.put_back(at)
    elif (lost := supply.lost(at)) is not None:
        yield lost


def _refuse_stillborn(unborn: int, workers: int) -> None:
    if unborn > workers:
        raise StandError(
            "processes that make runs end before they begin (out of memory? or a script that "
            "does not keep its work behind if __name__ == '__main__'?)"
        )


class _Worker:
    """A process, and the batches it has been given, the one at work first."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _environment_of_processes():
            resource_tracker.ensure_running()  # it would let interrupts through to the first one
            with _interrupts_wait():
                self._process.start()
        theirs.close()  # so that the end of the process is the end of the line
        self.held: deque[Batch] = deque()
        self.born = False

    def fill(self, supply: Supply) -> None:
        """Give it batches, as long as there are."""
        while len(self.held) < _AHEAD and (batch := supply.take()) is not None:
            self.held.append(batch)
            with suppress(OSError):  # it was ended: told when it is listened to
                self.connection.send(batch)

    def receive(self) -> tuple[Batch, Done] | Failure | None:
        """What it says: a batch that is done, what was raised, or that it is there."""
        message = self.connection.recv()
        self.born = True
        if isinstance(message, Done):
            return self.held.popleft(), message
        return message

    def dismiss(self) -> None:
        """End it, whatever it is at."""
        self._process.terminate()
        self.connection.close()

    def leave(self) -> None:
        """Wait until it has gone."""
        self._process.join(_LEAVES_S)
        if self._process.is_alive():  # pragma: no cover
            self._process.kill()
            self._process.join()
        self._process.close()
        self.connection.close()


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
def interrupts_noted() -> Iterator[list[int]]:
    """Ctrl-C, and SIGTERM where it is taken for that, only make a note meanwhile.

    Raised wherever it comes, it may come within a callback of the garbage collector, where Python
    prints it and goes on, or between a result and its being written.
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
    own = dict.fromkeys(VARIABLES, "1") | {"PYTHONWARNINGS": _QUIET}
    unset = [name for name in own if name not in os.environ]
    os.environ.update({name: own[name] for name in unset})
    try:
        yield
    finally:
        for name in unset:
            del os.environ[name]


def _serve(connection: Any) -> None:
    """A process that makes runs: batch after batch, until its parent ends it, or is no more."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    with suppress(EOFError, OSError):
        connection.send(None)
        while True:
            connection.send(answer(connection.recv()))


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
