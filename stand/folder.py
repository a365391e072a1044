"""The one way to write: beside, then renamed; whole or not there, never overwritten unasked."""

import errno
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from secrets import token_hex

from stand.errors import StandError

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

RECORDINGS = Path("recordings")
Content = bytes | str | Iterable[str]
"""Of a file: bytes, or text in UTF-8, whole or in pieces."""
_HIDDEN = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{8}\.(?P<kind>partial|old)", re.DOTALL)
_OF_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


def recording_folder(out: str | PathLike[str] | None, name: str) -> Path:
    """Where to record: `out`, or a folder of this name among the recordings.

    A link is followed, so that what it leads to is replaced.

    Raises
    ------
    StandError
        `out` is no folder of its own, or a link in a circle.
    """
    if out is None:
        return RECORDINGS / name
    folder = Path(out)
    if folder.name in ("", ".."):
        raise StandError(f"--out {folder}: must name a folder of its own")
    try:
        return folder.resolve() if folder.is_symlink() else folder
    except (OSError, RuntimeError) as error:
        raise StandError(f"--out {folder}: links that lead in a circle") from error


def refuse_files(paths: Iterable[Path], option: str = "--out", *, force: bool = False) -> None:
    """`StandError` where one of these files is there already, unless `force`."""
    for path in paths:
        if not force and (path.exists() or path.is_symlink()):
            raise StandError(f"{option} {path}: exists; --force replaces it")


def refuse_no_folder(path: Path, option: str = "--out") -> None:
    """`StandError` where what is there already leaves no folder for it to be in."""
    try:
        path.resolve()
    except (OSError, RuntimeError) as error:
        raise StandError(f"{option} {path}: links that lead in a circle") from error
    for above in path.parents:
        if (above.exists() or above.is_symlink()) and not above.is_dir():
            raise StandError(f"{option} {path}: cannot write there: {above} is no folder")


def refuse_existing(out: Path, force: bool) -> None:
    """An existing recording stays unless `force`; anything else stays in any case."""
    if not out.exists() and not out.is_symlink():
        return
    if not out.is_dir() or (any(out.iterdir()) and not (out / "run.mcap").exists()):
        raise StandError(f"--out {out}: exists and is not a recording; choose another folder")
    if not force and any(out.iterdir()):
        raise StandError(f"--out {out}: a recording is there; --force replaces it")


@contextmanager
def folder_beside(out: Path) -> Iterator[Path]:
    """A new folder beside `out`, which takes its place at the end; on any failure nothing is left.

    Folders above it are made, and removed again on a failure. A message that names a file of the
    new folder is told with the name that the file would have had.

    Raises
    ------
    StandError
        It cannot be created or put in its place.
    """
    beside = _unique(out)
    with _new_parents(out, f"--out {out}"):
        try:
            with _named(beside, out, f"--out {out}"):
                beside.mkdir()
                with held(beside):
                    yield beside
                    _put_in_place(beside, out)
        finally:
            shutil.rmtree(beside, ignore_errors=True)


@contextmanager
def file_beside(path: Path) -> Iterator[Path]:
    """A new, empty file beside `path`, which takes its place at the end; else nothing is left.

    Folders above it are made, and removed again on a failure. A link is followed.

    Raises
    ------
    StandError
        It cannot be written, or `path` is something else than a file.
    """
    target = _followed(path)
    beside = _unique(target)
    with _new_parents(target, str(path)):
        try:
            with _named(beside, path, str(path)):
                beside.open("xb").close()
                with held(beside):
                    yield beside
                    beside.replace(target)
        finally:
            with suppress(OSError):
                beside.unlink(missing_ok=True)


def write_files(contents: Mapping[Path, Content]) -> list[Path]:
    """Write files that belong together: all are there at the end, or on a failure none is new.

    Raises
    ------
    StandError
        One of them cannot be written; the others are as they were.
    """
    with ExitStack() as stack:
        for path, content in contents.items():
            beside = stack.enter_context(file_beside(path))
            with _named(beside, path, str(path)):
                _write(beside, content)
    return list(contents)


def write_file(path: Path, content: Content) -> Path:
    """Write one file, as `write_files` does."""
    return write_files({path: content})[0]


def refuse_no_file(path: Path) -> None:
    """A pipe or a device is no input: files are read more than once, and a pipe may never speak.

    What is not there, or a folder, is told by who opens it.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise StandError(f"{path}: is not a file")


@dataclass(frozen=True, slots=True)
class Left:
    """What a writer that was ended from outside has left of `target`: a hidden file or folder.

    `replaced`: it is what was to be replaced, whole, rather than what was to come.
    """

    path: Path
    target: Path
    replaced: bool


def left_behind(folder: Path) -> list[Left]:
    """What lies in a folder of writers that are no more, by name; of those at work nothing."""
    found = []
    with suppress(OSError):  # no such folder, or one that may not be looked at
        for path in sorted(folder.iterdir()):
            match = _HIDDEN.fullmatch(path.name)
            if match and not path.is_symlink() and not _is_held(path):
                target = path.with_name(match["name"])
                found.append(Left(path, target, match["kind"] == "old"))
    return found


def left_of(target: Path) -> list[Left]:
    """What lies beside a target of writers of it that are no more."""
    return [left for left in left_behind(target.parent) if left.target.name == target.name]


@contextmanager
def held(path: Path) -> Iterator[bool]:
    """While a writer is at work, and no longer: the kernel lets go of what a dead one held.

    Whether no other holds it.
    """
    if fcntl is None:
        yield True
        return
    number = os.open(path, os.O_RDONLY)
    ours = True
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:  # or a file system without locks
            ours = error.errno not in (errno.EAGAIN, errno.EACCES)
        yield ours
    finally:
        os.close(number)


def _is_held(path: Path) -> bool:
    if fcntl is None:
        return False
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:  # gone meanwhile, or not ours to read
        return True
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EAGAIN, errno.EACCES)
    finally:
        os.close(number)
    return False


def _write(path: Path, content: Content) -> None:
    if isinstance(content, bytes):
        path.write_bytes(content)
        return
    with path.open("w", encoding="utf-8", errors="replace", newline="") as file:
        file.writelines([content] if isinstance(content, str) else content)


def _unique(path: Path) -> Path:
    """A hidden name beside `path` that nobody else uses, also of two writers at once."""
    return path.with_name(f".{path.name}.{token_hex(4)}.partial")


def _followed(path: Path) -> Path:
    """Where a file is to be written; what is there and no file (a device, a folder) stays."""
    try:
        target = path.resolve() if path.is_symlink() else path
        other = target.exists() and not target.is_file()
    except (OSError, RuntimeError) as error:  # links in a circle
        reason = error.strerror if isinstance(error, OSError) else "links that lead in a circle"
        raise StandError(f"{path}: cannot write there: {reason}") from error
    if other:
        raise StandError(f"{path}: cannot write there: is not a file")
    return target


@contextmanager
def _new_parents(path: Path, name: str) -> Iterator[None]:
    """Make the folders above `path`; on a failure those that were made and are empty go again."""
    made: list[Path] = []
    try:
        try:
            for folder in reversed([path.parent, *path.parent.parents]):
                if not folder.is_dir():
                    folder.mkdir(exist_ok=True)
                    made.append(folder)
        except OSError as error:
            raise StandError(f"{name}: cannot write there: {error.strerror}") from error
        yield
    except BaseException:
        with suppress(OSError):
            for folder in reversed(made):
                folder.rmdir()
        raise


@contextmanager
def _named(beside: Path, out: Path, name: str) -> Iterator[None]:
    """Faults of writing `beside` are told with the name of what it becomes."""
    try:
        yield
    except StandError as error:
        error.args = (str(error).replace(str(beside), str(out)),)
        raise
    except OSError as error:
        if not error.filename and error.errno not in _OF_THE_DISK:
            raise
        where = Path(str(error.filename or beside))
        if where != beside and beside not in where.parents:
            raise  # of something else, which it names
        within = "" if where == beside else f"{out / where.relative_to(beside)}"
        raise StandError(f"{within or name}: cannot write there: {error.strerror}") from error


def _put_in_place(beside: Path, out: Path) -> None:
    """The old folder leaves only for a new one that has come."""
    old = beside.with_suffix(".old")
    there = out.exists()
    if there:
        out.rename(old)
    try:
        beside.rename(out)
    except OSError:
        if there:
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)
