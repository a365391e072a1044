"""What a log looks like before anything is stated of it, and the command that reads it."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from alignment.units import STANDARD_GRAVITY
from stand.errors import StandError
from stand.recording.content import BINARY, COMPRESSED, KNOWN, MESSAGES, TEXT, kind_of
from stand.recording.entrance import log_file
from stand.recording.expanded import expand
from stand.recording.formats import READERS
from stand.recording.log_columns import CHANNELS, SKIP, STAMPS, guessed_columns, sensor_unit
from stand.recording.mcap.reader import LogFile
from stand.recording.text_table import TextLayout, layout_of, number_of

SHOWN = 3  # rows
NEAR = 0.05  # relative, to gravity in one of its units
UNKNOWN = "UNIT"
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", None: "blanks"}


@dataclass(frozen=True, slots=True)
class Inspection:
    """What is seen in a log: `form` in words, `names` and first `rows` of its columns, what each
    seems to be (`guesses`), and the `command` to type, with UNIT or RATE where nothing tells. Of
    messages `names` are the topics and `guesses` their types; there are no rows."""

    path: str
    form: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    guesses: tuple[str, ...]
    command: str

    def lines(self) -> list[str]:
        """For people."""
        head = [f"{self.path}: {self.form}"]
        for k, guess in enumerate(self.guesses):
            name = self.names[k] if self.names else ""
            first = ", ".join(row[k].strip() if k < len(row) else "" for row in self.rows)
            told = f"{k + 1:4d}  {guess:8s}{name or '(no name)'}: {first} ..."
            head.append(told if self.rows else f"      {name}: {guess}")
        return [*head, f"If that is right: {self.command}"]


def inspect(path: Path, topic: str | None = None) -> Inspection:
    """Look at a log.

    Raises
    ------
    StandError
        Not there, no rows of numbers, damaged, or binary, which does not say what its rows are.
    """
    path = log_file(path)
    kind = kind_of(path)
    if kind in COMPRESSED:
        with TemporaryDirectory() as folder:
            inner = Path(folder) / (path.stem or path.name)
            expand(path, kind, inner)
            if kind_of(inner) in COMPRESSED:
                raise StandError(f"{path}: is compressed twice")
            found = inspect(inner, topic)
        told = found.command.replace(shlex.quote(str(inner)), shlex.quote(str(path)))
        return replace(found, path=str(path), form=f"{kind}, {found.form}", command=told)
    if kind == BINARY:
        raise StandError(
            f"{path}: binary: give its rows by --columns t,gx,gy,gz,ax,ay,az (in order, - "
            "skips one), --format '<f8' or another numpy type, --gyro-unit and --accel-unit"
        )
    if kind in MESSAGES:
        return _messages(path)
    return _text(path) if kind == TEXT else _arrays(path, kind, topic)


def _messages(path: Path) -> Inspection:
    with LogFile(path) as file:
        topics, imus = file.topics(), file.imu_topics()
    if not imus:
        raise StandError(f"{path}: no topic with sensor_msgs/msg/Imu; it has: {', '.join(topics)}")
    choice = ["--topic", imus[0]] if len(imus) > 1 else []
    return Inspection(
        path=str(path),
        form=f"messages of {len(topics)} topic{'s' * (len(topics) > 1)}",
        names=tuple(topics),
        rows=(),
        guesses=tuple(topics.values()),
        command=shlex.join(["stand", "align", str(path), *choice]),
    )


def _arrays(path: Path, kind: str, topic: str | None) -> Inspection:
    table = READERS[kind](path, topic)
    columns = [table.column(k) for k in range(table.width)]
    rows = [tuple(str(column[k]) for column in columns) for k in range(min(SHOWN, table.rows))]
    within = f" in {table.topic}" if table.topic else ""
    guesses = guessed_columns(table.names, table.width)
    command = _command(path, table.names, rows, guesses, decimal_comma=False)
    return Inspection(
        path=str(path),
        form=f"{KNOWN[kind]}: {table.width} columns of {table.rows} rows{within}",
        names=table.names,
        rows=tuple(rows),
        guesses=tuple(guesses),
        command=command + (f" --topic {shlex.quote(topic)}" if topic else ""),
    )


def _text(path: Path) -> Inspection:
    try:
        layout = layout_of(path)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
    guesses = guessed_columns(layout.names, layout.filled)
    rows = layout.rows[:SHOWN]
    skipped = [SKIP] * (layout.width - layout.filled)
    return Inspection(
        path=str(path),
        form=_form(layout),
        names=layout.names,
        rows=rows,
        guesses=tuple(guesses),
        command=_command(
            path, layout.names, layout.rows, guesses + skipped, decimal_comma=layout.decimal_comma
        ),
    )


def _form(layout: TextLayout) -> str:
    comma = ", decimal comma" if layout.decimal_comma else ""
    head = f"{layout.first} lines of header" if layout.first != 1 else "1 line of header"
    return f"{layout.filled} columns between {_SEPARATORS[layout.separator]}{comma}, {head}"


def _command(
    path: Path,
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    columns: Sequence[str],
    *,
    decimal_comma: bool,
) -> str:
    parts = ["stand", "import", str(path), "--columns", ",".join(columns)]
    for sensor, first in (("gyro", "g"), ("accel", "a")):
        headers = [
            names[k]
            for k, guess in enumerate(columns)
            if guess in CHANNELS and guess.startswith(first) and k < len(names)
        ]
        try:
            sensor_unit(sensor, None, headers)
        except StandError:
            accel = sensor == "accel"
            unit = _by_gravity(rows, columns, decimal_comma) if accel else UNKNOWN
            parts += [f"--{sensor}-unit", unit]
    if not any(set(stamp) <= set(columns) for stamp in STAMPS):
        parts += ["--rate", "RATE"]
    return shlex.join([*parts, "--out", f"{path.stem}.mcap"])


def _by_gravity(rows: Sequence[Sequence[str]], columns: Sequence[str], decimal_comma: bool) -> str:
    """The unit in which the first specific forces are gravity."""
    places = [k for k, guess in enumerate(columns) if guess in ("ax", "ay", "az")]
    try:
        force = np.array([[number_of(row[k], decimal_comma) for k in places] for row in rows])
    except (ValueError, IndexError):
        return UNKNOWN
    if len(places) != 3:
        return UNKNOWN
    with np.errstate(all="ignore"):  # any number may stand there
        size = float(np.linalg.norm(force.mean(axis=0)))
    units = {"m/s^2": STANDARD_GRAVITY, "g": 1.0, "mg": 1e3}
    return next((u for u, g in units.items() if abs(size / g - 1) < NEAR), UNKNOWN)
