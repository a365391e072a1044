"""What is required against what is predicted: the verdict, by guard band."""

from collections.abc import Iterable, Sequence

from alignment import ESTIMATORS
from stand.procedure.procedure import RequireEntry
from stand.rehearsal.result import Judgement, Prediction, Verdict


def judge(
    require: RequireEntry | None,
    limits: dict[str, float],
    methods: Sequence[str],
    predictions: Sequence[Prediction],
) -> list[Judgement]:
    """One judgement per quantity that is limited [rad].

    Each method counts by the stretch in which it is worst; it is judged by the best of them, or
    by the one that is asked for.
    """
    if require is None:
        return []
    finding = [m for m in methods if not ESTIMATORS[m].carries_nominal] or methods
    asked = finding if require.method is None else [require.method]
    return [
        _judged(require, quantity, limit, asked, predictions) for quantity, limit in limits.items()
    ]


def rows_of(quantity: str, predictions: Iterable[Prediction]) -> list[Prediction]:
    """Predictions of a quantity; a vertical X1 has a yaw for its heading."""
    names = ("heading", "yaw") if quantity == "heading" else (quantity,)
    return [p for p in predictions if p.quantity in names]


def _judged(
    require: RequireEntry,
    quantity: str,
    limit: float,
    methods: Sequence[str],
    predictions: Sequence[Prediction],
) -> Judgement:
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
    )


def _verdict(rms: float | None, limit: float, require: RequireEntry) -> Verdict:
    """A prediction may be off by `guard` either way: only beyond that is there a verdict."""
    if rms is None:
        return Verdict.FAIL
    expanded = require.coverage * rms
    if expanded * (1 + require.guard) <= limit:
        return Verdict.PASS
    return Verdict.FAIL if expanded * (1 - require.guard) > limit else Verdict.INDETERMINATE
