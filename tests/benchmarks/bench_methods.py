"""Speed of the methods and of their comparison: rows for `make bench`.

Each figure stands beside its goal; nothing is asserted.
"""

import os
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from alignment import ESTIMATORS, ImuReadings
from alignment.allan import analyse
from alignment.calibration.bench import Bench
from alignment.calibration.calibrate import calibrate
from alignment.calibration.fit import fitted
from alignment.calibration.observe import observed
from alignment.noise import check_at_rest, gap_doubt, mean_and_variance
from stand.evaluation.comparison import compare
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, settings

Best = Callable[[Callable[[], object], int], float]
Rows = list[tuple[str, str, str]]
COMPARED = ("triad", "two-position")


def settings_of(name: str, rate_hz: int, imu: str = "ring-laser") -> Settings:
    """A procedure as `stand compare` runs it."""
    return settings(name, imu, rate_hz=rate_hz)


def method_rows(best: Best) -> Rows:
    """Means, checks and whole methods, in samples/s of 200 Hz data."""
    settings = settings_of("two-position", 200)
    dwells, _ = Trials(settings).readings(0)
    dwell = dwells[0]
    readings, n = dwell.window(), len(dwell.window())
    rocking = settings_of("random-sway", 200)
    swaying, _ = Trials(rocking).readings(0)
    m = len(swaying[0].readings)

    def estimated(name: str) -> Callable[[], object]:
        return lambda: ESTIMATORS[name].estimate(swaying, rocking.site, rocking.options)

    def checked() -> None:
        check_at_rest(dwell)
        gap_doubt(dwell.window())

    def estimate() -> None:
        ESTIMATORS["triad"].estimate([dwell], settings.site, settings.options)

    return [
        _row("means and their variances", n / best(lambda: mean_and_variance(readings), 15), 50e6),
        _row("checks of rest and gaps", n / best(checked, 15), 5e6),
        _row("triad, whole", n / best(estimate, 7), 5e6),
        _row("inertial, rocking", m / best(estimated("inertial"), 3), 2e6),
        _row("fine, rocking, 10 updates/s", m / best(estimated("fine"), 3), 400e3),
    ]


def calibration_rows(best: Best) -> Rows:
    """Calibrations by `calibration-full` (60 stretches, 35 moves), once its design is known."""
    made = settings("calibration-full", "stim300", rate_hz=25, methods=["calibration"])
    bench = made.options.bench
    assert isinstance(bench, Bench)
    dwells, _ = Trials(made).readings(5000)
    seen = observed(dwells, made.site, bench.warmth)
    design = fitted([seen], bench, made.site).design

    def known() -> None:
        calibrate([seen], bench, made.site, design)

    calls = 5
    rate = calls / best(lambda: [known() for _ in range(calls)], 3)
    return [
        ("calibrations, procedure known", f"{rate:.3g} a second", f"{rate / 20:.2f} of the goal")
    ]


def allan_rows(n: int = 10_000_000) -> Rows:
    """Allan analysis of six channels of a long record."""
    rng = np.random.default_rng(0)
    w, f = rng.standard_normal((2, n, 3)) * 1e-3 + [[[0, 5e-5, 5e-5]], [[0, 9.81, 0]]]
    readings = ImuReadings(np.arange(1, n + 1) / 200, w, f)
    begin, cpu = time.perf_counter(), time.process_time()
    analyse(readings)
    took, cpu = time.perf_counter() - begin, time.process_time() - cpu
    what = f"allan of {n / 1e6:.0f} M samples, six channels"
    return [(what, f"{took:.1f} s ({cpu:.1f} s of computing)", f"{took / 3:.2f} of the goal's 3 s")]


def compare_rows() -> Rows:
    """Runs of `stand compare two-position` at 20 Hz, start of the processes included."""
    settings, rows = settings_of("two-position", 20), []
    per_core = 0.0
    for workers, runs in ((1, 60), (2, 240)):
        if workers > (os.cpu_count() or 1):
            break
        begin = time.perf_counter()
        compare(replace(settings, methods=COMPARED), runs, workers=workers)
        rate = runs / (time.perf_counter() - begin)
        per_core = per_core or rate
        name = f"compare two-position, {workers} core{'s' * (workers > 1)}"
        rows.append((name, f"{rate:.0f} runs/s", f"{rate / per_core:.2f} of one core"))
    return rows


def _row(what: str, rate: float, goal: float = 0.0) -> tuple[str, str, str]:
    return what, f"{rate:,.0f} samples/s", f"{rate / goal:.2f} of the goal" if goal else ""


if __name__ == "__main__":
    from bench import best

    for row in (*method_rows(best), *calibration_rows(best), *allan_rows(), *compare_rows()):
        print("{:36}{:>26}   {}".format(*row))
