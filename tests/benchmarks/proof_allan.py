"""Whether the Allan analysis earns its intervals: `make proof` writes docs/proof-allan.md.

Every preset as it is shipped (bandwidth, rounding, bias instability), simulated at rest and
analysed as `stand allan` does: how often the 95 % interval of N holds the data sheet's value, and
how wide it is against the scatter of the values. Runs know nothing of each other: seed k is unit k.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binom

from alignment.allan import channel
from stand.imu import load_imu
from stand.imu.model import Triad

RATE_HZ = 200
LEVEL = 0.95
FAMILY = (
    0.05  # chance that any one row of the page is outside its bounds, if all intervals are right
)
AXES = ("x", "y", "z")
INPUT = {"gyro": (4.8e-5, 5.5e-5, 0.0), "accel": (0.1, 9.81, -0.2)}  # rad/s, m/s^2: at rest
# (rests, seconds each): what `six-position` leaves, and an hour
SHAPES = ((1, 60), (6, 60), (1, 3600))
IMUS = (
    "adis16405", "adis16470", "adis16488", "bmi088", "hg1700", "hg4930", "hg9900", "icm42688p",
    "ln200s", "mpu9250", "primus200", "psins-inertial", "ring-laser", "stim300",
)  # fmt: skip
PAGE = Path(__file__).parents[2] / "docs" / "proof-allan.md"
HEAD = """# Coverage of the Allan analysis

Units as shipped, at rest, at {rate} Hz; all three axes of {seeds} units a row. "Holds": how many of
the 95 % intervals of N hold the value that the unit was made with; the bounds are those within
which all rows lie together in 95 of 100 such tables if every interval is right. "Width": half of
the interval, in per cent of N, over 1.96 standard deviations of the values: 1 if intervals are as
wide as they must be. Made by `make proof`.

| unit | sensor | rests | holds | bounds | N, mean over true | half width, % | width | stands |
|---|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Coverage:
    """What the intervals of N came to: `values` (n,), `low`, `high` over the true N."""

    values: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def holds(self) -> int:
        return int(np.count_nonzero((self.low <= 1) & (self.high >= 1)))

    @property
    def half_width(self) -> float:
        return float(np.mean(self.high - self.low)) / 2

    @property
    def width(self) -> float:
        """Of the intervals, over that of the scatter of the values."""
        return self.half_width / (1.96 * float(np.std(self.values, ddof=1)))


def coverage(imu: str, sensor: str, rests: int, seconds: int, seeds: Sequence[int]) -> Coverage:
    """N of one triad of a preset, over units that differ by their seed."""
    spec = load_imu(imu)
    triad = getattr(spec, sensor)
    found = []
    for seed in seeds:
        n = rests * seconds * RATE_HZ
        still = np.repeat(np.array(INPUT[sensor])[:, None], n, axis=1)
        force = still if sensor == "accel" else np.zeros((3, n))
        t = np.arange(1, n + 1) / RATE_HZ
        readings, _ = Triad(spec, sensor, seed, RATE_HZ).report(still, force, t, None)
        for axis, signal in zip(AXES, readings, strict=True):
            parts = np.split(signal, rests)
            one = channel(sensor, axis, parts, 1 / RATE_HZ, bandwidth=triad.bandwidth)
            noise = next((f for f in one.found if f.term == "N"), None)
            if noise is None:
                upper = next(m.upper for m in one.missing if m.term == "N")
                found.append((one.values[1], 0.0, upper))
            else:
                found.append((noise.value, noise.low, noise.high))
    return Coverage(*(np.array(found) / triad.noise).T)


def bounds(n: int, chance: float) -> tuple[int, int]:
    """How many of n right intervals hold the truth, but for a chance shared by both ends."""
    return int(binom.ppf(chance / 2, n, LEVEL)), int(binom.ppf(1 - chance / 2, n, LEVEL))


def rows(imus: Sequence[str], shapes: Sequence[tuple[int, int]], seeds: int) -> Iterator[str]:
    chance = FAMILY / (2 * len(imus) * len(shapes))
    for imu in imus:
        for sensor in INPUT:
            for rests, seconds in shapes:
                got = coverage(imu, sensor, rests, seconds, range(seeds))
                n = len(got.values)
                low, high = bounds(n, chance)
                stands = "yes" if low <= got.holds <= high else "**no**"
                yield (
                    f"| {imu} | {sensor} | {rests} x {seconds} s | {got.holds} of {n} "
                    f"| {low} to {high} | {got.values.mean():.4f} | {100 * got.half_width:.2f} "
                    f"| {got.width:.2f} | {stands} |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--only", nargs="*", default=[], metavar="IMU")
    parser.add_argument("--rests", type=int, nargs=2, metavar=("COUNT", "SECONDS"))
    asked = parser.parse_args()
    shapes = SHAPES if asked.rests is None else (tuple(asked.rests),)
    told = []
    for row in rows(asked.only or IMUS, shapes, asked.seeds):
        print(row, flush=True)
        told.append(row)
    if not asked.only and asked.rests is None:
        head = HEAD.format(rate=RATE_HZ, seeds=asked.seeds)
        PAGE.write_text(head + "\n".join(told) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
