"""The options that say how a log of others is read: the same for every command that takes one."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Annotated, Any, get_args, get_type_hints

import typer

_FORM = "form"
_LOG_NAME = re.compile(r"^--([a-z-]+)")


def _stated(
    columns: Annotated[
        str | None,
        typer.Option(
            help="Of a table, in order, out of t (or sec,nanosec or week,tow),gx,gy,gz,ax,ay,az; "
            "- skips one. Or by header or number: t=time_us,gx=2,...  Else by clear headers."
        ),
    ] = None,
    gyro_unit: Annotated[
        str | None, typer.Option(help="dps, deg/h, rad/s ...; deg: increments. Else the header's.")
    ] = None,
    accel_unit: Annotated[
        str | None, typer.Option(help="m/s^2, g, mg ...; m/s: increments. Else the header's.")
    ] = None,
    gyro_scale: Annotated[float, typer.Option(help="What one count (LSB) is, in its unit.")] = 1.0,
    accel_scale: Annotated[float, typer.Option(help="The same of the accelerometers.")] = 1.0,
    time_unit: Annotated[
        str | None, typer.Option(help="s, ms, us, ns, 100us or iso; else as the log says, or s.")
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="Of a log without times: t is not read."),
    ] = None,
    wrap: Annotated[
        float | None,
        typer.Option(help="t is a counter that begins anew after so much, in its unit."),
    ] = None,
    file_format: Annotated[
        str | None,
        typer.Option(
            "--format", help="csv, f8le or a numpy type such as '>f4'; else by the content."
        ),
    ] = None,
    skip_bytes: Annotated[int, typer.Option(help="Before the first binary row.")] = 0,
    axes: Annotated[
        str | None,
        typer.Option(
            metavar="X,-Z,Y", help="What X1, Y1, Z1 are of the log's axes; or FRD, FLU, RFU."
        ),
    ] = None,
    stamps: Annotated[
        str, typer.Option(help="Of messages: of their header, or log, when they were written.")
    ] = "header",
    frame: Annotated[
        str | None, typer.Option(help="Which frame_id, where several share a topic.")
    ] = None,
    sampling: Annotated[
        str, typer.Option(help="Samples are the mean since the one before, or the instant.")
    ] = "mean",
) -> None:
    """How a log is read, of the fields of `LogForm`."""


_OPTIONS = inspect.signature(_stated, eval_str=True).parameters


def takes_log_form(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command whose argument `form`, a `LogForm`, is made of options that all such share.

    One whose name is an option of the command's own comes as --log-name.
    """
    command.__annotations__.pop(_FORM)  # no option: its class waits for the command to run
    signature = inspect.signature(command, eval_str=True)
    own = [p for name, p in signature.parameters.items() if name != _FORM]
    taken = {name for p in own for name in _names(p)}
    shared = [_beside(p, taken) for p in _OPTIONS.values()]

    @functools.wraps(command)
    def wrapped(**given: Any) -> Any:
        from stand.errors import StandError
        from stand.recording.log_form import LogForm

        try:
            form = LogForm(**{name: given.pop(name) for name in _OPTIONS})
        except StandError as error:  # told by the names that this command has
            raise StandError(_LOG_NAME.sub(partial(_beside_name, taken), str(error))) from error
        return command(**given, form=form)

    wrapped.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own] + shared
    )
    hints = get_type_hints(command, include_extras=True)
    wrapped.__annotations__ = hints | {p.name: p.annotation for p in shared}
    del wrapped.__wrapped__  # type: ignore[attr-defined]
    return wrapped


def _beside_name(taken: set[str], found: re.Match[str]) -> str:
    return f"--log-{found[1]}" if found[0] in taken else found[0]


def _names(parameter: inspect.Parameter) -> set[str]:
    """Of the option of a command's parameter: as it is told, or made of the parameter's name."""
    told = [name for a in get_args(parameter.annotation) for name in _told(a)]
    return set(told) or {f"--{parameter.name}"}


def _told(option: Any) -> list[str]:
    """Names in an annotation; typer keeps the first one where a default would be."""
    told = (getattr(option, "default", None), *(getattr(option, "param_decls", None) or ()))
    return [name for name in told if isinstance(name, str) and name.startswith("--")]


def _beside(parameter: inspect.Parameter, taken: set[str]) -> inspect.Parameter:
    """The parameter of a shared option, under a name that is not taken."""
    (name,) = _names(parameter)
    kind, option = get_args(parameter.annotation)
    if name in taken:
        option = copy(option)
        option.default = f"--log-{name.lstrip('-')}"
    return parameter.replace(
        kind=inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[kind, option]
    )
