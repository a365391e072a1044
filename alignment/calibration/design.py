"""What a test can tell, before there are readings: Jacobian, noise, posterior, budget.

Also what one more station or move would add (`candidate`), for those who plan tests.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from alignment.arrays import Array
from alignment.calibration import terms
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.model import GRAVITY, Model
from alignment.calibration.noise import noise_parts
from alignment.calibration.session import Move, Session, Station
from alignment.earth import Site


class Design:
    """A test worked out once: solving it for readings is then a product with a matrix.

    Attributes
    ----------
    model : Model
    J : (m, p)
        Derivatives of the readings by the unknowns, at the expected ones.
    noises : mapping
        Covariances (m, m) of the readings by source.
    origin : Design
        Of the first run, where this is that of another.
    active : (a,)
        Columns of the unknowns that are not known beforehand.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.origin = self
        self.J = model.jacobian()
        self.noises = noise_parts(model)
        self.active = np.flatnonzero(model.unknowns.sigmas > 0)
        self.sigmas = model.unknowns.sigmas[self.active]
        R = np.sum(list(self.noises.values()), axis=0)
        # gyros and accelerometers differ by orders: each row in units of its own sigma
        self._scale = np.sqrt(np.diag(R))
        self._L = np.linalg.cholesky(R / np.outer(self._scale, self._scale))
        W = self.whitened(self.J[:, self.active] * self.sigmas)
        Q, self._U = np.linalg.qr(np.concatenate([W, np.eye(len(self.active))]))
        self._Q, self._Q_prior = Q[: len(W)], Q[len(W) :]
        self.W = W

    def of_readings(self, model: Model) -> "Design":
        """The same for another run of the procedure: its moves are its own, all else is known."""
        _ = self.weight, self.covariance, self.gain  # worked out once, for all
        known = copy(self)
        known.model = model
        return known

    def whitened(self, rows: Array) -> Array:
        """Rows (m, ...) in units of the noise, uncorrelated."""
        scaled = rows / (self._scale if rows.ndim == 1 else self._scale[:, None])
        return solve_triangular(self._L, scaled, lower=True)

    def step(self, left: Array, off: Array) -> Array:
        """Change (a,) of the active unknowns: `left` (m,) unexplained, `off` (a,) the prior."""
        told = self._Q.T @ self.whitened(left) - self._Q_prior.T @ (off / self.sigmas)
        return self.sigmas * solve_triangular(self._U, told)

    @cached_property
    def covariance(self) -> Array:
        """Posterior (a, a) of the active unknowns."""
        root = self.sigmas[:, None] * np.linalg.inv(self._U)
        return root @ root.T

    @cached_property
    def gain(self) -> Array:
        """(a, m): from the readings' errors to those of the active unknowns."""
        back = solve_triangular(self._L, self._Q, lower=True, trans=1) / self._scale[:, None]
        return self.sigmas[:, None] * solve_triangular(self._U, back.T)

    @cached_property
    def weight(self) -> Array:
        """Inverse covariance (m, m) of the readings about what is expected, priors included."""
        half = solve_triangular(self._L, self._Q, lower=True, trans=1) / self._scale[:, None]
        inverse = solve_triangular(self._L, np.diag(1 / self._scale), lower=True)
        return inverse.T @ inverse - half @ half.T

    def contributions(self, rows: Array) -> dict[str, Array]:
        """Standard deviations (k,) by source, of ``rows @ unknowns`` (k, a): noise and priors.

        Their squares sum to the posterior's: what noise does through the gain, and what of each
        prior the readings leave.
        """
        found = {}
        through = rows @ self.gain
        for name, part in self.noises.items():
            found[name] = np.sqrt(np.maximum(np.einsum("km,mn,kn->k", through, part, through), 0))
        left = (through @ self.J[:, self.active] - rows) * self.sigmas
        sources = [self.source(int(at)) for at in self.active]
        for name in dict.fromkeys(sources):
            own = np.array([s == name for s in sources])
            found[name] = np.linalg.norm(left[:, own], axis=1)
        return found

    def source(self, column: int) -> str:
        """Group of an unknown, as a budget names it."""
        if column >= terms.COUNT:
            return nuisance_source(self.model.unknowns.names[column - terms.COUNT])
        term = next(t for t in reversed(terms.UNIT) if t.at <= column)
        return term_source(term.sensor, term.name)


_WORDS = {
    "bias": "bias",
    "scale": "scale factor",
    "misalignment": "misalignment",
    "non_orthogonality": "non-orthogonality",
    "asymmetry": "asymmetry",
    "k2": "quadratic term",
    "k3": "cubic term",
    "g_sensitivity": "g-sensitivity",
    "g2_sensitivity": "g^2-sensitivity",
    "lever_arm": "lever arms",
    "lag": "lag",
    "temperature_bias": "bias by temperature",
    "temperature_scale": "scale factor by temperature",
}
_SENSOR_WORDS: dict[str, str] = dict(zip(SENSORS, ("gyro", "accelerometer"), strict=True))


def term_source(sensor: str, name: str) -> str:
    """In words."""
    return f"{_SENSOR_WORDS[sensor]} {_WORDS[name]}"


def nuisance_source(name: str) -> str:
    """A nuisance's group: what stands before 'of', 'about' or 'along', after a recording's name."""
    own = name.partition(": ")[2] or name
    for word in (" of ", " about ", " along "):
        own = own if own == GRAVITY else own.partition(word)[0]
    return own


# --- one more station or move --------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class CandidateRows:
    """What one station or move tells of the unknowns of a design, by itself.

    `rows` (r, p): derivatives in units of its noise, white noise and drifts as if alone: its
    information is ``rows.T @ rows``. `seconds` that it takes.
    """

    rows: Array
    seconds: float


def candidate(
    one: Station | tuple[Station, Station, Move],
    bench: Bench,
    site: Site,
    interval: float,
    names: Sequence[str] = (),
) -> CandidateRows:
    """Information of a candidate, with nothing run: of a station, or of a move between two.

    Parameters
    ----------
    one : Station or (Station, Station, Move)
        Of a move `first` is 0 and `last` 1.
    bench, site
    interval : float
        Between samples [s].
    names : sequence of str
        Nuisances that the columns are to hold, in this order after the unit's; else its own.
    """
    stations = (one,) if isinstance(one, Station) else one[:2]
    moves = () if isinstance(one, Station) else one[2:]
    model = Model([Session(stations, moves, interval)], bench, site)
    J, noises = model.jacobian(), noise_parts(model)
    own = np.concatenate(model.rows()[0][len(stations) if moves else 0 :])
    R = np.sum(list(noises.values()), axis=0)[np.ix_(own, own)]
    scale = np.sqrt(np.diag(R))
    L = np.linalg.cholesky(R / np.outer(scale, scale))
    rows = solve_triangular(L, J[own] / scale[:, None], lower=True)
    wanted = list(names) or list(model.unknowns.names)
    out = np.zeros((len(rows), terms.COUNT + len(wanted)))
    out[:, : terms.COUNT] = rows[:, : terms.COUNT]
    known = {name: terms.COUNT + k for k, name in enumerate(model.unknowns.names)}
    for k, name in enumerate(wanted):
        if name in known:
            out[:, terms.COUNT + k] = rows[:, known[name]]
    seconds = moves[0].length if moves else stations[0].stretch.span.length
    return CandidateRows(out, seconds)


def by_group(sizes: Mapping[str, Array]) -> list[tuple[str, Array]]:
    """Contributions, the largest first."""
    return sorted(sizes.items(), key=lambda item: -float(np.max(item[1], initial=0.0)))
