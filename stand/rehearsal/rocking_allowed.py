"""The rocking of a base that a method admits, as data; `stand.rehearsal.admissible` finds it."""

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.units import DEG


@dataclass(frozen=True, slots=True, eq=False)
class AdmissibleRocking:
    """What one method admits in one stretch.

    Attributes
    ----------
    method, label : str
    allowed : float
        Sigma of heading that is required [rad]: the limit over its coverage.
    planned, frequency : float
        Rocking of the base about its worse axis as it is planned [rad rms], and how fast [Hz].
    rms : float
        What is admissible at that frequency [rad rms]; 0 where the sensors alone are too much,
        infinite where it is more than ten times the planned one.
    sensors : float
        Sigma of heading by the sensors alone [rad].
    frequencies, curve : (k,)
        The chart: admissible rocking [rad rms] by frequency [Hz]; empty where nothing is known
        but at the planned one.
    """

    method: str
    label: str
    allowed: float
    planned: float
    frequency: float
    rms: float
    sensors: float
    frequencies: Array
    curve: Array

    def __post_init__(self) -> None:
        k = len(self.frequencies)
        set_owned(
            self, frequencies=(self.frequencies, (k,), float), curve=(self.curve, (k,), float)
        )

    @property
    def text(self) -> str:
        """'two-gyro: up to 0.03 deg rms at 0.2 Hz for a heading sigma of 0.1 deg; ...'."""
        wanted = f"for a heading sigma of {self.allowed / DEG:.3g} deg"
        planned = f"planned are {self.planned / DEG:.2g} deg"
        if not self.rms:
            alone = f"the sensors alone leave {self.sensors / DEG:.3g} deg"
            return f"{self.method}: no rocking {wanted}: {alone}"
        if not np.isfinite(self.rms):
            return f"{self.method}: ten times the planned {self.planned / DEG:.2g} deg rms {wanted}"
        most = f"rocking of up to {self.rms / DEG:.2g} deg rms at {self.frequency:.2g} Hz"
        return f"{self.method}: {most} {wanted}; {planned}"


def admissible_json(found: AdmissibleRocking) -> dict[str, object]:
    """One method's answer for machines: degrees; null for more than ten times the planned."""
    return {
        "method": found.method,
        "stretch": found.label,
        "heading_sigma_deg": found.allowed / DEG,
        "planned_rms_deg": found.planned / DEG,
        "frequency_hz": found.frequency,
        "admissible_rms_deg": found.rms / DEG if np.isfinite(found.rms) else None,
        "sensors_alone_deg": found.sensors / DEG if np.isfinite(found.sensors) else None,
        "chart": {
            "frequency_hz": found.frequencies.tolist(),
            "admissible_rms_deg": (found.curve / DEG).tolist(),
        },
    }
