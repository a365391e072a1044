"""ROS 2 bags as `ros2 bag record` leaves them, written by rosbags: folders, SQLite, split files."""

import builtins
import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import stand
from stand.errors import StandError
from stand.recording.mcap import read_imu, write_imu_log

T0 = 1_700_000_000_000_000_000
N = 400
T_NS = T0 + 10_000_000 * np.arange(N)
VALUES = np.random.default_rng(6).normal(size=(N, 6))
STORE = get_typestore(Stores.ROS2_HUMBLE)


def message(t_ns, values):
    kinds = STORE.types
    vector = kinds["geometry_msgs/msg/Vector3"]
    return kinds["sensor_msgs/msg/Imu"](
        kinds["std_msgs/msg/Header"](
            kinds["builtin_interfaces/msg/Time"](int(t_ns // 10**9), int(t_ns % 10**9)), "imu_link"
        ),
        kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        np.zeros(9),
        vector(*values[:3].tolist()),
        np.zeros(9),
        vector(*values[3:].tolist()),
        np.zeros(9),
    )


def bag(folder, storage, rows=slice(None)):
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        fill(writer, rows)
    return folder


def fill(writer, rows):
    imu = writer.add_connection("/imu/raw", "sensor_msgs/msg/Imu", typestore=STORE)
    text = writer.add_connection("/talk", "std_msgs/msg/String", typestore=STORE)
    word = STORE.types["std_msgs/msg/String"]("ready")
    writer.write(text, int(T_NS[0]), STORE.serialize_cdr(word, "std_msgs/msg/String"))
    for t_ns, values in zip(T_NS[rows].tolist(), VALUES[rows], strict=True):
        data = STORE.serialize_cdr(message(t_ns, values), "sensor_msgs/msg/Imu")
        writer.write(imu, t_ns + 500, data)


def check(log):
    assert log.topic == "/imu/raw"
    np.testing.assert_array_equal(log.t_ns, T_NS)
    np.testing.assert_array_equal(log.w_ib_b, VALUES[:, :3])
    np.testing.assert_array_equal(log.f_b, VALUES[:, 3:])


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_folders(tmp_path, storage):
    folder = bag(tmp_path / "a", storage)
    check(stand.read(folder).imu)
    (file,) = [path for path in folder.iterdir() if path.suffix != ".yaml"]
    check(stand.read(file).imu)
    # a folder that was renamed, as folders are
    check(stand.read(folder.rename(tmp_path / "renamed")).imu)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed(tmp_path, storage, mode):
    if storage is StoragePlugin.MCAP and mode is CompressionMode.FILE:
        pytest.skip("rosbags does not write it")
    writer = Writer(tmp_path / "a", version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        fill(writer, slice(None))
    check(stand.read(tmp_path / "a").imu)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_split_files_are_joined(tmp_path, storage):
    """Two recordings in one folder, as --max-bag-size leaves them; the lists are by hand."""
    first = bag(tmp_path / "a", storage, slice(0, 150))
    second = bag(tmp_path / "b", storage, slice(150, N))
    ending = "mcap" if storage is StoragePlugin.MCAP else "db3"
    shutil.move(second / f"b.{ending}", first / f"a_1.{ending}")
    told = (first / "metadata.yaml").read_text()
    assert f"a.{ending}" in told
    told = told.replace(f"- a.{ending}", f"- a.{ending}\n  - a_1.{ending}", 1)
    (first / "metadata.yaml").write_text(told)
    check(stand.read(first).imu)
    (first / f"a_1.{ending}").unlink()
    with pytest.raises(StandError, match=r"not a whole ROS 2 bag: Some database files are"):
        stand.read(first)


def test_metadata_that_is_hardly_there(tmp_path):
    """One MCAP is read whatever its folder's metadata say."""
    bag(tmp_path / "a", StoragePlugin.MCAP)
    (tmp_path / "a" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    check(stand.read(tmp_path / "a").imu)


@pytest.mark.parametrize(
    "text", ["", "]", "a: 1\n", "rosbag2_bagfile_information:\n  version: x\n"]
)
def test_metadata_that_make_no_sense(tmp_path, text):
    folder = bag(tmp_path / "a", StoragePlugin.SQLITE3)
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(StandError, match=r"a: not a whole ROS 2 bag: "):
        stand.read(folder)


def test_a_damaged_database(tmp_path):
    folder = bag(tmp_path / "a", StoragePlugin.SQLITE3)
    data = (folder / "a.db3").read_bytes()
    (folder / "a.db3").write_bytes(data[: len(data) // 2])
    with pytest.raises(StandError, match=r"a: not a whole ROS 2 bag: "):
        stand.read(folder)


def test_without_the_library(tmp_path, monkeypatch):
    folder = bag(tmp_path / "a", StoragePlugin.SQLITE3)
    known = builtins.__import__

    def without(name, *arguments):
        if name.startswith(("rosbags", "apsw")):
            raise ImportError(name)
        return known(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(StandError, match=r"pip install 'imu-test-stand\[logs\]'"):
        stand.read(folder)


def test_a_folder_of_a_run_and_an_mcap_need_no_library(tmp_path):
    (tmp_path / "a").mkdir()
    write_imu_log(
        tmp_path / "a" / "run.mcap",
        t_ns=T_NS - T0,
        w_ib_b=VALUES[:, :3],
        f_b=VALUES[:, 3:],
        metadata={},
    )
    assert len(read_imu(tmp_path / "a" / "run.mcap")) == len(stand.read(tmp_path / "a").imu) == N
