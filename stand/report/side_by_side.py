"""Two recordings of one procedure beside each other, as tables."""

from collections.abc import Collection

import numpy as np

from alignment import AttitudeEstimate
from alignment.options import of_noise_alone
from alignment.units import DEG, DEG_PER_HOUR, DEG_PER_RT_HOUR, M_S_PER_RT_HOUR, MILLI_G
from stand.evaluation.side_by_side import EstimatePair, SideBySide
from stand.report.document import UNDETERMINED, method_text, number, refusal_lines, sigma_text
from stand.report.tables import TableData
from stand.samples import CHANNELS

_SENSORS = ("gyros", "accelerometers")
LEAST = 1e-9  # deg: below it is rounding
BEYOND = 3.0  # sigmas: marked
_MEAN_UNITS = (*[("deg/h", DEG_PER_HOUR)] * 3, *[("mg", MILLI_G)] * 3)
_NOISE_UNITS = (("deg/rt-h", DEG_PER_RT_HOUR), ("m/s/rt-h", M_S_PER_RT_HOUR))


def tables(found: SideBySide) -> list[TableData]:
    """Estimates, means per stretch, noise."""
    told = [_estimates(found)] if found.estimates else []
    return [*told, _means(found), _noise(found)]


def headline(found: SideBySide) -> str:
    """What is A and what is B."""
    return f"A: {found.a.path}; B: {found.b.path}"


def remarks(found: SideBySide) -> list[str]:
    """How they were matched; methods without an answer."""
    return [*found.notes, *refusal_lines(found.refusals)]


def _estimates(found: SideBySide) -> TableData:
    rows = tuple(
        (
            method_text(e.a.method, e.a.window),
            e.a.label,
            *(_angle(e, k) for k in range(3)),
            *(_off(e, k, found.noise_only) for k in range(3)),
        )
        for e in found.estimates
    )
    names = ("roll", "yaw", "pitch")
    columns = ("method", "position", *(f"{n} A, B" for n in names))
    offs = tuple(f"B - A about {axis}" for axis in ("north", "east", "down"))
    notes = (
        "B - A: the small rotation from A's attitude to B's; ±: both sigmas in quadrature, "
        f"as if nothing were common to both; !: beyond {BEYOND:g} of them",
    )
    title = "estimates [deg]"
    return TableData(title, (*columns, *offs), rows, notes=notes, optional=columns[2:])


def _angle(e: EstimatePair, k: int) -> str:
    shown = [_shown(one, k) for one in (e.a, e.b)]
    return UNDETERMINED if shown == [UNDETERMINED] * 2 else ", ".join(shown)


def _shown(e: AttitudeEstimate, k: int) -> str:
    value = np.nan if e.angles is None else e.angles[k]
    return UNDETERMINED if np.isnan(value) else f"{value / DEG + 0.0:.3f}"


def _off(e: EstimatePair, k: int, noise_only: Collection[str]) -> str:
    if e.undetermined[k]:
        return UNDETERMINED
    value = e.off[k] / DEG if abs(e.off[k]) > LEAST * DEG else 0.0
    if e.sigmas is None:
        return number(value)
    alone = of_noise_alone("heading" if k == 2 else "tilt", noise_only)
    sigma = sigma_text(e.sigmas[k] / DEG, alone)
    return f"{_marked(number(value), e.off[k], e.sigmas[k])} {sigma}"


def _marked(text: str, value: float, sigma: float) -> str:
    return f"! {text}" if abs(value) > BEYOND * sigma else text


def _means(found: SideBySide) -> TableData:
    rows = []
    for s in found.stretches:
        sigmas = np.sqrt(s.variances.sum(axis=0))
        for k, channel in enumerate(CHANNELS):
            unit, si = _MEAN_UNITS[k]
            (a, b), sigma = s.means[:, k] / si, sigmas[k] / si
            off = _marked(f"{b - a:+.4g}", b - a, sigma)
            cells = (f"{a:.5g}", f"{b:.5g}", f"{off} ± {sigma:.2g}", unit)
            rows.append((s.label if not k else "", channel, *cells))
    columns = ("stretch", "channel", "mean A", "mean B", "B - A", "unit")
    notes = ("±: of the noise of both means; !: beyond 3 of them, as biases of two units are",)
    return TableData("means per stretch", columns, tuple(rows), notes=notes)


def _noise(found: SideBySide) -> TableData:
    rows = []
    for s in found.stretches:
        for j, (sensor, (unit, si)) in enumerate(zip(_SENSORS, _NOISE_UNITS, strict=True)):
            a, b = np.sqrt(np.mean(s.densities[:, 3 * j : 3 * j + 3] ** 2, axis=1)) / si
            ratio = f"{b / a:.3g}" if a > 0 else ""
            rows.append((s.label if not j else "", sensor, f"{a:.3g}", f"{b:.3g}", ratio, unit))
    columns = ("stretch", "sensor", "noise A", "noise B", "B / A", "unit")
    notes = (
        "noise: below twenty periods of the stretch, mean square of three axes; of equal units the "
        "ratio is 1 within about 15 % (1 sigma)",
    )
    return TableData("noise per stretch", columns, tuple(rows), notes=notes)
