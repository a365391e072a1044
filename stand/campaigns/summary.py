"""What the runs of a campaign say: errors with their intervals, honesty, yield, the worst units."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from alignment import ESTIMATORS
from alignment.arrays import Array, IntArray
from alignment.estimate import ANGLE_LIMIT, LATITUDE_LIMIT
from alignment.options import of_noise_alone
from alignment.units import DEG, DEG_PER_HOUR, MILLI_G
from stand.campaigns.campaign import PREDICTIONS
from stand.campaigns.folder import read_sweep, results_of
from stand.campaigns.results import Columns
from stand.campaigns.sweep import Sweep, VaryEntry
from stand.campaigns.sweep import shown as spelled
from stand.campaigns.trial import NEES
from stand.errors import StandError
from stand.evaluation.statistics import TAIL, nees_bounds
from stand.imu import unstated
from stand.imu.priors import noise_alone
from stand.rehearsal.rehearse import limits_of
from stand.rehearsal.sums import Sums
from stand.simulation.settings import Settings

FIRST = ("heading", "yaw", "pitch", "roll", "latitude")  # what a page shows, the first there is
WORST = 10  # units that are listed
PARTS = (0.025, 0.25, 0.5, 0.75, 0.975)  # of a distribution of errors


class Series(NamedTuple):
    """What one method finds of one quantity at one place."""

    method: str
    window: str
    place: str
    quantity: str

    @property
    def unit(self) -> tuple[str, float]:
        """In which it is read, and its size in SI."""
        if self.quantity.startswith("gyro bias"):
            return "deg/h", DEG_PER_HOUR
        if self.quantity.startswith("accelerometer bias"):
            return "mg", MILLI_G
        return "deg", DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A series in one case, SI.

    `rms` of the errors of `runs` runs with the 95 % interval of what it estimates, their `mean`,
    the root mean square of the `stated` sigmas, what `rehearse` predicts (None: nothing), and the
    `parts` of the errors' distribution, as `PARTS`. Runs `without` a number that can stand do not
    count; where these are most, there is none at all: NaN. `noise_only`: no sheet of the case's
    unit states more than noise of the sensors that tell it.
    """

    case: int
    series: Series
    runs: int
    rms: float
    low: float
    high: float
    mean: float
    stated: float
    predicted: float | None
    parts: tuple[float, ...]
    without: int = 0
    noise_only: bool = False

    @property
    def determined(self) -> bool:
        """Whether there is a number to stand behind."""
        return bool(np.isfinite(self.rms))


@dataclass(frozen=True, slots=True, kw_only=True)
class Honesty:
    """Mean NEES of a method's attitudes in one case, 3 if honest, and the bounds of 95 % for it."""

    case: int
    method: str
    window: str
    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Yield:
    """Units that meet what is required, by one method; `case` 0: of all cases.

    `low`, `high`: the 95 % interval of their share by Clopper and Pearson.
    """

    case: int
    method: str
    window: str
    passed: int
    runs: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """Of all units."""
        return self.passed / self.runs


class Refused(NamedTuple):
    """Runs in which a method gave no answer, or none that stands, and how many cases they are of.

    `seed`: one of them, of case `case`.
    """

    method: str
    reason: str
    runs: int
    cases: int
    case: int
    seed: int


class Worst(NamedTuple):
    """A unit far off: its error and stated sigma [SI]; `times` its limit, or its case's rms;
    `noise_only` as of its `Cell`."""

    case: int
    seed: int
    series: Series
    error: float
    sigma: float
    times: float
    noise_only: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """All that a page and JSON say of a campaign.

    `shown`: a series per method and window, of the quantity that is looked at and the place where
    it is worst. `limits`: what is required of that quantity [rad], by case. `unstated`: what the
    units' sheets leave out.
    """

    sweep: Sweep
    folder: Path
    done: int
    cells: tuple[Cell, ...]
    shown: tuple[Series, ...]
    honesty: tuple[Honesty, ...]
    yields: tuple[Yield, ...]
    refused: tuple[Refused, ...]
    worst: tuple[Worst, ...]
    limits: Mapping[int, float]
    unstated: tuple[str, ...] = ()

    @property
    def total(self) -> int:
        """Runs that were asked for."""
        return len(self.sweep.values) * self.sweep.entry.runs

    def of(self, series: Series) -> list[Cell]:
        """One series, case after case."""
        return [cell for cell in self.cells if cell.series == series]

    def told(self, series: Series) -> list[Cell]:
        """Those cells of it that have a number."""
        return [cell for cell in self.of(series) if cell.determined]


def summarised(folder: Path) -> Summary:
    """What lies in a campaign's folder.

    Raises
    ------
    StandError
        There is no campaign, or no run of it yet.
    """
    sweep = read_sweep(folder)
    rows = results_of(folder).columns()
    if not len(rows["case"]):
        raise StandError(f"{folder}: holds no runs yet")
    settings = {n: sweep.case(n).settings for n in np.unique(rows["case"]).tolist()}
    limits = {n: limits_of(made) for n, made in settings.items()}
    alone = {n: noise_alone(made.unit) for n, made in settings.items()}
    grouped = _Grouped(rows)
    cells = tuple(_cells(grouped, _predictions(folder), alone))
    yields = tuple(_yields(sweep, rows, limits))
    judged = {(y.method, y.window) for y in yields}  # what units are judged by comes first
    shown = tuple(sorted(_shown(cells), key=lambda one: (one.method, one.window) not in judged))
    quantity = shown[0].quantity if shown else ""
    of_it = {n: one[_limited(quantity)] for n, one in limits.items() if _limited(quantity) in one}
    return Summary(
        sweep=sweep,
        folder=folder,
        done=len(np.unique(np.stack([rows["case"], rows["seed"]]), axis=1).T),
        cells=cells,
        shown=shown,
        honesty=tuple(_honesty(grouped)),
        yields=yields,
        refused=tuple(_refused(rows)),
        worst=tuple(_worst(grouped, cells, shown, of_it)),
        limits=of_it,
        unstated=tuple(dict.fromkeys(s for one in settings.values() for s in unstated(one.imu))),
    )


def _limited(quantity: str) -> str:
    return "heading" if quantity == "yaw" else quantity


def _predictions(folder: Path) -> dict[tuple[int, Series], float]:
    path = folder / PREDICTIONS
    if not path.exists():  # of a campaign that has not ended yet
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))
    return {
        (int(case), Series(p["method"], p["window"], p["place"], p["quantity"])): p["rms"]
        for case, rows in found.items()
        for p in rows
        if p["rms"] is not None
    }


class _Grouped:
    """Rows by case and series."""

    def __init__(self, rows: Columns) -> None:
        self.rows = rows
        codes: list[IntArray] = []
        names: list[NDArray[Any]] = []
        for name in ("method", "window", "place", "quantity"):
            words, code = np.unique(rows[name].astype(str), return_inverse=True)
            codes.append(code)
            names.append(words)
        sizes = tuple(len(words) for words in names)
        key = np.ravel_multi_index(tuple(codes), sizes)
        order = np.lexsort((key, rows["case"]))
        edges = np.flatnonzero(np.diff(rows["case"][order]) | np.diff(key[order])) + 1
        self.groups: list[tuple[int, Series, IntArray]] = []
        for part in np.split(order, edges):
            first: int = part.tolist()[0]
            words = [str(own[code[first]]) for own, code in zip(names, codes, strict=True)]
            self.groups.append((int(rows["case"][first]), Series(*words), part))


def _cells(
    grouped: _Grouped,
    predicted: Mapping[tuple[int, Series], float],
    noise_only: Mapping[int, Collection[str]],
) -> Iterator[Cell]:
    errors, sigmas = grouped.rows["error"], grouped.rows["sigma"]
    stands = grouped.rows["refusal"] == ""
    for case, series, part in grouped.groups:
        own = part[stands[part]]
        found = errors[own][np.isfinite(errors[own])]
        known: dict[str, Any] = {
            "case": case,
            "series": series,
            "predicted": predicted.get((case, series)),
            "noise_only": of_noise_alone(series.quantity, noise_only[case]),
            "without": len(part) - len(own),
        }
        if series.quantity and 2 * len(own) < len(part):  # the few others are no sample of it
            nothing = dict.fromkeys(("rms", "low", "high", "mean", "stated"), nan)
            yield Cell(**known, **nothing, runs=len(found), parts=(nan,) * len(PARTS))
            continue
        if not len(found):
            continue
        stated = sigmas[own][np.isfinite(sigmas[own])]
        powers = [float((found**k).sum()) for k in (1, 2, 4)]
        of = [[*series, float(len(found)), *powers, float(len(found))]]
        sums = Sums.from_json({"runs": len(found), "of": of, "refused": []})
        runs, (rms, low, high) = sums.sigma(
            (series.method, series.window, series.place, series.quantity)
        )
        yield Cell(
            **known,
            runs=runs,
            rms=rms,
            low=low,
            high=high,
            mean=float(found.mean()),
            stated=float(np.sqrt((stated**2).mean())) if len(stated) else nan,
            parts=tuple(np.quantile(found, PARTS).tolist()),
        )


def _shown(cells: Sequence[Cell]) -> Iterator[Series]:
    there = {cell.series.quantity for cell in cells}
    quantity = next((name for name in FIRST if name in there), None)
    ways = dict.fromkeys((c.series.method, c.series.window) for c in cells)
    for way in ways:
        squares: dict[Series, float] = {}
        for cell in cells:
            if (cell.series.method, cell.series.window) == way and cell.series.quantity == quantity:
                square = cell.rms**2 if cell.determined else inf
                squares[cell.series] = squares.get(cell.series, 0.0) + square
        if squares:
            yield max(squares, key=lambda series: squares[series])


def _honesty(grouped: _Grouped) -> Iterator[Honesty]:
    values: dict[tuple[int, str, str], list[IntArray]] = {}
    for case, series, part in grouped.groups:
        if series.quantity == NEES:
            values.setdefault((case, series.method, series.window), []).append(part)
    for (case, method, window), parts in values.items():
        rows = np.concatenate(parts)
        own, seeds = grouped.rows["estimate"][rows], grouped.rows["seed"][rows]
        mean, low, high = nees_bounds(own, seeds)
        yield Honesty(case=case, method=method, window=window, mean=mean, low=low, high=high)


def _refused(rows: Columns) -> Iterator[Refused]:
    refusal = rows["refusal"]
    where = np.flatnonzero(refusal != "")
    found: dict[tuple[str, str], list[int]] = {}
    for k in where.tolist():
        reason = _general(refusal[k], rows["quantity"][k])
        found.setdefault((rows["method"][k], reason), []).append(k)
    for (method, reason), own in found.items():
        named = ", ".join(dict.fromkeys(q for k in own if (q := rows["quantity"][k])))
        reason = f"{named} not determined: {reason}" if named else reason
        runs = {(int(rows["case"][k]), int(rows["seed"][k])) for k in own}
        case, seed = min(runs)
        yield Refused(method, reason, len(runs), len({c for c, _ in runs}), case=case, seed=seed)


def _general(reason: str, quantity: str) -> str:
    """Why a quantity is not determined, without the number that differs from run to run."""
    if not quantity:
        return reason
    limit = LATITUDE_LIMIT if quantity == "latitude" else ANGLE_LIMIT
    return f"sigma is above {limit / DEG:.0f} deg"


# --- yield ---


def clopper_pearson(passed: int, runs: int, tail: float = TAIL) -> tuple[float, float]:
    """The exact interval of a share of which `passed` in `runs` were found.

    Clopper and Pearson, Biometrika 26 (1934): quantiles of beta(k, n - k + 1), beta(k + 1, n - k).
    """
    low = 0.0 if passed == 0 else float(betaincinv(passed, runs - passed + 1, tail))
    high = 1.0 if passed == runs else float(betaincinv(passed + 1, runs - passed, 1 - tail))
    return low, high


def _yields(
    sweep: Sweep, rows: Columns, limits: Mapping[int, Mapping[str, float]]
) -> Iterator[Yield]:
    totals: dict[tuple[str, str], list[int]] = {}
    for case, own in limits.items():
        if not own:
            continue
        part = np.flatnonzero(rows["case"] == case)
        seeds = np.unique(rows["seed"][part])
        for method, window in _ways(sweep.case(case).settings, rows, part):
            passed = _passed(rows, part, seeds, (method, window), own)
            low, high = clopper_pearson(passed, len(seeds))
            yield Yield(
                case=case, method=method, window=window, passed=passed, runs=len(seeds), low=low,
                high=high,
            )  # fmt: skip
            total = totals.setdefault((method, window), [0, 0])
            total[0] += passed
            total[1] += len(seeds)
    for (method, window), (passed, runs) in totals.items():
        low, high = clopper_pearson(passed, runs)
        yield Yield(
            case=0, method=method, window=window, passed=passed, runs=runs, low=low, high=high
        )


def _ways(settings: Settings, rows: Columns, part: IntArray) -> list[tuple[str, str]]:
    """The methods, with their windows, that units are judged by: as a rehearsal is."""
    require = settings.procedure.entry.require
    # what a method refuses has no window: it counts against all those that it has
    told = part[rows["quantity"][part] != ""]
    answers = list(dict.fromkeys(zip(rows["method"][told], rows["window"][told], strict=True)))
    silent = set(rows["method"][part]) - {method for method, _ in answers}
    there = [way for way in (*answers, *((m, "") for m in sorted(silent))) if way[0] in ESTIMATORS]
    if require is not None and require.method is not None:
        return [way for way in there if way[0] == require.method]
    return [way for way in there if not ESTIMATORS[way[0]].carries_nominal] or there


def _passed(
    rows: Columns,
    part: IntArray,
    seeds: IntArray,
    way: tuple[str, str],
    limits: Mapping[str, float],
) -> int:
    """Units of which every limited angle is within its limit at every place: a place that a method
    refused is not."""
    by_method = part[rows["method"][part] == way[0]]
    own = by_method[rows["window"][by_method] == way[1]]
    silent = rows["seed"][by_method[rows["quantity"][by_method] == ""]]
    met = ~np.isin(seeds, silent)
    for quantity, limit in limits.items():
        names = _names_of(quantity, rows["quantity"][own])
        these = own[np.isin(rows["quantity"][own].astype(str), names)]
        ok = (np.abs(rows["error"][these]) <= limit) & (rows["refusal"][these] == "")
        at = np.searchsorted(seeds, rows["seed"][these])
        told = np.bincount(at, minlength=len(seeds))
        met &= (told > 0) & (np.bincount(at, ok, minlength=len(seeds)) == told)
    return int(met.sum())


def _names_of(quantity: str, there: NDArray[Any]) -> list[str]:
    """A vertical X1 has a yaw for its heading."""
    if quantity == "heading" and "heading" not in there:
        return ["yaw"]
    return [quantity]


def _worst(
    grouped: _Grouped,
    cells: Sequence[Cell],
    shown: Sequence[Series],
    limits: Mapping[int, float],
) -> Iterator[Worst]:
    """The units that are farthest beyond their limit, or beyond their case's rms."""
    if not shown:
        return
    rms = {(cell.case, cell.series): cell.rms for cell in cells if cell.determined}
    alone = {cell.case: cell.noise_only for cell in cells if cell.series == shown[0]}
    rows, found = grouped.rows, []
    for case, series, part in grouped.groups:
        if series == shown[0] and (case, series) in rms:
            of = limits.get(case, rms[case, series])
            part = part[rows["refusal"][part] == ""]
            errors: Array = np.abs(rows["error"][part])
            best = part[np.argsort(-np.nan_to_num(errors))[:WORST]]
            found += [
                (abs(float(rows["error"][k])) / of if of else 0.0, case, int(k)) for k in best
            ]
    for times, case, k in sorted(found, key=lambda one: (-one[0], one[1], one[2]))[:WORST]:
        yield Worst(
            case=case,
            seed=int(rows["seed"][k]),
            series=shown[0],
            error=float(rows["error"][k]),
            sigma=float(rows["sigma"][k]),
            times=times,
            noise_only=alone[case],
        )


# --- sensitivities ---


class Sensitivity(NamedTuple):
    """What one parameter does to a series: rms error [SI] at some of its values.

    Of every value with every other: pooled over all values of the others. Of samples: by a fit of
    the logarithm, quadratic in each parameter, with the others in their middle.
    """

    label: str
    values: tuple[str, ...]
    rms: tuple[float, ...]

    @property
    def span(self) -> tuple[float, float]:
        """The least and the greatest."""
        return min(self.rms), max(self.rms)


STEPS = 11  # of a fitted parameter


def sensitivities(summary: Summary, series: Series) -> list[Sensitivity]:
    """Of every parameter, the greatest ratio first; none where all are varied together."""
    combine = summary.sweep.entry.combine
    cells = [cell for cell in summary.of(series) if cell.rms > 0]
    if combine == "product":
        found = list(_pooled(summary, cells))
    else:
        found = list(_fitted(summary, cells)) if combine == "latin-hypercube" else []
    return sorted(found, key=lambda s: -s.span[1] / s.span[0])


def _pooled(summary: Summary, cells: Sequence[Cell]) -> Iterator[Sensitivity]:
    for k, one in enumerate(summary.sweep.entry.vary):
        squares: dict[str, list[float]] = {spelled(value): [] for value in one.listed()}
        for cell in cells:
            squares[spelled(summary.sweep.values[cell.case - 1][k])].append(cell.rms**2)
        rms = {value: float(np.sqrt(np.mean(own))) for value, own in squares.items() if own}
        if len(rms) > 1:
            yield Sensitivity(one.label, tuple(rms), tuple(rms.values()))


def _fitted(summary: Summary, cells: Sequence[Cell]) -> Iterator[Sensitivity]:
    """Where there are cases enough, of the parameters that are drawn from a range."""
    ranges = [(k, one) for k, one in enumerate(summary.sweep.entry.vary) if one.range is not None]
    terms = 1 + 2 * len(ranges)
    if len(cells) < 2 * terms:
        return
    parts = np.array(
        [[_part(one, summary.sweep.values[c.case - 1][k]) for k, one in ranges] for c in cells]
    )
    design = np.hstack([np.ones((len(cells), 1)), parts, parts**2])
    logs = np.log([cell.rms for cell in cells])
    fit = np.linalg.lstsq(design, logs, rcond=None)[0]
    steps = np.linspace(-1, 1, STEPS)
    for i, (_, one) in enumerate(ranges):
        assert one.range is not None
        curve = fit[0] + fit[1 + i] * steps + fit[1 + len(ranges) + i] * steps**2
        values = one.range.at((steps + 1) / 2)
        names = tuple(f"{value:.3g}" for value in values)
        yield Sensitivity(one.label, names, tuple(np.exp(curve).tolist()))


def _part(one: VaryEntry, value: Any) -> float:
    """Where a value stands in its range, -1 to 1, by factors on a logarithmic one."""
    assert one.range is not None
    low, high = one.range.low, one.range.high
    if one.range.scale == "log":
        low, high, value = np.log([low, high, value]).tolist()
    return 2 * (value - low) / (high - low) - 1


# --- for machines ---


def summary_json(summary: Summary) -> dict[str, Any]:
    """All of it: numbers in the units that are named, null where there is none."""
    sweep = summary.sweep
    return {
        "title": sweep.entry.title,
        "folder": str(summary.folder),
        "runs": summary.done,
        "wanted": summary.total,
        "varied": list(sweep.labels),
        "cases": [
            {"case": n, "values": dict(zip(sweep.labels, values, strict=True))}
            for n, values in enumerate(sweep.values, start=1)
        ],
        "errors": [_cell_json(cell) for cell in summary.cells],
        "unstated": list(summary.unstated),
        "nees": [
            {**_way(h), "case": h.case, "mean": h.mean, "low": h.low, "high": h.high}
            for h in summary.honesty
        ],
        "yield": [
            {**_way(y), "case": y.case or None, **{name: getattr(y, name) for name in _SHARES}}
            for y in summary.yields
        ],
        "refused": [r._asdict() for r in summary.refused],
        "worst": [_worst_json(w) for w in summary.worst],
        "sensitivities": [
            _sensitivity_json(series, s)
            for series in summary.shown
            for s in sensitivities(summary, series)
        ],
    }


_SHARES = ("passed", "runs", "share", "low", "high")


def _sensitivity_json(series: Series, s: Sensitivity) -> dict[str, Any]:
    unit, per = series.unit
    rms = [x / per for x in s.rms]
    own = {"varied": s.label, "values": list(s.values), "unit": unit, "rms": rms}
    return series._asdict() | own


def _way(of: Honesty | Yield) -> dict[str, str]:
    return {"method": of.method, "window": of.window}


def _cell_json(cell: Cell) -> dict[str, Any]:
    unit, per = cell.series.unit
    numbers = {name: getattr(cell, name) for name in ("rms", "low", "high", "mean", "stated")}
    told = {name: _number(value, per) for name, value in numbers.items()}
    told["predicted"] = None if cell.predicted is None else _number(cell.predicted, per)
    told |= {"undetermined": cell.without, "noise_only": cell.noise_only}
    parts = {f"{100 * p:g} %": _number(x, per) for p, x in zip(PARTS, cell.parts, strict=True)}
    head = {"case": cell.case, **cell.series._asdict(), "unit": unit, "runs": cell.runs}
    return head | told | {"parts": parts}


def _worst_json(w: Worst) -> dict[str, Any]:
    unit, per = w.series.unit
    return {
        "case": w.case,
        "seed": w.seed,
        **w.series._asdict(),
        "unit": unit,
        "error": _number(w.error, per),
        "sigma": _number(w.sigma, per),
        "noise_only": w.noise_only,
        "times": _number(w.times, 1.0),
    }


def _number(value: float, per: float) -> float | None:
    return float(value) / per if np.isfinite(value) else None
