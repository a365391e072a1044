"""A calibration as tables for a terminal, a notebook and its page."""

from collections.abc import Sequence

from alignment.calibration import Derived, Parameter
from alignment.units import ARC_SECOND
from stand.calibration.file import CalibrationRecord
from stand.calibration.units import AXES, OF_NUISANCE, unit_of
from stand.imu.priors import only
from stand.report.tables import TableData

LEAST_PART = 0.01  # of a sigma, below which a contribution is left blank
BASES = {"data": "readings", "prior": "before", "both": "both"}
QUANTITIES = {
    "rotation": "rotation of the triad about",
    "non_orthogonality": "axes lean together about",
    "gyro_to_accel": "gyros against accelerometers about",
}


def number(value: float, sigma: float) -> str:
    """A value to the second digit of its sigma."""
    if not sigma > 0:
        return f"{value:.6g}"
    exponent = int(f"{sigma:e}".partition("e")[2])
    digits = min(max(0, 1 - exponent), 12)
    return f"{round(value, digits) + 0.0:.{digits}f}"  # no -0.0


def size(sigma: float) -> str:
    """An uncertainty to its second digit, written out."""
    return number(sigma, sigma)


def prior(sigma: float) -> str:
    """What was known beforehand, to three digits, written out."""
    if sigma == float("inf"):
        return "nothing"
    return f"{sigma:.0f}" if sigma >= 1000 else f"{sigma:.3g}"


def name_of(record: CalibrationRecord) -> str:
    """The unit by what is known of it: title, id, or the recording."""
    return (
        record.unit.get("title")
        or record.unit.get("id")
        or record.source.get("recording", "a unit")
    )


def headline(record: CalibrationRecord) -> str:
    """What it is, in one line."""
    c = record.calibration
    serial = f", serial {record.unit['serial']}" if record.unit.get("serial") else ""
    return (
        f"Calibration of {name_of(record)}{serial}: {len(c.parameters)} parameters, "
        f"chi-square {c.chi_square:.0f} of {c.dof}"
    )


def remarks(record: CalibrationRecord) -> list[str]:
    """What must be known of the numbers."""
    c = record.calibration
    return [
        *c.notes,
        *(f"not told: {line}" for line in c.null_space),
        *(f"left out: {one.stretch}: {one.reason}" for one in c.left_out),
    ]


def tables(record: CalibrationRecord) -> list[TableData]:
    """Gyros, accelerometers, the angles that misalignments come to, and what else was found."""
    found = [
        parameter_table(record, sensor, title)
        for sensor, title in (("gyro", "gyros"), ("accel", "accelerometers"))
    ]
    return [
        table for table in (*found, derived_table(record), nuisance_table(record)) if table.rows
    ]


def parameter_table(record: CalibrationRecord, sensor: str, title: str) -> TableData:
    """One row per parameter of a triad, in its unit."""
    c, known = record.calibration, record.errors
    rows = [
        _row(p, None if known is None else known[n], p.key.sensor in record.noise_only)
        for n, p in enumerate(c.parameters)
        if p.key.sensor == sensor
    ]
    columns = ("parameter", "value", "sigma", "unit", "known before", "told by")
    return TableData(
        f"{title}: what the unit does to the truth",
        columns if known is None else (*columns, "error"),
        tuple(rows),
    )


def _row(p: Parameter, error: float | None, noise_only: bool) -> tuple[str, ...]:
    unit, si = unit_of(p.key)
    sigma = p.sigma / si
    cells = (
        named(p),
        number(p.value / si, sigma),
        size(sigma) + only(noise_only),
        unit,
        prior(p.prior_sigma / si),
        BASES[p.basis],
    )
    return cells if error is None else (*cells, number(error / si, sigma))


def named(p: Parameter) -> str:
    """A parameter within the table of its triad."""
    key = p.key
    toward = "" if key.toward is None else f" toward {AXES[key.toward]}"
    return f"{key.term.replace('_', ' ')} {AXES[key.axis]}{toward}"


def of_noise_alone(d: Derived, record: CalibrationRecord) -> bool:
    """Whether an angle of a triad, or between both, has a sigma of noise alone."""
    of_both = d.quantity == "gyro_to_accel"
    return bool(record.noise_only) if of_both else d.sensor in record.noise_only


def derived_table(record: CalibrationRecord) -> TableData:
    """Angles that the misalignments come to."""
    rows = [
        (
            f"{d.sensor}: {QUANTITIES[d.quantity]} {AXES[d.axis]}",
            number(d.value / ARC_SECOND, d.sigma / ARC_SECOND),
            size(d.sigma / ARC_SECOND) + only(of_noise_alone(d, record)),
        )
        for d in record.calibration.derived
    ]
    return TableData("angles of the triads", ("angle", "value arcsec", "sigma"), tuple(rows))


def nuisance_table(record: CalibrationRecord) -> TableData:
    """What had to be estimated beside the unit."""
    rows = []
    of_noise = tuple(f"mean {sensor} bias" for sensor in record.noise_only)
    for n in record.calibration.nuisance:
        unit, si = OF_NUISANCE[n.unit]
        sigma = n.sigma / si
        rows.append(
            (
                n.name,
                number(n.value / si, sigma),
                size(sigma) + only(n.name.startswith(of_noise)),
                unit,
                prior(n.prior_sigma / si),
                BASES[n.basis],
            )
        )
    columns = ("what else", "value", "sigma", "unit", "known before", "told by")
    return TableData("estimated beside the unit", columns, tuple(rows))


def budget_table(record: CalibrationRecord) -> TableData:
    """What each source gives to the sigma of each parameter, in its unit."""
    c = record.calibration
    rows = []
    for n, p in enumerate(c.parameters):
        unit, si = unit_of(p.key)
        parts = [
            size(one.sigmas[n] / si) if one.sigmas[n] > LEAST_PART * p.sigma else ""
            for one in c.budget
        ]
        sigma = size(p.sigma / si) + only(p.key.sensor in record.noise_only)
        rows.append((f"{p.key.sensor} {named(p)}", *parts, sigma, unit))
    columns = ("parameter", *(one.name for one in c.budget), "sigma", "unit")
    notes = ("Their squares add up; what gives less than a hundredth of a sigma is left blank.",)
    return TableData("where each sigma comes from", columns, tuple(rows), notes=notes)


def all_tables(record: CalibrationRecord) -> Sequence[TableData]:
    """The tables, with the budget."""
    more = [budget_table(record)] if record.calibration.budget else []
    return [*tables(record), *more]
