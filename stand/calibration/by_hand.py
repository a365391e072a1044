"""From a log of a unit that was turned by hand to its calibration: what `--hand-held` answers."""

from collections.abc import Sequence
from pathlib import Path

from alignment.calibration.gravity import gravity_of
from alignment.calibration.hand_held import HandHeld, hand_held
from alignment.errors import AlignmentError
from stand.arguments import site_with
from stand.calibration.file import CalibrationRecord
from stand.calibration.logs import refuse_dead, unit_record
from stand.calibration.truth import errors_of
from stand.errors import StandError
from stand.evaluation.aligned import sheet_beside
from stand.imu import ImuSpec, load_imu
from stand.imu.priors import noise_alone, priors_of
from stand.recording.entrance import log_file
from stand.recording.hashes import sha256_of_file
from stand.recording.log import Log
from stand.versions import versions


def by_hand(
    logs: Sequence[Log],
    *,
    imu: str | ImuSpec | None = None,
    gravity: float | None = None,
    gravity_sigma: float | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    shortest_s: float = HandHeld().shortest,
    as_published: bool = False,
    axes: str = "",
    serial: str = "",
) -> CalibrationRecord:
    """A unit's calibration from one log without a table.

    Parameters
    ----------
    logs : sequence of Log
        One.
    imu : str or ImuSpec, optional
        Data sheet, whose sigmas are what is known before; as told, never as recorded: what a
        calibration finds should be what the readings say.
    gravity, gravity_sigma : float, optional
        As measured [m/s^2]; else normal gravity of the site, or what it is anywhere.
    latitude_deg, height_m : float, optional
        Of the site; else the recording's own.
    shortest_s : float
        Of a rest [s].
    as_published : bool
        See `HandHeld`.
    axes : str
        What the log was read with, for the record.
    serial : str
        Of the unit, for the record.

    Raises
    ------
    StandError
        More logs than one; a length that is none; what `hand_held` refuses, by the log's name.
    """
    if len(logs) != 1:
        raise StandError(f"--hand-held: {len(logs)} logs, must be one")
    if not 0.1 <= shortest_s <= 3600:
        raise StandError(f"shortest = {shortest_s:g} s: must be 0.1 to 3600")
    (log,) = logs
    refuse_dead(log)
    sheet = load_imu(imu) if isinstance(imu, str) else imu
    site = site_with(log.site, latitude_deg, height_m)
    measured = gravity_of(site, gravity, gravity_sigma)
    try:
        found = hand_held(
            log.readings,
            measured,
            site,
            None if sheet is None else priors_of(sheet, None),
            HandHeld(shortest_s, as_published),
        )
    except AlignmentError as error:
        raise StandError(f"{log.path}: {error}") from error
    told = sheet or sheet_beside(log.imu.metadata)
    return CalibrationRecord(
        calibration=found,
        unit=unit_record(told, serial),
        noise_only=noise_alone(sheet),
        source={
            "method": "hand-held, as published" if as_published else "hand-held",
            "recording": Path(log.path).name,
            "topic": log.topic,
        },
        axes=axes,
        # a run in memory has no file
        hashes={p.name: sha256_of_file(log_file(p)) for p in [Path(log.path)] if p.exists()},
        versions=versions(),
        errors=errors_of(found.keys, found.values, log.imu.metadata),
    )
