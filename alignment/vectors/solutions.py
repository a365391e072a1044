"""The three solutions of one problem, by name."""

from collections.abc import Callable

from scipy.spatial.transform import Rotation

from alignment.readings import ImuReadings
from alignment.vectors.fixes import Fixes, Matching, VectorOptions
from alignment.vectors.kalman import kalman
from alignment.vectors.observing import observing
from alignment.vectors.printed import printed

Solve = Callable[[ImuReadings, Fixes, Rotation, VectorOptions | None], Matching]
SOLUTIONS: dict[str, Solve] = {"printed": printed, "observing": observing, "kalman": kalman}
