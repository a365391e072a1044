"""The `stand` command: its list of commands, exit codes, and the one line of a known fault.

Heavy imports (MuJoCo, SciPy, rerun) wait inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand.cli.align import align, allan, import_log
from stand.cli.calibrate import apply, calibrate
from stand.cli.campaign import campaign
from stand.cli.catalogue import check_imu, check_table, list_entries, new
from stand.cli.command import Command
from stand.cli.film import film, picture
from stand.cli.progress import Stopped
from stand.cli.propose import propose
from stand.cli.review import recover, report, view
from stand.cli.run import drive, run
from stand.cli.stretches import stretches
from stand.cli.study import compare, export, rehearse
from stand.physics import set_driver_aside
from stand.threads import set_one_thread
from stand.unneeded import put_off_the_unneeded
from stand.versions import VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

INTERRUPTED = 130  # 128 + SIGINT, as shells have it

COMMANDS = {
    "run": run,
    "drive": drive,
    "align": align,
    "calibrate": calibrate,
    "apply": apply,
    "compare": compare,
    "rehearse": rehearse,
    "propose": propose,
    "campaign": campaign,
    "export": export,
    "import": import_log,
    "list": list_entries,
    "allan": allan,
    "stretches": stretches,
    "report": report,
    "film": film,
    "picture": picture,
    "recover": recover,
    "check-imu": check_imu,
    "check-table": check_table,
    "new": new,
    "view": view,
}


def main() -> None:
    """Entry point: known faults become one line and exit code 2."""
    set_driver_aside()
    set_one_thread()
    put_off_the_unneeded()
    _set_streams()
    signal.signal(signal.SIGTERM, _interrupt)
    asked = sys.argv[1:2]  # typer builds every command that it has before it looks which is asked
    own = application(asked) if set(asked) <= COMMANDS.keys() and asked else app
    sys.exit(guarded(lambda: own(standalone_mode=False)))


def _set_streams() -> None:
    """Output that a terminal of few letters, or none at all, can take."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who called
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        else:
            stream.reconfigure(errors="replace")


def _interrupt(signum: int, frame: object) -> None:
    raise KeyboardInterrupt


def guarded(command: Callable[[], Any]) -> int:
    """Run a command; exit code 0, 2 for bad input, 130 when interrupted; a bug is raised."""
    try:
        code = command()
    except typer.TyperException as error:
        return _complain(error.format_message())
    except (typer.Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except typer.Exit as stop:
        return stop.exit_code
    except Stopped as stopped:
        return _complain(str(stopped), INTERRUPTED)
    except OSError as error:  # a full disk, a folder without permission
        named = f"{error.filename}: " if error.filename else ""
        return _complain(f"{named}{error.strerror or error}")
    except MemoryError as error:
        return _complain(f"not enough memory: {error}")
    except Exception as error:
        from alignment.errors import Fault  # not before: it takes its time to import

        if not isinstance(error, Fault):  # a bug: its traceback, and exit code 1
            raise
        return _complain(str(error))
    if code == INTERRUPTED:  # typer turns Ctrl-C inside a command into this code
        return _complain("interrupted: nothing was written", INTERRUPTED)
    return code if isinstance(code, int) else 0


def _complain(message: str, code: int = 2) -> int:
    from stand.errors import printable  # not before, as above

    print(f"stand: {' '.join(printable(message).split())}", file=sys.stderr)
    return code


def _version(wanted: bool) -> None:
    if wanted:
        print(f"stand {VERSION}")
        raise typer.Exit


def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


def application(names: Iterable[str]) -> typer.Typer:
    """The command line with these of `COMMANDS`."""
    new = typer.Typer(
        name="stand",
        help="Virtual IMU test stand: rehearse a turntable test, record it, align from readings."
        "\n\nStart with: stand run six-position",
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name in names:
        new.command(name, cls=Command)(COMMANDS[name])
    new.callback(invoke_without_command=True)(_root)
    return new


app = application(COMMANDS)
