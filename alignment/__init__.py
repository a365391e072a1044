"""Estimators of attitude and calibration from inertial readings, of a stand or of a real log.

Notation: n is north-east-down, b the instrument axes (X1 forward, Y1 up, Z1 right at zero table
angles); ``w_ib_b`` [rad/s] is what gyros sense and ``f_b`` [m/s^2] what accelerometers sense,
both in b; ``C_nb`` takes b components to n components. SI units and radians throughout. Nothing
here knows the stand: an estimator cannot see the truth.

`ESTIMATORS` is the one list of methods; a new one is a module and a line here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from alignment.earth import Site
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.methods.carousel import carousel
from alignment.methods.fine import Innovations, fine, fine_tracks, innovations
from alignment.methods.inertial import inertial, inertial_tracks
from alignment.methods.integration import rk4, rk4_tracks
from alignment.methods.positions import multi_position, two_position
from alignment.methods.single_gyro import single_gyro
from alignment.methods.six_position import six_position, six_position_tracks
from alignment.methods.triad import triad
from alignment.methods.two_gyro import two_gyro
from alignment.methods.two_sample import two_sample, two_sample_tracks
from alignment.methods.vectors.method import vector_matching
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings, Turn

__all__ = [
    "ESTIMATORS",
    "AttitudeEstimate",
    "AttitudeTrack",
    "Dwell",
    "ImuReadings",
    "Method",
    "Options",
    "Priors",
    "Site",
    "Turn",
]


@dataclass(frozen=True, slots=True)
class Method:
    """An estimator as the lists show it.

    `needs_latitude`: whether ``site.latitude`` must be known; `needs_offset`: whether each dwell
    must hold the offset window and be at a nominal attitude. `tracks` gives the attitude over
    time of one dwell, for curves; None where there is nothing to see. `note` says what a reader of
    its numbers must know. `takes`: which stretches it is for: those at `rest`, those `turning` at a
    constant rate, `any` (a base that rocks), or those with satellite `fixes`. `innovations`: what
    the updates of a filter found beyond expectation.
    """

    title: str
    source: str
    note: str
    needs_latitude: bool
    needs_offset: bool
    estimate: Callable[[Sequence[Dwell], Site, Options], list[AttitudeEstimate]]
    tracks: Callable[[Dwell, Site, Options], list[AttitudeTrack]] | None = None
    takes: Literal["rest", "turning", "any", "fixes"] = "rest"
    innovations: Callable[[Dwell, Site, Options], Innovations] | None = None

    def suited(self, dwell: Dwell) -> bool:
        """Whether the method is for this stretch."""
        if self.takes == "fixes":
            return dwell.fixes is not None
        return self.takes == "any" or (dwell.turn is not None) == (self.takes == "turning")


ESTIMATORS = {
    "six-position": Method(
        "Levelling and horizontal rates after zero-offset removal, no integration",
        "[S0] autonomous initial orientation, six-position test",
        "± of noise, the zero offset's own included, drift and placement by stated priors",
        True,
        True,
        six_position,
        six_position_tracks,
    ),
    "rk4": Method(
        "Runge-Kutta integration of offset-corrected gyros from the nominal attitude",
        "[S0] the rival of the six-position method",
        "drift at the end of the dwell; ± of the angle random walk seen and stated priors",
        True,
        True,
        rk4,
        rk4_tracks,
    ),
    "two-sample": Method(
        "Coning-corrected two-sample integration of the same gyros, as rk4",
        "[S0] a second rival of the six-position method; Savage (1998)",
        "drift at the end of the dwell; ± of the angle random walk seen and stated priors",
        True,
        True,
        two_sample,
        two_sample_tracks,
    ),
    "triad": Method(
        "Gyrocompassing from mean rate and specific force; estimates latitude too",
        "[S4] analytic gyrocompassing, full-vector form",
        "± of noise and stated priors: biases come through, b/g in tilt, b/(W cos lat) in heading",
        False,
        False,
        triad,
    ),
    "single-gyro": Method(
        "Analytic gyrocompassing with the one gyro nearest to east or west",
        "[S4] analytic gyrocompassing, single-gyro form",
        "± of noise and stated priors; grows as 1/sin of the gyro's azimuth",
        False,
        False,
        single_gyro,
    ),
    "two-position": Method(
        "Double gyrocompassing: two positions a turn apart, biases cancel",
        "[S4] double gyrocompassing, as a least squares fit with priors",
        "± with placement and biases by the priors that were stated",
        False,
        False,
        two_position,
    ),
    "multi-position": Method(
        "All positions in one least squares fit with the biases",
        "[S4] double gyrocompassing, to any number of positions",
        "± with placement and biases by the priors that were stated",
        False,
        False,
        multi_position,
    ),
    "carousel": Method(
        "Dynamic gyrocompassing: Earth rate's harmonic over whole turns",
        "[S4] dynamic gyrocompassing",
        "± of noise and stated priors; attitude at encoder angle zero",
        True,
        False,
        carousel,
        takes="turning",
    ),
    "two-gyro": Method(
        "Mean azimuth on a rocking base from two horizontal gyros",
        "[S1] azimuth of a self-orienting system under random rocking",
        "± holds the sway's own angular rate, which the published bound leaves out",
        True,
        False,
        two_gyro,
        takes="any",
    ),
    "inertial": Method(
        "Inertial-frame alignment: gravity's cone over the whole record, by SVD",
        "[S1] robust answer to rocking: Wahba's problem in the inertial frame",
        "± of noise, sway and stated priors, at the last sample",
        True,
        False,
        inertial,
        inertial_tracks,
        takes="any",
    ),
    "fine": Method(
        "Fine alignment: Kalman filter of attitude, velocity and biases",
        "[S1] robust answer to rocking: zero-displacement updates",
        "± of noise, lever arm and stated priors, at the last sample",
        True,
        False,
        fine,
        fine_tracks,
        takes="any",
        innovations=innovations,
    ),
    "vectors": Method(
        "Vector matching with satellite navigation: as printed, observing form, Kalman filter",
        "[S2] correction of the orientation matrix by invariants and vector matching",
        "± of the fixes, the start and stated priors; without gyro scale and axes that are off",
        False,
        False,
        vector_matching,
        takes="fixes",
    ),
}
