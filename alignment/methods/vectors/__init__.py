"""Vector matching with satellite navigation: attitude of a moving vehicle from its fixes.

Three solutions of one problem on the same readings and fixes; each answers with a `Matching`, the
attitude and place over time by the fixes that had come. Source: [S2], methods.md section 4.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.against_truth import rotation_error
from alignment.arrays import Array, IntArray, set_owned
from alignment.methods.vectors.fixes import Matching, VectorOptions
from alignment.methods.vectors.kalman import kalman
from alignment.methods.vectors.observing import observing
from alignment.methods.vectors.printed import printed
from alignment.methods.vectors.solutions import SOLUTIONS
from alignment.readings import BoolArray, Fixes, ImuReadings

__all__ = [
    "SOLUTIONS",
    "Curve",
    "Fixes",
    "Matching",
    "VectorOptions",
    "compare",
    "kalman",
    "observing",
    "printed",
]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One solution against what was true, at each fix from the second on.

    `fixes` (m,) how many; `error` (m, 3) small rotation about n from truth to estimate [rad];
    `covariance` (m, 3, 3) [rad^2]; `given` (m,): False where the solution refused or did not
    correct, and the attitude is that of the last correction, carried by the gyros.
    """

    method: str
    fixes: IntArray
    error: Array
    covariance: Array
    given: BoolArray

    def __post_init__(self) -> None:
        m = len(self.fixes)
        set_owned(
            self,
            fixes=(self.fixes, (m,), np.int64),
            error=(self.error, (m, 3), float),
            covariance=(self.covariance, (m, 3, 3), float),
            given=(self.given, (m,), bool),
        )

    @property
    def nees(self) -> Array:
        """Normalised error squared (m,): chi-square of 3 degrees where the covariance is right."""
        return np.einsum(
            "mi,mi->m", self.error, np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        )


def compare(
    readings: ImuReadings,
    fixes: Fixes,
    C_nb0: Rotation,
    truth: Rotation,
    options: VectorOptions | None = None,
) -> dict[str, Curve]:
    """Error against number of fixes of every solution on the same data.

    `truth`: the true ``C_nb`` at each fix (m rotations); the rest as for the solutions.
    """
    return {
        name: against(solve(readings, fixes, C_nb0, options), truth)
        for name, solve in SOLUTIONS.items()
    }


def against(matching: Matching, truth: Rotation) -> Curve:
    """A solution's errors at its fixes, from the second on."""
    k = np.flatnonzero(matching.at_fix)[1:]
    C_nb = Rotation.from_quat(matching.C_nb.as_quat()[k])
    error = rotation_error(C_nb, truth[1:])
    return Curve(
        matching.method,
        matching.fixes[k],
        error,
        matching.covariance[k],
        given=matching.corrected[k],
    )
