"""What ends a campaign, a process or a cluster costs nothing that was made, and leaves no process.

All of it makes the same bytes: one process, two, a cluster, whatever was killed on the way.
"""

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from processes import begun, members
from swept import SWEEP, written

from stand.campaigns.campaign import Campaign
from stand.campaigns.results import PARTS, Results
from stand.campaigns.sweep import load_sweep
from stand.errors import StandError
from stand.simulation import cluster as dask_door
from stand.simulation.cluster import LOOPBACK, cluster, engine_at, of_this_machine
from stand.simulation.work import Done, Lost, Supply, Task, recipe_of

pytestmark = pytest.mark.slow
LONG = SWEEP.replace("runs = 6", "runs = 80\nmethods = ['triad']").replace(
    "rate_hz = 2", "rate_hz = 10"
)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    return written(tmp_path_factory.mktemp("files"), LONG)


@pytest.fixture(scope="module")
def reference(sweep, tmp_path_factory):
    """The bytes that one process makes."""
    made = Campaign(load_sweep(sweep), tmp_path_factory.mktemp("one") / "out", workers=1)
    assert sum(1 for _ in made) == 320
    return digest(made.folder)


def digest(folder):
    return hashlib.sha256((folder / "results.parquet").read_bytes()).hexdigest()


@contextmanager
def at_work(sweep, out, *options):
    """`stand campaign` in a group of its own, once it has kept something new."""
    before = set((out / PARTS).glob("*.parquet")) if out.exists() else set()
    arguments = ["campaign", str(sweep), "--out", str(out), "--json", *options]
    process = begun(arguments, stdout=subprocess.DEVNULL)
    try:
        until(lambda: set((out / PARTS).glob("*.parquet")) - before or process.poll() is not None)
        assert process.poll() is None, process.stderr.read()
        yield process
        process.communicate(timeout=120)
        until(lambda: not members(process.pid))  # nobody is left of the group
    finally:
        if members(process.pid):
            os.killpg(process.pid, signal.SIGKILL)


def until(done, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def kept(out):
    return sum(map(len, Results(out).known().values()))


def makers(group):
    """Processes that make runs, by what they were started as."""
    found = []
    for pid in members(group):
        try:
            line = Path(f"/proc/{pid}/cmdline").read_bytes()
        except OSError:
            continue
        if b"spawn_main" in line and b"resource_tracker" not in line:
            found.append(pid)
    return found


def test_client_and_workers_may_be_killed_and_ended(sweep, reference, tmp_path):
    out = tmp_path / "out"
    with at_work(sweep, out, "--workers", "2") as process:
        process.terminate()
        _, told = process.communicate(timeout=120)
    first = kept(out)
    assert process.returncode == 130
    ended = f"stand: interrupted: {first} of 320 runs are kept in {out}; --resume goes on\n"
    assert told == ended
    with at_work(sweep, out, "--workers", "2", "--resume") as process:
        process.kill()
    assert 0 < first < kept(out) < 320
    rest = Campaign(load_sweep(sweep), out, resume=True, workers=2)
    ended = [kill_one() for n, _ in enumerate(rest) if n == 20]
    assert len(ended) == 1
    assert not rest.lost
    assert not multiprocessing.active_children()
    assert digest(out) == reference


def kill_one():
    """End one of the processes that this one has started to make runs."""
    multiprocessing.active_children()[0].kill()


# --- Dask


@contextmanager
def started(*arguments, **environment):
    command = [sys.executable, "-m", "dask", *arguments]
    process = subprocess.Popen(
        command,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler and two workers as their user starts them, on this machine only."""
    pytest.importorskip("distributed")
    root = tmp_path_factory.mktemp("dask")
    file, here = str(root / "scheduler.json"), f"{LOOPBACK}:0"
    own = ("--scheduler-file", file, "--host", LOOPBACK, "--dashboard-address", here)
    with started("scheduler", *own, "--port", "0") as first:
        until((root / "scheduler.json").exists)
        workers = ("--nworkers", "2", "--nthreads", "1", "--host", LOOPBACK)
        workers += ("--dashboard-address", here)
        folder = ("--local-directory", str(root))
        tests = str(Path(__file__).parents[2])
        with started(
            "worker", "--scheduler-file", file, *workers, *folder, PYTHONPATH=tests
        ) as second:
            from distributed import Client

            with Client(scheduler_file=file) as client:
                client.wait_for_workers(2, timeout=120)
                address = client.scheduler.address
            yield address, [first.pid, second.pid]


def listening(pids):
    """Addresses on which processes of these groups listen, as /proc has them."""
    inodes = set()
    for group in pids:
        for pid in members(group):
            try:
                links = [os.readlink(f"/proc/{pid}/fd/{n}") for n in os.listdir(f"/proc/{pid}/fd")]
            except OSError:
                continue
            inodes |= {link[8:-1] for link in links if link.startswith("socket:[")}
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in inodes:
                found.add(fields[1].partition(":")[0])
    return found


def test_a_cluster_makes_the_same_bytes_with_client_and_worker_killed(
    sweep, reference, scheduler, tmp_path
):
    address, groups = scheduler
    out = tmp_path / "out"
    with at_work(sweep, out, "--scheduler", address) as process:
        process.kill()
    first = kept(out)
    assert 0 < first < 320
    rest = Campaign(load_sweep(sweep), out, resume=True, engine=engine_at(address))
    for n, _ in enumerate(rest):
        if n == 20:
            assert listening(groups) == {"0100007F"}  # 127.0.0.1, every one
            os.kill(makers(groups[1])[0], signal.SIGKILL)
    assert n == 319 - first > 20
    assert not rest.lost
    assert digest(out) == reference


def test_workers_of_another_version_are_refused(sweep, scheduler, tmp_path, monkeypatch):
    address, _ = scheduler
    ours = dask_door._own_versions() | {"ruckig_version": "0.0"}
    monkeypatch.setattr(dask_door, "_own_versions", lambda: ours)
    made = Campaign(load_sweep(sweep), tmp_path / "out", engine=engine_at(address))
    with pytest.raises(StandError, match=r"worker tcp://127.0.0.1:\d+: has ruckig .*, must be 0.0"):
        list(made)


def fatal():
    """What ends its process at seed 5."""
    return lambda seed: os.kill(os.getpid(), signal.SIGKILL) if seed == 5 else seed


def test_what_is_started_here_listens_here_alone_and_names_a_fatal_run():
    """Also where a worker is long in coming again, or who starts it has failed."""
    dask, distributed = dask_door.libraries()
    before = dict(os.environ)
    late = {"distributed.deploy.lost-worker-timeout": "50ms"}  # of 15 s, on a machine at work
    with dask.config.set(late), of_this_machine(1) as address:
        assert address.startswith(f"tcp://{LOOPBACK}:")
        assert listening([os.getpgid(0)]) <= {"0100007F"}
        found = list(cluster(Supply([Task(1, recipe_of(fatal), (4, 5))]), address))
        (nanny,) = (one for one in distributed.Nanny._instances if one.status.name == "running")
        distributed.utils.sync(nanny.loop, nanny.close)
        found += cluster(Supply([Task(2, recipe_of(fatal), (6,))]), address)
    assert [one for one in found if isinstance(one, Lost)] == [Lost(1, 5)]
    done = [(one.case, one.results) for one in found if isinstance(one, Done)]
    assert done == [(1, [4]), (2, [6])]
    assert dict(os.environ) == before


def test_a_scheduler_that_is_not_there_is_told(sweep, tmp_path, monkeypatch):
    monkeypatch.setattr(dask_door, "_CONNECT_S", 0.5)
    made = Campaign(load_sweep(sweep), tmp_path / "out", engine=engine_at("tcp://127.0.0.1:9"))
    with pytest.raises(StandError, match=r"--scheduler tcp://127\.0\.0\.1:9: nobody answers"):
        list(made)
    with pytest.raises(StandError, match=r"must be as tcp://127\.0\.0\.1:8786"):
        engine_at("here")
    with pytest.raises(StandError, match="--workers: of a scheduler that is started elsewhere"):
        engine_at("tcp://127.0.0.1:9", 2)


def test_a_scheduler_that_goes_is_told_and_what_was_made_is_kept(sweep, scheduler, tmp_path):
    """The last test: the others' scheduler goes with it."""
    address, groups = scheduler
    out = tmp_path / "out"
    with at_work(sweep, out, "--scheduler", address) as process:
        os.killpg(groups[0], signal.SIGKILL)
        _, told = process.communicate(timeout=120)
    assert process.returncode == 2, told
    assert told == f"stand: --scheduler {address}: the scheduler has gone\n"
    assert 0 < kept(out) < 320
