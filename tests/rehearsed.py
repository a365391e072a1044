"""A rehearsal's answer written by hand: what its report must show."""

from dataclasses import replace
from math import pi, sqrt

from stand.rehearsal.result import (
    Advice,
    Change,
    Contribution,
    Duration,
    Finding,
    Inputs,
    Judgement,
    Margin,
    Observability,
    Prediction,
    Rehearsal,
    Severity,
    StepDuration,
    StepFeasibility,
    Verdict,
)
from stand.rehearsal.verification import Achieved, Refused, Verification

DEG = pi / 180
DEG_H = DEG / 3600

PROCEDURE = """title = "Two positions"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad", "two-position"]
[require]
heading_deg = 0.1
[[step]]
kind = "dwell"
label = "first"
duration_s = 296
"""

STEPS = (
    ("dwell", "first", 0.0, 296.0, 0.0, 0.0, 296.0, 0.0),
    ("move", "half a turn", 296.0, 304.0, 7.2, 0.6, 0.0, pi),
    ("dwell", "second", 304.0, 600.0, 0.0, 1.1, 294.9, pi),
)


def margins(broken: bool) -> tuple[Margin, ...]:
    rate, first = (320.0, 296.75) if broken else (30.0, None)
    return (
        Margin("rate", "outer", rate, 300.0, "deg/s", rate / 300, 297.1, first),
        Margin("acceleration", "outer", 30.0, 200.0, "deg/s^2", 0.15, 296.4),
        Margin("torque", "outer", 12.5, 100.0, "N m", 0.125, 296.4),
        Margin("sensor rate", "gyro Y1", 30.0, 400.0, "deg/s", 0.075, 297.1),
    )  # fmt: skip


def prediction(method, label, quantity, unit, per, *parts) -> Prediction:
    """`parts`: (source, size in `unit`); they add up in quadrature."""
    total = sqrt(sum(size**2 for _, size in parts)) * per
    made_of = tuple(Contribution(source, size * per) for source, size in parts)
    return Prediction(method, "", label, quantity, unit, per, total, made_of)


def answer(
    verdict: Verdict = Verdict.FAIL, title: str = "Two positions, 180 degrees apart"
) -> Rehearsal:
    """A whole answer whose heading has `verdict`; FAIL has advice, and a broken limit.

    CONTRADICTED by runs that are set beside it.
    """
    if verdict is Verdict.CONTRADICTED:
        return verified(Verdict.PASS, heading=0.7)
    fails = verdict is Verdict.FAIL
    feasibility = tuple(
        StepFeasibility(
            number, kind, label, t_from, t_to,
            margins(fails and kind == "move") if kind == "move" else
            (Margin("angle", "outer", joint / DEG, float("inf"), "deg", 0.0),
             Margin("sampling", "", 59200.0, 3.0, "samples", 3 / 59200)),
            1.1 if settling else None, {}, (0.0, 0.0, 0.0, joint, 0.0, 0.0),
        )
        for number, (kind, label, t_from, t_to, _, settling, _, joint) in enumerate(STEPS, start=1)
    )  # fmt: skip
    duration = Duration(
        tuple(
            StepDuration(number, kind, label, t_from, t_to, motion, settling, dwell)
            for number, (kind, label, t_from, t_to, motion, settling, dwell, _) in enumerate(
                STEPS, start=1
            )
        )
    )
    predictions = (
        prediction("triad", "first", "heading", "deg", DEG, ("turn-on bias", 1.9),
                   ("bias instability", 0.028), ("white noise", 0.047), ("table azimuth", 0.0083)),
        prediction("triad", "second", "pitch", "deg", DEG, ("turn-on bias", 0.0113),
                   ("white noise", 0.0004), ("table tilt", 0.0028)),
        prediction("two-position", "first", "heading", "deg", DEG, ("white noise", 0.0332),
                   ("bias instability", 0.0281), ("placement", 0.0014), ("table azimuth", 0.0083),
                   ("scale factor", 0.0121), ("lag", 0.0)),
        prediction("two-position", "first", "pitch", "deg", DEG, ("table tilt", 0.0028),
                   ("white noise", 0.0003)),
        prediction("two-position", "first", "gyro bias X1", "deg/h", DEG_H, ("white noise", 0.41),
                   ("bias instability", 0.3)),
        Prediction("two-position", "", "first", "roll", "deg", DEG, None, (),
                   "sigma above 10 deg: the estimator is no longer linear there"),
    )  # fmt: skip
    # two sigma of it are 0.0919 deg: 46, 102 and 184 % of these
    required = {Verdict.PASS: 0.2, Verdict.INDETERMINATE: 0.09, Verdict.FAIL: 0.05}[verdict]
    required, coverage = required * DEG, 2.0
    heading = predictions[2].sigma
    reason = {
        Verdict.PASS: "",
        Verdict.FAIL: "white noise of the gyros alone takes 0.066 deg of it",
        Verdict.INDETERMINATE: "within the guard band: the prediction may be 10 % off",
    }[verdict]
    judgements = (
        Judgement(
            "heading", "two-position", "first", required, coverage, heading, 0.1, verdict, reason
        ),
        Judgement(
            "pitch", "two-position", "first", 0.01 * DEG, 2.0, 0.0028 * DEG, 0.1, Verdict.PASS
        ),
    )  # fmt: skip
    advice = (
        Advice("heading", "Rest 418 s instead of 296 s in both positions.",
               (Change('step 1 "first", duration_s', "296", "418"),
                Change('step 3 "second", duration_s', "296", "418"),
                Change('step 4 "back"', "", "kind = move")),
               0.038 * DEG, 844.0, PROCEDURE.replace("296", "418")),
    )  # fmt: skip
    inputs = Inputs(
        "two-position", title, PROCEDURE, "stim300", "Safran STIM300, 10 g accelerometers",
        'title = "STIM300"\n', "mid-class", "Mid-class three-axis table on a rocking base",
        'title = "Mid-class"\n', 48.5, 0.0, 200, "B",
        {"procedure": "ab" * 32, "imu": "cd" * 32, "table": "ef" * 32, "model": "01" * 32},
        {"stand_version": "0.1.0", "python_version": "3.11.2", "numpy_version": "2.3.0"},
    )  # fmt: skip
    findings = (
        Finding(Severity.WARNING, "settling", "second", "the class states no settling time"),
    )  # fmt: skip
    observability = (
        Observability("triad", 3, 9, 1.4, (
            "level at rest, accelerometer X bias cannot be told from pitch",
            "gyro bias about east cannot be told from heading")),
        Observability("two-position", 5, 9, 310.0, (
            "accelerometer Y bias cannot be told from the size of gravity",)),
    )  # fmt: skip
    return Rehearsal(
        inputs, feasibility, duration, predictions, observability, judgements,
        advice if fails else (), findings,
    )  # fmt: skip


def infeasible() -> Rehearsal:
    """Meets what is required, but the table cannot do it."""
    made = answer(Verdict.PASS)
    broken = replace(made.feasibility[1], margins=margins(True))
    return replace(made, feasibility=(made.feasibility[0], broken, made.feasibility[2]))


RUNS = 400


def achieved(p: Prediction, ratio: float, wide: float = 0.07, label: str = "") -> Achieved:
    """What runs came to where `ratio` was predicted of it, known to the part `wide`.

    Where nothing was predicted, `ratio` is the number itself.
    """
    sigma = ratio * p.per if p.sigma is None else p.sigma / ratio
    return Achieved(
        p.method, p.window, label or p.label, p.quantity, p.unit, p.per, p.sigma, RUNS, sigma,
        sigma / (1 + wide), sigma / (1 - wide),
    )  # fmt: skip


def runs(heading: float = 0.96, done: int = RUNS, wide: float = 0.07) -> Verification:
    """Runs beside the answer; `heading` of two-position: predicted over achieved."""
    made = answer()
    *_, level, bias, roll = made.predictions
    compared = (
        achieved(made.predictions[0], 1.04, wide),
        achieved(made.predictions[0], 0.98, wide, "second"),
        achieved(made.predictions[2], heading, wide),
        achieved(level, 1.01, wide),
        achieved(bias, 1.05, wide, "all"),
        achieved(roll, 25.0),
    )
    refused = (Refused("two-position", 3, "not at rest: it turns at 0.2 deg/s"),)
    return Verification(RUNS, done, 7, 16.0, compared, refused)


def verified(verdict: Verdict = Verdict.PASS, heading: float = 0.96, done: int = RUNS) -> Rehearsal:
    """The answer with `runs` beside it, and the findings that come of them."""
    made, beside = answer(verdict), runs(heading, done)
    off = tuple(
        Finding(Severity.WARNING, "prediction", a.label, f"{a.quantity} was predicted otherwise")
        for a in beside.disagreeing
    )
    return replace(made, findings=(*made.findings, *off), verification=beside)
