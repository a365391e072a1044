"""Constant errors of a triad: how each shows in the readings, and what they do in one attitude.

Reported, to first order in every error: ``(1 + s)(1 + M + N) x + a |x| + q x^2 + c x^3 + G f +
G2 f^2 + b``, x the true rate or specific force, f the specific force. M, N and G are matrices: in
one attitude what they add looks like a bias, in the next it is another one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.earth import EARTH_RATE
from alignment.options import Priors
from alignment.skew import Axes, back_from, spread

_Power = Callable[[Array], Array]

# what is told of each sensor beside its bias: fields of `Priors` and of `information.Triad`
ERRORS_OF = {
    "gyro": (
        "scale",
        "asymmetry",
        "cubic",
        "misalignment",
        "non_orthogonality",
        "g_sensitivity",
        "g2_sensitivity",
    ),
    "accel": (
        "scale",
        "asymmetry",
        "quadratic",
        "cubic",
        "misalignment",
        "non_orthogonality",
    ),
}


# --- how each error shows ------------------------------------------------------------------------


def _diagonal(x: Array) -> Array:
    return x[..., None] * np.eye(3)


def _leaning(x: Array) -> Array:
    """By angles Y-Z, Z-X, X-Y: half of each to both axes of the pair."""
    X, Y, Z = np.moveaxis(x, -1, 0)
    zero = np.zeros_like(X)
    rows = [[zero, Z, Y], [Z, zero, X], [Y, X, zero]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1)) / 2


def _by_force(f: Array) -> Array:
    """(..., 3, 9): each sensor's three coefficients by the components of `f`."""
    return np.asarray(np.eye(3)[:, :, None] * f[..., None, None, :]).reshape(*f.shape[:-1], 3, 9)


# field of a triad: columns (..., 3, k) of readings by the true value x and the force f
BY_AXIS: dict[str, Callable[[Array, Array], Array]] = {
    "bias": lambda x, f: _diagonal(np.ones_like(x)),
    "ramp": lambda x, f: _diagonal(np.zeros_like(x)),  # by time, not by what is felt
    "scale": lambda x, f: _diagonal(x),
    "asymmetry": lambda x, f: _diagonal(np.abs(x)),
    "quadratic": lambda x, f: _diagonal(x**2),
    "cubic": lambda x, f: _diagonal(x**3),
    "misalignment": lambda x, f: cross_matrix(x),
    "non_orthogonality": lambda x, f: _leaning(x),
    "g_sensitivity": lambda x, f: _by_force(f),
    "g2_sensitivity": lambda x, f: _by_force(f**2),
}


# what columns are linear in, where that is no true value itself: a function and its slope
_OF: dict[str, tuple[_Power, _Power]] = {
    "asymmetry": (np.abs, np.sign),
    "quadratic": (np.square, lambda x: 2 * x),
    "cubic": (lambda x: x**3, lambda x: 3 * x**2),
    "g2_sensitivity": (np.square, lambda x: 2 * x),
}
_PLAIN: tuple[_Power, _Power] = (lambda x: x, np.ones_like)


@dataclass(frozen=True, slots=True, eq=False)
class ConstantForm:
    """What readings take from constant errors but biases, as products: of what is felt, its size,
    its square and so on with the `basis`.

    Attributes
    ----------
    inputs : sequence of ((3, 6), function, slope)
        Of rates and forces (..., 6) what a group of three is of, and of that which power.
    basis : (3 * groups, 6, q)
        Columns, per standard deviation, by each of all these.
    """

    inputs: tuple[tuple[Array, _Power, _Power], ...]
    basis: Array

    @property
    def count(self) -> int:
        """How many errors there are."""
        return self.basis.shape[2]

    def columns(self, x: Array) -> Array:
        """Of rates and forces (..., 6) the columns (..., 6, q), as `constant_columns`."""
        if not self.inputs:
            return np.zeros((*x.shape, 0))
        powers = [power(x @ axes.T) for axes, power, _ in self.inputs]
        flat = self.basis.reshape(len(self.basis), -1)
        return (np.concatenate(powers, axis=-1) @ flat).reshape(*x.shape, self.count)

    def slopes(self, x: Array, u: Array) -> Array:
        """How ``columns(x) @ u`` changes with rates and forces x (r, n, 6), of errors `u` (r, q):
        (r, n, 6, 6). Of a size at 0 neither way."""
        if not self.inputs:
            return np.zeros((*x.shape, 6))
        each = [slope(x @ axes.T)[..., None] * axes for axes, _, slope in self.inputs]
        added = (self.basis @ u[:, None, :, None])[..., 0]  # (r, groups, 6)
        return np.swapaxes(added, 1, 2)[:, None] @ np.concatenate(each, axis=-2)


@lru_cache(maxsize=16)
def constant_form(priors: Priors) -> ConstantForm:
    """That of the errors that `priors` state: three axes, or nine coefficients, of each term."""
    kinds: dict[tuple[str, bool, str], tuple[Array, _Power, _Power]] = {}
    of: list[tuple[tuple[str, bool, str], slice, Array]] = []
    for sensor, name, sigma in _stated(priors):
        forced = name in ("g_sensitivity", "g2_sensitivity")
        axes = getattr(priors, f"{sensor}_axes")
        # the case's rotation turns what is felt; all else is of the sensors, along their own axes
        as_it_is = forced or name in ("misalignment", "non_orthogonality")
        along = axes is not None and not as_it_is
        kind = ("accel" if forced else sensor, along, name if name in _OF else "")
        first = 0 if kind[0] == "gyro" else 3
        own = np.zeros((3, 6))
        own[:, first : first + 3] = np.array(axes) if along else np.eye(3)
        kinds.setdefault(kind, (own, *_OF.get(name, _PLAIN)))
        # each is linear in its power, and powers of unit vectors are themselves
        unit = BY_AXIS[name](np.eye(3), np.eye(3))
        back = np.eye(3) if axes is None or name == "misalignment" else back_from(axes)
        rows = slice(0, 3) if sensor == "gyro" else slice(3, 6)
        of.append((kind, rows, sigma * (back @ unit)))
    basis = np.zeros((3 * len(kinds), 6, sum(unit.shape[2] for _, _, unit in of)))
    at = {kind: slice(3 * k, 3 * k + 3) for k, kind in enumerate(kinds)}
    first = 0
    for kind, rows, unit in of:
        basis[at[kind], rows, first : first + unit.shape[2]] = unit
        first += unit.shape[2]
    basis.flags.writeable = False  # there is one for all who ask
    return ConstantForm(tuple(kinds.values()), basis)


def constant_columns(w_b: Array, f_b: Array, priors: Priors) -> Array:
    """What readings (..., 6) take from constant errors but biases, per standard deviation.

    Parameters
    ----------
    w_b, f_b : (..., 3)
        True rates [rad/s] and specific forces [m/s^2].
    priors : Priors

    Returns
    -------
    (..., 6, q)
        One column per error that `priors` state: three axes, or nine coefficients, of each term.
    """
    return constant_form(priors).columns(np.concatenate([w_b, f_b], axis=-1))


def _stated(priors: Priors) -> tuple[tuple[str, str, float], ...]:
    """Sensor, name and standard deviation of each error that `priors` state."""
    every = ((sensor, name) for sensor in ERRORS_OF for name in ERRORS_OF[sensor])
    found = ((sensor, name, getattr(priors, f"{sensor}_{name}")) for sensor, name in every)
    return tuple(one for one in found if one[2] > 0)


# --- second order ---


def with_products(priors: Priors) -> Priors:
    """The priors of one whose errors multiply: sensors of unlike scale on a case that is turned.

    ``(1 + S)(1 + M)`` has ``S M`` beside S and M. Of a turned case ``m_ij = -m_ji``, so its
    symmetric half is ``(s_i - s_j) m_ij / 2``: axes i and j lean together by ``(s_i - s_j) m_ij``,
    ``sqrt(2)`` times the product of the standard deviations. The rest of it is another turn and
    another scale. Where nobody states that axes lean, positions would contradict one another by it.
    """
    p = priors
    return replace(
        p,
        gyro_non_orthogonality=float(
            np.hypot(p.gyro_non_orthogonality, np.sqrt(2) * p.gyro_scale * p.gyro_misalignment)
        ),
        accel_non_orthogonality=float(
            np.hypot(p.accel_non_orthogonality, np.sqrt(2) * p.accel_scale * p.accel_misalignment)
        ),
    )


# --- in one attitude -----------------------------------------------------------------------------


def constant_covariance(means: Array, priors: Priors) -> Array:
    """Covariance (..., 6, 6) of readings in one attitude by constant errors, biases among them.

    `means` (..., 6): rates [rad/s] and specific forces [m/s^2] there. A triad turned by a small
    rotation reads ``x x m``: nothing along x, the same across it whatever the attitude.
    """
    A = constant_columns(means[..., :3], means[..., 3:], priors)
    bias = np.zeros((6, 6))
    bias[:3, :3] = _biases(priors.gyro_bias, priors.gyro_axes)
    bias[3:, 3:] = _biases(priors.accel_bias, priors.accel_axes)
    return np.asarray(A @ np.swapaxes(A, -1, -2) + bias)


def _biases(sigma: float, axes: Axes | None) -> Array:
    """Covariance (3, 3) in b of biases of the sensors."""
    return sigma**2 * (np.eye(3) if axes is None else spread(axes))


def in_one_attitude(priors: Priors, gravity: float) -> Priors:
    """The priors of one who stays near one attitude and takes every constant for bias or scale.

    Misaligned accelerometers feel a part of gravity across them, misaligned gyros a part of Earth
    rate, g-sensitive gyros gravity: biases as long as the attitude stays. Asymmetry and higher
    orders are scale errors there. Not for differences between attitudes: what is folded here
    does not cancel in them as biases do.
    """
    g, p = gravity, priors
    across = np.hypot(p.accel_misalignment, p.accel_non_orthogonality / 2) * g
    pulled = np.hypot(p.gyro_g_sensitivity * g, p.gyro_g2_sensitivity * g**2)
    astray = np.hypot(p.gyro_misalignment, p.gyro_non_orthogonality / 2) * EARTH_RATE
    orders = [p.accel_scale, p.accel_asymmetry, p.accel_quadratic * g, p.accel_cubic * g**2]
    folded = dict.fromkeys(_FOLDED, 0.0) | {
        "gyro_bias": float(np.linalg.norm([p.gyro_bias, pulled, astray])),
        "accel_bias": float(np.hypot(p.accel_bias, across)),
        "gyro_scale": float(np.hypot(p.gyro_scale, p.gyro_asymmetry)),
        "accel_scale": float(np.linalg.norm(orders)),
    }
    return replace(p, **folded)


_FOLDED = (
    "gyro_misalignment",
    "gyro_non_orthogonality",
    "accel_misalignment",
    "accel_non_orthogonality",
    "gyro_g_sensitivity",
    "gyro_g2_sensitivity",
    "gyro_asymmetry",
    "accel_asymmetry",
    "gyro_cubic",  # of one attitude it has Earth rate alone: a part of 5e-9 of its size
    "accel_quadratic",
    "accel_cubic",
)
