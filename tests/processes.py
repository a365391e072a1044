"""Processes that a command under test has started."""

import os
import signal
import subprocess
import sys

TICKS = os.sysconf("SC_CLK_TCK")


STAND = [sys.executable, "-c", "from stand.cli.app import main; main()"]


def begun(arguments, **options):
    """`stand` with these arguments, in a group of its own that Ctrl-C reaches."""
    return subprocess.Popen(
        [*STAND, *arguments],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        # where the tests run in the background, Ctrl-C is ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )


def members(group):
    """Processes of a group, by /proc."""
    return list(_times(group))


def spent(group):
    """Seconds of processors that a group has used: how far it is, however busy the machine."""
    return sum(_times(group).values())


def _times(group):
    found = {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat", encoding="utf-8") as file:
                    fields = file.read().rpartition(")")[2].split()
            except OSError:
                continue
            state, _, own = fields[:3]
            if int(own) == group and state != "Z":
                found[int(entry)] = (int(fields[11]) + int(fields[12])) / TICKS
    return found
