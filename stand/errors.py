"""Known faults: each becomes one line and exit code 2 at the command line."""

import difflib
import operator
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from alignment.errors import Fault


class StandError(Fault):
    """A fault of the input, told in one line: file, field, value and what is allowed.

    Whatever the input put into `message`, line breaks and control characters become blanks.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


@contextmanager
def located(where: object) -> Iterator[None]:
    """Known faults are told with where they lie: a file, a topic."""
    try:
        yield
    except StandError as error:
        raise StandError(f"{where}: {error}") from error


def printable(text: str) -> str:
    """The text without line breaks and control characters, which could steer a terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)


def whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number from `least` to `most`; anything else is refused by its name."""
    try:
        number = operator.index(value)
    except TypeError:
        message = f"{name} = {value!r}: must be a whole number, {least} or more"
        raise StandError(message) from None
    if number < least:
        raise StandError(f"{name} = {number}: must be {least} or more")
    if most is not None and number > most:
        raise StandError(f"{name} = {number}: must be {most} or less")
    return number


def unknown(what: str, name: object, allowed: Iterable[str]) -> StandError:
    """An error for a name that is not in a list, with near matches first."""
    names = sorted(allowed)
    near = difflib.get_close_matches(str(name), names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    return StandError(f"unknown {what} {name!r}: {hint}known: {', '.join(names)}")
