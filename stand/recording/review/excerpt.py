"""A review of the samples alone: of any log, or of a stretch of a recording at its full rate."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from alignment import ImuReadings
from alignment.arrays import Array, IntArray
from alignment.units import DEG
from stand.recording.curves import Phase
from stand.recording.review.file import DEADLINE_S, check, naming, open_stream
from stand.recording.review.layout import excerpt_blueprint
from stand.recording.review.style import CHANNELS, TIMELINE, line_style, state_style, states_of
from stand.recording.thinning import bin_length, extremes_in

ROW_BUDGET = 200_000
"""Rows per series, as of the review of a run."""
PLOTS = CHANNELS[2:4]
"""Specific force, angular rate."""


def write_excerpt(
    path: Path, name: str, readings: ImuReadings, phases: Sequence[Phase] = ()
) -> int:
    """Write the samples of a stretch as an .rrd; `path` is overwritten.

    Parameters
    ----------
    path : Path
    name : str
        Shown with the recording.
    readings : ImuReadings
        n >= 1, on the recording's clock.
    phases : sequence of Phase
        Shown above the plots.

    Returns
    -------
    int
        Samples per bin of two rows; 1: every sample is there.

    Raises
    ------
    StandError
        It cannot be written.
    """
    m = bin_length(len(readings), ROW_BUDGET)
    values = (readings.f_b, 1.0), (readings.w_ib_b, DEG)
    rows = [extremes_in(readings.t, part, unit, m) for part, unit in values]
    with naming(path):
        path.open("wb").close()
        stream, found = open_stream(name)
        ranges = {c.entity: _range(part) for c, (_, part) in zip(PLOTS, rows, strict=True)}
        span = float(readings.t[0]), float(readings.t[-1])
        stream.send_blueprint(excerpt_blueprint(PLOTS, span, ranges, bool(phases)))
        stream.send_recording_name(name)
        for channel, (stamps, part) in zip(PLOTS, rows, strict=True):
            style = line_style(channel.names, channel.colors, width=1.2)
            stream.log(channel.entity, style, static=True, strict=True)
            _send(stream, channel.entity, stamps, rr.Scalars.columns(scalars=part))
        if phases:
            _send_phases(stream, phases)
        data = found.read(flush_timeout_sec=DEADLINE_S) or b""
        stream.disconnect()
        path.write_bytes(data)
        check(path, len(data), len(rows))
    return 1 if m <= 2 else m


def _range(values: Array) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _send(stream: rr.RecordingStream, entity: str, t_ns: IntArray, columns: Any) -> None:
    time = rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]"))
    stream.send_columns(entity, indexes=[time], columns=columns, strict=True)


def _send_phases(stream: rr.RecordingStream, phases: Sequence[Phase]) -> None:
    times, values = states_of(phases)
    _send(stream, "phase", np.array(times), rr.StateChange.columns(state=list(values)))
    stream.log("phase", state_style(phases), static=True, strict=True)
