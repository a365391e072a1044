"""A unit's constant errors from a test on a table or by hand, and readings without them."""

from alignment.calibration.apply import Correction, correct, corrected_covariance
from alignment.calibration.constants import TriadConstants, columns, constants_of, reported, slope
from alignment.calibration.result import (
    Calibration,
    Contribution,
    Derived,
    Gravity,
    Key,
    LeftOut,
    Nuisance,
    Parameter,
    Residual,
    basis_of,
    derived_of,
    parameters_of,
    share_of_prior,
)

__all__ = [
    "Calibration",
    "Contribution",
    "Correction",
    "Derived",
    "Gravity",
    "Key",
    "LeftOut",
    "Nuisance",
    "Parameter",
    "Residual",
    "TriadConstants",
    "basis_of",
    "columns",
    "constants_of",
    "correct",
    "corrected_covariance",
    "derived_of",
    "parameters_of",
    "reported",
    "share_of_prior",
    "slope",
]
