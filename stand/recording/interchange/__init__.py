"""MCAP in the form of ROS 2: the one place that knows this format."""

from .reader import (
    ImuLog,
    JointLog,
    TruthLog,
    read_imu,
    read_joints,
    read_metadata,
    read_truth,
)
from .writer import EPOCH_NS, McapWriter, write_imu_log

__all__ = [
    "EPOCH_NS",
    "ImuLog",
    "JointLog",
    "McapWriter",
    "TruthLog",
    "read_imu",
    "read_joints",
    "read_metadata",
    "read_truth",
    "write_imu_log",
]
