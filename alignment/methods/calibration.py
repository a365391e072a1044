"""A unit's constants from a test on a table, as one of the methods.

It finds no attitude: it carries the one that the table was told, less what the readings show of
the table's errors. What it is for is `AttitudeEstimate.calibration`. Source: IEEE Std 517 and 1293,
multi-position and rate tests, solved as one fit with the table's errors beside the unit's.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.calibration.bench import Bench, from_priors
from alignment.calibration.calibrate import assembled
from alignment.calibration.design import Design
from alignment.calibration.fit import Fit, fitted
from alignment.calibration.model import Model
from alignment.calibration.observe import observed
from alignment.calibration.result import SENSORS, Calibration, Key
from alignment.calibration.session import Session, Station
from alignment.earth import Site
from alignment.estimate import AttitudeEstimate
from alignment.options import Options
from alignment.readings import Dwell

CALIBRATION = "calibration"
UP = (0.0, 0.0, -1.0)  # in n


def calibration(dwells: Sequence[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Constants of a unit from rests, turns at constant rate and the moves between them.

    Parameters
    ----------
    dwells : sequence of Dwell
        With the attitudes that the table was told, and the joints' angles where its axes are
        known; rests with the readings of the moves beside them.
    site : Site
        With its latitude.
    options : Options
        `rule`; `bench`: what is known of unit, table and gravity; without it `priors`, those that
        are not stated wide.

    Returns
    -------
    list of AttitudeEstimate
        Of every rest the attitude as the table had it; the first one carries `calibration`. Of
        turning stretches there is none: their encoder's zero is told no better than the gyros'
        delay times the rate. Without rests the first stretch, without an attitude.

    Raises
    ------
    AlignmentError
        No stretch can be used, one position only, readings that contradict the table.
    NotAtRest, Saturated

    Notes
    -----
    Leading errors: the seat and the table in absolute misalignment, gravity in the accelerometers'
    scale factor, bias instability in the biases, noise in all else.
    """
    bench = bench_from(options)
    if options.bench is None:
        bench = replace(bench, means=not any(dwell.readings.instants for dwell in dwells))
    seen = observed(dwells, site, bench.warmth)
    fit = fitted([seen], bench, site)
    found = assembled(fit)
    doubts = _doubts(found)
    t_from, t_to = min(d.t_from for d in dwells), max(d.t_to for d in dwells)
    stations = fit.design.model.sessions[0].stations
    rests = [k for k, station in enumerate(stations) if not station.stretch.rate]
    if not rests:
        first = stations[0].stretch
        return [
            AttitudeEstimate(
                CALIBRATION,
                first.label,
                t_from,
                t_to,
                C_nb=None,
                sequence=options.rule.sequence_for(first.C_pb.inv().apply(UP)),
                flags=("constants alone: a turning stretch has no attitude", *doubts),
                **_constants(found),
            )
        ]
    estimates = []
    for k in rests:
        station = stations[k]
        C_nb, covariance = _attitude(fit, k)
        nominal = station.stretch.C_pb
        estimates.append(
            AttitudeEstimate(
                CALIBRATION,
                station.stretch.label,
                t_from,
                t_to,
                C_nb=C_nb,
                sequence=options.rule.sequence_for(nominal.inv().apply(UP)),
                covariance=covariance,
                flags=doubts,
                **({} if estimates else _constants(found)),
            )
        )
    return estimates


def bench_from(options: Options) -> Bench:
    """What is known beforehand: as a bench, or as priors alone."""
    return options.bench if isinstance(options.bench, Bench) else from_priors(options.priors)


def calibration_design(session: Session, site: Site, options: Options) -> Design:
    """What planned stations and moves will tell."""
    return Design(Model([session], bench_from(options), site))


def _attitude(fit: Fit, number: int) -> tuple[Rotation, Array]:
    """``C_nb`` of a station, and its covariance (3, 3) about n [rad^2]."""
    design, poses = fit.design, fit.design.model.poses[0]
    station: Station = poses.session.stations[number]
    at = poses.edges[number]
    turns = poses.leanings.turns[at]
    columns = design.model.columns_of_table(0)
    places = np.searchsorted(design.active, columns)
    C_nb = station.stretch.C_pb * Rotation.from_rotvec(turns @ fit.x[columns])
    to_n = C_nb.as_matrix() @ turns
    P = design.covariance[np.ix_(places, places)]
    covariance = to_n @ P @ to_n.T
    joints = poses.leanings.axes[at]
    if joints.shape[1]:
        own = C_nb.as_matrix() @ joints * design.model.bench.joint_noise
        covariance = covariance + own @ own.T
    return C_nb, fit.growth**2 * (covariance + covariance.T) / 2


def _constants(found: Calibration) -> dict[str, Any]:
    """What the first estimate has beside its attitude."""
    own = {p.key: p for p in found.parameters}
    biases = [own.get(Key(sensor, "bias", i)) for sensor in SENSORS for i in range(3)]
    return {
        "calibration": found,
        "biases": np.array([0.0 if p is None else p.value for p in biases]),
        "bias_sigmas": np.array([0.0 if p is None else p.sigma for p in biases]),
    }


def _doubts(found: Calibration) -> tuple[str, ...]:
    doubts = tuple(f"{one.stretch} left out: {one.reason}" for one in found.left_out)
    if found.enlarged > 1:
        doubts += (
            f"the readings contradict one another: chi-square {found.chi_square:.0f} for "
            f"{found.dof}: sigmas are {found.enlarged:.3g} times as large for it",
        )
    return doubts
