"""The same seed makes the same bytes of `run.mcap`, whatever kernels BLAS has for a processor.

`STAND_KERNELS=all` tries five instead of the oldest and the processor's own.
"""

import json
import os
import subprocess
import sys

import pytest

KERNELS = ("Prescott", "")  # the oldest, and what this processor would take
if os.environ.get("STAND_KERNELS"):
    KERNELS = (*KERNELS, "Haswell", "SkylakeX", "Nehalem")

# an ideal run with a filter on a base that sways, a servo run on an imperfect table, a cone, a
# motion from a file and a drive: units that round finely, so that nothing is hidden
RUNS = """
import hashlib, json, os, sys
import numpy as np
import stand
from stand.procedure.procedure import procedure_from
from stand.toml_files import Source

HEAD = 'title = "t"\\n[site]\\nlatitude_deg = 48.5\\n[estimate]\\nmethods = ["inertial"]\\n'
DWELL = '[[step]]\\nkind = "dwell"\\nlabel = "a"\\nduration_s = 20\\n'
MOVE = '[[step]]\\nkind = "move"\\nlabel = "m"\\nattitude_deg = { pitch = 40, roll = 30 }\\n'
CONE = '[[step]]\\nkind = "coning"\\nlabel = "c"\\naxis = "X1"\\nhalf_angle_deg = 1.0\\n'
CONE += 'frequency_hz = 1.0\\nduration_s = 10\\n'
SWAY = '[[background]]\\nkind = "sway"\\nfade_s = 5\\n'
SWAY += 'axes = { base_roll = { rms_deg = 2, frequency_hz = 0.2 } }\\n'
PROFILE = '[[step]]\\nkind = "profile"\\nlabel = "p"\\nfile = "p.csv"\\n'
rows = [f"{k / 10},{5 * (1 - np.cos(np.pi * k / 50)) ** 2:.9f}" for k in range(101)]
os.makedirs(sys.argv[1])
with open(f"{sys.argv[1]}/p.csv", "w") as file:
    file.write("\\n".join(["time_s,inner_deg", *rows]))
texts = {"sway": (HEAD + DWELL + SWAY, "ideal", "stim300"), "servo": (HEAD + MOVE + DWELL, "servo",
    "ring-laser"), "cone and profile": (HEAD + CONE + PROFILE + DWELL.replace('"a"', '"b"'),
    "ideal", "ring-laser")}
found = {}
for name, (text, motion, imu) in texts.items():
    procedure = procedure_from(Source(name, f"{sys.argv[1]}/{name}.toml", text))
    settings = stand.settings(procedure, imu, motion=motion, rate_hz=50, seed=3)
    stand.run(settings, f"{sys.argv[1]}/{name}")
stand.drive("weaving", imu="ring-laser", rate_hz=20, seed=3, out=f"{sys.argv[1]}/drive")
for name in (*texts, "drive"):
    data = open(f"{sys.argv[1]}/{name}/run.mcap", "rb").read()
    found[name] = hashlib.sha256(data).hexdigest()
A = np.random.default_rng(0).standard_normal((64, 64))
found["BLAS"] = hashlib.sha256((A @ A).tobytes()).hexdigest()
print(json.dumps(found))
"""


def hashes(kernel, folder):
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_CORETYPE"}
    environment |= {"OPENBLAS_CORETYPE": kernel} if kernel else {}
    done = subprocess.run(
        [sys.executable, "-c", RUNS, str(folder)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_the_same_bytes_on_any_processor(tmp_path):
    found = [hashes(kernel, tmp_path / (kernel or "own")) for kernel in KERNELS]
    if len({one.pop("BLAS") for one in found}) == 1:
        pytest.skip("this BLAS has one kernel here")
    assert all(one == found[0] for one in found), found
