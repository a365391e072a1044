"""Procedures and units at once that nobody tuned anything to, by number: any keys of a sheet.

A unit of any grade states about half of what a sheet can state, each by a factor of its own from
what its grade has; a procedure rests, spins and rocks at any place and attitude.
"""

from typing import Any

import numpy as np
from generated import LATITUDE_DEG, TABLES, TILT_DEG
from procedures import document

from alignment.units import DEG
from stand.evaluation.comparison import applicable
from stand.imu.preset import ImuSpec, imu_from
from stand.procedure.procedure import procedure_from, table_of
from stand.samples import Sampling
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, assembled
from stand.toml_files import Source

COUNT = 60
GRADES = 1e4  # from navigation to consumer grade, of gyros; of accelerometers the root of it
SPREAD = 3.0  # by which a key may be better or worse than its grade
LEAST_SAMPLES = 3  # of a mean whose scatter is told
OFTEN = 0.5  # that a sheet states a key
RATES_HZ = (2, 5, 10, 20, 50)
KINDS = ("typical", "1 sigma", "maximum", "unspecified")

# of a navigation unit; the power of the grade with which they grow
_GYRO = {
    "turn_on_bias_deg_h": (0.003, 1.0),
    "bias_instability_deg_h": (0.001, 1.0),
    "rate_random_walk_deg_h_rt_h": (0.001, 1.0),
    "rate_ramp_deg_h_h": (0.001, 1.0),
    "scale_factor_ppm": (5.0, 0.7),
    "scale_asymmetry_ppm": (1.0, 0.7),
    "misalignment_mrad": (0.02, 0.6),
    "non_orthogonality_mrad": (0.02, 0.6),
    "g_sensitivity_deg_h_g": (0.001, 1.0),
    "g2_sensitivity_deg_h_g2": (0.0003, 1.0),
    "bias_temperature_deg_h_K": (0.0003, 1.0),
    "scale_temperature_ppm_K": (0.5, 0.6),
    "resolution_deg_s": (1e-7, 1.0),
}
_ACCEL = {
    "turn_on_bias_mg": (0.02, 0.8),
    "bias_instability_ug": (1.0, 0.5),
    "acceleration_random_walk_ug_rt_h": (1.0, 0.5),
    "acceleration_ramp_ug_h": (1.0, 0.5),
    "scale_factor_ppm": (20.0, 0.6),
    "scale_asymmetry_ppm": (3.0, 0.6),
    "misalignment_mrad": (0.03, 0.6),
    "non_orthogonality_mrad": (0.03, 0.6),
    "second_order_ug_g2": (3.0, 0.6),
    "bias_temperature_ug_K": (0.3, 0.6),
    "scale_temperature_ppm_K": (1.0, 0.5),
    "resolution_mg": (0.001, 0.6),
}


def unit_case(number: int) -> Settings:
    """The settings of a run: procedure, unit, rate and sampling; every method that takes it."""
    rng = np.random.default_rng([number, 30_000])
    unit, data = _unit(number, rng), _procedure(number, rng)
    if rng.random() < 0.25:
        data["temperature"] = {
            "time_s": [0.0, float(rng.uniform(30, 600))],
            "temperature_C": [25.0, round(float(rng.uniform(0, 50)), 1)],
        }
    rate = int(rng.choice(RATES_HZ))
    window = data["estimate"]["offset_window_s"]
    data["estimate"]["offset_window_s"] = max(window, LEAST_SAMPLES / rate)
    sampling = Sampling.INSTANT if rng.random() < 0.25 else Sampling.MEAN

    def settings() -> Settings:
        name = f"mixed-{number}"
        procedure = procedure_from(Source(name, f"{name}.toml", document(data)))
        site = procedure.entry.site.site()
        return assembled(procedure, unit, table_of(procedure), site, rate, sampling=sampling)

    there = applicable(Trials(settings()).plan)
    data["estimate"]["methods"] = [name for name in there if name != "calibration"]
    return settings()


def _unit(number: int, rng: np.random.Generator) -> ImuSpec:
    grade = GRADES ** rng.random()

    def stated(size: float, kinds: tuple[str, ...] = KINDS) -> dict[str, Any]:
        value = float(f"{size * SPREAD ** rng.uniform(-1, 1):.3g}")
        return {"value": value, "kind": str(rng.choice(kinds)), "source": "made up"}

    def some(keys: dict[str, tuple[float, float]], of: float) -> dict[str, Any]:
        there = [key for key in keys if rng.random() < OFTEN]
        return {key: stated(keys[key][0] * of ** keys[key][1]) for key in there}

    gyro = {"angle_random_walk_deg_rt_h": stated(0.001 * grade**0.6)} | some(_GYRO, grade)
    accel = {"velocity_random_walk_m_s_rt_h": stated(0.005 * grade**0.4)} | some(_ACCEL, grade)
    sampling: dict[str, Any] = {}
    for sensor in (gyro, accel):
        if rng.random() < OFTEN:
            sensor["bandwidth_hz"] = stated(40.0)
    if rng.random() < OFTEN:  # a range, without which no non-linearity can be stated
        gyro["range_deg_s"] = {"value": 400.0, "kind": "maximum", "source": "made up"}
        gyro["scale_nonlinearity_ppm"] = stated(10.0 * grade**0.6)
        accel["range_g"] = {"value": 10.0, "kind": "maximum", "source": "made up"}
        accel["scale_nonlinearity_ppm"] = stated(30.0 * grade**0.6)
    if rng.random() < OFTEN:
        places = np.round(rng.uniform(-10, 10, (3, 3)), 1).tolist()
        accel["places_mm"] = {"value": places, "kind": "typical", "source": "made up"}
    for key, size in (("clock_offset_ppm", 5.0), ("jitter_us", 20.0), ("latency_ms", 1.0)):
        if rng.random() < OFTEN:
            sampling[key] = stated(size * grade**0.25)
    if rng.random() < 0.2:
        sampling["output"] = "increment"
        for sensor, key in ((gyro, "resolution_deg_s"), (accel, "resolution_mg")):
            sensor.pop(key, None)
        gyro["increment_lsb_arc_s"] = stated(0.001 * grade**0.6)
        accel["increment_lsb_m_s"] = stated(1e-5 * grade**0.4)
    data = {
        "title": f"Unit {number}",
        "grade": f"{grade:.0f}",
        "evidence": "none",
        "gyro": gyro,
        "accel": accel,
        "sampling": sampling,
    }
    return imu_from(Source(f"unit-{number}", f"unit-{number}.toml", document(data)))


def _procedure(number: int, rng: np.random.Generator) -> dict[str, Any]:
    kind = ("rests", "spins", "both", "rests", "rocks")[number % 5]
    table = "rocking-platform" if kind == "rocks" else TABLES[number // 5 % len(TABLES)]
    size, way = rng.uniform(0, TILT_DEG), rng.uniform(0, 2 * np.pi)
    low = 8.0 if table != "rocking-platform" else TILT_DEG
    tilts = {
        "base_roll": round(float(np.clip(size * np.cos(way), -low, low)), 2),
        "base_pitch": round(float(np.clip(size * np.sin(way), -low, low)), 2),
    }
    steps: list[dict[str, Any]] = []
    for k in range(rng.integers(1, 5, endpoint=True)):
        asked = _attitude(rng) | (tilts if k == 0 else {})
        steps.append({"kind": "move", "label": f"to {k + 1}", "joints_deg": asked})
        rests = kind in ("rests", "rocks") or (kind == "both" and k % 2 == 0)
        steps.append(_rest(k, rng) if rests else _spin(k, rng))
    shortest = min((step["duration_s"] for step in steps if step["kind"] == "dwell"), default=15.0)
    window = round(min(float(rng.uniform(1, 15)), shortest), 1)
    data: dict[str, Any] = {
        "title": f"Mixed {number}",
        "table": table,
        "site": {
            "latitude_deg": round(float(rng.uniform(-LATITUDE_DEG, LATITUDE_DEG)), 3),
            "height_m": round(float(rng.uniform(0, 3000)), 0),
            "deflection_north_arc_s": round(float(rng.normal(0, 10)), 1),
            "deflection_east_arc_s": round(float(rng.normal(0, 10)), 1),
        },
        "estimate": {"methods": ["triad"], "offset_window_s": window},
        "move_limits": {"rate_deg_s": 20, "acceleration_deg_s2": 20, "jerk_deg_s3": 80},
        "step": steps,
    }
    if kind == "rocks":
        data["background"] = [_rocking(rng)]
    return data


def _attitude(rng: np.random.Generator) -> dict[str, float]:
    """Gimbal angles, of any attitude; every other time level, as tables are used."""
    outer, inner = (round(float(a), 2) for a in rng.uniform(-180, 180, 2))
    middle = round(float(np.arcsin(rng.uniform(-1, 1)) / DEG), 2)
    if rng.random() < 0.5:
        return {"outer": outer, "middle": 0.0, "inner": 90.0 * float(rng.integers(-1, 2))}
    return {"outer": outer, "middle": middle, "inner": inner}


def _rest(k: int, rng: np.random.Generator) -> dict[str, Any]:
    seconds = round(float(np.exp(rng.uniform(np.log(3), np.log(300)))), 1)
    return {"kind": "dwell", "label": f"rest {k + 1}", "duration_s": seconds}


def _spin(k: int, rng: np.random.Generator) -> dict[str, Any]:
    rate = round(float(np.exp(rng.uniform(np.log(3), np.log(60)))), 1)
    return {
        "kind": "rate",
        "label": f"spin {k + 1}",
        "axis": str(rng.choice(["outer", "middle", "inner"], p=[0.6, 0.2, 0.2])),
        "rate_deg_s": rate * float(rng.choice([-1, 1])),
        "turns": round(float(rng.uniform(1.0, 6.0)), 1),
        "directions": str(rng.choice(["one", "both"], p=[0.7, 0.3])),
    }


def _rocking(rng: np.random.Generator) -> dict[str, Any]:
    axes = [a for a in ("base_roll", "base_pitch", "base_yaw") if rng.random() < 0.7]
    return {
        "kind": "sine",
        "fade_s": 2.0,
        "axes": {
            axis: {
                "amplitude_deg": round(float(np.exp(rng.uniform(np.log(0.05), np.log(4)))), 3),
                "frequency_hz": round(float(rng.uniform(0.05, 0.4)), 3),
                "phase_deg": round(float(rng.uniform(0, 360)), 0),
            }
            for axis in axes or ["base_roll"]
        },
    }
