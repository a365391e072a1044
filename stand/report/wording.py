"""A rehearsal's numbers in words and with units, for the page and for build servers."""

from __future__ import annotations

from math import isfinite

from alignment.units import ARC_SECOND, DEG
from stand.evaluation.statistics import TAIL
from stand.imu.priors import only
from stand.rehearsal.result import Judgement, Margin, Prediction
from stand.rehearsal.verification import AGREES, Achieved, Refused, Verification

_ARC_SECONDS_BELOW = 0.01 * DEG


def digits(value: float) -> str:
    """Three digits, or all of those before the point: '0.0123', '1.5', '1234'."""
    if not isfinite(value):
        return "unlimited"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def deg_text(angle: float) -> str:
    """An angle [rad] in degrees, small ones with their arc seconds."""
    if abs(angle) >= _ARC_SECONDS_BELOW or angle == 0:
        return f"{digits(angle / DEG)}°"
    return f"{digits(angle / DEG)}° ({digits(angle / ARC_SECOND)}″)"


def sigma_text(sigma: float | None, per: float, unit: str, noise_only: bool = False) -> str:
    """A predicted sigma [SI] in the unit it is told in."""
    if sigma is None:
        return "not determined"
    return f"{digits(sigma / per)} {unit}{only(noise_only)}"


def predicted_text(p: Prediction) -> str:
    """A predicted sigma, and where there is a bias also that and both in quadrature."""
    told = sigma_text(p.sigma, p.per, p.unit, p.noise_only)
    if p.rms is None or not shows_bias(p):
        return told
    return f"{told}, bias {digits(p.bias / p.per)}: {digits(p.rms / p.per)} rms"


def shows_bias(p: Prediction) -> bool:
    """Whether a bias is more than a thousandth of the sigma beside it."""
    return p.sigma is not None and abs(p.bias) > 1e-3 * p.sigma


def ratio_text(ratio: tuple[float, float, float]) -> str:
    """A ratio with the ends of its interval: '0.98 (0.84 to 1.12)'."""
    value, low, high = (f"{x:.2f}" if 0.1 <= x < 10 else digits(x) for x in ratio)
    return f"{value} ({low} to {high})"


def achieved_text(a: Achieved) -> str:
    """An achieved sigma with its interval, in the unit it is told in."""
    sigma, low, high = (digits(x / a.per) for x in (a.sigma, a.low, a.high))
    return f"{sigma} ({low} to {high}) {a.unit}"


def achieved_in_words(a: Achieved) -> str:
    """One sentence of a prediction beside what runs came to."""
    predicted = sigma_text(a.predicted, a.per, a.unit, a.noise_only)
    told = f"predicted {predicted}, achieved {achieved_text(a)} in {runs_text(a.runs)}"
    if a.ratio is None:
        return told
    verdict = "agrees" if a.agrees else f"misses {AGREES[0]:g} to {AGREES[1]:g}"
    if a.agrees and not a.agrees_alone:
        verdict += ", though not by its own interval alone"
    return f"{told}; ratio {ratio_text(a.ratio)} {verdict}"


def chance_text(v: Verification) -> str:
    """How many plain intervals miss, and how many are to by chance alone."""
    compared = sum(a.ratio is not None for a in v.achieved)
    return (
        f"{len(v.missing_alone)} of {compared} plain 95 % intervals miss {AGREES[0]:g} to "
        f"{AGREES[1]:g}; chance makes up to {2 * TAIL * compared:.2g} of them miss"
    )


def refused_in_words(r: Refused, done: int) -> str:
    """One sentence of a method that gave no answer in some of the runs that were done."""
    return f"{r.who} gave no answer in {r.runs} of {runs_text(done)}: {r.reason}"


def runs_text(n: int) -> str:
    """'1 run', '60 runs'."""
    return "1 run" if n == 1 else f"{n} runs"


def limit_text(j: Judgement, value: float) -> str:
    """A value [SI] of what is judged, in its unit."""
    return deg_text(value) if j.unit == "deg" else f"{digits(value / j.per)} {j.unit}"


def judged_in_words(j: Judgement) -> str:
    """One sentence of a requirement: what is asked, what is predicted, by what, and why not."""
    asked = f"{j.quantity} within {limit_text(j, j.required)} (k = {j.coverage:g})"
    where = " of ".join(part for part in (j.method, f'"{j.label}"' if j.label else "") if part)
    found = "not determined"
    if j.expanded is not None:
        found = f"predicted {limit_text(j, j.expanded)}{only(j.noise_only)}"
    told = f"{j.verdict.value}: {asked}; {found}" + (f" by {where}" if where else "")
    return f"{told}; {j.reason}" if j.reason else told


def margin_in_words(m: Margin) -> str:
    """One sentence of a limit: how much of it is used, by what and when."""
    name = " ".join(part for part in (m.axis, m.quantity) if part)
    told = f"{name} {digits(m.value)} of {digits(m.limit)} {m.unit} ({percent(m.ratio)})"
    if m.first_violation is not None:
        return f"{told}, first beyond it at {m.first_violation:.3f} s"
    return told if m.t is None else f"{told} at {m.t:.3f} s"


def percent(ratio: float) -> str:
    """A part of a limit: '52 %', '0.4 %'."""
    if not isfinite(ratio):
        return "beyond it"
    value = 100 * ratio
    return f"{value:.0f} %" if value >= 9.5 or value == 0 else f"{value:.2g} %"
