"""A recorded run read again block by block, as it was written, in memory that does not grow."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import IntArray
from stand.errors import StandError
from stand.recording.mcap.decode import JointBatch, decode_imu, decode_joints, gather
from stand.recording.mcap.records import Segment, directory, faults_of, opened, segments
from stand.recording.mcap.writer import (
    ENCODER_TOPIC,
    IMU_TOPIC,
    JOINT_TRUTH_TOPIC,
    SATURATED_TOPIC,
    TRUTH_TOPIC,
)
from stand.samples import CHANNELS, ImuBlock, TruthBlock
from stand.table.joints import JOINTS

_BITS_AT = 4  # of a std_msgs/msg/UInt8, behind the encapsulation
_STAMPED = 16  # bytes from a message's log time to its payload: publish time is between


def replayed(path: Path, epoch_ns: int) -> Iterator[tuple[TruthBlock, ImuBlock]]:
    """The samples of a run of ours, chunk by chunk.

    Raises
    ------
    StandError
        A file that is no such run, or damaged.
    """
    with opened(path) as file, faults_of(path):
        found = directory(file)
        topics = {channel.topic: number for number, channel in found.channels.items()}
        for topic in (IMU_TOPIC, TRUTH_TOPIC, ENCODER_TOPIC, JOINT_TRUTH_TOPIC):
            if topic not in topics:
                raise StandError(f"no topic {topic}: not a run of the stand")
        for part in segments(file, found):
            if (part.channel == topics[IMU_TOPIC]).any():
                yield _blocks(part, topics, epoch_ns)


def _blocks(part: Segment, topics: dict[str, int], epoch_ns: int) -> tuple[TruthBlock, ImuBlock]:
    imu = decode_imu(part.data, *_of(part, topics[IMU_TOPIC]))
    true = decode_imu(part.data, *_of(part, topics[TRUTH_TOPIC]))
    joints, said = (_joints(part, topics[name]) for name in (JOINT_TRUTH_TOPIC, ENCODER_TOPIC))
    n = len(imu.t_ns)
    if {len(true.t_ns), len(joints.t_ns), len(said.t_ns)} != {n}:
        raise StandError("a chunk whose topics have unequal counts of samples")
    t_ns = imu.t_ns - epoch_ns
    truth = TruthBlock(
        t_ns=t_ns,
        w_ib_b=true.w_ib_b,
        f_b=true.f_b,
        q_wb=true.q,
        joints=joints.angles,
        joint_rates=joints.rates,
        encoders=said.angles,
        encoder_rates=said.rates,
    )
    saturated = _saturated(part, topics.get(SATURATED_TOPIC, -1), imu.t_ns)
    return truth, ImuBlock(t_ns, imu.w_ib_b, imu.f_b, saturated)


def _of(part: Segment, channel: int) -> tuple[IntArray, IntArray]:
    rows = part.channel == channel
    return part.start[rows], part.size[rows]


def _joints(part: Segment, channel: int) -> JointBatch:
    return decode_joints(part.data, *_of(part, channel), names=JOINTS)


def _saturated(part: Segment, channel: int, stamps: IntArray) -> NDArray[np.bool_]:
    """Channels beyond their range (n, 6) bool: bit k of a message is channel k."""
    flags = np.zeros((len(stamps), len(CHANNELS)), bool)
    starts, sizes = _of(part, channel)
    if len(starts) and (sizes > _BITS_AT).all():
        times = gather(part.data, starts - _STAMPED, "<i8")
        rows = np.clip(np.searchsorted(stamps, times), 0, len(stamps) - 1)
        bits = gather(part.data, starts + _BITS_AT, "u1")
        flags[rows] = bits[:, None] >> np.arange(len(CHANNELS)) & 1
    return flags
