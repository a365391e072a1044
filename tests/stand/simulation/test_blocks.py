"""A run as it goes: the same bits, however many threads its truth is worked out by."""

import os
from dataclasses import fields

import numpy as np
import pytest

import stand
from stand.physics.truth import Truth
from stand.procedure.procedure import procedure_from
from stand.simulation.simulation import BLOCK, Simulation
from stand.toml_files import Source

SWAY = """
title = "Sway, then a move"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = []
[[step]]
kind = "sway"
label = "swaying"
duration_s = 20
fade_s = 4
[step.axes]
base_roll = { rms_deg = 1, frequency_hz = 0.2 }
base_yaw = { rms_deg = 1, frequency_hz = 0.3 }
[[step]]
kind = "move"
label = "on"
joints_deg = { middle = 40 }
"""


def every(threads: int, imu: str, monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """All arrays of a run of more than two blocks, which so many threads make."""
    monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
    procedure = procedure_from(Source("p", "p.toml", SWAY))
    simulation = Simulation(stand.settings(procedure, imu, rate_hz=2000, seed=4))
    assert simulation.total > 3 * BLOCK
    blocks = list(simulation.blocks())
    return [
        np.concatenate([getattr(part, field.name) for part in parts])
        for parts in ([b.truth for b in blocks], [b.readings for b in blocks])
        for field in fields(parts[0])
    ]


@pytest.mark.parametrize("imu", ["ring-laser", "stim300"])
def test_two_threads_make_the_bits_of_one(imu, monkeypatch):
    """Readings of neighbouring blocks follow one another: noise, low-pass and increments too."""
    used, block = [], Truth.block_and_sensed

    def noted(truth, *args):
        if not any(truth is one for one in used):
            used.append(truth)
        return block(truth, *args)

    monkeypatch.setattr(Truth, "block_and_sensed", noted)
    alone = every(1, imu, monkeypatch)
    assert len(used) == 1
    for one, other in zip(alone, every(2, imu, monkeypatch), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(used) == 1 + min(2, os.cpu_count() or 1)
