"""Parameters as the matrices of one triad, and what a unit of these constants reports."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.calibration.result import Key, Sensor

_SQUARE = ("scale_and_axes", "g_sensitivity", "g2_sensitivity", "places")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TriadConstants:
    """The constants of one triad in SI.

    Attributes
    ----------
    scale_and_axes : (3, 3)
        (I + S)(I + M): true to reported at small input.
    bias, asymmetry, k2, k3, lag, temperature_bias, temperature_scale : (3,)
    g_sensitivity, g2_sensitivity : (3, 3)
        Row i: of gyro i to each component of force, and of its square.
    places : (3, 3) m
        Row i: where accelerometer i sits, in b.
    """

    scale_and_axes: Array
    bias: Array
    asymmetry: Array
    k2: Array
    k3: Array
    lag: Array
    temperature_bias: Array
    temperature_scale: Array
    g_sensitivity: Array
    g2_sensitivity: Array
    places: Array

    def __post_init__(self) -> None:
        shapes = {name: (3, 3) if name in _SQUARE else (3,) for name in self.__slots__}
        set_owned(self, **{n: (getattr(self, n), shape, float) for n, shape in shapes.items()})

    @property
    def linear(self) -> bool:
        """Whether it reports a linear function of what it feels."""
        return not (self.asymmetry.any() or self.k2.any() or self.k3.any())


def constants_of(keys: Iterable[Key], values: Iterable[float], sensor: Sensor) -> TriadConstants:
    """The constants of one triad from parameters (n,); what none of them says is zero."""
    by_term = {name: np.zeros(3) for name in _VECTORS}
    by_term |= {name: np.zeros((3, 3)) for name in _MATRICES}
    for key, value in zip(keys, values, strict=True):
        if key.sensor == sensor:
            at = key.axis if key.toward is None else (key.axis, key.toward)
            by_term[key.term][at] = value
    scale, M = by_term.pop("scale"), by_term.pop("misalignment")
    places = by_term.pop("lever_arm")
    axes = (1 + scale)[:, None] * (np.eye(3) + M)
    return TriadConstants(scale_and_axes=axes, places=places, **by_term)


_VECTORS = (
    *("bias", "scale", "asymmetry", "k2", "k3", "lag", "temperature_bias", "temperature_scale"),
)
_MATRICES = ("misalignment", "g_sensitivity", "g2_sensitivity", "lever_arm")


def reported(constants: TriadConstants, x: Array, f: Array, warmth: Array | float = 0.0) -> Array:
    """What a triad reports (n, 3) of true input `x` and force `f` (n, 3), no lag, no noise.

    `x` of accelerometers is the force at each one's own place; `warmth` (n,) or one number [K]
    above the reference temperature.
    """
    c, dT = constants, np.reshape(warmth, (-1, 1))
    L = x @ c.scale_and_axes.T
    y = L * (1 + c.k2 * L + c.k3 * L**2 + c.temperature_scale * dT) + c.asymmetry * np.abs(L)
    y = y + f @ c.g_sensitivity.T + f**2 @ c.g2_sensitivity.T
    return np.asarray(y + c.bias + c.temperature_bias * dT)


def slope(constants: TriadConstants, x: Array) -> Array:
    """Derivative (n, 3, 3) of what a triad reports by what it feels, at `x` (n, 3)."""
    return np.asarray(_gain(constants, x @ constants.scale_and_axes.T)[..., None]
                      * constants.scale_and_axes)  # fmt: skip


def _gain(c: TriadConstants, L: Array) -> Array:
    """Derivative (n, 3) of each sensor's report by its linear part."""
    return np.asarray(1 + 2 * c.k2 * L + 3 * c.k3 * L**2 + c.asymmetry * np.sign(L))


def columns(
    keys: Sequence[Key], constants: TriadConstants, x: Array, f: Array, warmth: float = 0.0
) -> Array:
    """Derivatives (n, 3, p) of what a triad reports by its parameters `keys` (p,).

    `x` is what it feels and `f` the force on it (n, 3). Lags and lever arms act on what changes:
    their columns are zero here.
    """
    c = constants
    L = x @ c.scale_and_axes.T
    gain, scale = _gain(c, L), c.scale_and_axes.diagonal()
    found = np.zeros((*x.shape, len(keys)))
    for n, key in enumerate(keys):
        i, j = key.axis, key.toward
        found[:, i, n] = _column(key, L[:, i], gain[:, i] * scale[i], x, f, j, warmth)
        if key.term == "scale":
            found[:, i, n] = gain[:, i] * L[:, i] / scale[i]
    return found


def _column(
    key: Key, L: Array, gain: Array, x: Array, f: Array, toward: int | None, warmth: float
) -> Array:
    """Derivative (n,) of one sensor's report by one of its parameters but scale."""
    nothing = np.zeros(len(x))
    j = 0 if toward is None else toward
    by_term = {
        "bias": lambda: np.ones(len(x)),
        "misalignment": lambda: gain * x[:, j],
        "asymmetry": lambda: np.abs(L),
        "k2": lambda: L**2,
        "k3": lambda: L**3,
        "g_sensitivity": lambda: f[:, j],
        "g2_sensitivity": lambda: f[:, j] ** 2,
        "temperature_bias": lambda: nothing + warmth,
        "temperature_scale": lambda: warmth * L,
    }
    return by_term.get(key.term, lambda: nothing)()
