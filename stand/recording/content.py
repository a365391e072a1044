"""What kind of log a file is, by its first bytes: names say nothing."""

from pathlib import Path

from stand.errors import StandError
from stand.folder import refuse_no_file
from stand.recording.mcap.bag import METADATA
from stand.recording.text_table import is_text

MCAP, ROS2, TEXT, BINARY = "mcap", "ros2", "text", "binary"
MESSAGES = (MCAP, ROS2)
"""Kinds that say themselves what is in them, by topics."""
KNOWN: dict[str, str] = {}
"""Kinds that are tables, in words."""
_MAGIC = {
    b"\x89MCAP": MCAP,
    b"SQLite format 3\0": ROS2,
}
_TEXT_ENDINGS = (".csv", ".txt", ".tsv")  # which tell what an empty file is


def kind_of(path: Path) -> str:
    """The kind of a log: a file, or the folder of a ROS 2 bag.

    Raises
    ------
    StandError
        There is no such file, or it is no log at all.
    """
    refuse_no_file(path)
    try:
        if path.is_dir():
            if not (path / METADATA).is_file():
                raise StandError(f"{path}: is a folder, must be a file")
            return ROS2
        with path.open("rb") as file:
            head = file.read(64)
        for magic, kind in _MAGIC.items():
            if head.startswith(magic):
                return kind
        if not head:
            return TEXT if path.suffix.lower() in _TEXT_ENDINGS else BINARY
        return TEXT if is_text(path) else BINARY
    except FileNotFoundError as error:
        raise StandError(f"{path}: no such file") from error
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
