"""What a foreign log looks like before anything is told of it, and the command that reads it."""

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from alignment.units import STANDARD_GRAVITY
from stand.errors import StandError
from stand.folder import refuse_no_file
from stand.recording.log_columns import (
    CHANNELS,
    SKIP,
    SPLIT_STAMP,
    guessed_columns,
    sensor_unit,
)
from stand.recording.text_table import TextLayout, is_text, layout_of, number_of

SHOWN = 3  # rows
NEAR = 0.05  # relative, to gravity in one of its units
UNKNOWN = "UNIT"
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", None: "blanks"}


@dataclass(frozen=True, slots=True)
class Inspection:
    """What is seen in a text: `form` in words, `names` and first `rows` of its columns, what each
    seems to be (`guesses`), and the `command` to type, with UNIT or RATE where nothing tells."""

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
            head.append(f"{k + 1:4d}  {guess:8s}{name or '(no name)'}: {first} ...")
        return [*head, f"If that is right: {self.command}"]


def inspect(path: Path) -> Inspection:
    """Look at a foreign log.

    Raises
    ------
    StandError
        Not there, no rows of numbers, or binary, which does not say what its rows are.
    """
    refuse_no_file(path)
    try:
        if path.is_file() and not is_text(path):
            raise StandError(
                f"{path}: binary: give its rows by --columns t,gx,gy,gz,ax,ay,az (in order, - "
                "skips one), --format '<f8' or another numpy type, --gyro-unit and --accel-unit"
            )
        layout = layout_of(path)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
    names = layout.names + ("",) * (layout.filled - len(layout.names)) if layout.names else ()
    guesses = guessed_columns(names, layout.filled)
    return Inspection(
        path=str(path),
        form=_form(layout),
        names=names,
        rows=layout.rows[:SHOWN],
        guesses=tuple(guesses),
        command=_command(path, layout, guesses),
    )


def _form(layout: TextLayout) -> str:
    comma = ", decimal comma" if layout.decimal_comma else ""
    head = f"{layout.first} lines of header" if layout.first != 1 else "1 line of header"
    return f"{layout.filled} columns between {_SEPARATORS[layout.separator]}{comma}, {head}"


def _command(path: Path, layout: TextLayout, guesses: list[str]) -> str:
    columns = list(guesses) + [SKIP] * (layout.width - layout.filled)
    parts = ["stand", "import", str(path), "--columns", ",".join(columns)]
    for sensor, first in (("gyro", "g"), ("accel", "a")):
        headers = [
            layout.names[k]
            for k, guess in enumerate(guesses)
            if guess in CHANNELS and guess.startswith(first) and layout.names
        ]
        try:
            sensor_unit(sensor, None, headers)
        except StandError:
            unit = _by_gravity(layout, guesses) if sensor == "accel" else UNKNOWN
            parts += [f"--{sensor}-unit", unit]
    if "t" not in guesses and not set(SPLIT_STAMP) <= set(guesses):
        parts += ["--rate", "RATE"]
    return shlex.join([*parts, "--out", f"{path.stem}.mcap"])


def _by_gravity(layout: TextLayout, guesses: list[str]) -> str:
    """The unit in which the first specific forces are gravity."""
    places = [k for k, guess in enumerate(guesses) if guess in ("ax", "ay", "az")]
    try:
        force = np.array(
            [[number_of(row[k], layout.decimal_comma) for k in places] for row in layout.rows]
        )
    except (ValueError, IndexError):
        return UNKNOWN
    if len(places) != 3:
        return UNKNOWN
    with np.errstate(all="ignore"):  # any number may stand there
        size = float(np.linalg.norm(force.mean(axis=0)))
    units = {"m/s^2": STANDARD_GRAVITY, "g": 1.0, "mg": 1e3}
    return next((u for u, g in units.items() if abs(size / g - 1) < NEAR), UNKNOWN)
