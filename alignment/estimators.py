"""The one list of methods: a new estimator is a module in `alignment.methods` and an entry here.

Whatever the rest of the house must know of a method stands in its entry.
"""

from alignment.method import Method, Window
from alignment.methods.calibration import calibration, calibration_design
from alignment.methods.carousel import carousel
from alignment.methods.carousel_gains import carousel_gains
from alignment.methods.fine import fine, fine_tracks, innovations
from alignment.methods.harmonics import BLOCKS
from alignment.methods.inertial import LEAST_SAMPLES, inertial, inertial_tracks
from alignment.methods.integration import integration_gains, rk4, rk4_tracks
from alignment.methods.position_gains import multi_position_gains, two_position_gains
from alignment.methods.positions import (
    ANOMALY,
    multi_position,
    multi_position_of_runs,
    two_position,
    two_position_of_runs,
)
from alignment.methods.rocking_gains import fine_functional, inertial_functional
from alignment.methods.single_gyro import single_gyro, single_gyro_gains
from alignment.methods.six_position import six_position, six_position_gains, six_position_tracks
from alignment.methods.triad import triad, triad_gains
from alignment.methods.two_gyro import LEAST_SAMPLES as two_gyro_least
from alignment.methods.two_gyro import two_gyro, two_gyro_functional
from alignment.methods.two_sample import two_sample, two_sample_tracks
from alignment.methods.vectors.method import vector_matching

ESTIMATORS = {
    "six-position": Method(
        title="Levelling and horizontal rates after zero-offset removal, no integration",
        source="[S0] autonomous initial orientation, six-position test",
        note="± of noise, the zero offset's own included, drift and placement by stated priors",
        estimate=six_position,
        alone=True,
        gains=six_position_gains,
        needs_latitude=True,
        needs_offset=True,
        windows={
            "same": Window("same window", circular=True),
            "fresh": Window("fresh window"),
        },
        published_deg=(0.009105, 0.006733, 0.017117),
        tracks=six_position_tracks,
        tells_mean=True,
    ),
    "rk4": Method(
        title="Runge-Kutta integration of offset-corrected gyros from the nominal attitude",
        source="[S0] the rival of the six-position method",
        note="drift at the end of the dwell; ± of the angle random walk seen and stated priors",
        estimate=rk4,
        alone=True,
        gains=integration_gains,
        needs_latitude=True,
        needs_offset=True,
        carries_nominal=True,
        published_deg=(0.213968, 0.222806, 0.385168),
        tracks=rk4_tracks,
    ),
    "two-sample": Method(
        title="Coning-corrected two-sample integration of the same gyros, as rk4",
        source="[S0] a second rival of the six-position method; Savage (1998)",
        note="drift at the end of the dwell; ± of the angle random walk seen and stated priors",
        estimate=two_sample,
        alone=True,
        gains=integration_gains,
        needs_latitude=True,
        needs_offset=True,
        carries_nominal=True,
        tracks=two_sample_tracks,
    ),
    "triad": Method(
        title="Gyrocompassing from mean rate and specific force; estimates latitude too",
        source="[S4] analytic gyrocompassing, full-vector form",
        note="± of noise and stated priors: biases come through, b/g in tilt, b/(W cos lat) in "
        "heading",
        estimate=triad,
        gains=triad_gains,
        windows={"pair": Window("opposed pairs", attitude=False)},
        tells_mean=True,
    ),
    "single-gyro": Method(
        title="Analytic gyrocompassing with the one gyro nearest to east or west",
        source="[S4] analytic gyrocompassing, single-gyro form",
        note="± of noise and stated priors; grows as 1/sin of the gyro's azimuth",
        estimate=single_gyro,
        alone=True,
        gains=single_gyro_gains,
        gyros=1,
        azimuth_matters=True,
        tells_mean=True,
    ),
    "two-position": Method(
        title="Double gyrocompassing: two positions a turn apart, biases cancel",
        source="[S4] double gyrocompassing, as a least squares fit with priors",
        note="± with placement and biases by the priors that were stated",
        estimate=two_position,
        estimate_of_runs=two_position_of_runs,
        gains=two_position_gains,
        turns_cancel_bias=True,
        anomaly=ANOMALY,
        tells_mean=True,
    ),
    "multi-position": Method(
        title="All positions in one least squares fit with the biases",
        source="[S4] double gyrocompassing, to any number of positions",
        note="± with placement and biases by the priors that were stated",
        estimate=multi_position,
        estimate_of_runs=multi_position_of_runs,
        gains=multi_position_gains,
        turns_cancel_bias=True,
        anomaly=ANOMALY,
        fits_positions=True,
        tells_mean=True,
    ),
    "carousel": Method(
        title="Dynamic gyrocompassing: Earth rate's harmonic over whole turns",
        source="[S4] dynamic gyrocompassing",
        note="± of noise and stated priors; attitude at encoder angle zero",
        estimate=carousel,
        takes="turning",
        least_samples=BLOCKS,
        gains=carousel_gains,
        needs_latitude=True,
        turns_cancel_bias=True,
    ),
    "two-gyro": Method(
        title="Mean azimuth on a rocking base from two horizontal gyros",
        source="[S1] azimuth of a self-orienting system under random rocking",
        note="± holds the sway's own angular rate, which the published bound leaves out",
        estimate=two_gyro,
        alone=True,
        knows_skew=True,
        takes="standing",
        least_samples=two_gyro_least,
        functional=two_gyro_functional,
        needs_latitude=True,
        needs_upright=True,
        azimuth_matters=True,
        tells_mean=True,
    ),
    "inertial": Method(
        title="Inertial-frame alignment: gravity's cone over the whole record, by SVD",
        source="[S1] robust answer to rocking: Wahba's problem in the inertial frame",
        note="± of noise, sway and stated priors, at the last sample",
        estimate=inertial,
        alone=True,
        takes="any",
        least_samples=LEAST_SAMPLES,
        functional=inertial_functional,
        needs_latitude=True,
        tracks=inertial_tracks,
    ),
    "fine": Method(
        title="Fine alignment: Kalman filter of attitude, velocity and biases",
        source="[S1] robust answer to rocking: zero-displacement updates",
        note="± of noise, lever arm and stated priors, at the last sample",
        estimate=fine,
        alone=True,
        takes="any",
        least_samples=LEAST_SAMPLES,
        functional=fine_functional,
        needs_latitude=True,
        tracks=fine_tracks,
        innovations=innovations,
    ),
    "calibration": Method(
        title="A unit's biases, scale factors, axes and more from a test on a table",
        source="[C] multi-position and rate tests, in one fit with the table's own errors",
        note="± of noise, drift, seat, table and gravity; attitudes are those that the table was "
        "told",
        estimate=calibration,
        takes="any",
        design=calibration_design,
        needs_latitude=True,
        carries_nominal=True,
        follows_moves=True,
    ),
    "vectors": Method(
        title="Vector matching with satellite navigation: as printed, observing form, Kalman "
        "filter",
        source="[S2] correction of the orientation matrix by invariants and vector matching",
        note="± of the fixes, the start and stated priors; without gyro scale and axes that are "
        "off",
        estimate=vector_matching,
        knows_skew=True,
        takes="fixes",
        no_prediction="it needs satellite fixes along a path, which no table's procedure has: see "
        "the sigmas of a drive",
        windows={
            "printed": Window("as printed"),
            "observing": Window("observing form"),
            "kalman": Window("Kalman filter"),
        },
    ),
}

DEFAULT_METHOD = "triad"  # of recordings that name none: it needs neither latitude nor table
