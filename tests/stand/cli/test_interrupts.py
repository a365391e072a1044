"""Ctrl-C at any moment: one line, exit code 130, no child and no half of a file left.

`STAND_INTERRUPTS=20` interrupts each command as many times instead of the first of them once; see
also the tests of what an interrupted verification and campaign keep.
"""

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from procedures import resting
from processes import begun, members, spent

TIMES = int(os.environ.get("STAND_INTERRUPTS", "0"))
UNITS = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "rad/s", "--accel-unit", "m/s^2")
COMMANDS = {
    "compare": ("compare", "two-position", "--runs", "3000", "--json"),
    "run": ("run", "long.toml", "--rate", "1000", "--motion", "servo", "--out", "run"),
    "calibrate": ("calibrate", "log.csv", *UNITS, "--hand-held", "--latitude", "48.5"),
    "verify": ("rehearse", "two-position", "--rate", "20", "--verify", "100000"),
    "campaign": ("campaign", "sweep.toml", "--out", "campaign", "--workers", "2"),
    "propose": ("propose", "--heading", "0.2", "--imu", "hg9900", "--trade-off", "--out", "p.toml"),
}
KEPT = {"campaign": {"campaign"}}  # by design: what was made is gone on with
BEGUN_S = 1.0  # of processors: until then Python imports the command itself
LATEST_S = 6.0
SOONER_S = {"calibrate": 2.0}  # is through soon after
SWEEP = """
title = "Some"
procedure = "two-position"
imu = "hg9900"
runs = 2000
rate_hz = 20
[[vary]]
key = "imu.gyro.angle_random_walk_deg_rt_h"
values = [0.001, 0.01]
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Over an hour at rest: that this tells nothing of the unit is found at the end."""
    path = tmp_path_factory.mktemp("log") / "log.csv"
    f = 1e-3 * np.random.default_rng(0).normal(size=(400_000, 6)) + [0, 0, 0, 9.8, 0, 0]
    lines = (f"{k / 100},{','.join(map(repr, row))}\n" for k, row in enumerate(f.tolist()))
    with path.open("w", encoding="utf-8") as file:
        file.writelines(lines)
    return path


def interrupted(command, folder, after_s):
    """Its exit code and what it said, interrupted when its group has used so much of processors."""
    process = begun(command, cwd=folder, stdout=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 240
        while spent(process.pid) < after_s and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert process.poll() is None, process.communicate()
        os.killpg(process.pid, signal.SIGINT)
        _, told = process.communicate(timeout=120)
        deadline = time.monotonic() + 20  # the resource tracker ends when it finds itself alone
        while members(process.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        return process.returncode, told, members(process.pid)
    finally:
        if members(process.pid):
            os.killpg(process.pid, signal.SIGKILL)


CASES = [(name, k) for name in COMMANDS for k in range(TIMES)] or [("compare", 0)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), CASES)
def test_one_line_and_nothing_left(request, tmp_path, name, number):
    (tmp_path / "long.toml").write_text(resting(3600))
    (tmp_path / "sweep.toml").write_text(SWEEP)
    if name == "calibrate":
        (tmp_path / "log.csv").symlink_to(request.getfixturevalue("log"))
    before = {path.name for path in tmp_path.iterdir()}
    after_s = random.Random(f"{name} {number}").uniform(BEGUN_S, SOONER_S.get(name, LATEST_S))
    code, told, left = interrupted(COMMANDS[name], tmp_path, after_s)
    assert code == 130, (after_s, told)
    assert told.startswith("stand: interrupted: "), (after_s, told)
    assert told.count("\n") == 1, (after_s, told)
    assert left == []
    assert {path.name for path in tmp_path.iterdir()} - before <= KEPT.get(name, set())
    assert not list(Path(tmp_path).rglob("*.partial"))
