"""The one entrance for logs: a file of any kind, known by its content, opened as one thing."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn, Protocol, Self

from stand.errors import StandError
from stand.recording.content import COMPRESSED, MESSAGES, kind_of
from stand.recording.expanded import expand
from stand.recording.foreign import load_foreign
from stand.recording.log_form import OF_MESSAGES, OF_TABLES, LogForm
from stand.recording.mcap.bag import bag_file, is_bag
from stand.recording.mcap.reader import FixLog, ImuLog, JointLog, LogFile, TruthLog, VelocityLog
from stand.recording.metadata import RUN, epoch_of
from stand.versions import VERSION

RUN_FILE = "run.mcap"
Progress = Callable[[float], None]


def unseen(done: float) -> None:
    """Progress that nobody watches."""


class OpenLog(Protocol):
    """A log that is open: what can be read of it, by what it is. `LogFile` has the words."""

    path: str

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...
    @property
    def metadata(self) -> dict[str, dict[str, str]]: ...
    def imu(self, topic: str | None = None) -> ImuLog: ...
    def truth(self) -> TruthLog: ...
    def joints(self, topic: str | None = None) -> JointLog: ...
    def fixes(self) -> FixLog: ...
    def velocities(self) -> VelocityLog: ...


def open_log(
    path: str | PathLike[str], form: LogForm | None = None, progress: Progress = unseen
) -> OpenLog:
    """Open a log of any kind: the way in for every command.

    Parameters
    ----------
    path : path
        A file of any kind that docs/own-logs.md lists, a folder of `stand run`, or of a ROS 2
        bag.
    form : LogForm, optional
        What is stated of it.
    progress : callable
        Told the part read, 0 to 1.

    Raises
    ------
    StandError
        One line: the file, what is wrong with it, what is allowed.
    """
    file, form = log_file(path), form or LogForm()
    kind = kind_of(file)
    if kind in COMPRESSED:
        return _ExpandedLog(file, kind, form, progress)
    if kind in MESSAGES:
        form.refuse(file, OF_TABLES, "is for tables; this log itself says what is in it")
        return LogFile(file, form, progress)
    form.refuse(file, OF_MESSAGES, "is for messages, this log is a table")
    return _TableLog(file, form, progress)


def read_imu(
    path: str | PathLike[str],
    topic: str | None = None,
    form: LogForm | None = None,
    progress: Progress = unseen,
) -> ImuLog:
    """What the IMU said, of a log of any kind that nothing else is read from; as `open_log`."""
    with open_log(path, form, progress) as log:
        return log.imu(topic)


def forms_of(paths: Sequence[str | PathLike[str]], form: LogForm) -> list[LogForm]:
    """What one form of several logs says of each; errors as `open_log`.

    Beside a log of others a recording of this stand needs none, and beside a table messages say
    themselves what is in them. An option that is for none of them stays, to be refused.
    """
    told = [_says_itself(path) for path in paths]
    alone = {False: OF_TABLES, True: OF_MESSAGES}
    found = []
    for messages, ours in told:
        spared = alone[not messages] if (not messages, False) in told else ()
        others = any(not own for _, own in told)
        found.append(LogForm() if ours and others else form.without(spared))
    return found


def _says_itself(path: str | PathLike[str]) -> tuple[bool, bool]:
    """Whether a log is of messages, and whether this stand wrote it."""
    file = log_file(path)
    if kind_of(file) not in MESSAGES:
        return False, False
    with LogFile(file) as log:
        return True, "stand_version" in log.metadata.get(RUN, {})


def log_file(path: str | PathLike[str]) -> Path:
    """The file of a log: itself, or that of a folder; a bag of several is its folder.

    Raises
    ------
    StandError
        A folder with neither: what lies in it that is a recording is named.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    if is_bag(path):
        return bag_file(path)
    if not (path / RUN_FILE).exists():
        within = sorted(file.parent.name for file in path.glob(f"*/{RUN_FILE}"))
        one = f"; give one of its folders: {', '.join(within)}" if within else ""
        raise StandError(f"{path}: a folder without {RUN_FILE}, holds no recording{one}")
    return path / RUN_FILE


def origin_of(log: ImuLog) -> int:
    """What the times of a log count from [ns]: its own epoch, or its first sample."""
    return epoch_of(log.metadata) if is_ours(log) else int(log.t_ns[0])


def is_ours(log: ImuLog) -> bool:
    """Whether this stand wrote the log, or brought it in."""
    return "stand_version" in log.metadata.get(RUN, {})


class _ExpandedLog:
    """A log in a file that is compressed as a whole: what is within, told by the file's name."""

    def __init__(self, path: Path, kind: str, form: LogForm, progress: Progress) -> None:
        self.path = str(path)
        self._folder = TemporaryDirectory()
        self._inner = Path(self._folder.name) / (path.stem or path.name)
        try:
            expand(path, kind, self._inner)
            with self._by_name():
                if kind_of(self._inner) in COMPRESSED:
                    raise StandError(f"{self._inner}: is compressed twice")
                self._log = open_log(self._inner, form, progress)
        except BaseException:
            self._folder.cleanup()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._log.__exit__(*exc)
        self._folder.cleanup()

    @contextmanager
    def _by_name(self) -> Iterator[None]:
        try:
            yield
        except StandError as error:
            raise StandError(str(error).replace(str(self._inner), self.path)) from error

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        with self._by_name():
            return self._log.metadata

    def imu(self, topic: str | None = None) -> ImuLog:
        with self._by_name():
            return replace(self._log.imu(topic), path=self.path)

    def truth(self) -> TruthLog:
        with self._by_name():
            return replace(self._log.truth(), path=self.path)

    def joints(self, topic: str | None = None) -> JointLog:
        with self._by_name():
            return replace(self._log.joints(topic), path=self.path)

    def fixes(self) -> FixLog:
        with self._by_name():
            return replace(self._log.fixes(), path=self.path)

    def velocities(self) -> VelocityLog:
        with self._by_name():
            return replace(self._log.velocities(), path=self.path)


class _TableLog:
    """A log of readings alone: no joints, no fixes, no truth."""

    def __init__(self, path: Path, form: LogForm, progress: Progress) -> None:
        self.path = str(path)
        self._form, self._progress = form, progress

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        return {}

    def imu(self, topic: str | None = None) -> ImuLog:
        log = load_foreign(Path(self.path), self._form, topic, self._progress)
        record = {"epoch_ns": str(log.epoch_ns), "stand_version": VERSION}
        return ImuLog(
            path=self.path,
            topic=log.topic,
            frame_id="",
            t_ns=log.t_ns + log.epoch_ns,
            w_ib_b=log.w_ib_b,
            f_b=log.f_b,
            metadata={RUN: record},
            notes=log.notes,
        )

    def truth(self) -> NoReturn:
        raise StandError(f"{self.path}: a table of readings, it has no truth")

    def joints(self, topic: str | None = None) -> NoReturn:
        raise StandError(f"{self.path}: a table of readings, it has no joints")

    def fixes(self) -> NoReturn:
        raise StandError(f"{self.path}: a table of readings, it has no satellite fixes")

    def velocities(self) -> NoReturn:
        raise StandError(f"{self.path}: a table of readings, it has no satellite fixes")
