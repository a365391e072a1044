"""Scale errors in the fine filter: what noise must not tell of them."""

import numpy as np
from rocking import Angle, G, Motion, noisy
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.methods.fine import filtered

SITE = Site(latitude=np.radians(48.5), local_gravity=G)


def test_noise_does_not_tell_scale_errors():
    """At rest aslant by 10 deg, scale errors of 0.4 % stated and none there: what two level axes
    have of them the records do not tell, so it is found to be none, however long they are.

    Were noise of the forces in what a scale error multiplies, each update found the variance of
    the prior times its own part of the innovation's: 0.0041^2 times 600, two and a half sigmas.
    """
    lean = Motion(pitch=Angle(start=np.radians(10.0)))
    priors = Priors(gyro_walk=7e-6, accel_walk=2.5e-3, accel_scale=0.004, gyro_bias=1e-6)
    found = []
    for seed in range(6):
        t, w, f, C = lean.readings(120.0, 10)
        w, f = noisy(np.random.default_rng(seed), w, f, 10, 1, priors.gyro_walk, priors.accel_walk)
        readings = ImuReadings(t, w[0], f[0])
        run = filtered(Dwell("", 0.0, 120.0, readings), SITE, Options(priors=priors))
        found.append(run.constants[-1][run.names.index("accel_scale")])
        down = (run.C_nb[-1] * Rotation.from_matrix(C).inv()).apply([0.0, 0.0, 1.0])
        tilts = np.array([-down[1], down[0]])
        assert (np.abs(tilts) < 4 * np.sqrt(run.covariance[-1].diagonal()[:2])).all()
    across = np.array(found)[:, [0, 2]]
    assert np.abs(across.mean(axis=0)).max() < 0.15 * priors.accel_scale
