"""Runs on a Dask cluster: the door for `distributed`.

Whoever can connect to a scheduler can run any Python on it and on its workers: what is started
here listens on this machine only.
"""

from __future__ import annotations

import ctypes
import logging
import os
import time
from asyncio import CancelledError
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, partial
from queue import Empty, SimpleQueue
from typing import Any

from stand.errors import StandError
from stand.simulation.parallel import interrupts_noted
from stand.simulation.work import Batch, Done, Engine, Failure, Lost, Supply, answer
from stand.versions import versions

LOOPBACK = "127.0.0.1"
_AHEAD = 2  # batches that a worker has: the one at work, and the next
_HEARD_S = 0.1  # after which an interrupt that was noted is acted upon
_CONNECT_S = 10.0
_WORKERS_S = 60.0  # for the first worker to come, or another one where all have gone
_SILENT_S = 5.0  # of a scheduler that does not answer any more
_FETCH_S = 30.0  # for a result: of a worker that has gone it is made again first
_AGAIN = "again"
_COUNTED_S = 2.0  # between looks at how many workers there are
# of glibc: what is freed at the end of the heap stays, and arrays come from there. Dask sets
# the opposite in the environment of its workers, for which a run pays 10 ms of page faults
_TRIM, _MMAP = (-1, 64 << 20), (-3, 32 << 20)
_TRIMMED = "MALLOC_TRIM_THRESHOLD_"
# samples of stacks, memory and loops: 7 % of a core for two workers that have nothing to do
_UNWATCHED = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.worker.memory.monitor-interval": "2s",
}


def libraries() -> tuple[Any, Any]:
    """The libraries `dask` and `distributed`.

    Raises
    ------
    StandError
        They are not installed.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise StandError(
            "--scheduler: a cluster is Dask's: pip install 'imu-test-stand[cluster]'"
        ) from None
    return dask, distributed


def cluster(supply: Supply, address: str) -> Generator[Done | Lost | None]:
    """Batches as the workers of a scheduler make them.

    Raises
    ------
    StandError
        Nobody answers at this address, there are no workers, or they have other versions of what
        computes; the scheduler has gone, or all workers have and none comes.
    RunFailed
        A bug in a run.
    KeyboardInterrupt
        Ctrl-C, or SIGTERM where it is taken for that.
    """
    _, distributed = libraries()
    if supply.empty:
        return
    with interrupts_noted() as noted, _client(distributed, address) as client:
        _check_workers(client, address)
        far = _Far(client, address)
        try:
            while True:
                far.fill(supply)
                if not far.held and supply.empty:
                    return
                found = far.next()
                if noted:
                    raise KeyboardInterrupt
                if found is None:
                    yield None
                    continue
                batch, result = found
                if result is _AGAIN:
                    supply.put_back(batch)
                elif isinstance(result, Failure):
                    result.reraise()
                elif isinstance(result, Done):
                    supply.took(batch, result)
                    yield result
                elif (lost := supply.lost(batch)) is not None:
                    yield lost
        finally:
            far.drop()


@contextmanager
def _client(distributed: Any, address: str) -> Iterator[Any]:
    with _quiet():
        try:
            client = distributed.Client(
                address, timeout=_CONNECT_S, set_as_default=False, name="imu-test-stand"
            )
        except (OSError, TimeoutError, ValueError, ImportError) as error:
            raise StandError(f"--scheduler {address}: nobody answers: {error}") from error
        try:
            yield client
        finally:
            with suppress(Exception):  # of a scheduler that is no more
                client.close(timeout=_SILENT_S)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask logs what is told in one line here."""
    theirs = ("distributed", "tornado")
    names = [name for name in logging.root.manager.loggerDict if name.startswith(theirs)]
    before = {name: logging.getLogger(name).level for name in names}  # Dask gives each its own
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _check_workers(client: Any, address: str) -> None:
    """Refuse workers that would compute something else, or several runs at once in a process."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError:
        raise StandError(f"--scheduler {address}: has no workers") from None
    for worker, one in client.scheduler_info(n_workers=-1)["workers"].items():
        if one["nthreads"] != 1:
            raise StandError(
                f"--scheduler {address}: worker {worker} has {one['nthreads']} threads, must have "
                "1: dask worker --nworkers N --nthreads 1"
            )
    found = client.run(_own_versions, on_error="return")
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException):
            raise StandError(
                f"--scheduler {address}: worker {worker} has no stand like this one: {theirs}"
            )
        _refuse_versions(worker, theirs, _own_versions())


def _own_versions() -> dict[str, str]:
    """Of all that has a say in the numbers."""
    return {name: v for name, v in versions().items() if name != "python_version"}


def _refuse_versions(worker: str, theirs: Mapping[str, str], ours: Mapping[str, str]) -> None:
    for name, wanted in ours.items():
        if theirs.get(name) != wanted:
            raise StandError(
                f"worker {worker}: has {name.removesuffix('_version')} {theirs.get(name)}, "
                f"must be {wanted} as here"
            )


class _Far:
    """Batches that are at a cluster."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self.held: dict[Any, Batch] = {}
        self._ended: SimpleQueue[Any] = SimpleQueue()
        self._heard = self._counted = time.monotonic()  # from a scheduler that answers
        self._manned = self._heard  # when there was a worker
        self._ahead = self._wanted()

    def _wanted(self) -> int:
        """How many batches are handed out; a refusal where nobody has taken any for long."""
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        now = time.monotonic()
        if workers:
            self._manned = now
        elif now - self._manned > _WORKERS_S:
            raise StandError(
                f"--scheduler {self._address}: its workers have gone, none for {_WORKERS_S:g} s"
            )
        return _AHEAD * max(1, workers)

    def fill(self, supply: Supply) -> None:
        """Hand out batches, as long as there are and somebody takes them.

        A run that has been lost goes alone: nobody else's end is taken for its own.

        Raises
        ------
        StandError
            There have been no workers for `_WORKERS_S`.
        """
        if self._client.status != "running":
            return
        if time.monotonic() - self._counted > _COUNTED_S:
            self._ahead, self._counted = self._wanted(), time.monotonic()
        while len(self.held) < self._ahead and (batch := supply.take()) is not None:
            if self.held and any(one.tries for one in (batch, *self.held.values())):
                supply.put_back(batch)
                return
            future = self._client.submit(_answer, batch, _own_versions(), pure=False, retries=0)
            self.held[future] = batch
            future.add_done_callback(self._ended.put)

    def next(self) -> tuple[Batch, Any] | None:
        """A batch that has ended with what came of it; None: no news.

        What came of it is its `Done` or `Failure`; None where it ended its worker; `_AGAIN` where
        its result went with a worker that something else ended, or nobody has it any more.

        Raises
        ------
        StandError
            The scheduler has gone; a batch never came to a worker.
        """
        try:
            future = self._ended.get(timeout=_HEARD_S)
        except Empty:
            self._refuse_silence()
            return None
        batch = self.held.pop(future)
        if future.status == "finished":
            try:
                return batch, future.result(timeout=_FETCH_S)
            except (Exception, CancelledError):
                return batch, _AGAIN
        if future.status != "error":
            return batch, _AGAIN
        error = future.exception()
        if type(error).__name__ == "KilledWorker":
            return batch, None
        raise StandError(f"--scheduler {self._address}: {type(error).__name__}: {error}")

    def _refuse_silence(self) -> None:
        if self._client.status == "running":
            self._heard = time.monotonic()
        elif time.monotonic() - self._heard > _SILENT_S:
            raise StandError(f"--scheduler {self._address}: the scheduler has gone")

    def drop(self) -> None:
        """Nobody waits for the rest."""
        with suppress(Exception):
            self._client.cancel(list(self.held), force=True)


def _answer(batch: Batch, ours: Mapping[str, str]) -> Done | Failure:
    """At a worker, also one that came later than it was asked for its versions."""
    _keep_memory()
    try:
        worker = libraries()[1].get_worker().address
        _refuse_versions(worker, _own_versions(), ours)
    except StandError as error:
        return Failure(error, "")
    return answer(batch)


@cache
def _keep_memory() -> None:
    """Undo what Dask asks of glibc, where it is glibc."""
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        for option, value in (_MMAP, _TRIM):
            mallopt(option, value)


LOCAL = "local"


def engine_at(scheduler: Any, workers: int | None = None) -> Engine:
    """Who makes runs at a scheduler.

    Parameters
    ----------
    scheduler : str or object
        An address, as ``tcp://127.0.0.1:8786``; ``"local"``: one that is started here and ends
        with the work; or a cluster or client of Dask's.
    workers : int, optional
        Of one that is started here; else as many as there are cores.

    Raises
    ------
    StandError
        It is none of these; Dask is not installed.
    """
    libraries()
    if scheduler == LOCAL:
        return partial(_local, workers=workers or os.cpu_count() or 1)
    if workers is not None:
        raise StandError("--workers: of a scheduler that is started elsewhere, as many as it has")
    client = getattr(scheduler, "scheduler", None)  # a client has one
    address = getattr(scheduler, "scheduler_address", getattr(client, "address", scheduler))
    if not isinstance(address, str) or "://" not in address:
        raise StandError(f"--scheduler {address}: must be as tcp://127.0.0.1:8786, or {LOCAL}")
    return partial(cluster, address=address)


def _local(supply: Supply, workers: int) -> Generator[Done | Lost | None]:
    if supply.empty:
        return
    with of_this_machine(workers) as address:
        yield from cluster(supply, address)


@contextmanager
def of_this_machine(workers: int) -> Iterator[str]:
    """A scheduler and workers on this machine, that listen to it only: the scheduler's address."""
    library, distributed = libraries()
    own = dict(library.config.get("distributed.nanny.pre-spawn-environ"))
    own.pop(_TRIMMED, None)
    before = dict(os.environ)
    chosen = _UNWATCHED | {
        "distributed.nanny.pre-spawn-environ": own,
        "distributed.scheduler.allowed-failures": 0,  # halving isolates what ends a worker
        # Dask gives up for good who is not there so long after any loss, one that is about to
        # come again too: where starting takes 15 s, or runs end worker after worker
        "distributed.deploy.lost-worker-timeout": "1d",
    }
    try:
        with (
            _quiet(),
            library.config.set(chosen),
            distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host=LOOPBACK,
                dashboard_address=f"{LOOPBACK}:0",
                worker_dashboard_address=None,
                silence_logs=logging.CRITICAL,
            ) as local,
        ):
            local.loop.add_callback(_keep_manned, local, workers)
            yield local.scheduler_address
    finally:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


def _keep_manned(local: Any, workers: int) -> None:
    """Start anew, now and later, whom Dask does not: one that failed as it was to come again."""
    if local.status.name != "running":
        return
    for name, nanny in list(local.workers.items()):
        if nanny.status.name in ("closed", "failed"):
            del local.workers[name]
    local.scale(workers)
    local.loop.call_later(_COUNTED_S, _keep_manned, local, workers)
