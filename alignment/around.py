"""Where a heading's error is no longer small: what it comes to on the whole circle.

Heading is the direction of a horizontal Earth rate that is known in size. First order takes the
error across it for the heading's; what is found along it does not matter then. It does where the
errors reach the size of the rate itself: the direction turns by more, and may turn round.
"""

import numpy as np

from alignment.arrays import Array

_SMALL = 0.1  # rad: below, first order is good to 0.2 % of sigma
_DRAWS = np.linspace(-6, 6, 97)  # of a normal number, and their weights
_WEIGHTS = np.exp(-(_DRAWS**2) / 2) / np.sum(np.exp(-(_DRAWS**2) / 2))
_BOTH = np.outer(_WEIGHTS, _WEIGHTS)
_NEVER = np.finfo(float).tiny
_FLAT = 1e-12  # of the larger variance of tilts: no direction is surer
_LEAST_LEFT = 1e-3  # of the Earth's level rate
_COMPLEX = np.array([1.0, 1j])
_ANYWHERE = np.pi / np.sqrt(3)  # rad, of a direction of which nothing is known


def whole_circle(covariance: Array, heading: float) -> Array:
    """`covariance` (3, 3) about n with the heading's sigma grown to `heading` [rad], if it is less.

    Correlations stay.
    """
    ratio = heading / max(float(np.sqrt(covariance[2, 2])), np.finfo(float).tiny)
    grown = np.array([1.0, 1.0, max(ratio, 1.0)])
    return np.asarray(covariance * np.outer(grown, grown))


def by_direction(errors: Array) -> float:
    """Root mean square [rad] of the direction of ``(1 + a, b)``, a and b normal.

    `errors` (2, 2): covariance of a, along, and b, across, in parts of the horizontal rate.
    """
    if errors.trace() < _SMALL**2:
        return float(np.sqrt(errors[1, 1]))
    a, b = _drawn(errors)
    return _rms(np.arctan2(b, 1 + a))


def with_level_rate(covariance: Array, both: Array, lever: Array) -> Array:
    """`covariance` (3, 3) about n, as found, with its tilts as they are where the level rate turns
    by much: see `by_level_rate`, of which `both` (4, 4) and `lever` (2,) are.

    Tilts that go with a heading go round with it, and so does their correlation. Those that are not
    small to first order have no direction: both axes are as unsure.
    """
    first, after = _about_the_north(both, lever, found=True)
    found = np.asarray(covariance - first + after)
    if first[:2, :2].trace() > _SMALL**2:
        level = found[:2, :2].trace() / 2
        return np.diag([level, level, found[2, 2]])
    return found


def by_level_rate(covariance: Array, both: Array, lever: Array) -> tuple[Array, Array]:
    """What of errors about n is left (3, 3) of each cause, and a covariance (3, 3) that is added.

    A match knows the tilt in the middle of its record; to the end it turns on by the Earth's level
    rate, of the size it has and in the direction that is found. So tilt goes with heading's error
    h, by `lever` (2,) of tilts N, E per radian, and on the circle as h turns that rate. Tilts are
    about the true north.

    Notes
    -----
    `both` (4, 4): covariance to first order of tilts, heading b and a, by how much the level rate
    is found larger. Tilts ``N + i E`` are complex: what goes with a and b is M (a, b), of which the
    turn makes ``l b``, and on the circle ``l (exp(i h) - 1)/i``, h that of ``1 + a + i b``.
    In directions where tilts come to less all causes count less; where they come to more, that is
    added: with ``S = L L^T`` before and ``L Q diag(m) Q^T L^T`` after, by m.
    """
    first, after = (P[:2, :2] for P in _about_the_north(both, lever, found=False))
    less, more = np.eye(3), np.zeros((3, 3))
    if not first.any():
        return less, more
    values, axes = np.linalg.eigh(covariance[:2, :2])
    values = np.maximum(values, values[-1] * _FLAT)
    L, whitened = axes * np.sqrt(values), (axes / np.sqrt(values)).T
    m, Q = np.linalg.eigh(whitened @ (covariance[:2, :2] - first + after) @ whitened.T)
    less[:2, :2] = L @ (Q * np.sqrt(np.clip(m, 0.0, 1.0))) @ Q.T @ whitened
    more[:2, :2] = L @ (Q * np.maximum(m - 1, 0.0)) @ Q.T @ L.T
    return less, more


def _about_the_north(both: Array, lever: Array, found: bool) -> tuple[Array, Array]:
    """Covariances (3, 3) of what a and b make of tilts and heading, to first order and on the
    circle, there about the north that is `found` or the true one; heading's variance is b's."""
    errors = both[np.ix_([3, 2], [3, 2])]
    if errors.trace() < _SMALL**2:
        return np.zeros((3, 3)), np.zeros((3, 3))
    a, b = _drawn(errors)
    h = np.arctan2(b, 1 + a)
    along, across = _COMPLEX @ both[:2, [3, 2]] @ np.linalg.pinv(errors, hermitian=True)
    goes, turned = along * a + across * b, lever @ _COMPLEX
    whole = goes + turned * ((np.exp(1j * h) - 1) / 1j - b)
    if found:
        whole = whole * np.exp(-1j * h)
    return _squares(goes, b), _squares(whole, h * (_rms(b) / max(_rms(h), _NEVER)))


def _squares(tilts: Array, heading: Array) -> Array:
    """Mean squares and products (3, 3) of tilts ``N + i E`` and heading, over the grid."""
    values = np.stack([tilts.real, tilts.imag, heading])
    return np.asarray(np.einsum("ikl,jkl,kl->ij", values, values, _BOTH) / np.sum(_BOTH))


def by_size(found: Array, errors: Array, about: float) -> float:
    """Root mean square [rad] about `about` of the direction of a rate whose size, one, is known.

    `found` (2,): what is felt along and across; `errors` (2, 2): their covariance. Where one
    component tells all, two directions fit: an error that lies along an axis hides the other.
    """
    off = np.linspace(-np.pi, np.pi, 2**12, endpoint=False)
    angle = about + off
    left = np.stack([np.cos(angle), np.sin(angle)]) - np.asarray(found)[:, None]
    misfit = np.sum(left * np.linalg.solve(errors, left), axis=0)
    weights = np.exp((misfit.min() - misfit) / 2)
    return float(np.sqrt(np.sum(weights * off**2) / np.sum(weights)))


def by_length(sigma: float) -> float:
    """Mean square of ``|(1 + a, b)| - 1``, a and b normal of `sigma`, over that of a.

    What is left along a direction that follows the error: one where it is small, two where it is
    all, for then both components lie along it.
    """
    if sigma < _SMALL:
        return 1.0
    a, b = _drawn(sigma**2 * np.eye(2))
    return (_rms(np.hypot(1 + a, b) - 1) / sigma) ** 2


def by_one_gyro(azimuth: float, errors: Array) -> float:
    """Root mean square [rad] of an azimuth that one gyro tells, and another gyro its side.

    `azimuth` [rad] of the gyro from north, positive to the east; `errors` (2, 2): covariance of
    what it reads along itself, and of what is felt across it, in parts of the horizontal rate.
    Cosines beyond one, which are refused, are left out.
    """
    if errors.trace() < _SMALL**2 * np.sin(azimuth) ** 2:
        return float(np.sqrt(errors[0, 0]) / abs(np.sin(azimuth)))
    a, b = _drawn(errors)
    cosine, side = np.cos(azimuth) + a, np.sin(azimuth) + b
    told = np.abs(cosine) <= 1
    found = np.copysign(np.arccos(np.clip(cosine, -1, 1)), side)
    return _rms(np.angle(np.exp(1j * (found - azimuth))), told)


def _drawn(errors: Array) -> tuple[Array, Array]:
    """Two normal numbers over the grid, (k, k) each."""
    values, vectors = np.linalg.eigh(errors)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    grid = np.stack(np.meshgrid(_DRAWS, _DRAWS, indexing="ij"))
    a, b = np.tensordot(root, grid, axes=1)
    return a, b


def _rms(error: Array, told: Array | bool = True) -> float:
    weights = _BOTH * told
    return float(np.sqrt(np.sum(weights * error**2) / np.sum(weights)))


def less_turned(covariance: Array, left: float) -> Array:
    """Factors (3, 3) of a covariance about n where an unknown bias leaves less than the Earth's.

    Heading is the direction of a level rate: where the gyros show but a part `left` of the Earth's,
    the same noise turns it by more. Noise of its own size makes a rate as small by chance. Gyros
    that show nothing of it, dead ones say, leave the whole circle, whatever their noise.
    """
    sigma = float(np.sqrt(covariance[2, 2]))
    least = max(float(np.hypot(left, sigma)), _LEAST_LEFT)
    grown = max(1.0, 1 / least)
    if left < _LEAST_LEFT:
        grown = max(grown, _ANYWHERE / max(sigma, np.finfo(float).tiny))
    more = np.array([1.0, 1.0, grown])
    return np.outer(more, more)
