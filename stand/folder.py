"""The folder of a recording: whole or not there, and never overwritten unasked."""

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp

from stand.errors import StandError

RECORDINGS = Path("recordings")


def recording_folder(out: str | PathLike[str] | None, name: str) -> Path:
    """Where to record: `out`, or a folder of this name among the recordings.

    A link is followed, so that what it leads to is replaced.

    Raises
    ------
    StandError
        `out` is no folder of its own.
    """
    if out is None:
        return RECORDINGS / name
    folder = Path(out)
    if folder.name in ("", ".."):
        raise StandError(f"--out {folder}: must name a folder of its own")
    return folder.resolve() if folder.is_symlink() else folder


def refuse_files(paths: Iterable[Path], option: str = "--out", *, force: bool = False) -> None:
    """`StandError` where one of these files is there already, unless `force`."""
    for path in paths:
        if not force and (path.exists() or path.is_symlink()):
            raise StandError(f"{option} {path}: exists; --force replaces it")


def refuse_existing(out: Path, force: bool) -> None:
    """An existing recording stays unless `force`; anything else stays in any case."""
    if not out.exists() and not out.is_symlink():
        return
    if not out.is_dir() or (any(out.iterdir()) and not (out / "run.mcap").exists()):
        raise StandError(f"--out {out}: exists and is not a recording; choose another folder")
    if not force and any(out.iterdir()):
        raise StandError(f"--out {out}: a recording is there; --force replaces it")


@contextmanager
def written_beside(out: Path) -> Iterator[Path]:
    """A new folder beside `out`, which takes its place at the end; on any failure nothing is left.

    Raises
    ------
    StandError
        It cannot be created.
    """
    beside = _new_folder(out)
    try:
        yield beside
        _put_in_place(beside, out)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _new_folder(out: Path) -> Path:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return Path(mkdtemp(prefix=f".{out.name}.", suffix=".partial", dir=out.parent))
    except OSError as error:
        raise StandError(f"--out {out}: cannot write there: {error.strerror}") from error


def _put_in_place(beside: Path, out: Path) -> None:
    old = beside.with_suffix(".old")
    if out.exists():
        out.rename(old)
    beside.chmod(0o755)  # temporary folders are made for their owner alone
    beside.rename(out)
    shutil.rmtree(old, ignore_errors=True)
