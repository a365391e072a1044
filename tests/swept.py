"""A sweep of runs that take some milliseconds: two rests of seconds, half a turn between them."""

from pathlib import Path

PROCEDURE = """
title = "Two short rests"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad", "two-position"]
[move_limits]
rate_deg_s = 90.0
[require]
heading_deg = 0.1
method = "two-position"
[[step]]
kind = "dwell"
label = "first"
duration_s = 20
[[step]]
kind = "move"
label = "half a turn"
joints_deg = { outer = 180.0 }
[[step]]
kind = "dwell"
label = "second rest"
duration_s = 20
"""
SWEEP = """
title = "Short rests"
procedure = "short.toml"
imu = "hg9900"
rate_hz = 2
runs = 6
[[vary]]
name = "rest [s]"
key = ["step.first.duration_s", 'step."second rest".duration_s']
values = [10, 20]
[[vary]]
key = "imu.gyro.angle_random_walk_deg_rt_h"
range = { low = 0.001, high = 0.01, count = 2, scale = "log" }
"""


def written(folder: Path, sweep: str = SWEEP, procedure: str = PROCEDURE) -> Path:
    """The files of a sweep in a folder: the sweep's own."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "short.toml").write_text(procedure, encoding="utf-8")
    path = folder / "sweep.toml"
    path.write_text(sweep, encoding="utf-8")
    return path
