"""Rests whose attitude nobody told: the order of their angles is that of the vertical they feel."""

from math import radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Site
from alignment.angles import Sequence

W, G = 7.292115e-5, 9.8093587
N, E, D = np.eye(3)
UP = {  # columns X1, Y1, Z1 in n
    "Y1": np.column_stack([N, -D, E]),
    "X1": np.column_stack([-D, E, N]),
}


def rest(C, nominal):
    lat = radians(48.5)
    w, f = C.T @ (W * np.array([np.cos(lat), 0, -np.sin(lat)])), C.T @ np.array([0, 0, -G])
    t = np.arange(1, 401) / 10
    readings = ImuReadings(t, np.tile(w, (400, 1)), np.tile(f, (400, 1)))
    return Dwell("rest", 0.0, 40.0, readings, Rotation.from_matrix(C) if nominal else None)


@pytest.mark.parametrize("method", ["triad", "single-gyro", "inertial", "six-position", "rk4"])
@pytest.mark.parametrize(
    ("up", "sequence"), [("Y1", Sequence.YAW_PITCH_ROLL), ("X1", Sequence.YAW_ROLL_PITCH)]
)
def test_angles_are_in_the_order_that_is_regular_there(method, up, sequence):
    site = Site(radians(48.5), local_gravity=G)
    for nominal in (False, True):
        estimates = ESTIMATORS[method].estimate([rest(UP[up], nominal)], site, Options())
        assert [e.sequence for e in estimates] == [sequence] * len(estimates)
        assert not any(e.singular for e in estimates)
