"""Vector matching as one method of the list: what each solution says at the last fix."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate
from alignment.methods.vectors.fixes import Matching, VectorOptions
from alignment.methods.vectors.solutions import SOLUTIONS
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings

METHOD = "vectors"
WITHOUT_START = ("observing",)  # what needs no programmed attitude
NO_START = "refused: it starts from a programmed attitude, and none was given"
NO_PRIORS = "no sensor biases were stated: they are taken as zero, and so is their part of ±"


def vector_matching(
    dwells: Sequence[Dwell], site: Site, options: Options
) -> list[AttitudeEstimate]:
    """Attitude of a moving vehicle at its last fix, by each of the three solutions.

    Parameters
    ----------
    dwells : sequence of Dwell
        With fixes. ``nominal`` is the programmed attitude at the first of them, wrong by
        ``nominal_sigma`` about each axis; where it is None, only the observing form answers.
    site : Site
        Not used: the place comes with the fixes.
    options : Options

    Returns
    -------
    list of AttitudeEstimate
        Per dwell one for each solution, named by ``window``; without an attitude where that
        solution refused, its reason as the flag.

    Raises
    ------
    AlignmentError, TooShort, PoleError
        No solution answers; of several reasons the observing form's.

    Notes
    -----
    Leading errors: accelerometer bias over gravity in tilt, over the horizontal acceleration in
    heading; as printed it matches velocities that did not pass through the matrix. Source:
    methods.md section 4.
    """
    return [estimate for dwell in dwells for estimate in _answers(dwell, options)]


def options_of(
    priors: Priors, start_sigma: float | None = None, options: Options | None = None
) -> VectorOptions:
    """The choices of the solutions from those of all methods."""
    usual = VectorOptions()
    sigma = usual.attitude_sigma if start_sigma is None else start_sigma
    rule = usual.rule if options is None else options.rule
    return VectorOptions(priors, sigma, rule=rule)


def _answers(dwell: Dwell, options: Options) -> list[AttitudeEstimate]:
    h = dwell.readings.interval
    readings = dwell.readings.between(dwell.t_from - h, dwell.t_to + h)
    found: dict[str, AttitudeEstimate | AlignmentError] = {}
    for name in SOLUTIONS:
        try:
            found[name] = _answer(name, dwell, readings, options)
        except AlignmentError as error:
            found[name] = error
    if not any(isinstance(e, AttitudeEstimate) and e.C_nb is not None for e in found.values()):
        raise _reason(found["observing"])
    return [
        _refused(name, dwell, str(e)) if isinstance(e, AlignmentError) else e
        for name, e in found.items()
    ]


def _answer(name: str, dwell: Dwell, readings: ImuReadings, options: Options) -> AttitudeEstimate:
    assert dwell.fixes is not None
    if dwell.nominal is None and name not in WITHOUT_START:
        raise AlignmentError(NO_START)
    start = Rotation.identity() if dwell.nominal is None else dwell.nominal
    choices = options_of(options.priors, dwell.nominal_sigma, options)
    matching = SOLUTIONS[name](readings, dwell.fixes, start, choices)
    return answer(name, dwell.label, matching, options.priors)


def answer(name: str, label: str, matching: Matching, priors: Priors) -> AttitudeEstimate:
    """What a solution says at its last fix; without an attitude if it never corrected one."""
    given = np.flatnonzero(matching.corrected)
    last = len(matching.t) - 1
    told = [matching.doubts[k] for k in (*given[-1:], last)]
    if len(given) and not (priors.gyro_bias or priors.accel_bias):
        told.append(NO_PRIORS)
    C_nb, P = matching.C_nb[last], matching.covariance[last]
    return AttitudeEstimate(
        METHOD,
        label,
        float(matching.t[0]),
        float(matching.t[last]),
        C_nb=C_nb if len(given) else None,
        sequence=matching.rule.sequence_at(C_nb),
        window=name,
        covariance=(P + P.T) / 2 if len(given) else None,  # their rounding differs
        flags=tuple(dict.fromkeys(text for text in told if text)),
    )


def _refused(name: str, dwell: Dwell, reason: str) -> AttitudeEstimate:
    usual = VectorOptions().rule.sequence_for(np.array([0.0, 1.0, 0.0]))
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        dwell.t_to,
        C_nb=None,
        sequence=usual,
        window=name,
        flags=(reason,),
    )


def _reason(found: AttitudeEstimate | AlignmentError) -> AlignmentError:
    return found if isinstance(found, AlignmentError) else AlignmentError("; ".join(found.flags))
