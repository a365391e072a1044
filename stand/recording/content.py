"""What kind of log a file is, by its first bytes: names say nothing."""

from pathlib import Path

from stand.errors import StandError
from stand.folder import refuse_no_file
from stand.recording.mcap.bag import METADATA
from stand.recording.text_table import is_text

MCAP, ROS1, ROS2, TEXT, BINARY = "mcap", "ros1", "ros2", "text", "binary"
MESSAGES = (MCAP, ROS1, ROS2)
"""Kinds that say themselves what is in them, by topics."""
KNOWN = {
    "npy": "an array of NumPy",
    "npz": "arrays of NumPy",
    "mat": "a MATLAB file",
    "hdf5": "an HDF5 file",
    "parquet": "a Parquet file",
    "ulog": "a PX4 log",
}
"""Kinds that are tables, in words."""
COMPRESSED = ("zstd", "lz4", "gzip")
_MAGIC = {
    b"\x89MCAP": MCAP,
    b"#ROSBAG V": ROS1,
    b"SQLite format 3\0": ROS2,
    b"\x93NUMPY": "npy",
    b"PK\x03\x04": "npz",
    b"MATLAB 5.0 MAT-file": "mat",
    b"MATLAB 7.3 MAT-file": "hdf5",
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"PAR1": "parquet",
    b"ULog\x01\x12\x35": "ulog",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"\x04\x22\x4d\x18": "lz4",
    b"\x1f\x8b\x08": "gzip",
}
_HEAD = 128
_MAT_END = (b"IM", b"MI")
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
            head = file.read(_HEAD)
        for magic, kind in _MAGIC.items():
            if head.startswith(magic):
                return kind
        if head[126:128] in _MAT_END and head[124:126] in (b"\0\1", b"\1\0"):
            return "mat"  # with words of another writer
        if not head:
            return TEXT if path.suffix.lower() in _TEXT_ENDINGS else BINARY
        return TEXT if is_text(path) else BINARY
    except FileNotFoundError as error:
        raise StandError(f"{path}: no such file") from error
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
