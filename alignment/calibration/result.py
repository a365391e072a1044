"""What a calibration comes to: a unit's constant errors, how sure they are, and who says so.

The parameters say what the unit does to the truth, in the order of the sensor model: with L =
(I + S)(I + M) x, x the true rate, or the force at each accelerometer's own place ::

    y = L + asymmetry |L| + K2 L^2 + K3 L^3 + scale_T dT L + [gyros: G f + G2 f^2] + b + b_T dT

and what comes out late by the lag. S is diagonal, M has six off-diagonal terms: m_ij (`axis` i,
`toward` j) is the part of axis j that sensor i feels. Source: methods of IEEE 517 and 1293; the
antisymmetric part of M is the triad's rotation, the symmetric one its non-orthogonality.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from alignment.arrays import Array, set_owned

Sensor = Literal["gyro", "accel"]
Term = Literal[
    "bias",
    "scale",
    "misalignment",
    "asymmetry",
    "k2",
    "k3",
    "g_sensitivity",
    "g2_sensitivity",
    "lever_arm",
    "lag",
    "temperature_bias",
    "temperature_scale",
]
Basis = Literal["data", "prior", "both"]
"""Who says a value: the readings, what was known before, or both."""
Quantity = Literal["rotation", "non_orthogonality", "gyro_to_accel"]
SENSORS: tuple[Sensor, ...] = get_args(Sensor)
TERMS: tuple[Term, ...] = get_args(Term)
BASES: tuple[Basis, ...] = get_args(Basis)
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
TOWARD = frozenset({"misalignment", "g_sensitivity", "g2_sensitivity", "lever_arm"})
"""Terms of two axes: a sensor's, and the component that it feels or lies along."""
ONE_SENSOR: Mapping[str, Sensor] = {
    "g_sensitivity": "gyro",
    "g2_sensitivity": "gyro",
    "lever_arm": "accel",
}
"""Terms that only one kind of sensor has."""
PAIRS = ((1, 2), (2, 0), (0, 1))
"""Of axes that lean together, or turn into one another about the third."""
BY_DATA, BY_PRIOR = 0.1, 0.9  # share of the prior below, above which one of both says it alone


@dataclass(frozen=True, slots=True)
class Key:
    """Which parameter: `axis` 0 to 2 of the sensor; `toward` of terms of two axes, else None."""

    sensor: Sensor
    term: Term
    axis: int
    toward: int | None = None

    def __post_init__(self) -> None:
        if (self.toward is None) is (self.term in TOWARD):
            raise ValueError(f"toward = {self.toward}: must be 0 to 2 of {', '.join(TOWARD)} alone")
        if self.axis not in range(3) or self.toward not in (None, 0, 1, 2):
            raise ValueError(f"axis = {self.axis}, toward = {self.toward}: must be 0, 1 or 2")
        if self.sensor != ONE_SENSOR.get(self.term, self.sensor):
            raise ValueError(f"{self.term}: of the {ONE_SENSOR[self.term]} alone")
        if self.term == "misalignment" and self.axis == self.toward:
            raise ValueError(f"toward = {self.toward}: must be another axis than its own")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One constant error of one sensor in SI: rad/s, m/s^2, 1, rad, s, m and their quotients.

    Attributes
    ----------
    key : Key
    value, sigma : float
    prior_sigma : float
        What was known before; infinite where nothing was.
    basis : str
        'data', 'prior' or 'both'.
    share : float
        Of the posterior variance that the prior holds, 0 to 1: (sigma / prior_sigma)^2.
    """

    key: Key
    value: float
    sigma: float
    prior_sigma: float
    basis: Basis
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Nuisance:
    """What had to be estimated beside the unit: of the table, the seat, gravity; in SI `unit`."""

    name: str
    value: float
    sigma: float
    prior_sigma: float
    basis: Basis
    share: float
    unit: str = "rad"


@dataclass(frozen=True, slots=True, kw_only=True)
class Derived:
    """An angle [rad] that parameters come to.

    `quantity`: 'rotation' of a triad from b about `axis`; 'non_orthogonality', by how much the two
    other axes than `axis` lean together; 'gyro_to_accel', the rotation of the gyros' triad against
    the accelerometers' (`sensor` 'gyro').
    """

    quantity: Quantity
    sensor: Sensor
    axis: int
    value: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gravity:
    """Gravity [m/s^2] as it was given, and its standard deviation."""

    value: float
    sigma: float = 0.0


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A stretch that was not used, and why."""

    stretch: str
    reason: str


@dataclass(frozen=True, slots=True)
class Residual:
    """What a fit leaves of one stretch's observations, each in its own sigmas.

    `of`: what was observed ('force at rest', 'rate at rest', 'vertical after a move', ...).
    """

    stretch: str
    of: str
    sigmas: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """What one source, by name, gives to the sigma of each parameter (n,), SI.

    The squares of all sources add up to the variances.
    """

    name: str
    sigmas: Array

    def __post_init__(self) -> None:
        set_owned(self, sigmas=(self.sigmas, (None,), float))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """A unit's parameters with all that is known of how sure they are.

    Attributes
    ----------
    parameters : tuple of Parameter
    covariance : (n, n)
        Of the parameters in their order, SI, gravity's and the nuisances' part in it.
    nuisance : tuple of Nuisance
    chi_square, dof : float, int
        Of the residuals; where it contradicts the sigmas they are enlarged by `enlarged`.
    gravity : Gravity
    enlarged : float
        By which every sigma was multiplied for a chi-square that is too great; 1 for none.
    null_space : tuple of str
        What the readings cannot tell, in words.
    notes : tuple of str
        What a reader must know before the numbers: ranks, conditions, doubts.
    left_out : tuple of LeftOut
    derived : tuple of Derived
    budget : tuple of Contribution
        Where the sigmas of the parameters come from; empty where nobody worked it out.
    residuals : tuple of Residual
        Of every stretch in its order; empty where nobody kept them.
    reference_temperature : float
        Of terms of temperature [deg C].
    """

    parameters: tuple[Parameter, ...]
    covariance: Array
    chi_square: float
    dof: int
    gravity: Gravity
    nuisance: tuple[Nuisance, ...] = ()
    enlarged: float = 1.0
    null_space: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    derived: tuple[Derived, ...] = ()
    budget: tuple[Contribution, ...] = ()
    residuals: tuple[Residual, ...] = ()
    reference_temperature: float = 25.0

    def __post_init__(self) -> None:
        n = len(self.parameters)
        set_owned(self, covariance=(self.covariance, (n, n), float))
        if len({p.key for p in self.parameters}) < n:
            raise ValueError("parameters: one of them is there twice")
        if any(len(one.sigmas) != n for one in self.budget):
            raise ValueError(f"budget: must have {n} sigmas of each source")

    @property
    def keys(self) -> tuple[Key, ...]:
        """Of the parameters, in their order."""
        return tuple(p.key for p in self.parameters)

    @property
    def values(self) -> Array:
        """Of the parameters (n,), SI."""
        return np.array([p.value for p in self.parameters])

    @property
    def sigmas(self) -> Array:
        """Of the parameters (n,), SI."""
        return np.array([p.sigma for p in self.parameters])


def share_of_prior(sigma: float, prior_sigma: float) -> float:
    """Share of a posterior variance that its prior holds, 0 to 1."""
    if prior_sigma == 0.0:
        return 1.0
    return min(1.0, (sigma / prior_sigma) ** 2)


def basis_of(share: float) -> Basis:
    """Who says a value, by the prior's share."""
    if share < BY_DATA:
        return "data"
    return "prior" if share > BY_PRIOR else "both"


def nuisance_of(name: str, value: float, sigma: float, prior: float, unit: str) -> Nuisance:
    """With who says it, by the prior's share."""
    share = share_of_prior(sigma, prior)
    return Nuisance(
        name=name,
        value=value,
        sigma=sigma,
        prior_sigma=prior,
        basis=basis_of(share),
        share=share,
        unit=unit,
    )


def parameters_of(
    keys: Sequence[Key], values: Array, covariance: Array, prior_sigmas: Array
) -> tuple[Parameter, ...]:
    """Parameters from values (n,), covariance (n, n) and priors (n,), all SI."""
    sigmas = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    found = []
    for key, value, sigma, prior in zip(keys, values, sigmas, prior_sigmas, strict=True):
        share = share_of_prior(float(sigma), float(prior))
        found.append(
            Parameter(
                key=key,
                value=float(value),
                sigma=float(sigma),
                prior_sigma=float(prior),
                basis=basis_of(share),
                share=share,
            )
        )
    return tuple(found)


def derived_of(keys: Sequence[Key], values: Array, covariance: Array) -> tuple[Derived, ...]:
    """What the misalignments of (n,) parameters come to; of triads that have all six of them."""
    names, A = _angles(keys)
    told, spread = A @ values, A @ covariance @ A.T
    sigmas = np.sqrt(np.maximum(spread.diagonal(), 0.0))
    return tuple(
        Derived(quantity=q, sensor=s, axis=k, value=float(v), sigma=float(sigma))
        for (q, s, k), v, sigma in zip(names, told, sigmas, strict=True)
    )


# quantity, sign of the second of a pair, size: both of m_ij and m_ji
_OF_PAIRS: tuple[tuple[Quantity, float, float], ...] = (
    ("rotation", -1.0, 0.5),
    ("non_orthogonality", 1.0, 1.0),
)


def _angles(keys: Sequence[Key]) -> tuple[list[tuple[Quantity, Sensor, int]], Array]:
    """Names of the derived angles and the rows (m, n) that take parameters to them."""
    at = {key: n for n, key in enumerate(keys)}
    names: list[tuple[Quantity, Sensor, int]] = []
    rows: list[Array] = []
    for sensor in SENSORS:
        pairs = [(Key(sensor, "misalignment", i, j), Key(sensor, "misalignment", j, i))
                 for i, j in PAIRS]  # fmt: skip
        if not all(key in at for pair in pairs for key in pair):
            continue
        for quantity, sign, size in _OF_PAIRS:
            for axis, (one, other) in enumerate(pairs):
                row = np.zeros(len(keys))
                row[at[one]], row[at[other]] = size, sign * size
                names.append((quantity, sensor, axis))
                rows.append(row)
    by_name = dict(zip(names, rows, strict=True))
    for axis in range(3):
        both = [by_name.get(("rotation", sensor, axis)) for sensor in SENSORS]
        if both[0] is not None and both[1] is not None:
            names.append(("gyro_to_accel", "gyro", axis))
            rows.append(both[0] - both[1])
    return names, np.array(rows).reshape(len(rows), len(keys))
