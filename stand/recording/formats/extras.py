"""Libraries that not everybody has."""

from stand.errors import StandError


def missing(path: object, what: str, library: str) -> StandError:
    """One line that says how to get it."""
    return StandError(f"{path}: {what} is read by {library}: pip install 'imu-test-stand[logs]'")
