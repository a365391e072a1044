"""ROS 2 bags that are not one MCAP file: folders of several, and SQLite storage, by `rosbags`."""

import re
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from stand.errors import StandError
from stand.versions import VERSION

METADATA = "metadata.yaml"
_SQLITE = b"SQLite format 3\0"
# what LogFile can read; other topics are named only
_READ = re.compile(
    r"(sensor_msgs/msg/(Imu|JointState|NavSatFix)"
    r"|geometry_msgs/msg/Twist(WithCovariance)?Stamped)"
)


def bag_file(folder: Path) -> Path:
    """What to read of a folder of `ros2 bag record`: its one MCAP file, or the folder itself."""
    parts = sorted(folder.glob("*.mcap"))
    told = (folder / METADATA).read_text(encoding="utf-8", errors="replace")
    compressed = re.search(r"compression_mode:\s*['\"]?(message|file)", told, re.IGNORECASE)
    listed = {Path(name).name for name in re.findall(r"[^\s\[\],'\"]+\.mcap", told)}
    alone = len(parts) == 1 and not compressed and listed <= {parts[0].name}
    return parts[0] if alone else folder


def is_bag(path: Path) -> bool:
    """Whether it is a ROS 2 bag in another form than one MCAP file."""
    if path.is_dir():
        return (path / METADATA).is_file()
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_SQLITE)) == _SQLITE


def joined(path: Path) -> BinaryIO:
    """A bag's messages as one MCAP, in a file that is gone when it is closed.

    Raises
    ------
    StandError
        It is damaged, a part of it is missing, or `rosbags` is not installed.
    """
    try:
        import apsw
        from rosbags.rosbag2 import Reader, ReaderError
    except ImportError:
        raise StandError(
            "a ROS 2 bag of several files or in SQLite is read by rosbags: "
            "pip install 'imu-test-stand[logs]'"
        ) from None
    file = TemporaryFile()  # noqa: SIM115  the caller closes it
    try:
        with Reader(path) as bag:
            writer = Writer(file, compression=CompressionType.NONE)
            writer.start(profile="ros2", library=f"imu-test-stand {VERSION}")
            channels = {
                c.id: writer.register_channel(
                    c.topic, "cdr", writer.register_schema(c.msgtype, "ros2msg", b"")
                )
                for c in bag.connections
            }
            wanted = [c for c in bag.connections if _READ.fullmatch(c.msgtype)]
            for connection, t_ns, data in bag.messages(wanted) if wanted else ():
                writer.add_message(channels[connection.id], t_ns, bytes(data), t_ns)
            writer.finish()
    except (ReaderError, apsw.Error, ValueError, KeyError, FileNotFoundError) as error:
        file.close()
        raise StandError(f"not a whole ROS 2 bag: {error}") from error
    except BaseException:
        file.close()
        raise
    file.seek(0)
    return file
