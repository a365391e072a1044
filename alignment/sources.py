"""The papers whose methods are rebuilt here, by the letter they are cited by."""

SOURCES = {
    "S0": "Autonomous initial orientation without integration: the six-position test on a "
    "three-axis stand, against Runge-Kutta integration",
    "S1": "Azimuth error of a self-orienting strapdown system under random rocking (two gyros)",
    "S2": "Correction of the orientation matrix in an inertial-satellite system: invariants and "
    "vector matching",
    "C": "Calibration on a table: IEEE Std 517 (gyros) and 1293 (accelerometers), with the table's "
    "errors estimated beside the unit's",
    "S4": "Analytic, dynamic and double (two-position) gyrocompassing, with error budgets",
}


def legend() -> list[str]:
    """A line for each letter."""
    return [f"[{letter}] {title}" for letter, title in SOURCES.items()]
