"""What is worked out of a record once, whoever asks again: several methods look at the same one."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

T = TypeVar("T")
R = TypeVar("R")


def once(function: Callable[[T], R]) -> Callable[[T], R]:
    """The same function of one immutable object; its answer is kept as long as the object is.

    Whoever asks gets the one answer that there is, so it must be immutable too. What is raised is
    raised anew each time.
    """
    known: WeakKeyDictionary[Any, R] = WeakKeyDictionary()

    @wraps(function)
    def kept(one: T) -> R:
        if one not in known:
            known[one] = function(one)
        return known[one]

    return kept
