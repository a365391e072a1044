"""From recordings of a test on a table to a unit's calibration: what `stand calibrate` answers."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from alignment import Priors, Site
from alignment.calibration import Calibration
from alignment.calibration.bench import MEASURED_GRAVITY, Bench, freed, from_priors, trusting
from alignment.calibration.calibrate import assembled, with_budget
from alignment.calibration.fit import fitted
from alignment.calibration.gravity import gravity_of
from alignment.calibration.observe import Observed, observed
from alignment.errors import AlignmentError
from alignment.information.model import InstrumentErrors
from alignment.options import SENSORS
from stand import toml_files as catalogue
from stand.arguments import site_with
from stand.calibration.file import CalibrationRecord
from stand.calibration.logs import refuse_dead, unit_record
from stand.calibration.truth import errors_of
from stand.errors import StandError, located
from stand.imu import ImuSpec, load_imu, unstated, without
from stand.imu.priors import noise_alone, priors_of
from stand.procedure.procedure import procedure_from
from stand.recording.attached_model import attached_model
from stand.recording.entrance import log_file
from stand.recording.hashes import sha256_of_file
from stand.recording.log import Log
from stand.recording.metadata import MODEL_FOLDER, RUN, recorded_imu
from stand.samples import Sampling
from stand.simulation.benches import Warmth, bench_of
from stand.simulation.settings import temperature_of
from stand.table.table import Table, load_table, table_from, without_errors
from stand.versions import versions

ARM = 0.2  # m: of a unit's place on a table, from where its axes cross

Metadata = Mapping[str, Mapping[str, str]]


def on_table(
    logs: Sequence[Log],
    *,
    imu: str | ImuSpec | None = None,
    table: str | Table | None = None,
    trust_table: bool = False,
    gravity: float | None = None,
    gravity_sigma: float | None = None,
    free: Sequence[str] = (),
    latitude_deg: float | None = None,
    height_m: float | None = None,
    axes: str = "",
    serial: str = "",
) -> CalibrationRecord:
    """A unit's calibration from recordings on a table: one, or several of one unit on one table.

    Parameters
    ----------
    logs : sequence of Log
        With stretches and the attitudes that the table was told; each one was switched on, and the
        unit mounted, anew.
    imu : str or ImuSpec, optional
        Data sheet, whose sigmas are what is known before; else as recorded, else nothing is. Of a
        sensor of which it states no more than noise, nothing but that is known.
    table : str or Table, optional
        Class of the table; else as recorded, else what the log's priors say of it.
    trust_table : bool
        Take table and seat for perfect.
    gravity, gravity_sigma : float, optional
        As measured [m/s^2]; else as the site has it.
    free : sequence of str
        Terms to find where the sheet states none: keys of `alignment.calibration.bench.USUAL`.
    latitude_deg, height_m : float, optional
    axes, serial : str
        For the record.

    Raises
    ------
    StandError
        No log; no latitude; readings that cannot be those of such a unit on such a table.
    """
    if not logs:
        raise StandError("no recording to calibrate from")
    for log in logs:
        refuse_dead(log)
    first = logs[0]
    metadata: Metadata = first.imu.metadata
    with located(first.path):
        sheet = _sheet(imu, metadata)
        on = _table(table, first)
        site = _site(first, gravity, gravity_sigma, latitude_deg, height_m)
        with _with_its_model(on, first) as whole:
            bench = _bench(first, sheet, whole, site)
        bench = _freed(bench, free)
    sigma = _gravity_sigma(site, bench, gravity, gravity_sigma)
    bench = replace(bench, gravity_sigma=sigma)
    bench = trusting(bench) if trust_table else bench
    calibration = _calibrated(logs, bench, site, sheet, trust_table)
    found = {(key.sensor, key.term) for key in calibration.keys}
    notes = () if sheet is None else unstated(sheet, found)
    if trust_table:
        notes += ("the table and the seat were taken for perfect: no sigma knows their errors",)
    return CalibrationRecord(
        calibration=replace(calibration, notes=calibration.notes + notes),
        unit=unit_record(sheet, serial),
        noise_only=noise_alone(sheet),
        source=_source(logs, on, trust_table),
        axes=axes,
        hashes={Path(log.path).name: sha256_of_file(log_file(log.path)) for log in _files(logs)},
        versions=versions(),
        errors=errors_of(calibration.keys, calibration.values, metadata),
    )


def _freed(bench: Bench, free: Sequence[str]) -> Bench:
    try:
        return freed(bench, free) if free else bench
    except AlignmentError as error:
        raise StandError(str(error)) from error


def _files(logs: Sequence[Log]) -> list[Log]:
    """Those that lie in a file: a run in memory has none."""
    return [log for log in logs if Path(log.path).exists()]


def _calibrated(
    logs: Sequence[Log], bench: Bench, site: Site, sheet: ImuSpec | None, trusted: bool
) -> Calibration:
    seen = [_observed(log, site, sheet) for log in logs]
    try:
        fit = fitted(seen, bench, site, all_of_them=trusted)
    except AlignmentError as error:
        raise StandError(f"{', '.join(log.path for log in logs)}: {error}") from error
    reference = 25.0 if sheet is None else sheet.reference_temperature
    return with_budget(fit, assembled(fit, reference))


def _observed(log: Log, site: Site, sheet: ImuSpec | None) -> Observed:
    dwells = log.dwells
    if sheet is not None:
        ranges = sheet.ranges
        dwells = [replace(d, readings=replace(d.readings, ranges=ranges)) for d in dwells]
    try:
        return observed(dwells, site, _warmth(log.imu.metadata, sheet))
    except AlignmentError as error:
        raise StandError(f"{log.path}: {error}") from error


# --- what is known -------------------------------------------------------------------------------


def _sheet(imu: str | ImuSpec | None, metadata: Metadata) -> ImuSpec | None:
    if imu is not None:
        return load_imu(imu) if isinstance(imu, str) else imu
    recorded = recorded_imu(metadata)
    if recorded is None:
        return None
    off = [term for term in metadata[RUN].get("without", "").split(",") if term]
    return without(recorded, off)


def _table(table: str | Table | None, log: Log) -> Table | None:
    if table is not None:
        return load_table(table) if isinstance(table, str) else table
    text = log.imu.metadata.get("table", {}).get("toml")
    if text is None:
        return None
    name = log.imu.metadata[RUN].get("table", "table")
    try:
        recorded = table_from(catalogue.Source(name, f"{name}.toml", text))
    except StandError as error:
        raise StandError(f"the table in its metadata: {error}") from error
    priors = log.options.priors
    return recorded if priors.seat or priors.turn else without_errors(recorded)


@contextmanager
def _with_its_model(table: Table | None, log: Log) -> Iterator[Table | None]:
    """A recorded table with the model of a stand of its owner's: as attached, or as it was run."""
    run = log.imu.metadata.get(RUN, {})
    if table is None or table.model is None or table.model.exists():
        yield table
    elif "model_file" in run:
        yield replace(table, model=Path(run["model_file"]))
    else:
        with TemporaryDirectory() as folder:
            main = MODEL_FOLDER + run.get("model", table.model.name)
            yield replace(table, model=attached_model(Path(log.path), main, Path(folder)))


def _site(
    log: Log,
    gravity: float | None,
    sigma: float | None,
    latitude_deg: float | None,
    height_m: float | None,
) -> Site:
    site = site_with(log.site, latitude_deg, height_m)
    if site.latitude is None:
        raise StandError("latitude: not known, but Earth rate is needed: --latitude would do")
    try:
        gravity_of(site, gravity, sigma)  # refuses what is none
    except AlignmentError as error:
        raise StandError(str(error)) from error
    return site if gravity is None else replace(site, local_gravity=gravity)


def _gravity_sigma(site: Site, bench: Bench, gravity: float | None, sigma: float | None) -> float:
    if sigma is not None:
        return sigma
    return MEASURED_GRAVITY if gravity is not None else bench.gravity_sigma


def _bench(log: Log, sheet: ImuSpec | None, table: Table | None, site: Site) -> Bench:
    metadata = log.imu.metadata
    run = metadata.get(RUN, {})
    interval = float(np.median([d.readings.interval for d in log.dwells])) if log.dwells else 0.01
    made = bench_of(
        sheet,
        table,
        site,
        Sampling.INSTANT if log.readings.instants else Sampling.MEAN,
        1 / interval,
        ideal=run.get("motion", "ideal") == "ideal",
        joints_known=all(d.joints is not None for d in log.dwells),
    )
    noise = _noise_of(log)
    wide = from_priors(noise if sheet is None else priors_of(sheet, None)).unit
    of_wide = {sensor: getattr(wide, sensor) for sensor in noise_alone(sheet)}
    made = replace(made, unit=_with_noise(replace(made.unit, **of_wide), noise))
    if table is None:
        p = log.options.priors
        made = replace(made, placement=p.turn, seat=p.seat, tilt=p.nominal, azimuth=p.azimuth)
    # where a table of its owner's has its unit, no sheet says
    return made if log.simulated else replace(made, arm_sigma=ARM)


def _with_noise(unit: InstrumentErrors, shown: Priors) -> InstrumentErrors:
    """The same with the noise that is `shown` where none is stated."""
    for sensor in SENSORS:
        triad = getattr(unit, sensor)
        if not np.any(triad.noise):
            walk = np.full(3, getattr(shown, f"{sensor}_walk"))
            unit = replace(unit, **{sensor: replace(triad, noise=walk)})
    return unit


def _noise_of(log: Log) -> Priors:
    """White noise as the rests themselves show it, for a unit of which none is known."""
    rests = [d for d in log.dwells if d.turn is None] or list(log.dwells)
    walks = []
    for values in ("w_ib_b", "f_b"):
        each = []
        for dwell in rests:
            window = dwell.window()
            steps = np.diff(getattr(window, values), axis=0)
            each.append(np.mean(steps**2) / 2 * window.interval)
        walks.append(float(np.sqrt(np.mean(each))) if each else 0.0)
    return replace(Priors(), gyro_walk=walks[0], accel_walk=walks[1])


def _warmth(metadata: Metadata, sheet: ImuSpec | None) -> Warmth | None:
    text = metadata.get("procedure", {}).get("toml")
    if text is None or sheet is None:
        return None
    source = catalogue.Source("procedure", "the procedure in its metadata", text)
    temperature = temperature_of(procedure_from(source))
    return None if temperature is None else Warmth(temperature, sheet.reference_temperature)


# --- the record ----------------------------------------------------------------------------------


def _source(logs: Sequence[Log], table: Table | None, trusted: bool) -> dict[str, str]:
    first = logs[0]
    told = {
        "method": "on a table",
        "recording": ", ".join(Path(log.path).name for log in logs),
        "topic": first.topic,
    }
    procedure = first.imu.metadata.get(RUN, {}).get("procedure")
    if procedure:
        told["procedure"] = procedure
    if table is not None:
        told |= {"table": table.id, "table_title": table.title, "table_toml": table.text}
    return told | ({"trusted": "table and seat"} if trusted else {})
