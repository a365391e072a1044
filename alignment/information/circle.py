"""Heading as a point of a circle: what first order leaves out of its error.

The horizontal Earth rate has a known size, so that readings tell of it only where on a circle it
lies. First order takes the circle for its tangent. Where turns show the rate across the circle much
worse than along another direction, a heading far off may fit nearly as well as the true one.
"""

from typing import NamedTuple

import numpy as np

from alignment.arrays import Array
from alignment.earth import Site
from alignment.information.model import sensor_inputs
from alignment.information.result import DETERMINED, Information

_NEAR = np.linspace(-8, 8, 129)  # standard deviations about the true heading
_ROUND = np.radians(np.arange(-180.0, 180.0, 2.0))
_DRAWS = np.linspace(-6, 6, 73)  # of a normal number, and their weights
_WEIGHTS = np.exp(-(_DRAWS**2) / 2) / np.sum(np.exp(-(_DRAWS**2) / 2))
# two of them, turned by half a radian: no line on which headings change over lies along a row
_HALF = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
# of the tangent's chi-square: what is never less everywhere, nor more nearby, is first order
_STRAIGHT, _NEARBY = 0.9, 2.0  # and within so many standard deviations
_FAR = 36.0  # chi-square beyond which no heading is taken for another


class Rival(NamedTuple):
    """What the circle makes of the error of a heading.

    `ratio`: its root mean square over that of first order; `apart` [rad]: the heading that adds
    most to it, and by how much `chi2` the readings are against it.
    """

    ratio: float
    apart: float
    chi2: float


NO_RIVAL = Rival(1.0, 0.0, np.inf)


def circle_information(known: Information, site: Site) -> Array:
    """Information (2, 2) of the horizontal Earth rate in parts of itself, to north and to east.

    Of what `known` has its stretches tell when tilts, biases and all else are found beside it.
    """
    # a turn about down by eta takes the rate of b to the west
    sought = np.stack([by_north_rate(known, site), -known.J[:, 2]], axis=1)
    prior = known.prior
    others = np.flatnonzero((prior > 0) & (np.arange(len(prior)) != 2))
    R = np.sum(known.noises, axis=0)[np.ix_(known.used, known.used)]
    scale = np.sqrt(np.diag(R))
    L = np.linalg.cholesky(R / np.outer(scale, scale))
    both = np.concatenate([sought, known.J[:, others]], axis=1)[known.used]
    white = np.linalg.solve(L, both / scale[:, None])
    stated = np.diag(1 / prior[others])
    A = np.concatenate([white[:, 2:], stated])
    y = np.concatenate([white[:, :2], np.zeros((len(others), 2))])
    size = np.linalg.norm(A, axis=0)
    A = A / np.where(size > 0, size, 1.0)
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    return np.asarray(left.T @ left)


def by_north_rate(known: Information, site: Site) -> Array:
    """Coefficients (m,) of all stretches by the horizontal Earth rate alone."""
    every = range(len(known.stretches))
    return np.concatenate([_by_north_rate(known, k, site) for k in every])


def curvature(sigma: float) -> float:
    """Mean square of what a circle leaves its tangent by, ``1 - cos h``: h normal of `sigma` [rad].

    ``3/2 - 2 exp(-sigma^2/2) + exp(-2 sigma^2)/2``: ``3 sigma^4/4`` of small ones, 3/2 all round.
    """
    return float(1.5 - 2 * np.exp(-(sigma**2) / 2) + np.exp(-2 * sigma**2) / 2)


def chord(sigma: float) -> float:
    """Mean square of ``sin h``, where first order has h: h normal of `sigma` [rad].

    ``(1 - exp(-2 sigma^2)) / 2``: ``sigma^2`` of small ones, 1/2 all round.
    """
    return float(-np.expm1(-2 * sigma**2) / 2)


def _by_north_rate(known: Information, k: int, site: Site) -> Array:
    """Coefficients (6h,) of a stretch by its horizontal Earth rate alone, accelerometers none."""
    _, _, C_bn, project = sensor_inputs(known.stretches[k], known.C_np, site)
    north = np.array([site.w_ie_n[0], site.w_ie_n[1], 0.0])
    felt = np.concatenate([C_bn @ north, np.zeros((len(C_bn), 3))], axis=1)
    return np.asarray(project @ felt).ravel()


def rival(G: Array) -> Rival:
    """What the circle of information `G` (2, 2) makes of the likeliest heading's error.

    Notes
    -----
    Free of its size the rate would be found at ``(1, 0) + z``, z normal of covariance ``G^-1``; the
    likeliest heading is the point of the circle nearest to that in the metric G. Its mean square
    is summed over z. A heading h off costs ``chi2 = d^T G d, d = (cos h - 1, sin h)``, which first
    order has as ``h^2 G_ee``; it is taken for the true one in ``Q(sqrt(chi2)/2)`` of the cases.
    """
    sigma = 1 / np.sqrt(G[1, 1])
    h = np.concatenate([_NEAR[np.abs(_NEAR * sigma) < np.pi] * sigma, _ROUND])
    d = np.stack([np.cos(h) - 1, np.sin(h)], axis=1)
    chi2 = np.einsum("ki,ij,kj->k", d, G, d)
    tangent, nearby = (h / sigma) ** 2, np.abs(h) <= _NEARBY * sigma
    none = np.all(chi2 >= _STRAIGHT * np.minimum(tangent, _FAR))
    if none and np.all(_STRAIGHT * chi2[nearby] <= tangent[nearby]):
        return NO_RIVAL
    # chi-square of every heading against what is drawn, less what is the same for all of them
    U = np.linalg.cholesky(G)
    z = np.stack(np.meshgrid(_DRAWS, _DRAWS, indexing="ij"), axis=-1).reshape(-1, 2) @ _HALF
    cost = chi2 - 2 * z @ (d @ U).T
    error = h[np.argmin(cost, axis=1)]
    weights = np.outer(_WEIGHTS, _WEIGHTS).ravel()
    worst = int(np.argmax(h**2 * np.exp(-chi2 / 8) * (np.abs(h) > 2 * sigma)))
    ratio = float(np.sqrt(weights @ error**2) / sigma)
    if sigma >= DETERMINED:  # nobody asks by how much it is too large
        ratio = max(ratio, 1.0)
    return Rival(ratio, float(abs(h[worst])), float(chi2[worst]))
