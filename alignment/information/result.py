"""Fisher information of a procedure, and what follows from it.

``F = J^T R^-1 J`` with the sensitivities J of the readings' means and harmonics to every error and
the covariance R of their noise; with priors ``P = (F + diag(1/prior^2))^-1``. Source: methods.md
sections 2 and 5; S. M. Kay, Fundamentals of Statistical Signal Processing I, eq. 3.31 and 10.28.

First order: it holds while sigmas of angles stay below some degrees (`DETERMINED`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence as Order
from alignment.angles import SequenceRule, angle_jacobian, angles_from_C_nb, near_singular
from alignment.arrays import Array, set_owned
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.information.drift import Span, gauss_markov, random_walk
from alignment.information.model import (
    InstrumentErrors,
    Parameter,
    ParameterColumns,
    Setting,
    Stretch,
    TriadErrors,
    coefficient_weights,
    parameters,
    sensitivities,
    white_variances,
)
from alignment.information.words import SOUGHT, Combination, combinations

DETERMINED = np.radians(10.0)  # sigma of an angle above it: first order says nothing
ROUNDING = np.repeat([1e-12, 1e-9], 3)  # rad/s, m/s^2: no coefficient is surer than this
ANGLES = ("heading", "roll", "pitch", "yaw")

_NULL = 1e-12  # singular value, of columns of length one, that is nothing
_SEEN = 1e-6  # part of a quantity within what nothing tells, above which it is undetermined


@dataclass(frozen=True, eq=False)  # without slots: it is solved when somebody asks
class Information:
    """What a procedure tells of attitude and errors; m coefficients, p parameters.

    Whoever needs the sensitivities and the noises alone pays for no decomposition.

    Attributes
    ----------
    stretches : tuple of Stretch
    C_np : Rotation
        Attitude of the table's frame.
    parameters : tuple of Parameter
    J : (m, p)
        Of coefficients (stretch by stretch: constant, cosine, sine; of six channels each).
    noise_names : tuple of str
    noises : (k, m, m)
        Covariance of the coefficients by each.
    used : (m,)
        False where there is no sensor.
    root, weights : (p, r), (m, r)
        The covariance ``P = root root^T``, without what nothing tells, and the best gain
        ``P J^T R^-1 = root weights^T``.
    scale, unknown : (p,), (p, u)
        Directions nothing tells, neither readings nor priors, of length one each in units of
        `scale`.
    rank, sought : int
        How many of the parameters sought the readings alone determine, and how many these are:
        attitude, biases, lag if one turns, and whatever nothing is known of beforehand.
    condition : float
        Of the readings' Fisher matrix over what it determines, columns in units of their priors
        (or of 1 deg, 10 deg/h, 1 mg, ... where there are none).
    unseen : tuple of Combination
        What the readings alone cannot tell apart, in words.
    """

    stretches: tuple[Stretch, ...]
    C_np: Rotation
    parameters: tuple[Parameter, ...]
    J: Array
    noise_names: tuple[str, ...]
    noises: Array
    used: NDArray[np.bool_]

    def __post_init__(self) -> None:
        m, p = self.J.shape
        set_owned(
            self,
            J=(self.J, (m, p), float),
            noises=(self.noises, (len(self.noise_names), m, m), float),
            used=(self.used, (m,), bool),
        )

    @cached_property
    def _white(self) -> tuple[Array, Array]:
        """What makes the readings white (u, m), and their sensitivities (u, p) then."""
        whitening = _whitening(self.noises, self.used)
        return whitening, whitening @ self.J

    @cached_property
    def _solved(self) -> tuple[Array, Array, Array, Array]:
        whitening, W = self._white
        root, by_white, scale, unknown = _solved(W, self.prior)
        solved = root, whitening.T @ by_white, scale, unknown
        for part in solved:
            part.flags.writeable = False
        return solved

    @cached_property
    def _observed(self) -> tuple[int, int, float, tuple[Combination, ...]]:
        sought = _sought(self.parameters, any(s.rate for s in self.stretches))
        rank, condition, vectors = _observed(self._white[1], self.parameters, sought)
        unseen = combinations(vectors, self.parameters, self.stretches, self.C_np)
        return rank, len(sought), condition, unseen

    @property
    def root(self) -> Array:
        return self._solved[0]

    @property
    def weights(self) -> Array:
        return self._solved[1]

    @property
    def scale(self) -> Array:
        return self._solved[2]

    @property
    def unknown(self) -> Array:
        return self._solved[3]

    @property
    def rank(self) -> int:
        return self._observed[0]

    @property
    def sought(self) -> int:
        return self._observed[1]

    @property
    def condition(self) -> float:
        return self._observed[2]

    @property
    def unseen(self) -> tuple[Combination, ...]:
        return self._observed[3]

    @property
    def prior(self) -> Array:
        """Standard deviations beforehand (p,); infinite ones are there."""
        return np.array([parameter.prior for parameter in self.parameters])

    def row(self, quantity: str, stretch: int = 0) -> Array:
        """Sensitivity (p,) of a quantity to the parameters.

        `quantity`: 'heading' (of X1 on the horizon), 'roll', 'pitch' or 'yaw' of b in that stretch
        (of a turning one at encoder angle zero), by the sequence that is regular there; or the
        label of a parameter, such as 'gyro bias X1'.

        Raises
        ------
        AlignmentError
            No such quantity; heading of an X1 that is vertical.
        """
        if quantity in ANGLES:
            return self._angle_row(quantity, stretch)
        labels = [p.label for p in self.parameters]
        if quantity not in labels:
            allowed = ", ".join((*ANGLES, *labels[3:10]))
            raise AlignmentError(f"quantity {quantity!r}: must be one of {allowed}, ...")
        return np.eye(len(labels))[labels.index(quantity)]

    def attitude_rows(self, stretch: int = 0) -> Array:
        """Sensitivity (3, p) of the small rotation about n that took b to where it is."""
        C_nb = (self.C_np * self.stretches[stretch].C_pb).as_matrix()
        columns = ParameterColumns.of(self.parameters)
        rows = np.zeros((3, len(self.parameters)))
        rows[:, :3] = np.eye(3)
        rows[:, columns.mounting] = C_nb
        rows[:, columns.placement[stretch]] = C_nb
        return rows

    def _angle_row(self, quantity: str, stretch: int) -> Array:
        C_nb = self.C_np * self.stretches[stretch].C_pb
        order = SequenceRule.REGULAR.sequence_at(C_nb)
        if quantity == "heading":
            order = Order.YAW_PITCH_ROLL
        angles = angles_from_C_nb(order, C_nb)
        if near_singular(order, angles):
            label = self.stretches[stretch].label
            raise AlignmentError(f"{label}: X1 is vertical, it has no heading")
        roll, yaw, pitch = angle_jacobian(order, *angles)
        of_eta = {"heading": -yaw, "roll": roll, "pitch": pitch, "yaw": yaw}[quantity]
        return np.asarray(of_eta @ self.attitude_rows(stretch))

    def covariance(self, rows: ArrayLike) -> Array:
        """Covariance (k, k) of quantities by their rows (k, p).

        Raises
        ------
        AlignmentError
            Nothing tells one of them.
        """
        rows = np.asarray(rows, dtype=float)
        if not all(self._determined(row) for row in rows):
            raise AlignmentError(f"not determined: {'; '.join(c.text for c in self.unseen)}")
        half = rows @ self.root
        return np.asarray(half @ half.T)

    def sigma(self, quantity: str, stretch: int = 0) -> float:
        """Predicted standard deviation (SI) of a quantity; infinite where nothing tells it."""
        row = self.row(quantity, stretch)
        return float(np.linalg.norm(row @ self.root)) if self._determined(row) else np.inf

    def determined(self, quantity: str, stretch: int = 0) -> bool:
        """Whether `sigma` can be stood behind: finite, and of an angle below 10 deg."""
        sigma = self.sigma(quantity, stretch)
        return sigma < (DETERMINED if quantity in ANGLES else np.inf)

    def gain(self, quantity: str, stretch: int = 0) -> Array:
        """Gain (m,) of the best linear estimator: error of the coefficients to error of quantity.

        It is that of this model's own unit and setting.

        Raises
        ------
        AlignmentError
            Nothing tells the quantity.
        """
        row = self.row(quantity, stretch)
        if not self._determined(row):
            why = self.why(quantity, stretch) or "no reading depends on it"
            raise AlignmentError(f"{quantity} is not determined: {why}")
        return np.asarray(self.weights @ (self.root.T @ row))

    def contributions(
        self, quantity: str, stretch: int = 0, gain: ArrayLike | None = None
    ) -> dict[str, float]:
        """Standard deviation (SI) that each source brings into a quantity, by its name.

        They add up in quadrature to the sigma of the estimator with that gain.

        Parameters
        ----------
        quantity, stretch
            As `row`.
        gain : (m,) or None
            Of the estimator: ``estimate = nominal + gain @ (coefficients - nominal ones)``. None:
            the best one, and the total is `sigma`.

        Notes
        -----
        ``error = (gain J - row) errors + gain noise``. A source that nothing is known of
        contributes nothing where the gain is blind to it, and infinity where it is not.
        """
        row, prior = self.row(quantity, stretch), self.prior
        stated = np.where(np.isfinite(prior), prior, 0.0)
        if gain is None:
            gain = self.gain(quantity, stretch)
            P_row = self.root @ (self.root.T @ row)
            each = np.divide(np.abs(P_row), stated, out=np.zeros_like(stated), where=stated > 0)
        else:
            gain = np.asarray(gain, dtype=float)
            if np.any(gain[~self.used] != 0):
                raise AlignmentError("gain: uses a sensor that is not there")
            each = np.abs(gain @ self.J - row) * stated
            total = np.sqrt(np.sum(each**2) + gain @ np.sum(self.noises, axis=0) @ gain)
            each[self._felt_unknown(row, gain, float(total))] = np.inf
        found = {
            name: float(np.sqrt(max(gain @ N @ gain, 0.0)))
            for name, N in zip(self.noise_names, self.noises, strict=True)
        }
        for parameter, value in zip(self.parameters, each.tolist(), strict=True):
            found[parameter.source] = float(np.hypot(found.get(parameter.source, 0.0), value))
        return found

    def _felt_unknown(self, row: Array, gain: Array, total: float) -> NDArray[np.bool_]:
        """Which parameters (p,) that nothing is known of a gain feels, beyond its rounding.

        At an error's usual size more than a millionth of the `total` of all else.
        """
        sizes = np.array([p.size for p in self.parameters])
        left = np.abs(gain @ self.J - row) * sizes
        return np.isinf(self.prior) & (left > _SEEN * total)

    def why(self, quantity: str, stretch: int = 0) -> str:
        """What the readings cannot tell a quantity from; '' where they tell it."""
        row = self.row(quantity, stretch)
        return "; ".join(
            c.text
            for c in self.unseen
            if abs(row @ c.vector) > _SEEN * float(np.abs(row) @ np.abs(c.vector))
        )

    def _determined(self, row: Array) -> bool:
        scaled = row * self.scale
        return bool(np.all(np.abs(scaled @ self.unknown) <= _SEEN * np.linalg.norm(scaled)))


def information(
    stretches: Sequence[Stretch],
    C_np: Rotation,
    site: Site,
    unit: InstrumentErrors,
    setting: Setting | None = None,
) -> Information:
    """Fisher information of the stretches of a procedure.

    Parameters
    ----------
    stretches : sequence of Stretch
        In order of time.
    C_np : Rotation
        Attitude of the table's frame, where it is looked at.
    site : Site
        Latitude known, at least as a case to look at (`Setting.latitude` says how well).
    unit : Unit
    setting : Setting
        By default the table's attitude is sought and the rest of it perfect.

    Raises
    ------
    ValueError
        No stretches, or stretches that overlap.
    AlignmentError
        No latitude.

    Notes
    -----
    Leading errors of the model: first order in all errors; drift within a turn enters by its
    covariance with whole-turn harmonics; the lever arm is none (the instrument at the axes'
    crossing); rounding of the samples is left out.
    """
    stretches = tuple(stretches)
    if not stretches:
        raise ValueError("stretches: at least one is needed")
    for a, b in pairwise(stretches):
        if b.start < a.start + a.span.length - 1e-6:
            raise ValueError(f"{b.label}: begins before {a.label} has ended")
    setting = setting or Setting()
    found = tuple(parameters(stretches, unit, setting))
    columns = ParameterColumns.of(found)
    J = np.concatenate(
        [
            sensitivities(stretch, k, C_np, site, columns).reshape(-1, len(found))
            for k, stretch in enumerate(stretches)
        ]
    )
    names, noises, used = _noises(stretches, unit)
    return Information(stretches, C_np, found, J, noise_names=names, noises=noises, used=used)


def _noises(
    stretches: Sequence[Stretch], unit: InstrumentErrors
) -> tuple[tuple[str, ...], Array, NDArray[np.bool_]]:
    """Names, covariances (k, m, m) of coefficients and which of them there are (m,)."""
    spans = [stretch.span for stretch in stretches]
    white = np.concatenate([white_variances(s, unit) for s in stretches])
    used = np.isfinite(white).ravel()
    white = np.where(np.isfinite(white), white, 0.0) + ROUNDING**2
    moved = np.concatenate([coefficient_weights(s)[:, None] * s.disturbance**2 for s in stretches])
    parts: dict[str, Array] = {}
    for k, name, triad in ((0, "gyro", unit.gyro), (1, "accelerometer", unit.accel)):
        mine = np.repeat([1.0 - k, float(k)], 3)
        parts[f"{name} noise"] = np.diag((white * mine).ravel())
        instability, walk = _drift(spans, triad)
        parts[f"{name} bias-instability"] = np.kron(instability, np.diag(mine))
        parts[f"{name} random-walk"] = np.kron(walk, np.diag(mine))
    parts["motion"] = np.diag(moved.ravel())
    return tuple(parts), np.array(list(parts.values())), used


def _drift(spans: Sequence[Span], triad: TriadErrors) -> tuple[Array, Array]:
    h = sum(len(span.orders) for span in spans)
    instability: Array = np.zeros((h, h))
    for process in triad.drift:
        instability = instability + process.sigma**2 * gauss_markov(spans, process.time)
    walk = triad.random_walk**2 * random_walk(spans) if triad.random_walk else np.zeros((h, h))
    return instability, walk


def _whitening(noises: Array, used: NDArray[np.bool_]) -> Array:
    """``L^-1`` (u, m) with ``L L^T`` the noises' sum, of the u sensors there are."""
    R = np.sum(noises, axis=0)[np.ix_(used, used)]
    scale = np.sqrt(np.diag(R))
    L = np.linalg.cholesky(R / np.outer(scale, scale))
    result = np.zeros((len(R), len(used)))
    result[:, used] = solve_triangular(L, np.diag(1 / scale), lower=True)
    return result


def _solved(W: Array, prior: Array) -> tuple[Array, Array, Array, Array]:
    """What follows from whitened sensitivities (u, p) and priors (p,).

    Root of the covariance (p, r); the white readings' part in its columns (u, r), which makes the
    gain ``root part^T`` without a normal matrix's loss of digits; scale (p,) and directions (p, k)
    in it that neither readings nor priors tell.
    """
    p = len(prior)
    active = np.flatnonzero(prior > 0)
    known = np.flatnonzero(np.isfinite(prior[active]))
    rows = np.zeros((len(known), len(active)))
    rows[np.arange(len(known)), known] = 1 / prior[active[known]]
    A = np.concatenate([W[:, active], rows])
    length = np.linalg.norm(A, axis=0)
    # a column that is rounding beside its like (heading at a pole) is no column
    attitude = active < 3
    length[attitude] = length[attitude].max(initial=0.0)
    length = np.where(length > 0, length, 1.0)
    U, s, Vt = _decomposed(A / length)
    kept = s > _NULL * s.max(initial=0.0)
    root: Array = np.zeros((p, int(kept.sum())))
    root[active] = Vt[kept].T / s[kept] / length[:, None]
    unknown: Array = np.zeros((p, int((~kept).sum())))
    unknown[active] = Vt[~kept].T
    scale: Array = np.zeros(p)
    scale[active] = 1 / length
    return root, U[: len(W), kept], scale, unknown


def _sought(found: Sequence[Parameter], turning: bool) -> list[int]:
    """Which parameters the readings are asked for."""

    def is_sought(p: Parameter) -> bool:
        if p.source == "lag":
            return turning and p.prior > 0
        return p.prior > 0 and (p.source in SOUGHT or np.isinf(p.prior))

    return [i for i, p in enumerate(found) if is_sought(p)]


def _observed(W: Array, found: Sequence[Parameter], sought: list[int]) -> tuple[int, float, Array]:
    """Rank, condition number, and directions (p, u) among those sought that readings do not see."""
    sizes = np.array([found[i].size for i in sought])
    A = W[:, sought] * sizes
    # a column that is rounding beside its like is no column
    like = np.array([found[i].source for i in sought])
    norms = np.linalg.norm(A, axis=0)
    length = np.array([norms[like == source].max() for source in like])
    length = np.where(length > 0, length, 1.0)
    _, s, Vt = _decomposed(A / length)
    rank = int(np.sum(s > _NULL * s.max(initial=0.0)))
    weights = _decomposed(A)[1][:rank]
    vectors = np.zeros((len(found), len(sought) - rank))
    vectors[sought] = Vt[rank:].T * (sizes / length)[:, None]
    return rank, float((weights[0] / weights[-1]) ** 2) if rank else np.inf, vectors


def _decomposed(A: Array) -> tuple[Array, Array, Array]:
    """Singular vectors (n, k), all k values and right vectors (k, k) of A (n, k), zeros last."""
    n, k = A.shape
    padded = np.concatenate([A, np.zeros((max(k - n, 0), k))])
    U, s, Vt = np.linalg.svd(padded, full_matrices=False)
    return U[:n], s, Vt
