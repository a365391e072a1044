"""What candidates tell of a unit's constants: per second in the search, exactly in the end.

In the search a candidate's information grows with its time (white noise alone), so that it adds up
and cannot promise too little time. `Problem.exact` has the drifts, rounding, encoder steps and the
order in time; what the moves tell comes with the rehearsal only.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from alignment.arrays import Array, set_owned
from alignment.calibration import terms
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.model import Model
from alignment.calibration.noise import DRIFTS, ENCODER, Drifts, noise_parts
from alignment.calibration.session import Session, Station
from alignment.information.drift import Span
from alignment.methods.calibration import CALIBRATION
from alignment.readings import BoolArray
from stand.calibration.units import name_of
from stand.procedure.procedure import RequireEntry, procedure_from
from stand.procedure.requirements import CONSTANTS
from stand.proposal.candidates import Candidate, Clock
from stand.proposal.text import procedure_of
from stand.proposal.wanted import Wanted
from stand.rehearsal.constants import derived_rows, planned_stations
from stand.rehearsal.rehearse import prepared
from stand.rehearsal.scene import Scene
from stand.simulation.settings import Settings, assembled
from stand.toml_files import Source

EVER = 1e7  # s: as long as anybody
EDGE = 1e-9  # of a stretch, so that its whole turns are whole


class Goal:
    """What is required of a unit's constants.

    Attributes
    ----------
    names : tuple of str
        Of each row: its quantity, of `CONSTANTS`.
    rows : (k, COUNT)
        Constants by the unknowns of the fit.
    limits : (k,)
        Greatest sigma [SI]: the requirement over coverage, less the guard band.
    """

    def __init__(
        self, require: RequireEntry, limits: Mapping[str, float], present: BoolArray
    ) -> None:
        outside = terms.outside(present)
        told = [name_of(key) for key in outside.keys]
        names, angles = derived_rows(present)
        every = np.concatenate([outside.matrix, angles])
        own: list[str] = []
        at: list[int] = []
        most: list[float] = []
        for quantity, limit in limits.items():
            if quantity not in CONSTANTS:
                continue
            for k, name in enumerate([*told, *names]):
                if name.startswith(CONSTANTS[quantity].rows):
                    own.append(quantity)
                    at.append(k)
                    most.append(limit / (require.coverage * (1 + require.guard)))
        self.names = tuple(own)
        set_owned(self, rows=(every[at], (len(at), terms.COUNT), float))
        set_owned(self, limits=(np.array(most), (len(at),), float))

    rows: Array
    limits: Array

    def scaled(self, factor: float) -> "Goal":
        """The same with every limit times a factor."""
        other = copy(self)
        set_owned(other, limits=(self.limits * factor, (len(self.names),), float))
        return other

    def by_quantity(self, ratios: Array) -> dict[str, float]:
        """The worst row of each quantity, of ratios (k,)."""
        return {
            name: float(np.max(ratios[[own == name for own in self.names]]))
            for name in dict.fromkeys(self.names)
        }


class Problem:
    """Candidates of a unit on a table, with what is required.

    Attributes
    ----------
    candidates : tuple of Candidate
    clock : Clock
    goal : Goal
    told : list of (r, a)
        Of each candidate: rows in units of the noise of one second, and of the priors; what one
        second tells is ``row.T @ row``.
    wanted_rows : (a, k)
        ``wanted_rows[:, j] @ covariance @ wanted_rows[:, j]`` at most 1: the requirement is kept.
    """

    def __init__(
        self,
        wanted: Wanted,
        candidates: Sequence[Candidate],
        like: Settings,
        limits: dict[str, float],
    ) -> None:
        self.candidates, self.clock = tuple(candidates), Clock(like.table)
        every = [(one, one.quantum or 1.0) for one in candidates]
        require = wanted.entry.require.model_copy(update={"method": None})
        self.settings = settings_of(
            procedure_of(wanted, every, (CALIBRATION,), require, table=like.table.id), like
        )
        self.scene: Scene = prepared(self.settings)
        bench = self.settings.options.bench
        assert isinstance(bench, Bench)
        self._bench, self._interval = bench, 1 / self.settings.rate_hz
        self._stations = self._by_candidate(planned_stations(self.scene))
        self._first = np.cumsum([0, *(len(own) for own in self._stations)]).tolist()
        model = self._model(1.0)
        sigmas = model.unknowns.sigmas
        self.active = np.flatnonzero(sigmas > 0)
        self.sigmas = sigmas[self.active]
        present = np.isin(np.arange(terms.COUNT), self.active)
        self.goal = Goal(wanted.entry.require, limits, present)
        self._J, self._rows = model.jacobian()[:, self.active] * self.sigmas, model.rows()[0]
        parts = noise_parts(model)
        once, twice = _averaged(parts), _averaged(noise_parts(self._model(2.0)))
        lengths, turns = np.zeros(len(self._J)), np.zeros(len(self._J))
        for own, station in zip(self._rows, self._all(), strict=True):
            lengths[own] = station.stretch.span.length
            turns[own] = lengths[own] if station.stretch.rate else 0.0
        # what stays however long one looks; what averages out, of one second; and the ends of a
        # turn by its encoder, which tell its mean rate as it is long: of one second too
        encoder = parts.get(ENCODER, np.zeros_like(once))
        self._lasting = 2 * twice - once + np.where(np.outer(turns, turns), 0.0, encoder)
        self._white = 2 * np.diag(once - twice) * lengths
        self._ends = encoder * np.outer(turns, turns)
        self.told = self._per_second()

    def _by_candidate(self, stations: Sequence[Station]) -> list[tuple[Station, ...]]:
        found, at = [], 0
        for one in self.candidates:
            n = 2 if one.axis else 1
            found.append(tuple(stations[at : at + n]))
            at += n
        return found

    def _model(self, times: float) -> Model:
        """Of all candidates, each so many times its own length."""
        found = []
        for own in self._stations:
            for station in own:
                stretch = station.stretch
                longer = replace(stretch, duration=times * stretch.span.length * (1 + EDGE))
                found.append(replace(station, stretch=longer))
        return Model([Session(tuple(found), (), self._interval)], self._bench, self.scene.site)

    def _all(self) -> list[Station]:
        return [station for own in self._stations for station in own]

    def _per_second(self) -> list[Array]:
        found, at = [], 0
        for own in self._stations:
            parts = []
            for _ in own:
                rows = self._rows[at]
                parts.append(self._J[rows] / np.sqrt(self._white[rows] * len(own))[:, None])
                at += 1
            # as many rows as it has directions: an exact square root of what it tells
            found.append(np.linalg.qr(np.concatenate(parts), mode="r"))
        return found

    @cached_property
    def wanted_rows(self) -> Array:
        scaled = np.zeros((len(self.goal.names), len(self.active)))
        unit = self.active < terms.COUNT
        scaled[:, unit] = self.goal.rows[:, self.active[unit]]
        return (scaled * self.sigmas / self.goal.limits[:, None]).T

    @cached_property
    def overheads(self) -> Array:
        """Seconds (n,) of each candidate's ramps."""
        return np.array(
            [self.clock.length(one, one.quantum) - one.quantum for one in self.candidates]
        )

    def scaled(self, factor: float) -> "Problem":
        """The same with every limit times a factor."""
        other = copy(self)
        other.__dict__.pop("wanted_rows", None)
        other.goal = self.goal.scaled(factor)
        return other

    # --- in the search

    def covariance(self, t: Array) -> Array:
        """Posterior (a, a), scaled by the priors, of `t` (n,) [s] of each candidate."""
        M = np.eye(len(self.active))
        for k in np.flatnonzero(t > 0):
            M += t[k] * self.told[k].T @ self.told[k]
        return np.linalg.inv(M)

    def squares(self, t: Array) -> Array:
        """Variances (k,) over what they may be, by white noise alone."""
        E = self.wanted_rows
        return np.einsum("ak,ab,bk->k", E, self.covariance(t), E)

    # --- exactly

    def order(self, t: Array) -> list[int]:
        """The shortest tour that going to the nearest next, and exchanging ends, finds."""
        left, at, found = list(np.flatnonzero(t > 0)), (0.0, 0.0, 0.0), []
        while left:
            k = min(left, key=lambda k: self.clock.move(at, self.candidates[k].position))
            at = self.candidates[k].position
            found.append(int(k))
            left.remove(k)
        return _untangled(found, self._path)

    def _path(self, order: Sequence[int]) -> float:
        at, total = (0.0, 0.0, 0.0), 0.0
        for k in order:
            total += self.clock.move(at, self.candidates[k].position)
            at = self.candidates[k].position
        return total

    def total(self, t: Array) -> float:
        """Of the whole plan [s]."""
        return self.clock.total(self.amounts(t))

    def amounts(self, t: Array) -> tuple[tuple[Candidate, float], ...]:
        """Candidates in their order, each with its seconds of data."""
        return tuple((self.candidates[k], float(t[k])) for k in self.order(t))

    def exact(self, t: Array) -> Array:
        """Variances (k,) over what they may be, with drifts in their order, moves left out."""
        spans, numbers = self._spans(t)
        rows = np.concatenate([self._rows[n] for n in numbers])
        seconds = np.concatenate(
            [np.full(len(self._rows[n]), s.length) for n, s in zip(numbers, spans, strict=True)]
        )
        R = self._lasting[np.ix_(rows, rows)] + np.diag(self._white[rows] / seconds)
        R += self._drifting(spans, numbers)
        R += self._ends[np.ix_(rows, rows)] / np.outer(seconds, seconds)
        scale = np.sqrt(np.diag(R))
        L = np.linalg.cholesky(R / np.outer(scale, scale))
        A = solve_triangular(L, self._J[rows] / scale[:, None], lower=True)
        E = self.wanted_rows
        return np.einsum("ak,ak->k", E, np.linalg.solve(np.eye(len(E)) + A.T @ A, E))

    def _drifting(self, spans: Sequence[Span], numbers: Sequence[int]) -> Array:
        """Covariance by bias instability, random walk and ramp, in the order of the stations."""
        sizes = [len(self._rows[n]) // 6 for n in numbers]  # coefficients of each
        total = np.cumsum([0, *(6 * size for size in sizes)])
        whole = np.zeros((total[-1], total[-1]))
        drifts = Drifts(spans)
        for k, sensor in enumerate(SENSORS):
            at = np.concatenate([
                a + 3 * size * k + np.arange(3 * size)
                for a, size in zip(total[:-1].tolist(), sizes, strict=True)
            ])  # fmt: skip
            for part in drifts.of(getattr(self._bench.unit, sensor)).values():
                whole[np.ix_(at, at)] += np.kron(part, np.eye(3))
        return whole

    def _spans(self, t: Array) -> tuple[list[Span], list[int]]:
        """When each station is looked at in the plan, and its number."""
        order, spans, numbers = self.order(t), [], []
        times = self.clock.timeline((self.candidates[k], float(t[k])) for k in order)
        for k, (start, end) in zip(order, times, strict=True):
            one = self.candidates[k]
            lead = self.clock.length(one, 0.0) / 4 if one.axis else 0.0
            own = self._stations[k]
            for n, station in enumerate(own):
                span = station.stretch.span
                begin = start + n * (end - start) / len(own) + lead
                spans.append(Span(begin, t[k] / len(own), span.rate, span.angle))
                numbers.append(self._first[k] + n)
        return spans, numbers


def _averaged(parts: Mapping[str, Array]) -> Array:
    """Covariance (m, m) of the readings but for what wanders in time and what encoders err."""
    own = [part for name, part in parts.items() if not name.endswith((*DRIFTS, ENCODER))]
    return np.sum(own, axis=0)


def _untangled(order: list[int], path: Callable[[Sequence[int]], float]) -> list[int]:
    """The order with parts of it turned round where that makes the path shorter."""
    best, length = order, path(order)
    for i in range(len(order) - 1):
        for j in range(i + 1, len(order)):
            other = best[:i] + best[i : j + 1][::-1] + best[j + 1 :]
            if (found := path(other)) < length - 1e-9:
                best, length = other, found
    return best


def settings_of(text: str, like: Settings) -> Settings:
    """The same settings with a procedure of our own."""
    procedure = procedure_from(Source("proposal", "proposal", text))
    return assembled(
        procedure,
        like.imu,
        like.table,
        like.site,
        like.rate_hz,
        seed=like.seed,
        without=like.without,
        revision=like.revision,
        true_table=like.true_table,
        sampling=like.sampling,
    )
