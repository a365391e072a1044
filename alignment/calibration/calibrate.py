"""A unit's calibration from the stretches of one recording or several."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration import terms
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.design import Design
from alignment.calibration.fit import Fit, fitted
from alignment.calibration.model import AXES
from alignment.calibration.observe import Observed
from alignment.calibration.result import (
    Calibration,
    Contribution,
    Gravity,
    Nuisance,
    Residual,
    derived_of,
    nuisance_of,
    parameters_of,
)
from alignment.calibration.words import untold
from alignment.earth import Site


def calibrate(
    seen: Sequence[Observed],
    bench: Bench,
    site: Site,
    design: Design | None = None,
    reference_temperature: float = 25.0,
) -> Calibration:
    """The parameters of a unit from a test on a table.

    Parameters
    ----------
    seen : sequence of Observed
        One recording each, of one unit on one table.
    bench : Bench
        What is known beforehand.
    site : Site
        With its latitude; ``local_gravity`` where it was measured.
    design : Design, optional
        Of just these stretches, where it is known already: then only the solving is left.
    reference_temperature : float
        Of terms of temperature [deg C].

    Raises
    ------
    AlignmentError
        As `alignment.calibration.fit.fitted`.

    Notes
    -----
    Leading errors: the seat and the table in absolute misalignment, gravity in the accelerometers'
    scale factor, bias instability in the biases, noise in all else. All are in the covariance.
    """
    return assembled(fitted(seen, bench, site, design), reference_temperature)


def assembled(fit: Fit, reference_temperature: float = 25.0) -> Calibration:
    """A fit as its result: parameters, nuisances, what they cannot tell."""
    design = fit.design
    told = np.isin(np.arange(terms.COUNT), design.active)
    outside = terms.outside(told)
    rows = _rows(design, outside.matrix)
    growth = fit.growth
    covariance = growth**2 * rows @ design.covariance @ rows.T
    values = outside.matrix @ fit.x[: terms.COUNT]
    prior = np.sqrt(rows**2 @ design.sigmas**2)
    return Calibration(
        parameters=parameters_of(outside.keys, values, covariance, prior),
        covariance=(covariance + covariance.T) / 2,
        chi_square=fit.chi_square,
        dof=fit.dof,
        gravity=_gravity(fit),
        nuisance=(*_nuisances(fit), *_of_sessions(fit)),
        enlarged=growth,
        notes=_contradiction(fit),
        null_space=untold(design.origin),
        left_out=fit.left_out,
        derived=derived_of(outside.keys, values, covariance),
        residuals=tuple(_residuals(fit)),
        reference_temperature=reference_temperature,
    )


def _residuals(fit: Fit) -> Iterator[Residual]:
    """What every stretch and move is off from what all others say of it, in sigmas of that."""
    model, weight = fit.design.model, fit.design.weight
    off = weight @ fit.off / np.sqrt(weight.diagonal())
    for k, rows in enumerate(model.rows()):
        session = model.sessions[k]
        label = f"recording {k + 1}: " if len(model.sessions) > 1 else ""
        for station, own in zip(session.stations, rows, strict=False):
            name = f"{label}{station.stretch.label}"
            kinds = ("mean {} of turns", "{} once a turn", "{} once a turn")
            for of, values in zip(("rate", "force"), np.split(off[own], 2), strict=True):
                orders = kinds if station.stretch.rate else ("{} at rest",)
                for kind, three in zip(orders, values.reshape(-1, 3).tolist(), strict=True):
                    yield Residual(name, kind.format(of), tuple(three))
        for move, own in zip(session.moves, rows[len(session.stations) :], strict=True):
            yield Residual(f"{label}{move.label}", "rotation of moves", tuple(off[own].tolist()))


def with_budget(fit: Fit, calibration: Calibration) -> Calibration:
    """The same with what each source gives to every sigma."""
    design = fit.design
    outside = terms.outside(np.isin(np.arange(terms.COUNT), design.active))
    parts = design.contributions(_rows(design, outside.matrix))
    budget = [Contribution(name, fit.growth * sigmas) for name, sigmas in parts.items()]
    return replace(calibration, budget=tuple(one for one in budget if one.sigmas.any()))


def _rows(design: Design, matrix: Array) -> Array:
    """Rows (k, a) on the active unknowns of rows (k, COUNT) on those of the unit."""
    whole = np.zeros((len(matrix), design.model.count))
    whole[:, : terms.COUNT] = matrix
    return whole[:, design.active]


def _contradiction(fit: Fit) -> tuple[str, ...]:
    if not fit.contradicted:
        return ()
    return (
        f"the readings contradict one another: chi-square {fit.chi_square:.0f} for {fit.dof}: "
        f"every sigma is {fit.growth:.3g} times as large for it (another class of table than told, "
        "or errors that nobody stated)",
    )


def _gravity(fit: Fit) -> Gravity:
    site, unknowns = fit.design.model.site, fit.design.model.unknowns
    return Gravity(value=site.gravity, sigma=float(unknowns.sigmas[terms.COUNT]))


def _nuisances(fit: Fit) -> list[Nuisance]:
    design, unknowns = fit.design, fit.design.model.unknowns
    sigmas = fit.growth * np.sqrt(design.covariance.diagonal())
    found = []
    for at, sigma in zip(design.active.tolist(), sigmas.tolist(), strict=True):
        if at >= terms.COUNT:
            k = at - terms.COUNT
            prior = float(unknowns.sigmas[at])
            found.append(
                nuisance_of(unknowns.names[k], float(fit.x[at]), sigma, prior, unknowns.units[k])
            )
    return found


# --- the bias of a session -----------------------------------------------------------------------


def _of_sessions(fit: Fit) -> list[Nuisance]:
    """Mean bias of each recording: what was switched on, and its drift since, as it was on average.

    Notes
    -----
    The drift's mean is told by the readings too, with the bias and against it: their sum is known
    better than either.
    """
    design, model = fit.design, fit.design.model
    found = []
    for k in range(len(model.sessions)):
        label = f"recording {k + 1}: " if len(model.sessions) > 1 else ""
        for sensor, unit in zip(SENSORS, ("rad/s", "m/s^2"), strict=True):
            rows, mean = _bias_rows(design, k, sensor), _mean_rows(design, k, sensor)
            drift = _drift(design, sensor)
            through = mean @ drift
            alike = rows @ design.gain @ through.T
            covariance = (
                rows @ design.covariance @ rows.T
                + through @ mean.T
                - through @ design.weight @ through.T
                - alike
                - alike.T
            )
            values = rows @ fit.x[design.active] + through @ design.weight @ fit.off
            prior = np.sqrt(rows**2 @ design.sigmas**2 + (through @ mean.T).diagonal())
            sigmas = fit.growth * np.sqrt(np.maximum(covariance.diagonal(), 0.0))
            for axis, value, sigma, before in zip(
                AXES, values.tolist(), sigmas.tolist(), prior.tolist(), strict=True
            ):
                name = f"{label}mean {sensor} bias {axis}"
                found.append(nuisance_of(name, value, sigma, before, unit))
    return found


def _bias_rows(design: Design, k: int, sensor: str) -> Array:
    """Rows (3, a) of the bias as it was switched on in session k."""
    rows = np.zeros((3, design.model.count))
    rows[:, terms.columns_of(sensor, "bias")] = np.eye(3)
    name = f"recording {k + 1}: {sensor} bias X1"
    if name in design.model.unknowns.names:
        at = design.model.unknowns.at(name)
        rows[:, at : at + 3] = np.eye(3)
    return rows[:, design.active]


def _mean_rows(design: Design, k: int, sensor: str) -> Array:
    """Rows (3, m) that average the stations' constant readings of one triad, by their time."""
    model = design.model
    stations = model.sessions[k].stations
    lengths = np.array([s.stretch.span.length for s in stations])
    rows = np.zeros((3, len(design.J)))
    for own, weight in zip(model.rows()[k], lengths / lengths.sum(), strict=False):
        half = own[: len(own) // 2] if sensor == "gyro" else own[len(own) // 2 :]
        rows[np.arange(3), half[:3]] = weight
    return rows


def _drift(design: Design, sensor: str) -> Array:
    """Covariance (m, m) of the readings by what changes the bias."""
    word = {"gyro": "gyro", "accel": "accelerometer"}[sensor]
    names = [f"{word} {name}" for name in ("bias instability", "random walk", "ramp")]
    zero = np.zeros((len(design.J), len(design.J)))
    return sum((design.noises[name] for name in names if name in design.noises), zero)
