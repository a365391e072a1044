"""Speed of films: rows for `make bench`, or alone. Nothing is asserted.

python tests/benchmarks/bench_film.py
"""

import resource
import tempfile
import time
from pathlib import Path

import stand
from stand.recording.log import Log
from stand.report.encoding import KINDS
from stand.report.film import SIZE, write_film

Rows = list[tuple[str, str, str]]
SHORT_S, LONG_S = 1.0, 5.0  # of film: their difference is without what is made once
MINUTE_S, GOAL_S = 60.0, 120.0

# All six axes move all the time, so that the stand is drawn for every picture.
ROCKING = """
title = "All axes rock"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = []
[[step]]
kind = "sine"
label = "rocking"
duration_s = 20
[step.axes]
""" + "".join(
    f"{axis} = {{ amplitude_deg = 5, frequency_hz = 0.2 }}\n"
    for axis in ("base_pitch", "base_roll", "base_yaw", "outer", "middle", "inner")
)


def film_rows(folder: Path) -> Rows:
    """A film whose stand never rests, of each kind: processor and wall time of its seconds."""
    (folder / "rocking.toml").write_text(ROCKING)
    stand.run(stand.settings(folder / "rocking.toml", rate_hz=100), out=folder / "rocking")
    log = stand.read(folder / "rocking")
    rows: Rows = []
    for ending in KINDS:
        spent = [_spent(log, folder / f"film{ending}", span) for span in (SHORT_S, LONG_S)]
        processor, wall = (
            (long - short) / (LONG_S - SHORT_S) for short, long in zip(*spent, strict=True)
        )
        rows.append(
            (
                f"film of {SIZE[0]} x {SIZE[1]}, {ending}",
                f"{processor:.2f} CPU s, {wall:.2f} s a second of film",
                f"60 s of it: {MINUTE_S * wall:.0f} s of {GOAL_S:.0f}",
            )
        )
    return rows


def _spent(log: Log, out: Path, span: float) -> tuple[float, float]:
    """Processor time, the drawing process's with it, and wall time of a film [s]."""
    begun, used = time.perf_counter(), _processor()
    write_film(log, out, t_from=5.0, t_to=5.0 + span, speed=1.0, force=True)
    return _processor() - used, time.perf_counter() - begun


def _processor() -> float:
    own = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(use.ru_utime + use.ru_stime for use in own)


def _main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for row in film_rows(Path(folder)):
            print("  ".join(row))


if __name__ == "__main__":
    _main()
