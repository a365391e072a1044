"""Procedures that nobody tuned anything to, by number: the same number, the same procedure."""

from dataclasses import dataclass

import numpy as np

from stand.imu import ImuSpec, imu_from
from stand.procedure.procedure import Procedure, procedure_from
from stand.table.table import load_table
from stand.toml_files import Source

COUNT = 30
IMUS = ("stim300", "hg9900", "ring-laser", "adis16470", "icm42688p")
TABLES = ("precision", "mid-class", "laboratory", "rocking-platform")
RESTS = (2, 12)
REST_S = (5.0, 1800.0)
LATITUDE_DEG = 85.0
TILT_DEG = 20.0
MARGIN_DEG = 1.0  # that a base axis stays within its travel
COARSE = """
title = "biased and noisy"
grade = "consumer"
evidence = "none"
[gyro]
turn_on_bias_deg_h = {{ value = {:.4g}, kind = "assumed", source = "a test" }}
angle_random_walk_deg_rt_h = {{ value = {:.4g}, kind = "assumed", source = "a test" }}
[accel]
turn_on_bias_mg = {{ value = {:.4g}, kind = "assumed", source = "a test" }}
velocity_random_walk_m_s_rt_h = {{ value = {:.4g}, kind = "assumed", source = "a test" }}
"""


@dataclass(frozen=True, slots=True)
class Generated:
    """A procedure and the unit it is for."""

    procedure: Procedure
    imu: str


def generated(number: int, longest_s: float = REST_S[1]) -> Generated:
    """Rests at random attitudes on a base that is tilted, anywhere but at a pole.

    `longest_s` cuts rests short, for tests that have no hours; nothing else changes with it.
    """
    rng = np.random.default_rng([number, 20_000])
    table = TABLES[number % len(TABLES)]
    latitude = rng.uniform(-LATITUDE_DEG, LATITUDE_DEG)
    tilts = _tilts(table, rng)
    lines = [
        f'title = "Generated {number}"',
        f'table = "{table}"',
        f"[site]\nlatitude_deg = {latitude:.3f}",
        '[estimate]\nmethods = ["triad", "two-position", "multi-position"]',
        "[move_limits]\nrate_deg_s = 20\nacceleration_deg_s2 = 20\njerk_deg_s3 = 80",
    ]
    for k in range(rng.integers(RESTS[0], RESTS[1], endpoint=True)):
        joints = {**(tilts if k == 0 else {}), **_attitude(rng)}
        told = ", ".join(f"{joint} = {angle:.2f}" for joint, angle in joints.items())
        seconds = min(np.exp(rng.uniform(*np.log(REST_S))), longest_s)
        lines += [
            f'[[step]]\nkind = "move"\nlabel = "to {k + 1}"\njoints_deg = {{ {told} }}',
            f'[[step]]\nkind = "dwell"\nlabel = "rest {k + 1}"\nduration_s = {seconds:.1f}',
        ]
    source = Source(f"generated-{number}", "procedure", "\n".join(lines) + "\n")
    return Generated(procedure_from(source), IMUS[number % len(IMUS)])


def leaning(number: int) -> tuple[Procedure, ImuSpec]:
    """Two rests some half a turn apart about an axis that leans by some degrees, of a coarse unit.

    Which way it leans is told by the sign of what its biases, tens of mg, leave of the force along
    it.
    """
    rng = np.random.default_rng([number, 20_001])
    table = TABLES[number % len(TABLES)]
    outer, inner = rng.uniform(-180, 0, 2)
    first = _tilts(table, rng) | {
        "outer": outer,
        "middle": rng.uniform(-10, 10),
        "inner": inner,
    }
    second = {"inner": inner + rng.uniform(160, 180)}
    lines = [
        f'title = "Leaning {number}"',
        f'table = "{table}"',
        f"[site]\nlatitude_deg = {rng.uniform(-70, 70):.3f}\ngravity_m_s2 = 9.81",
        '[estimate]\nmethods = ["two-position"]',
    ]
    for k, joints in enumerate((first, second)):
        told = ", ".join(f"{joint} = {angle:.2f}" for joint, angle in joints.items())
        lines += [
            f'[[step]]\nkind = "move"\nlabel = "to {k + 1}"\njoints_deg = {{ {told} }}',
            f'[[step]]\nkind = "dwell"\nlabel = "rest {k + 1}"\n'
            f"duration_s = {rng.uniform(30, 300):.1f}",
        ]
    source = Source(f"leaning-{number}", "procedure", "\n".join(lines) + "\n")
    unit = COARSE.format(
        np.exp(rng.uniform(*np.log([30, 800]))),
        np.exp(rng.uniform(*np.log([0.005, 0.1]))),
        rng.uniform(20, 60),
        np.exp(rng.uniform(*np.log([0.005, 0.05]))),
    )
    return procedure_from(source), imu_from(Source("coarse", f"coarse-{number}.toml", unit))


def _tilts(table: str, rng: np.random.Generator) -> dict[str, float]:
    """Base roll and pitch [deg]: a tilt any way, as far as the table's travel allows."""
    size, way = rng.uniform(0, TILT_DEG), rng.uniform(0, 2 * np.pi)
    axes, asked = (
        load_table(table).entry.axis,
        {"base_roll": np.cos(way), "base_pitch": np.sin(way)},
    )
    found = {}
    for joint, part in asked.items():
        low, high = axes[joint].travel_deg or (-TILT_DEG, TILT_DEG)
        found[joint] = float(np.clip(size * part, low + MARGIN_DEG, high - MARGIN_DEG))
    return found


def _attitude(rng: np.random.Generator) -> dict[str, float]:
    """Gimbal angles [deg] of an attitude that is as likely as any other."""
    outer, inner = rng.uniform(-180, 180, 2)
    return {
        "outer": outer,
        "middle": float(np.degrees(np.arcsin(rng.uniform(-1, 1)))),
        "inner": inner,
    }
