"""The instrument: what an IMU reports of the truth, and the presets that say how badly."""

from stand.imu.model import TERMS, Imu, Temperature, UnitErrors, without
from stand.imu.preset import ImuEntry, ImuSpec, Stated, TriadSpec, imu_from, load_imu, unstated

__all__ = [
    "TERMS",
    "Imu",
    "ImuEntry",
    "ImuSpec",
    "Stated",
    "Temperature",
    "TriadSpec",
    "UnitErrors",
    "imu_from",
    "load_imu",
    "unstated",
    "without",
]
