"""What calibrations on a table and by hand share: logs that are no readings, the unit's record."""

from alignment.stuck import dead
from stand.errors import StandError
from stand.imu import ImuSpec
from stand.recording.log import Log


def refuse_dead(log: Log) -> None:
    """`StandError` where a channel of a real log never changes: it is no sensor's."""
    if not log.simulated and (words := dead(log.readings)):
        raise StandError(f"{log.path}: {words}")


def unit_record(sheet: ImuSpec | None, serial: str) -> dict[str, str]:
    """What is known of the unit, as far as it is: `CalibrationRecord.unit`."""
    known = {} if sheet is None else {"id": sheet.id, "title": sheet.title, "toml": sheet.text}
    return known | ({"serial": serial} if serial else {})
