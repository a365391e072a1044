"""How fits of several positions follow their readings: the gains of [S4] double gyrocompassing.

The gain is that of the best estimate under the priors that the method is told, as
`alignment.information` has it: the fit's own first order. Another heading that would fit nearly as
well is beyond that: `alignment.information.circle`.
"""

from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.constant_errors import with_products
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.gains import Answer, Mirror
from alignment.information import ANGLES, Information, Setting, Stretch, assumed, information
from alignment.information.circle import circle_information
from alignment.information.drift import switched_on
from alignment.methods.position_fit import (
    ROUNDING,
    drift_covariance,
    local_vectors,
    predicted_mirrors,
)
from alignment.methods.positions import ANOMALY, LEAST_TURN
from alignment.options import Options

_NORTH = Rotation.identity()


def known_to(stretches: Sequence[Stretch], site: Site, options: Options) -> Information:
    """What readings tell to a method that takes the unit for what its priors say."""
    priors = switched_on(with_products(options.priors))
    unit, setting = assumed(priors)
    anomaly = ANOMALY if site.local_gravity is None else 0.0
    setting = Setting(placement=setting.placement, mounting=priors.seat, gravity=anomaly)
    rounded = [
        Stretch(
            s.label,
            s.start,
            s.duration,
            s.C_pb,
            rate=s.rate,
            axis_b=s.axis_b,
            angle=s.angle,
            disturbance=ROUNDING,
        )
        for s in stretches
    ]
    return information(rounded, _NORTH, site, unit, setting)


def two_position_gains(stretches: Sequence[Stretch], site: Site, options: Options) -> list[Answer]:
    """Each rest that is followed by one turned by 30 deg or more."""
    pairs = [(k, k + 1) for k, pair in enumerate(pairwise(stretches)) if _turn(*pair) >= LEAST_TURN]
    if not pairs:
        raise AlignmentError("too little turn: no two successive dwells are 30 deg or more apart")
    return [_fitted(stretches, pair, site, options)[0] for pair in pairs]


def multi_position_gains(
    stretches: Sequence[Stretch], site: Site, options: Options
) -> list[Answer]:
    """All rests together."""
    widest = max((_turn(a, b) for a in stretches for b in stretches), default=0.0)
    if widest < LEAST_TURN:
        raise AlignmentError("too little turn: no two dwells are 30 deg or more apart")
    return _fitted(stretches, tuple(range(len(stretches))), site, options)


def _turn(a: Stretch, b: Stretch) -> float:
    return float((a.C_pb.inv() * b.C_pb).magnitude())


def _fitted(
    stretches: Sequence[Stretch], planned: tuple[int, ...], site: Site, options: Options
) -> list[Answer]:
    site.horizontal_rate()
    used = tuple(stretches[k] for k in planned)
    known = known_to(used, site, options)
    labels = [p.label for p in known.parameters if p.source.endswith(" bias")]
    biases = {label: known.gain(label) for label in labels if known.determined(label)}
    circle = circle_information(known, site)
    mirrors = _mirrors(known, site, options)
    return [
        Answer(
            label=stretch.label,
            stretches=used,
            planned=planned,
            own=k,
            gain=_best(known, k),
            biases=biases,
            circle=circle,
            unseen=_unseen(known, k),
            mirrors=tuple(
                Mirror(chi2, turns[k], dict(zip(labels, off.tolist(), strict=True)))
                for chi2, turns, off in mirrors
            ),
        )
        for k, stretch in enumerate(used)
    ]


def _mirrors(known: Information, site: Site, options: Options) -> list[tuple[float, Array, Array]]:
    """Other attitudes that the fit may take for the planned ones (`predicted_mirrors`)."""
    priors = switched_on(with_products(options.priors))
    C = np.array([s.C_pb.as_matrix() for s in known.stretches])
    white = [N for name, N in zip(known.noise_names, known.noises, strict=True) if "noise" in name]
    variances = np.sum(white, axis=0).diagonal().reshape(-1, 6)
    latitude, gravity = local_vectors(site)
    assert latitude is not None
    assert gravity is not None
    anomaly = ANOMALY if site.local_gravity is None else 0.0
    drift = np.repeat(drift_covariance(priors, [s.span for s in known.stretches]), 3, axis=0)
    leant = site.plumb.inv().as_matrix() @ C[0]
    return predicted_mirrors(
        leant, variances, C[0].T @ C, latitude, gravity, priors, anomaly, drift
    )


def _unseen(known: Information, k: int) -> dict[str, str]:
    """Angles of a position that nothing tells, with what they cannot be told from.

    A bias that nobody states is one that nobody knows: the fit leaves such an angle where it
    began, with a sigma as wide as a bias may be.
    """
    found = {}
    for quantity in ANGLES:
        with suppress(AlignmentError):  # heading of an X1 that is vertical
            if not np.isfinite(known.sigma(quantity, k)):
                found[quantity] = known.why(quantity, k)
    return found


def _best(known: Information, k: int) -> Array:
    """Gain (3, m) of the best estimate of a position's attitude."""
    return np.asarray(known.attitude_rows(k) @ known.root @ known.weights.T)
