"""MCAP in the form of ROS 2: the one place that knows this format."""

from stand.recording.mcap.reader import (
    FixLog,
    ImuLog,
    JointLog,
    TruthLog,
    VelocityLog,
    read_attachments,
    read_fixes,
    read_imu,
    read_joints,
    read_metadata,
    read_truth,
    read_velocities,
)
from stand.recording.mcap.writer import (
    EPOCH_NS,
    DriveWriter,
    McapWriter,
    Satellites,
    write_imu_log,
)

__all__ = [
    "EPOCH_NS",
    "DriveWriter",
    "FixLog",
    "ImuLog",
    "JointLog",
    "McapWriter",
    "Satellites",
    "TruthLog",
    "VelocityLog",
    "read_attachments",
    "read_fixes",
    "read_imu",
    "read_joints",
    "read_metadata",
    "read_truth",
    "read_velocities",
    "write_imu_log",
]
