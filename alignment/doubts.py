"""Doubts about an estimate that a reader must see."""

import numpy as np

from alignment.arrays import Array


def heading_doubt(covariance: Array) -> tuple[str, ...]:
    """A flag when heading is too unsure for first-order theory (sigma above 8 deg)."""
    sigma = float(np.degrees(np.sqrt(covariance[2, 2])))
    return ("heading sigma above 8 deg: beyond first order",) if sigma > 8.0 else ()
