"""The three solutions of one problem, by name."""

from collections.abc import Callable

from scipy.spatial.transform import Rotation

from alignment.methods.vectors.fixes import Matching, VectorOptions
from alignment.methods.vectors.kalman import kalman
from alignment.methods.vectors.observing import observing
from alignment.methods.vectors.printed import printed
from alignment.readings import Fixes, ImuReadings

Solve = Callable[[ImuReadings, Fixes, Rotation, VectorOptions | None], Matching]
SOLUTIONS: dict[str, Solve] = {"printed": printed, "observing": observing, "kalman": kalman}
