"""What each command does with its words before it runs: refuse what is none, naming the value."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_NUMBERS = {int: "an integer", float: "a number"}


class Command(TyperCommand):
    """A command that names the value it refuses, and takes no empty word for one.

    An empty word is what a script leaves of a variable that nobody set: for a default it would
    stand silently. Where the default is empty itself it is one.
    """

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # pyright: ignore
        given, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        for param in self.params:
            if _empty(given.get(param.name)) and not _may_be_empty(param):
                hint = f"'{param.opts[0]}'"
                raise typer.BadParameter("must not be empty", ctx, param_hint=hint)
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            if error.param is not None and error.message:  # what is missing has none
                error.message = _named(error, given)
            raise


def _empty(value: Any) -> bool:
    return value == "" or (isinstance(value, list | tuple) and "" in value)


def _may_be_empty(param: Any) -> bool:
    """Where nothing is the default, or a name of a catalogue: that one tells what it has."""
    told = param.type_descriptor.annotation
    paths = any(
        isinstance(kind, type) and issubclass(kind, Path) for kind in (told, *get_args(told))
    )
    return param.default == "" or not (paths or param.opts[0].startswith("--"))


def _named(error: typer.BadParameter, given: Mapping[str, Any]) -> str:
    """What is wrong with a value, with the value."""
    assert error.param is not None
    told = error.param.type_descriptor.annotation
    for kind, words in _NUMBERS.items():
        if told is kind or kind in get_args(told):
            return f"{given.get(error.param.name)!r} must be {words}"
    return error.message.removeprefix("Value error, ")


def refuse_given(context: typer.Context, where: str, names: Iterable[str]) -> None:
    """`StandError` where the line has one of these options, which mean nothing `where`."""
    from stand.errors import StandError

    for param in context.command.params:
        source = context.get_parameter_source(param.name)
        if param.name in names and source is not None and source.name == "COMMANDLINE":
            raise StandError(f"{param.opts[0]}: means nothing {where}")
