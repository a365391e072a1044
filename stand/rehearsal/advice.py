"""The cheapest change of a procedure's own numbers that makes it pass.

Variants (both directions, a slower or second turn, an added position, a longer offset window,
another start azimuth, or none) are tried at their own length and then with longer stretches: the
least that passes of lengths an eighth of an octave apart; those that are out of reach are passed
over. Of all that pass within every
limit the shortest comes first; where none does, the best that was tried says what stands in the
way.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import ceil, exp, inf, log
from typing import Any

from alignment import ESTIMATORS
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu.priors import only
from stand.procedure.procedure import procedure_from
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.requirement import rows_of
from stand.rehearsal.result import Advice, Change, Judgement, Rehearsal, Verdict
from stand.rehearsal.wording import toml_of
from stand.simulation.settings import Settings, with_procedure

_GROWTH = 2.0  # of a length that fails, at least
_WHOLE = 0.95  # of a length that whole seconds make of it
_MOST = 64.0  # times the length
_FACTORS = (1.0, *(2.0**k * (1 + n / 8) for k in range(6) for n in range(1, 9)))
_LONGEST = 7 * 86400.0  # s: no advice is longer than that
_DEARER = 3.0  # times the shortest found: no longer ones are looked for
_NO_GAIN = 0.99  # of sigma: a stretch twice as long that does not gain that is limited otherwise
_KEPT = 3  # pieces of advice per quantity
_AXIS = "outer"  # turns about the vertical
_AZIMUTHS = (45.0, 90.0, 135.0)

Data = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """A changed procedure and what comes of it."""

    data: Data
    text: str
    result: Rehearsal


def with_advice(
    settings: Settings, progress: Callable[[float], None] = lambda done: None
) -> Rehearsal:
    """A rehearsal, with advice for every quantity that fails; `progress` is told of variants."""
    result = rehearse(settings)
    failing = [j.quantity for j in result.judgements if j.verdict is Verdict.FAIL and not j.refused]
    if not failing or not result.feasibility:
        return result
    data = settings.procedure.entry.model_dump(exclude_unset=True, mode="json")
    tried: list[_Trial] = []
    wanted = _wanted(result)
    whole = _remedies(settings, data, wanted, tried, progress)
    advice: list[Advice] = []
    for quantity in failing:
        found = whole
        if not whole and wanted != (quantity,):
            found = _remedies(settings, data, (quantity,), tried, progress)
        advice += [_advice_of(quantity, data, trial) for trial in found[:_KEPT]]
        if not found:
            advice.append(_nothing(quantity, data, tried))
    return replace(result, advice=tuple(advice))


def _wanted(result: Rehearsal) -> tuple[str, ...]:
    return tuple(j.quantity for j in result.judgements if not j.refused)


def _remedies(
    settings: Settings,
    data: Data,
    wanted: Sequence[str],
    tried: list[_Trial],
    progress: Callable[[float], None],
) -> list[_Trial]:
    """Changes that make all the `wanted` pass, the shortest first; all goes into `tried`."""
    found: list[_Trial] = []
    variants = list(_variants(data, settings))
    for number, variant in enumerate(variants):
        progress(number / len(variants))
        cheapest = min((t.result.duration.total for t in found), default=_LONGEST / _DEARER)
        trial = _longer(settings, variant, wanted, _DEARER * cheapest, tried)
        if trial is not None:
            found.append(trial)
    progress(1.0)
    return sorted(found, key=lambda trial: trial.result.duration.total)


def _longer(
    settings: Settings, data: Data, wanted: Sequence[str], longest: float, tried: list[_Trial]
) -> _Trial | None:
    """The shortest lengthening of a variant that passes within `longest` s; None: none does."""
    before, off, k, least = 0.0, inf, 0, 0.0
    while True:
        trial = _tried(settings, _stretched(data, _FACTORS[k]))
        if trial is None or trial.result.duration.total > longest:
            return None
        tried.append(trial)
        if _passes(trial.result, wanted):
            break
        factor, now = _FACTORS[k], _worst(trial.result, wanted)
        if factor == _FACTORS[-1] or (now > _NO_GAIN * off and now < inf):
            return None
        least = _reach(before, off, factor, now) if _smooth(data) else factor
        before, off = factor, now
        k = bisect_left(_FACTORS, max(least, _GROWTH * factor))
        k = min(k, len(_FACTORS) - 1)
    least = max(_WHOLE * least, before)  # whole seconds lengthen a little more than was asked
    failed = bisect_left(_FACTORS, least) - (before < least)
    return _shortest(settings, data, wanted, (failed, k), trial) if k else trial


def _reach(before: float, off: float, factor: float, now: float) -> float:
    """The least length at which what is off by `now` at `factor` can pass.

    `off` was at `before`. What is off falls ever more slowly: noise averages out, and what does
    not average remains. So no length passes that the slope between these two does not reach.
    """
    if not (before and off < inf and now > 1.0):
        return factor
    slope = log(off / now) / log(factor / before)
    return factor * exp(log(now) / slope)


def _smooth(data: Data) -> bool:
    """Whether all lengths go with the factor: turns are whole, and go in steps."""
    return not any("turns" in step for step in data["step"])


def _shortest(
    settings: Settings, data: Data, wanted: Sequence[str], ends: tuple[int, int], best: _Trial
) -> _Trial:
    """The shortest that passes between factors of which the first fails and the last passes."""
    failed, passed = ends
    while passed - failed > 1:
        middle = (failed + passed) // 2
        trial = _tried(settings, _stretched(data, _FACTORS[middle]))
        if trial is not None and _passes(trial.result, wanted):
            best, passed = trial, middle
        else:
            failed = middle
    return best


def _tried(settings: Settings, data: Data) -> _Trial | None:
    """A fresh rehearsal of a changed procedure; None where its numbers are not allowed."""
    text = toml_of(data)
    source = catalogue.Source(settings.procedure.id, settings.procedure.name, text)
    try:
        procedure = procedure_from(source)
    except StandError:
        return None
    result = rehearse(with_procedure(settings, procedure), judged_only=True)
    return _Trial(data, text, result) if result.feasible else None


def _passes(result: Rehearsal, wanted: Sequence[str]) -> bool:
    return all(j.verdict is Verdict.PASS for j in result.judgements if j.quantity in wanted)


def _worst(result: Rehearsal, wanted: Sequence[str]) -> float:
    """How far the worst of what is wanted is off, as a part of what would pass."""
    open_ones = [
        j for j in result.judgements if j.quantity in wanted and j.verdict is not Verdict.PASS
    ]
    return max(
        (inf if j.expanded is None else j.expanded * (1 + j.guard) / j.required for j in open_ones),
        default=0.0,
    )


# --- variants ------------------------------------------------------------------------------------


def _variants(data: Data, settings: Settings) -> Iterator[Data]:
    yield data
    for change in (_both_directions, _slower, _second_turn, _longer_window, _added_position):
        varied = deepcopy(data)
        if change(varied):
            yield varied
    if any(ESTIMATORS[m].azimuth_matters for m in data["estimate"]["methods"]):
        for azimuth in _AZIMUTHS:
            varied = deepcopy(data)
            if _turned(varied, azimuth):
                yield varied


def _turning(data: Data) -> list[Data]:
    return [step for step in data["step"] if step["kind"] in ("rate", "sweep")]


def _both_directions(data: Data) -> bool:
    one_way = [step for step in _turning(data) if step.get("directions", "one") == "one"]
    for step in one_way:
        step["directions"] = "both"
    return bool(one_way)


def _slower(data: Data) -> bool:
    steps = [step for step in _turning(data) if step["kind"] == "rate"]
    for step in steps:
        step["rate_deg_s"] /= 2
    return bool(steps)


def _second_turn(data: Data) -> bool:
    steps = [step for step in _turning(data) if "turns" in step]
    for step in steps:
        step["turns"] *= 2
    return bool(steps)


def _longer_window(data: Data) -> bool:
    """Zero offsets over half of the shortest dwell."""
    estimate = data["estimate"]
    if not any(ESTIMATORS[m].needs_offset for m in estimate["methods"]):
        return False
    lengths = [step["duration_s"] for step in data["step"] if step["kind"] == "dwell"]
    half = min(lengths, default=0.0) / 2
    if half <= estimate.get("offset_window_s", 10.0):
        return False
    estimate["offset_window_s"] = half
    return True


def _added_position(data: Data) -> bool:
    """Half a turn after the last dwell and the same dwell once more, fitted together."""
    dwells = [k for k, step in enumerate(data["step"]) if step["kind"] == "dwell"]
    if not dwells or data.get("background"):
        return False
    last = data["step"][dwells[-1]]
    angle = 180.0
    for step in data["step"][: dwells[-1]]:
        angle = 180.0 + step.get("joints_deg", {}).get(_AXIS, angle - 180.0)
    if any("attitude_deg" in step for step in data["step"][: dwells[-1]]):
        return False  # where the outer axis then stands is for the planner to say
    labels = {step["label"] for step in data["step"]}
    name = next(n for k in range(2, 99) if (n := f"{last['label']} turned {k}") not in labels)
    move = {"kind": "move", "label": f"to {name}", "joints_deg": {_AXIS: angle}}
    data["step"] = [
        *data["step"][: dwells[-1] + 1],
        move,
        {**last, "label": name},
        *data["step"][dwells[-1] + 1 :],
    ]
    methods = data["estimate"]["methods"]
    fitting = [m for m in ESTIMATORS if ESTIMATORS[m].fits_positions]
    if data.get("require", {}).get("method") is None and not set(fitting) & set(methods):
        data["estimate"]["methods"] = [*methods, fitting[0]]
    return True


def _turned(data: Data, azimuth: float) -> bool:
    """Everything begins at another azimuth of the outer axis."""
    if any("attitude_deg" in step for step in data["step"]):
        return False
    for step in data["step"]:
        if _AXIS in step.get("joints_deg", {}):
            step["joints_deg"][_AXIS] += azimuth
    labels = {step["label"] for step in data["step"]}
    name = f"to azimuth {azimuth:g}"
    while name in labels:
        name += " first"
    first = {"kind": "move", "label": name, "joints_deg": {_AXIS: azimuth}}
    data["step"] = [first, *data["step"]]
    return True


def _stretched(data: Data, factor: float) -> Data:
    """Every dwell and turn longer, in whole seconds and turns; offset windows along with them."""
    if factor == 1.0:
        return data
    longer = deepcopy(data)
    for step in longer["step"]:
        if step["kind"] in ("dwell", "rate", "sweep"):
            for key in ("duration_s", "turns"):
                if key in step:
                    step[key] = float(ceil(step[key] * factor))
    estimate = longer["estimate"]
    if estimate.get("offset_window_s", 10.0) > 10.0:
        estimate["offset_window_s"] *= factor
    return longer


# --- words ---------------------------------------------------------------------------------------


def _advice_of(quantity: str, before: Data, trial: _Trial) -> Advice:
    changes = tuple(_changes(before, trial.data))
    judged = _judged(trial.result.judgements, quantity)
    duration = trial.result.duration.total
    assert judged.sigma is not None
    told = f" beside a bias of {_told(judged, judged.bias)}" if judged.bias else ""
    text = (
        f"{'; '.join(_in_words(change) for change in changes)}: {quantity} then has a sigma of "
        f"{_told(judged, judged.sigma)}{only(judged.noise_only)}{told} by {judged.method}, "
        f"in {duration:.0f} s"
    )
    return Advice(
        quantity=quantity,
        text=text,
        changes=changes,
        sigma=judged.sigma,
        duration=duration,
        toml=trial.text,
        noise_only=judged.noise_only,
    )


def _told(judged: Judgement, value: float) -> str:
    """A value [SI] in the unit of what is judged."""
    return f"{value / judged.per:.3g} {judged.unit}"


def _judged(judgements: Sequence[Judgement], quantity: str) -> Judgement:
    return next(j for j in judgements if j.quantity == quantity)


def _in_words(change: Change) -> str:
    if not change.before:
        return f"add {change.where}: {change.after}"
    return f"{change.where}: {change.after} instead of {change.before}"


def _nothing(quantity: str, before: Data, tried: Sequence[_Trial]) -> Advice:
    """What stands in the way of the best that was tried, and how far that went."""

    def off(trial: _Trial) -> tuple[bool, float, float]:
        judged = _judged(trial.result.judgements, quantity)
        size = judged.beyond if judged.expanded is None else judged.expanded
        return judged.expanded is None, size, trial.result.duration.total

    best = min(tried, key=off)
    judged = _judged(best.result.judgements, quantity)
    longest = max(trial.result.duration.total for trial in tried)
    text = (
        f"none of {len(tried)} procedures tried, up to {_MOST:g} times as long ({longest:.0f} s), "
        f"reaches {judged.required / judged.per:g} {judged.unit} with coverage "
        f"{judged.coverage:g}: {_in_the_way(best.result, judged)}"
    )
    changed = "; ".join(_in_words(change) for change in _changes(before, best.data))
    reached = ""
    if judged.expanded is not None:
        reached = f" to {_told(judged, judged.expanded)}{only(judged.noise_only)}"
    better = f" in the best, which comes{reached} in {best.result.duration.total:.0f} s ({changed})"
    text += better if changed else ""
    return Advice(quantity=quantity, text=text, changes=(), sigma=None, duration=None)


def _in_the_way(result: Rehearsal, judged: Judgement) -> str:
    """The largest part of what a judgement is of."""
    rows = rows_of(judged.quantity, (p for p in result.predictions if p.method == judged.method))
    worst = next((p for p in rows if p.label == judged.label), None)
    first = judged.reason.partition("; ")[0]  # what it cannot be told from follows
    what = f"{judged.method}, {first}," if first else "the errors of the unit"
    if worst is not None and worst.contributions:
        first = worst.contributions[0]
        what = f"{first.source} ({first.sigma / worst.per:.3g} {worst.unit})"
    return f"{what} stands in the way"


def _changes(before: Data, after: Data) -> Iterator[Change]:
    """What differs, told by step and key; steps that were added as a whole."""
    for part in ("estimate",):
        yield from _differences(part, before[part], after[part])
    labels, known = {step["label"] for step in before["step"]}, iter(before["step"])
    for number, step in enumerate(after["step"], start=1):
        where = f'step {number} "{step["label"]}"'
        if step["label"] in labels:  # in their order; those that are added have labels of their own
            yield from _differences(where, next(known), step)
        else:
            what = ", ".join(f"{k} = {_shown(v)}" for k, v in step.items() if k != "label")
            yield Change(where, "", what)


def _differences(
    where: str, before: Mapping[str, Any], after: Mapping[str, Any]
) -> Iterator[Change]:
    for key, value in after.items():
        if before.get(key) != value:
            old = _shown(before[key]) if key in before else "the default"
            yield Change(f"{where}, {key}", old, _shown(value))


def _shown(value: Any) -> str:
    if isinstance(value, float | int):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_shown(v)}" for k, v in value.items())
    return ", ".join(map(_shown, value)) if isinstance(value, list | tuple) else str(value)
