"""Libraries that not everybody has, and what they say of damaged files."""

from stand.errors import StandError

_LONGEST = 100  # characters of a library's words


def missing(path: object, what: str, library: str) -> StandError:
    """One line that says how to get it."""
    return StandError(f"{path}: {what} is read by {library}: pip install 'imu-test-stand[logs]'")


def damaged(path: object, what: str, error: Exception) -> StandError:
    """One line of whatever a library says to bytes that make no sense."""
    told = "asks for too much memory" if isinstance(error, MemoryError) else str(error)
    told = " ".join(told.split())[:_LONGEST] or type(error).__name__
    return StandError(f"{path}: not a whole {what}: {told}")
