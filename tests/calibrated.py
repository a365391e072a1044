"""Calibrations of many simulated units set against what each was given: short tests and proof."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from alignment.calibration import terms
from alignment.calibration.bench import Bench, trusting
from alignment.calibration.design import Design
from alignment.calibration.fit import Fit, fitted, solved
from alignment.calibration.model import Model
from alignment.calibration.observe import Observed, observed
from alignment.units import ARC_SECOND, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from stand.calibration.truth import true_values
from stand.procedure.procedure import Procedure
from stand.simulation.monte_carlo import Trials
from stand.simulation.parallel import campaign
from stand.simulation.settings import Settings, settings
from stand.simulation.work import Engine

ASSUMED = ("lag", "lever_arm")  # terms that a calibration allows for and no sheet draws
# group: unit, size in SI, sensor and term
GROUPS = {
    "gyro bias": ("deg/h", DEG_PER_HOUR, ("gyro", "bias")),
    "gyro scale": ("ppm", PPM, ("gyro", "scale")),
    "gyro misalignment": ("arcsec", ARC_SECOND, ("gyro", "misalignment")),
    "gyro g-sensitivity": ("deg/h/g", DEG_PER_HOUR / STANDARD_GRAVITY, ("gyro", "g_sensitivity")),
    "accel bias": ("ug", MICRO_G, ("accel", "bias")),
    "accel scale": ("ppm", PPM, ("accel", "scale")),
    "accel misalignment": ("arcsec", ARC_SECOND, ("accel", "misalignment")),
}
BETWEEN = "gyro to accel"


@dataclass(frozen=True)
class Outcome:
    """One run: normalised squared error of `freedom` unknowns that the sheet states, chi-square
    over its freedom, errors and sigmas by group [in the group's unit], stretches left out."""

    nees: float
    freedom: int
    chi_square: float
    errors: dict[str, list[float]]
    sigmas: dict[str, list[float]]
    left_out: int = 0


def case(procedure: str | Procedure, imu: str, table: str, rate_hz: int = 50) -> Settings:
    """A calibration as it is run."""
    return settings(procedure, imu, table, rate_hz=rate_hz, methods=["calibration"])


def outcomes(
    made: Settings,
    seeds: Sequence[int],
    workers: int | None = 1,
    engine: Engine | None = None,
) -> Generator[tuple[Outcome, Outcome]]:
    """Runs of the stand, each calibrated: as it should be, and as if the table were perfect.

    `workers`, `engine`: who makes them, as `stand.simulation.parallel.campaign` takes them.
    """
    return campaign(partial(_ready, made), seeds, workers, engine=engine)


def _ready(made: Settings) -> Callable[[int], tuple[Outcome, Outcome]]:
    return partial(_trial, Trials(made))


def _trial(trials: Trials, seed: int) -> tuple[Outcome, Outcome]:
    made, bench = trials.settings, trials.settings.options.bench
    assert isinstance(bench, Bench)
    dwells, _ = trials.readings(seed)
    seen = observed(dwells, made.site, bench.warmth)
    truth = true_values(terms.ALL.keys, *trials.units(seed), made.unit)
    fit = fitted([seen], bench, made.site)
    return _outcome(fit, truth, fit.growth), _outcome(_trusting(seen, bench, made), truth, 1.0)


def _trusting(seen: Observed, bench: Bench, made: Settings) -> Fit:
    """Without a look at what contradicts it."""
    design = Design(Model([seen.session], trusting(bench), made.site))
    x, off = solved(design, seen.y)
    return Fit(design, x, off)


def _outcome(fit: Fit, truth: np.ndarray, growth: float) -> Outcome:
    design = fit.design
    x = np.linalg.pinv(terms.ALL.matrix) @ truth
    stated = np.ones(terms.COUNT, bool)
    for term in terms.UNIT:
        stated[term.columns] = term.name not in ASSUMED
    own = np.flatnonzero([a < terms.COUNT and stated[a] for a in design.active])
    off = fit.x[design.active[own]] - x[design.active[own]]
    P = growth**2 * design.covariance[np.ix_(own, own)]
    scale = np.sqrt(P.diagonal())
    nees = (off / scale) @ np.linalg.solve(P / np.outer(scale, scale), off / scale)
    errors, sigmas = {}, {}
    for name, (_, size, rows) in _rows(design).items():
        cut = rows[:, design.active]
        spread = np.sqrt(np.einsum("ka,ab,kb->k", cut, design.covariance, cut))
        sigmas[name] = (growth * spread / size).tolist()
        errors[name] = (rows[:, : terms.COUNT] @ (fit.x[: terms.COUNT] - x) / size).tolist()
    chi_square = fit.chi_square / fit.dof
    return Outcome(float(nees), len(own), chi_square, errors, sigmas, len(fit.left_out))


def _rows(design: Design) -> dict[str, tuple[str, float, np.ndarray]]:
    """Rows (k, p) on the unknowns by group, of what there is."""
    found = {}
    active = np.isin(np.arange(terms.COUNT), design.active)
    for name, (unit, size, (sensor, term)) in GROUPS.items():
        mine = [(key.sensor, key.term) == (sensor, term) for key in terms.ALL.keys]
        keep = np.flatnonzero(mine)
        rows = terms.ALL.matrix[keep]
        if (np.abs(rows) @ active).all():
            found[name] = (unit, size, rows)
    turned = [terms.columns_of(sensor, "misalignment") for sensor in ("gyro", "accel")]
    if all(active[own].all() for own in turned):
        eye = np.eye(terms.COUNT)
        found[BETWEEN] = ("arcsec", ARC_SECOND, eye[turned[0]] - eye[turned[1]])
    whole = {}
    for name, (unit, size, rows) in found.items():
        out = np.zeros((len(rows), design.model.count))
        out[:, : terms.COUNT] = rows
        whole[name] = (unit, size, out)
    return whole


def rms(values: Sequence[Sequence[float]]) -> float:
    """Root mean square of all of them."""
    return float(np.sqrt(np.mean(np.square(values))))
