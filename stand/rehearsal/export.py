"""Hand-over to a real controller: the demanded motion on an even grid, and the list of steps."""

import csv
from collections.abc import Iterator
from io import StringIO
from itertools import chain
from math import ceil
from pathlib import Path

import numpy as np

from alignment.units import DEG
from stand.columns import cell
from stand.errors import StandError
from stand.folder import refuse_files, write_files
from stand.motion.plan import Plan
from stand.motion.planner import plan
from stand.motion.profile import MOST_ROWS, SUFFIXES, TIME
from stand.physics.mjcf import describe, load_model
from stand.simulation.settings import Settings
from stand.table.joints import JOINTS

PER_SECOND = 100  # rows
_BLOCK = 20_000  # rows worked out at once
STEP_COLUMNS = ("step", "kind", "label", "t_from_s", "t_to_s", "steady_from_s", "steady_to_s")


def steps_file(out: Path) -> Path:
    """Where the list of steps goes: beside the motion."""
    return out.with_name(f"{out.stem}_steps{out.suffix}")


def exported(settings: Settings, out: Path, force: bool = False) -> int:
    """Plan the settings' procedure and `export` it to new files.

    Raises
    ------
    StandError
        No file, or one that is there (and not `force`); the plan is impossible.
    """
    if out.name in ("", "..") or out.is_dir():
        raise StandError(f"--out {out}: must be a file")
    refuse_files((out, steps_file(out)), force=force)
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    stand = describe(load_model())
    return export(plan(settings.procedure, stand, settings.table, settings.seed), out)


def export(planned: Plan, out: Path) -> int:
    """Write angle, rate and acceleration of every axis each 10 ms, and the steps beside them.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    StandError
        More rows than a `profile` step reads.

    Notes
    -----
    Read back by a `profile` step the rows hold exactly; between two of them the motion is the
    quintic through both, which differs from a piece with a jerk switch J in it by up to
    ``J h^3 / 384`` (h = 10 ms; 5e-6 deg at 2000 deg/s^3).
    """
    count = ceil(planned.motion.duration * PER_SECOND - 1e-6) + 1
    if count > MOST_ROWS:
        raise StandError(
            f"{out}: {count} rows at {PER_SECOND} Hz, at most {MOST_ROWS} can be read back"
        )
    columns = [f"{joint}{suffix}" for joint in JOINTS for suffix in SUFFIXES]
    head = ",".join([TIME, *columns]) + "\n"
    write_files({out: chain([head], _lines(planned, count)), steps_file(out): _steps(planned)})
    return count


def _steps(planned: Plan) -> str:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(STEP_COLUMNS)
    for s in planned.steps:
        times = (s.t_from, s.t_to, s.steady_from, s.steady_to)
        writer.writerow([s.number + 1, s.kind, cell(s.label), *(f"{t:.9f}" for t in times)])
    return text.getvalue()


def _lines(planned: Plan, count: int) -> Iterator[str]:
    for first in range(0, count, _BLOCK):
        ticks = np.arange(first, min(first + _BLOCK, count))
        states = np.stack(planned.motion.joints(ticks / PER_SECOND), axis=2) / DEG
        states[np.abs(states) < 1e-15] = 0.0
        rows = states.reshape(len(ticks), -1).tolist()
        yield "".join(
            f"{k / PER_SECOND:.2f},{','.join(map(repr, row))}\n"
            for k, row in zip(ticks.tolist(), rows, strict=True)
        )
