"""What is required against what is predicted: the verdict, by guard band."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from alignment import ESTIMATORS
from alignment.units import DEG
from stand.procedure.procedure import RequireEntry
from stand.procedure.requirements import CONSTANTS
from stand.rehearsal.result import Judgement, Prediction, Verdict


def judge(
    require: RequireEntry | None,
    limits: dict[str, float],
    methods: Sequence[str],
    predictions: Sequence[Prediction],
    floors: Mapping[str, Callable[[], Mapping[str, float]]] | None = None,
) -> list[Judgement]:
    """One judgement per quantity that is limited [SI].

    `floors` by method: sigmas of a unit's constants that seat, table and gravity leave of the best
    unit. Each method counts by the stretch in which it is worst; it is judged by the best of them,
    or by the one that is asked for.
    """
    if require is None:
        return []
    finding = [m for m in methods if not ESTIMATORS[m].carries_nominal] or methods
    asked = finding if require.method is None else [require.method]
    found = []
    for quantity, limit in limits.items():
        constant = quantity in CONSTANTS
        own = methods if constant and require.method is None else asked
        judged = _judged(require, quantity, limit, own, predictions)
        if constant and floors and judged.method and judged.verdict is Verdict.FAIL:
            judged = _by_floor(judged, floors[judged.method]())
        found.append(judged)
    return found


def _by_floor(j: Judgement, floors: Mapping[str, float]) -> Judgement:
    """The same, refused where no unit and no time on this table could keep it."""
    floor = floor_of(j.quantity, floors)
    if j.coverage * floor <= j.required:
        return j
    reason = (
        f"{floor_text(j.quantity, floor, j.coverage)}: no unit and no longer test on this table "
        f"keeps {j.required / j.per:.3g}"
    )
    return replace(j, reason=reason, refused=True)


def floor_of(quantity: str, floors: Mapping[str, float]) -> float:
    """The sigma [SI] of a constant's worst axis, of the floors of all."""
    names = CONSTANTS[quantity].rows
    return max((sigma for name, sigma in floors.items() if name.startswith(names)), default=0.0)


def floor_text(quantity: str, floor: float, coverage: float) -> str:
    """In words."""
    unit, per = CONSTANTS[quantity].unit
    leave = f"{coverage * floor / per:.3g} {unit} (k = {coverage:g})"
    return f"seat, table and gravity alone leave {leave}"


def rows_of(quantity: str, predictions: Iterable[Prediction]) -> list[Prediction]:
    """Predictions of a quantity; a vertical X1 has a yaw for its heading."""
    if quantity in CONSTANTS:
        return [p for p in predictions if p.quantity.startswith(CONSTANTS[quantity].rows)]
    names = ("heading", "yaw") if quantity == "heading" else (quantity,)
    return [p for p in predictions if p.quantity in names]


def _judged(
    require: RequireEntry,
    quantity: str,
    limit: float,
    methods: Sequence[str],
    predictions: Sequence[Prediction],
) -> Judgement:
    told_in = CONSTANTS[quantity].unit if quantity in CONSTANTS else ("deg", DEG)
    worst: list[Prediction] = []
    for method in methods:
        rows = rows_of(quantity, (p for p in predictions if p.method == method))
        if rows:
            worst.append(max(rows, key=lambda p: p.rank))
    if not worst:
        return Judgement(
            quantity=quantity,
            method="",
            label="",
            required=limit,
            coverage=require.coverage,
            sigma=None,
            guard=require.guard,
            verdict=Verdict.INDETERMINATE,
            reason=f"no method of this procedure tells {quantity}",
            unit=told_in[0],
            per=told_in[1],
        )
    best = min(worst, key=lambda p: p.rank)
    verdict = _verdict(best.rms, limit, require)
    return Judgement(
        quantity=quantity,
        method=best.method,
        label=best.label,
        required=limit,
        coverage=require.coverage,
        sigma=best.sigma,
        guard=require.guard,
        verdict=verdict,
        reason=best.reason,
        bias=best.bias,
        beyond=best.beyond,
        noise_only=best.noise_only,
        unit=told_in[0],
        per=told_in[1],
    )


def _verdict(rms: float | None, limit: float, require: RequireEntry) -> Verdict:
    """A prediction may be off by `guard` either way: only beyond that is there a verdict."""
    if rms is None:
        return Verdict.FAIL
    expanded = require.coverage * rms
    if expanded * (1 + require.guard) <= limit:
        return Verdict.PASS
    return Verdict.FAIL if expanded * (1 - require.guard) > limit else Verdict.INDETERMINATE
