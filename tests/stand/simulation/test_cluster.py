"""Workers that a cluster must not have, without a cluster: what is asked and what is told."""

from types import SimpleNamespace

import pytest

from stand.errors import StandError
from stand.simulation import cluster as door
from stand.simulation.work import Supply, Task
from stand.versions import versions

ADDRESS = "tcp://127.0.0.1:9"


class Client:
    """Of a scheduler with one worker that is there at once, and no second one ever."""

    status = "running"

    def __init__(self, threads, theirs):
        self.threads, self.theirs, self.closed = threads, theirs, False

    def wait_for_workers(self, least, timeout):
        assert timeout == 60
        if self.threads is None or least > 1:
            raise TimeoutError

    def scheduler_info(self, n_workers):
        assert n_workers == -1  # all of them, not the first five
        return {"workers": {"far": {"nthreads": self.threads}}}

    def run(self, function, on_error):
        return {"far": function() | self.theirs if isinstance(self.theirs, dict) else self.theirs}

    def close(self, timeout):
        self.closed = True


@pytest.mark.parametrize(
    ("threads", "theirs", "told"),
    [
        (None, {}, f"--scheduler {ADDRESS}: has no workers"),
        (2, {}, f"--scheduler {ADDRESS}: worker far has 2 threads, must have 1"),
        (1, ImportError("no stand"), "worker far has no stand like this one: no stand"),
        (1, {"numpy_version": "0.1"}, "worker far: has numpy 0.1, must be "),
    ],
)
def test_workers_that_would_compute_something_else(monkeypatch, threads, theirs, told):
    client = Client(threads, theirs)
    asked = []

    def made(address, **options):
        asked.append((address, options["timeout"]))
        return client

    monkeypatch.setattr(door, "libraries", lambda: (None, SimpleNamespace(Client=made)))
    supply = Supply([Task(1, b"", range(3))])
    with pytest.raises(StandError, match=told.replace("(", r"\(")):
        list(door.cluster(supply, ADDRESS))
    assert asked == [(ADDRESS, 10.0)]
    assert client.closed


def test_python_may_be_another_and_nothing_else():
    """Python has no say in the numbers."""
    assert set(versions()) - set(door._own_versions()) == {"python_version"}


def test_nothing_to_do_asks_nobody(monkeypatch):
    monkeypatch.setattr(door, "libraries", lambda: (None, None))
    assert list(door.cluster(Supply([]), ADDRESS)) == []


class Future:
    """Of a batch that never ends."""

    def add_done_callback(self, put):
        pass


class Taken:
    """A client with two workers who take what they are given and never end."""

    status = "running"

    def __init__(self):
        self.seeds = []

    def scheduler_info(self, n_workers):
        return {"workers": {"near": {}, "far": {}}}

    def submit(self, function, batch, ours, pure, retries):
        self.seeds.append(batch.seeds)
        return Future()


def test_a_run_that_was_lost_goes_alone():
    """Neither beside others that are at work, nor others beside it."""
    client, supply = Taken(), Supply([Task(1, b"", range(100))])
    first = supply.take()
    assert first is not None
    supply.put_back(first._replace(seeds=(7,), tries=1))
    far = door._Far(client, ADDRESS)
    far.fill(supply)
    far.fill(supply)
    assert client.seeds == [(7,)]
    far.held.clear()  # it has ended
    far.fill(supply)
    assert len(client.seeds) > 2
    supply.put_back(first._replace(seeds=(8,), tries=1))
    far.held.popitem()
    before = len(client.seeds)
    far.fill(supply)
    assert len(client.seeds) == before


def test_workers_that_have_all_gone_are_waited_for_and_then_told(monkeypatch):
    """Of a cluster of this machine none comes again where its nanny gave up."""
    client, supply = Taken(), Supply([Task(1, b"", range(100))])
    far = door._Far(client, ADDRESS)
    monkeypatch.setattr(door, "_COUNTED_S", -1.0)  # always
    client.scheduler_info = lambda n_workers: {"workers": {}}
    far.fill(supply)  # waited for
    monkeypatch.setattr(door, "_WORKERS_S", -1.0)
    with pytest.raises(StandError, match=f"--scheduler {ADDRESS}: its workers have gone, none for"):
        far.fill(supply)
