"""What a person may ask of a run: each argument checked, before anything heavy is imported."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from enum import Enum
from inspect import Parameter, signature
from math import isfinite
from numbers import Real
from os import PathLike, fspath
from typing import TypeVar

from alignment import Site
from alignment.units import DEG
from stand.errors import StandError, unknown

HIGHEST_RATE_HZ = 10_000
ALLAN_TERMS = ("N", "B", "K", "Q", "R")
LOWEST_M, HIGHEST_M = -1000, 10_000  # of a site
MOST_RUNS = 10_000_000
MOST_WORKERS = 1024  # processes of one machine: beyond, it is a slip

Choice = TypeVar("Choice", bound=Enum)
Named = str | PathLike[str]


def site_with(site: Site, latitude_deg: float | None, height_m: float | None) -> Site:
    """The site with what was said instead."""
    if latitude_deg is not None:
        if not abs(_number("latitude", latitude_deg)) <= 90:
            raise StandError(f"latitude = {latitude_deg:g} deg: must be -90 to 90")
        site = replace(site, latitude=latitude_deg * DEG)
    if height_m is not None:
        if not (isfinite(_number("height", height_m)) and LOWEST_M <= height_m <= HIGHEST_M):
            raise StandError(f"height = {height_m:g} m: must be {LOWEST_M} to {HIGHEST_M}")
        site = replace(site, height=height_m)
    return site


def _number(name: str, value: float) -> float:
    if not isinstance(value, Real):
        raise StandError(f"{name} = {value!r}: must be a number")
    return value


def entry_name(what: str, name: Named) -> str:
    """The id or path that names an entry of a catalogue."""
    if not isinstance(name, str | PathLike):
        raise StandError(f"{what} = {name!r}: must be an id, a path, or one that is loaded")
    return fspath(name)


def one_of(name: str, value: str, choices: type[Choice]) -> Choice:
    """A choice by its word."""
    if value not in [choice.value for choice in choices]:
        raise unknown(name, value, [choice.value for choice in choices])
    return choices(value)


def words(name: str, given: Sequence[str]) -> tuple[str, ...]:
    """Several words, of which text would be its letters."""
    if isinstance(given, str) or not all(isinstance(word, str) for word in given):
        raise StandError(f"{name} = {given!r}: must be a list of words")
    return tuple(given)


def refuse_mistaken(mistaken: Collection[str], function: Callable[..., object]) -> None:
    """Keywords that a function does not have: the near ones are named, with their units."""
    for name in mistaken:
        parameters = signature(function).parameters.values()
        known = [p.name for p in parameters if p.kind is not Parameter.VAR_KEYWORD]
        raise unknown("argument", name, known)
