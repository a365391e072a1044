"""The one way to write: whole or not there, whatever happens on the way."""

import os
from pathlib import Path

import pytest

from stand import folder
from stand.errors import StandError
from stand.folder import file_beside, folder_beside, write_file, write_files

FULL = OSError(28, "No space left on device")


def there(root: Path) -> list[str]:
    """Everything below a folder, hidden names too."""
    return sorted(str(p.relative_to(root)) for p in root.rglob("*"))


def test_a_file_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(StandError, match="cannot write there"):
        write_file(tmp_path / "file" / "below.html", "text")
    (tmp_path / "folder").mkdir()
    with pytest.raises(StandError, match="cannot write there"):
        write_file(tmp_path / "folder", "text")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_a_file_is_there_at_the_end_only(tmp_path):
    path = tmp_path / "new" / "deep" / "a.txt"
    with file_beside(path) as beside:
        beside.write_text("whole")
        assert not path.exists()
    assert there(tmp_path) == ["new", "new/deep", "new/deep/a.txt"]
    assert path.read_text() == "whole"
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask  # as any other program makes it


@pytest.mark.parametrize("fault", [FULL, StandError("no"), KeyError("bug"), KeyboardInterrupt()])
@pytest.mark.parametrize("beside", [file_beside, folder_beside])
def test_after_any_fault_nothing_is_left(tmp_path, beside, fault):
    with pytest.raises(StandError if fault is FULL else type(fault)), beside(tmp_path / "a/b/c"):
        raise fault
    assert there(tmp_path) == []


def test_folders_that_were_there_stay(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(KeyError), file_beside(tmp_path / "mine" / "new" / "a.txt"):
        raise KeyError
    assert there(tmp_path) == ["mine"]


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    path = tmp_path / "a.txt"
    with file_beside(path) as one, file_beside(path) as two:
        one.write_text("one")
        two.write_text("two")
    assert path.read_text() == "one"  # whole: that of who came last
    assert there(tmp_path) == ["a.txt"]


def test_files_that_belong_together_come_together(tmp_path):
    (tmp_path / "a.txt").write_text("old")

    def pieces():
        yield "half"
        raise FULL

    with pytest.raises(StandError, match=r"b\.txt: cannot write there: No space left"):
        write_files({tmp_path / "a.txt": "new", tmp_path / "b.txt": pieces()})
    assert there(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    write_files({tmp_path / "a.txt": ["n", "ew\n"], tmp_path / "b.txt": b"\xff"})
    assert (tmp_path / "a.txt").read_bytes() == b"new\n"
    assert (tmp_path / "b.txt").read_bytes() == b"\xff"


def test_a_link_is_followed_and_a_device_stays(tmp_path):
    (tmp_path / "link").symlink_to("target")
    write_file(tmp_path / "link", "x")
    assert (tmp_path / "target").read_text() == "x"
    assert (tmp_path / "link").is_symlink()
    (tmp_path / "round").symlink_to("round")
    with pytest.raises(StandError, match="round: cannot write there: "):
        write_file(tmp_path / "round", "x")
    with pytest.raises(StandError, match="null: cannot write there: is not a file"):
        write_file(Path("/dev/null"), "x")


def test_faults_are_told_with_the_name_the_file_would_have(tmp_path):
    with pytest.raises(StandError) as told, folder_beside(tmp_path / "run") as beside:
        raise StandError(f"{beside / 'run.mcap'}: no")
    assert str(told.value) == f"{tmp_path / 'run' / 'run.mcap'}: no"
    with pytest.raises(StandError) as told, folder_beside(tmp_path / "run") as beside:
        (beside / "nowhere" / "a").open("wb")
    assert str(told.value).startswith(f"{tmp_path / 'run' / 'nowhere' / 'a'}: cannot write there")
    with pytest.raises(FileNotFoundError), folder_beside(tmp_path / "run"):
        open("/no/such/input")  # noqa: SIM115
    assert there(tmp_path) == []


def test_an_old_folder_stays_if_the_new_one_cannot_come(tmp_path, monkeypatch):
    out = tmp_path / "run"
    out.mkdir()
    (out / "old").write_text("")
    rename = Path.rename

    def refuses(path, target):
        if path.suffix == ".partial":
            raise FULL
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refuses)
    with pytest.raises(StandError), folder.folder_beside(out) as beside:
        (beside / "new").write_text("")
    assert there(tmp_path) == ["run", "run/old"]
    monkeypatch.undo()
    with folder.folder_beside(out) as beside:
        (beside / "new").write_text("")
    assert there(tmp_path) == ["run", "run/new"]
