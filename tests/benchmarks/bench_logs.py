"""An hour of an IMU at 1 kHz, of a ROS 1 bag and of CSV: time and memory of reading it."""

import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

RATE, HOUR = 1000, 3600
_HEAD = 42  # bytes of a message's header, with its size before it
COLUMNS = "t,gx,gy,gz,ax,ay,az"
ALONE = """
import resource, sys, time
from stand.recording.entrance import read_imu
from stand.recording.log_form import LogForm
begin, seen = time.perf_counter(), []
form = LogForm(gyro_unit="rad/s", accel_unit="m/s^2") if sys.argv[2] == "csv" else None
log = read_imu(sys.argv[1], form=form, progress=seen.append)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(len(log), time.perf_counter() - begin, time.process_time(), peak, len(seen))
"""


def log_rows(rate: int = RATE, seconds: int = HOUR) -> list[tuple[str, str, str]]:
    """Of either file: time, memory, how often progress was told."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in (("bag", write_bag), ("csv", write_csv)):
            path = Path(folder) / f"hour.{kind}"
            write(path, rate, seconds)
            size = path.stat().st_size / 1e6
            command = [sys.executable, "-c", ALONE, str(path), kind]
            told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            n, wall, cpu, peak, seen = told.split()
            path.unlink()
            rows.append(
                (
                    f"{int(n):,} samples of {kind} ({size:,.0f} MB)",
                    f"{float(wall):.0f} s ({float(cpu):.0f} s of computing), "
                    f"{int(n) / float(wall):,.0f} samples/s",
                    f"{float(peak):.0f} MB, progress {seen} times",
                )
            )
    return rows


def _blocks(rate: int, seconds: int):
    rng = np.random.default_rng(0)
    for second in range(seconds):
        t_ns = second * 10**9 + np.arange(1, rate + 1) * (10**9 // rate)
        yield t_ns, rng.normal(size=(rate, 6)) * 1e-3 + [5e-5, 0, 5e-5, 0, 9.81, 0]


def write_csv(path: Path, rate: int, seconds: int) -> None:
    """Seven columns with a header, 9 digits."""
    with path.open("w") as file:
        file.write(COLUMNS + "\n")
        for t_ns, values in _blocks(rate, seconds):
            for t, v in zip(t_ns.tolist(), values.tolist(), strict=True):
                file.write(f"{t * 1e-9:.6f}," + ",".join(f"{x:.9g}" for x in v) + "\n")


def write_bag(path: Path, rate: int, seconds: int) -> None:
    """A chunk a second, without an index: after wiki.ros.org/Bags/Format/2.0."""

    def fields(**values: bytes) -> bytes:
        parts = [f"{name}=".encode() + value for name, value in values.items()]
        text = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        return struct.pack("<I", len(text)) + text

    def sized(data: bytes) -> bytes:
        return struct.pack("<I", len(data)) + data

    kind = fields(topic=b"/imu", type=b"sensor_msgs/Imu", md5sum=b"*", message_definition=b"")
    connection = fields(op=b"\7", conn=bytes(4), topic=b"/imu") + kind
    message = np.dtype(
        [
            ("head", f"V{_HEAD}"),
            ("size", "<u4"),
            ("seq", "<u4"),
            ("stamp", "<u4", 2),
            ("frame", "<u4"),
            ("before", "<f8", 13),
            ("w", "<f8", 3),
            ("between", "<f8", 9),
            ("f", "<f8", 3),
            ("behind", "<f8", 9),
        ]
    )
    with path.open("wb") as file:
        head = fields(op=b"\3", index_pos=bytes(8), conn_count=b"\1\0\0\0", chunk_count=bytes(4))
        file.write(b"#ROSBAG V2.0\n" + head + sized(bytes(4096 - len(head) - 4)))
        for t_ns, values in _blocks(rate, seconds):
            rows = np.zeros(rate, message)
            stamps = np.stack([1_700_000_000 + t_ns // 10**9, t_ns % 10**9], axis=1)
            heads = [
                fields(op=b"\2", conn=bytes(4), time=struct.pack("<II", *stamp))
                for stamp in stamps.tolist()
            ]
            rows["head"] = np.array(heads, dtype=f"V{_HEAD}")
            rows["size"], rows["stamp"] = message.itemsize - _HEAD - 4, stamps
            rows["w"], rows["f"] = values[:, :3], values[:, 3:]
            data = connection + rows.tobytes()
            file.write(
                fields(op=b"\5", compression=b"none", size=struct.pack("<I", len(data)))
                + sized(data)
            )


if __name__ == "__main__":
    for row in log_rows(*map(int, sys.argv[1:])):
        print(*row, sep=" | ")
