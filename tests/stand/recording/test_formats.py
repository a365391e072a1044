"""Every kind of file is read: written by another library, the same numbers come back."""

import builtins
import gzip
import io
import struct

import lz4.frame
import numpy as np
import pytest
import zstandard
from rosbags.rosbag1 import Writer
from written_logs import at_rest, mcap, ros1_bag, stamps, ulog

import stand
from stand.errors import StandError
from stand.recording.entrance import read_imu
from stand.recording.formats.matlab import read_mat
from stand.recording.log_form import LogForm

W, F = at_rest()
T_NS = stamps()
T = np.arange(1, len(W) + 1) / 100
UNITS = {"gyro_unit": "rad/s", "accel_unit": "m/s^2"}
MATRIX = np.c_[T, W, F]


def check(log, tolerance=0.0, relative=False):
    np.testing.assert_allclose(log.w_ib_b, W, rtol=0, atol=tolerance)
    np.testing.assert_allclose(log.f_b, F, rtol=0, atol=tolerance * 1e6)
    t_ns = log.t_ns - log.t_ns[0] if relative else log.t_ns
    wanted = T_NS - T_NS[0] if relative else T_NS
    np.testing.assert_array_equal(t_ns, wanted)


@pytest.mark.parametrize(
    "compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4]
)
def test_ros1_bags(tmp_path, compression):
    path = ros1_bag(tmp_path / "a.bag", T_NS, W, F, compression=compression)
    log = read_imu(path)
    assert (log.topic, log.frame_id) == ("/imu/raw", "imu_link")
    check(log)
    check(stand.read(path).imu)
    renamed = path.rename(tmp_path / "log.csv")  # the content says what it is
    check(read_imu(renamed))


def test_ros1_messages_in_an_mcap(tmp_path):
    check(read_imu(mcap(tmp_path / "a.mcap", T_NS, W, F, ros1=True)))


def test_a_bag_that_was_not_closed(tmp_path):
    """Without an index it is read from the front; cut off within a record it is refused."""
    data = bytearray(ros1_bag(tmp_path / "a.bag", T_NS, W, F).read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at : at + 8] = bytes(8)
    (tmp_path / "b.bag").write_bytes(data)
    check(read_imu(tmp_path / "b.bag"))
    (tmp_path / "b.bag").write_bytes(data[:60_000])
    with pytest.raises(StandError, match=r"b\.bag: cut off or damaged at byte \d+; rosbag reindex"):
        read_imu(tmp_path / "b.bag")
    (tmp_path / "c.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(StandError, match=r"#ROSBAG V1\.2: only version 2\.0 is read"):
        read_imu(tmp_path / "c.bag")


@pytest.mark.parametrize("shape", ["rows", "lying", "fields"])
def test_npy(tmp_path, shape):
    columns = "t,gx,gy,gz,ax,ay,az"
    form = LogForm(columns=columns, **UNITS)
    if shape == "fields":
        array = np.rec.fromarrays(MATRIX.T, names=columns)
        form = LogForm(**UNITS)  # names that say it all
    else:
        array = MATRIX if shape == "rows" else np.asfortranarray(MATRIX.T)
    np.save(tmp_path / "a.npy", array)
    check(read_imu(tmp_path / "a.npy", form=form), relative=True)


@pytest.mark.parametrize(
    ("kind", "shape", "told"),
    [
        ("|V0", (3,), "damaged: (3,) of 0 bytes are not in {}"),
        ("<f8", (30,), "damaged: (30,) of 8 bytes are not in {}"),
        ("<f8", (3,), "cut off: (3,) of 8 bytes are not in it"),
        ("<f8", (-1, 7), "damaged: (-1, 7) of 8 bytes are not in {}"),
        ("|O", (1,), "holds Python objects, must be numbers"),
    ],
)
def test_an_array_that_its_file_cannot_hold(tmp_path, kind, shape, told):
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        head = {"descr": kind, "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, head)
        file.write(bytes(20))
    with pytest.raises(StandError) as caught:
        read_imu(path, form=LogForm(columns="t,gx,gy,gz,ax,ay,az", **UNITS))
    assert str(caught.value) == f"{path}: {told.format(path.stat().st_size)}"


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz(tmp_path, save):
    save(tmp_path / "a.npz", time=T, gyro=W, acc=F.T, rate=100.0, gps=np.zeros(7))
    log = read_imu(tmp_path / "a.npz", form=LogForm(**UNITS))
    check(log, relative=True)
    assert "left aside, of another length: gps" in log.notes


def test_mat(tmp_path):
    from scipy.io import savemat

    inside = {"time": T[:, None], "gyro_rad_s": W, "acc_m_s2": F}
    for name, variables, form in (
        ("a.mat", {"t": T, "gyro": W, "acc": F, "fs": 100.0}, LogForm(**UNITS)),
        ("b.mat", {"imu": inside, "note": "bench"}, LogForm()),
        ("c.mat", {"data": MATRIX}, LogForm(columns="t,gx,gy,gz,ax,ay,az", **UNITS)),
    ):
        for compressed in (False, True):
            savemat(tmp_path / name, variables, do_compression=compressed)
            check(read_imu(tmp_path / name, form=form), relative=True)
    assert read_imu(tmp_path / "b.mat", "imu").topic.startswith("imu: columns time, gyro_x [")


def test_a_mat_of_another_byte_order_by_hand(tmp_path):
    """Big endian: one matrix (3, 2) of doubles called ab, its columns 1, 2, 3 and 4, 5, 6."""

    def element(kind, data):
        return struct.pack(">II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")

    name = struct.pack(">I", 2 << 16 | 1) + b"ab\0\0"  # small: within its own head
    body = element(6, struct.pack(">II", 6, 0)) + element(5, struct.pack(">ii", 3, 2)) + name
    body += element(9, np.arange(1.0, 7.0).astype(">f8").tobytes())
    data = b"MATLAB 5.0 MAT-file".ljust(124) + b"\1\0MI" + element(14, body)
    (tmp_path / "a.mat").write_bytes(data)
    table = read_mat(tmp_path / "a.mat", None)
    assert (table.rows, table.width) == (3, 2)
    np.testing.assert_array_equal(table.column(1), [4, 5, 6])
    (tmp_path / "a.mat").write_bytes(data[:-8])
    with pytest.raises(
        StandError, match=r"a\.mat: damaged before byte 128: an element of 96 bytes, 88 are"
    ):
        read_mat(tmp_path / "a.mat", None)


@pytest.mark.parametrize("head", [b"", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512)])
def test_hdf5_and_mat_7_3(tmp_path, head):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w", userblock_size=len(head)) as file:
        file["imu/t"] = T
        file["imu/gyro"] = np.degrees(W).T  # as MATLAB has its columns
        file["imu/gyro"].attrs["units"] = "deg/s"
        file["imu/accel"] = F
        file["imu/accel"].attrs["units"] = b"m/s^2"
        file["gps/lat"] = np.zeros(9)
    if head:
        data = (tmp_path / "a.h5").read_bytes()
        (tmp_path / "a.h5").write_bytes(head + data[len(head) :])
    check(read_imu(tmp_path / "a.h5", "imu"), 1e-18, relative=True)
    check(read_imu(tmp_path / "a.h5"), 1e-18, relative=True)


def test_parquet(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(
        {
            "stamp": pa.array(T_NS, pa.timestamp("ns")),
            "frame": ["imu"] * len(T),
            **{f"gyro_{a} [rad/s]": W[:, k] for k, a in enumerate("xyz")},
            **{f"acc_{a} [m/s^2]": F[:, k] for k, a in enumerate("xyz")},
        }
    )
    pq.write_table(table, tmp_path / "a.parquet")
    check(read_imu(tmp_path / "a.parquet"))
    holes = table.set_column(2, "gyro_x [rad/s]", pa.array([None, *W[1:, 0]]))
    pq.write_table(holes, tmp_path / "b.parquet")
    with pytest.raises(StandError, match=r"column gyro_x \[rad/s\]: 1 of 400 values are missing"):
        read_imu(tmp_path / "b.parquet")


@pytest.mark.parametrize("name", ["sensor_combined", "vehicle_imu"])
def test_px4(tmp_path, name):
    """In floats; its axes are forward, right, down."""
    frd = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)  # of forward, up, right
    path = ulog(tmp_path / "a.ulg", (T_NS - T_NS[0]) // 1000 + 10_000, W @ frd.T, F @ frd.T, name)
    log = read_imu(path, form=LogForm(axes="FRD"))
    check(log, 1e-6, relative=True)
    assert log.topic.startswith(name)
    assert "--axes FRD" in log.notes[0]


@pytest.mark.parametrize(
    ("order", "gyro_scale", "accel_scale"), [("<f4", 1, 1), (">f8", 1, 1), ("<i4", 1e-10, 1e-7)]
)
def test_rows_of_numbers(tmp_path, order, gyro_scale, accel_scale):
    rows = np.c_[np.rint(T * 1000), W / gyro_scale, F / accel_scale]
    rows = rows if "f" in order else np.rint(rows)
    path = tmp_path / "a.bin"
    path.write_bytes(b"HEADER\0\1\2\3" + rows.astype(order).tobytes())
    form = LogForm(
        columns="t,gx,gy,gz,ax,ay,az",
        gyro_unit="rad/s",
        accel_unit="m/s^2",
        gyro_scale=gyro_scale,
        accel_scale=accel_scale,
        time_unit="ms",
        file_format=order,
        skip_bytes=10,
    )
    log = read_imu(path, form=form)
    np.testing.assert_allclose(log.w_ib_b, W, atol=1e-10)  # half a count; a float's 24 bits
    np.testing.assert_allclose(log.f_b, F, atol=1e-6)
    np.testing.assert_array_equal(log.t_ns - log.t_ns[0], T_NS - T_NS[0])


def _zstd(data):
    return zstandard.ZstdCompressor().compress(data)


@pytest.mark.parametrize("compress", [_zstd, lz4.frame.compress, gzip.compress])
@pytest.mark.parametrize("kind", ["mcap", "bag", "csv"])
def test_compressed_as_a_whole(tmp_path, compress, kind):
    inner = tmp_path / f"a.{kind}"
    if kind == "csv":
        units = [("g", "rad/s"), ("a", "m/s^2")]
        head = ",".join(["t", *(f"{s}{a} [{unit}]" for s, unit in units for a in "xyz")])
        np.savetxt(inner, MATRIX, "%.17g", ",", header=head, comments="")
    else:
        (mcap if kind == "mcap" else ros1_bag)(inner, T_NS, W, F)
    path = tmp_path / "b"
    path.write_bytes(compress(inner.read_bytes()))
    log = read_imu(path)
    check(log, relative=kind == "csv")
    assert log.path == str(path)
    path.write_bytes(compress(inner.read_bytes())[:-40])
    with pytest.raises(StandError, match=rf"^{path}: "):
        read_imu(path)


def test_traps_in_compressed_files(tmp_path):
    """What expands without end, or says so of itself, is refused before it is made."""
    path = tmp_path / "a.csv.zst"
    path.write_bytes(_zstd(bytes(100 << 20)))
    with pytest.raises(StandError, match=r"a\.csv\.zst: expands to more than 67108864 bytes"):
        read_imu(path)
    path.write_bytes(gzip.compress(_zstd(b"t,gx\n")))
    with pytest.raises(StandError, match=r"a\.csv\.zst: is compressed twice"):
        read_imu(path)
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40, 7)}
    )
    path.write_bytes(head.getvalue())
    with pytest.raises(StandError, match=r"damaged: \(1099511627776, 7\) of 8 bytes are not in"):
        read_imu(path)


@pytest.mark.parametrize(
    ("library", "head"),
    [("pyulog", b"ULog\x01\x12\x35\x01"), ("h5py", b"\x89HDF\r\n\x1a\n"), ("pyarrow", b"PAR1")],
)
def test_without_a_library(tmp_path, monkeypatch, library, head):
    path = tmp_path / "a"
    path.write_bytes(head + bytes(100))
    known = builtins.__import__

    def without(name, *arguments):
        if name.partition(".")[0] == library:
            raise ImportError(name)
        return known(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    told = rf"read by {library}: pip install 'imu-test-stand\[logs\]'"
    with pytest.raises(StandError, match=told):
        read_imu(path)


@pytest.mark.parametrize(
    "head", [b"\x93NUMPY", b"PK\3\4", b"PAR1", b"ULog\x01\x12\x35", b"#ROSBAG V"]
)
def test_a_known_kind_is_never_rows_of_numbers(tmp_path, head):
    path = tmp_path / "a.bin"
    path.write_bytes(head + bytes(57))
    with pytest.raises(StandError) as caught:
        read_imu(path, form=LogForm(columns="t,gx,gy,gz,ax,ay,az", **UNITS))
    assert "whole number of rows" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
