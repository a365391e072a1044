"""Choices of the methods, apart from the readings and the site."""

from dataclasses import dataclass

from alignment.angles import SequenceRule


@dataclass(frozen=True, slots=True)
class Options:
    """What a person may choose.

    `offset_window` [s]: how much of each dwell gives the zero offsets. `rule`: which order of
    turns each position is read by.
    """

    offset_window: float = 10.0
    rule: SequenceRule = SequenceRule.REGULAR
