"""Logs of every kind, written by others than the stand: the same readings in each."""

import struct

import numpy as np
from rosbags.typesys import Stores, get_typestore

T0 = 1_700_000_000_000_000_000
RATE = 100
EARTH, G = np.radians(15.041067 / 3600), 9.8094  # rad/s, m/s^2
AXES = ("x", "y", "z")


def at_rest(n=400, latitude_deg=48.5, heading_deg=30.0, seed=1):
    """A level unit, X1 at a heading, Y1 up, Z1 right: rates, forces (n, 3) with little noise."""
    rng = np.random.default_rng(seed)
    north, up = EARTH * np.cos(np.radians(latitude_deg)), EARTH * np.sin(np.radians(latitude_deg))
    c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    w = np.array([north * c, up, -north * s]) + 1e-7 * rng.standard_normal((n, 3))
    f = np.array([0.0, G, 0.0]) + 1e-4 * rng.standard_normal((n, 3))
    return w, f


def stamps(n=400, rate=RATE):
    """(n,) ns since 1970."""
    return T0 + np.arange(1, n + 1) * (10**9 // rate)


def imu_message(store, t_ns, w, f, frame="imu_link", none=(0.0, 0.0), seq=None):
    """A sensor_msgs/msg/Imu of a typestore; `none`: covariance[0] of rates and forces."""
    kinds = store.types
    vector = kinds["geometry_msgs/msg/Vector3"]
    covariances = [np.zeros(9), np.zeros(9)]
    for covariance, first in zip(covariances, none, strict=True):
        covariance[0] = first
    time = kinds["builtin_interfaces/msg/Time"](int(t_ns // 10**9), int(t_ns % 10**9))
    header = kinds["std_msgs/msg/Header"]
    head = header(time, frame) if seq is None else header(seq, time, frame)
    return kinds["sensor_msgs/msg/Imu"](
        head,
        kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        np.zeros(9),
        vector(*map(float, w)),
        covariances[0],
        vector(*map(float, f)),
        covariances[1],
    )


def ros1_bag(path, t_ns, w, f, *, compression=None, frames=("imu_link",), log_ns=None, **more):
    """By rosbags."""
    from rosbags.rosbag1 import Writer

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    log_ns = t_ns + 500 if log_ns is None else log_ns
    with writer:
        imu = writer.add_connection("/imu/raw", "sensor_msgs/msg/Imu", typestore=store)
        talk = writer.add_connection("/talk", "std_msgs/msg/String", typestore=store)
        word = store.types["std_msgs/msg/String"]("ready")
        data = store.serialize_ros1(word, "std_msgs/msg/String")
        writer.write(talk, int(log_ns[0]), data)
        for k in range(len(t_ns)):
            frame = frames[k % len(frames)]
            message = imu_message(store, t_ns[k], w[k], f[k], frame, seq=k, **more)
            data = store.serialize_ros1(message, "sensor_msgs/msg/Imu")
            writer.write(imu, int(log_ns[k]), data)
    return path


def mcap(path, t_ns, w, f, *, ros1=False, frames=("imu_link",), log_ns=None, bare=False, **more):
    """By the mcap package, messages by rosbags: as ROS 2 or as ROS 1 has them; `bare`: without
    compression and checksums, so that what is damaged in it is read."""
    from mcap.writer import CompressionType, Writer

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    log_ns = t_ns + 500 if log_ns is None else log_ns
    name, encoding, kind = (
        ("sensor_msgs/Imu", "ros1", "ros1msg")
        if ros1
        else ("sensor_msgs/msg/Imu", "cdr", "ros2msg")
    )
    with open(path, "wb") as file:
        said = {"compression": CompressionType.NONE, "enable_crcs": False} if bare else {}
        writer = Writer(file, **said)
        writer.start(profile="ros1" if ros1 else "ros2", library="test")
        schema = writer.register_schema(name, kind, b"")
        channel = writer.register_channel("/imu/raw", encoding, schema)
        for k in range(len(t_ns)):
            frame, seq = frames[k % len(frames)], k if ros1 else None
            message = imu_message(store, t_ns[k], w[k], f[k], frame, seq=seq, **more)
            write = store.serialize_ros1 if ros1 else store.serialize_cdr
            data = bytes(write(message, "sensor_msgs/msg/Imu"))
            writer.add_message(channel, int(log_ns[k]), data, int(log_ns[k]))
        writer.finish()
    return path


def ulog(path, t_us, w, f, name="sensor_combined"):
    """By hand, after docs.px4.io/main/en/dev_log/ulog_file_format.html."""
    if name == "sensor_combined":
        fields = "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2"
        rows = np.zeros(len(t_us), [("t", "<u8"), ("w", "<f4", 3), ("f", "<f4", 3)])
        rows["w"], rows["f"] = w, f
    else:
        step = int(np.diff(t_us)[0])
        fields = (
            "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;"
            "float[3] delta_velocity;uint32_t delta_angle_dt;uint32_t delta_velocity_dt"
        )
        kinds = [("t", "<u8"), ("s", "<u8"), ("w", "<f4", 3), ("f", "<f4", 3), ("dt", "<u4", 2)]
        rows = np.zeros(len(t_us), kinds)
        rows["s"], rows["dt"] = t_us, step
        rows["w"], rows["f"] = w * step * 1e-6, f * step * 1e-6
    rows["t"] = t_us

    def record(kind, data):
        return struct.pack("<HB", len(data), ord(kind)) + data

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(t_us[0]))
    out += record("F", f"{name}:{fields}".encode())
    out += record("A", struct.pack("<BH", 0, 3) + name.encode())
    out += b"".join(record("D", struct.pack("<H", 3) + row.tobytes()) for row in rows)
    path.write_bytes(out)
    return path
