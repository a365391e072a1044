"""How large a value of a preset can be: what units of a grade have, and how units get mixed up.

A band holds what the sheets of a grade state, with some room on both sides. It must stay narrower
than the mix-up it is there to find: a band of 1 to 60 cannot see a factor of 60.
"""

from collections.abc import Mapping
from typing import NamedTuple

GRADES = ("consumer", "industrial", "tactical", "navigation")
REFERENCE = "reference"  # the grade of made-up units: no band holds for them

Span = tuple[float, float]


class Band(NamedTuple):
    """Least and largest value of a key, in its `unit`, for each of `GRADES`, and `why`."""

    unit: str
    spans: tuple[Span, Span, Span, Span]
    why: str

    def of(self, grade: str | None) -> Span:
        """The band of a grade; of all grades together for None."""
        if grade is not None:
            return self.spans[GRADES.index(grade)]
        return min(low for low, _ in self.spans), max(high for _, high in self.spans)


def _alike(unit: str, low: float, high: float, why: str) -> Band:
    span = (low, high)
    return Band(unit, (span, span, span, span), why)


# Sheets named in `why` are those of the shipped presets and of other units of their grades.
_SHARED = {
    "scale_factor_ppm": Band(
        "ppm",
        ((1000, 1e5), (300, 1e4), (30, 3000), (1, 800)),
        "MPU-9250 3 %, STIM300 500, HG9900 5",
    ),
    "scale_asymmetry_ppm": _alike("ppm", 0.1, 1e5, "a part of the scale factor"),
    "scale_nonlinearity_ppm": Band(
        "ppm", ((100, 3e4), (20, 1e4), (5, 3000), (0.5, 500)), "MPU-9250 0.5 %, STIM300 20 to 200"
    ),
    "misalignment_mrad": Band(
        "mrad", ((1, 100), (0.3, 30), (0.1, 20), (0.003, 1)), "cross-axis 2 % to 10 arc seconds"
    ),
    "non_orthogonality_mrad": Band(
        "mrad", ((1, 100), (0.1, 30), (0.05, 10), (0.002, 1)), "STIM300 0.2, HG4930 0.375"
    ),
    "scale_temperature_ppm_K": _alike("ppm/K", 0.01, 1000, "MEMS 0.01 %/K and below"),
    "bandwidth_hz": _alike("Hz", 10, 8000, "STIM300 16 to 262, ICM-42688-P 3979"),
}
GYRO_BANDS: Mapping[str, Band] = _SHARED | {
    "turn_on_bias_deg_h": Band(
        "deg/h",
        ((200, 1e5), (20, 2e4), (0.5, 1200), (0.001, 0.5)),
        "MPU-9250 18000, HG9900 0.0035",
    ),
    "bias_instability_deg_h": Band(
        "deg/h", ((1, 300), (0.5, 100), (0.03, 20), (1e-4, 0.05)), "ADIS16405 25 to PSINS 0.001"
    ),
    "angle_random_walk_deg_rt_h": Band(
        "deg/rt-h",
        ((0.1, 3), (0.08, 2.5), (0.012, 0.5), (5e-4, 0.012)),
        "BMI088 0.84 to HG9900 0.002",
    ),
    "rate_random_walk_deg_h_rt_h": _alike("deg/h/rt-h", 1e-5, 200, "rarely stated"),
    "rate_ramp_deg_h_h": _alike("deg/h/h", 1e-5, 200, "rarely stated"),
    "g_sensitivity_deg_h_g": Band(
        "deg/h/g", ((20, 3000), (5, 1000), (0.1, 100), (1e-4, 0.1)), "BMI088 360, STIM300 1"
    ),
    "g2_sensitivity_deg_h_g2": _alike("deg/h/g^2", 1e-4, 100, "ADIS16470 1.8"),
    "bias_temperature_deg_h_K": Band(
        "deg/h/K", ((3, 1000), (0.3, 300), (0.003, 10), (1e-5, 0.03)), "BMI088 54, ICM-42688-P 18"
    ),
    "range_deg_s": _alike("deg/s", 50, 5000, "ADIS16495 125, MPU-9250 2000"),
    "resolution_deg_s": Band(
        "deg/s", ((1e-3, 0.3), (1e-6, 0.3), (1e-7, 0.02), (1e-9, 1e-3)), "16 bit to 32 bit"
    ),
    "increment_lsb_arc_s": _alike("arc seconds", 1e-5, 50, "LN-200S 0.39"),
}
ACCEL_BANDS: Mapping[str, Band] = _SHARED | {
    "turn_on_bias_mg": Band(
        "mg", ((5, 300), (0.3, 100), (0.1, 30), (0.005, 3)), "MPU-9250 60 to HG9900 0.025"
    ),
    "bias_instability_ug": Band(
        "ug", ((10, 1000), (3, 500), (1, 300), (0.1, 80)), "ADIS16405 200 to STIM300 5"
    ),
    "velocity_random_walk_m_s_rt_h": Band(
        "m/s/rt-h",
        ((0.02, 0.5), (0.02, 0.5), (5e-3, 0.15), (2e-3, 0.1)),
        "MPU-9250 0.18, HG1700 0.02",
    ),
    "acceleration_random_walk_ug_rt_h": _alike("ug/rt-h", 1e-3, 1000, "rarely stated"),
    "acceleration_ramp_ug_h": _alike("ug/h", 1e-3, 1000, "rarely stated"),
    "second_order_ug_g2": _alike("ug/g^2", 0.3, 5000, "PSINS 10"),
    "bias_temperature_ug_K": Band(
        "ug/K", ((10, 5000), (3, 2000), (1, 500), (0.1, 60)), "BMI088 200, ICM-42688-P 150"
    ),
    "range_g": _alike("g", 1.5, 60, "STIM300 5 to ADIS16470 40"),
    "resolution_mg": Band(
        "mg", ((0.02, 10), (1e-5, 5), (1e-5, 0.5), (1e-7, 0.05)), "16 bit to 32 bit"
    ),
    "increment_lsb_m_s": _alike("m/s", 1e-9, 0.1, "LN-200S 6.1e-5"),
}
SAMPLING_BANDS: Mapping[str, Band] = {
    "output_rate_hz": _alike("Hz", 1, 50_000, "ICM-42688-P 32000"),
    "clock_offset_ppm": _alike("ppm", 1e-3, 1e5, "crystals 1 to 100, MEMS oscillators 5 %"),
    "jitter_us": _alike("us", 1e-3, 5000, "ring-laser logs 500"),
    "latency_ms": _alike("ms", 1e-3, 500, "filters and buses"),
}

# What a value may have been given in by mistake: unit -> other unit -> factor to unit.
_AGAIN = "{unit}, multiplied by {by:g} once too often"
SLIPS: Mapping[str, Mapping[str, float]] = {
    "deg/h": {"deg/s": 3600, "rad/s": 206264.8, _AGAIN: 1 / 3600},
    "deg/rt-h": {"deg/s/rt-Hz": 60, "rad/s/rt-Hz": 3437.747, "deg/h/rt-Hz": 1 / 60},
    "deg/h/rt-h": {"deg/h/rt-s": 60, "deg/s/rt-h": 3600, "deg/s/rt-s": 216000},
    "deg/h/h": {"deg/s/h": 3600, "deg/s/s": 3600 * 3600},
    "deg/h/g": {"deg/s/g": 3600, _AGAIN: 1 / 3600},
    "deg/h/g^2": {"deg/s/g^2": 3600, _AGAIN: 1 / 3600},
    "deg/h/K": {"deg/s/K": 3600, _AGAIN: 1 / 3600},
    "deg/s": {"rad/s": 57.29578, "deg/h": 1 / 3600},
    "arc seconds": {"rad": 206264.8, "deg": 3600},
    "mg": {"g": 1000, "m/s^2": 101.9716, "ug": 1e-3},
    "ug": {"mg": 1000, "g": 1e6, "m/s^2": 101971.6, _AGAIN: 1e-3},
    "m/s/rt-h": {"m/s^2/rt-Hz": 60, "ug/rt-Hz": 5.88399e-4, _AGAIN: 1 / 60},
    "ug/rt-h": {"mg/rt-h": 1000},
    "ug/h": {"mg/h": 1000},
    "ug/g^2": {"mg/g^2": 1000, _AGAIN: 1e-3},
    "ug/K": {"mg/K": 1000, _AGAIN: 1e-3},
    "ppm": {"%": 1e4, "parts of one": 1e6, _AGAIN: 1e-4},
    "ppm/K": {"%/K": 1e4, "parts of one per K": 1e6},
    "mrad": {"rad": 1000, "deg": 17.45329, "arc minutes": 0.2908882, "arc seconds": 4.848137e-3},
    "g": {"mg": 1e-3, "m/s^2": 0.1019716},
    "Hz": {"kHz": 1000},
    "us": {"ms": 1000, "s": 1e6, "ns": 1e-3},
    "ms": {"s": 1000, "us": 1e-3},
    "m/s": {},
}


def slips(value: float, unit: str, span: Span) -> list[tuple[str, float]]:
    """Units that `value` was probably given in, each with what it then is in `unit`.

    Those known mix-ups that bring it into the band `span`, common ones first.
    """
    low, high = span
    return [
        (name.format(unit=unit, by=1 / factor), value * factor)
        for name, factor in SLIPS[unit].items()
        if low <= value * factor <= high
    ]
