"""What a drive left behind, and its JSON form."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from alignment import Priors, Site
from alignment.methods.vectors import Curve, Fixes, Matching
from alignment.methods.vectors.method import METHOD
from alignment.units import DEG
from stand.arguments import HIGHEST_RATE_HZ
from stand.errors import StandError
from stand.evaluation.milestones import LIMITS, doubts, needed, points
from stand.evaluation.score import Score, score_to_json
from stand.imu import ImuSpec, unstated
from stand.imu.priors import noise_alone, priors_of
from stand.vehicle.scenario import Drive
from stand.versions import versions

LOWEST_RATE_HZ = 20  # means over longer samples are not exact: see `Path.means`
MOST_SAMPLES = 10_000_000  # of a drive: they are held at once, some hundred bytes each
START_SIGMA = 0.5 * DEG  # of the programmed start about each axis, as published


@dataclass(frozen=True, slots=True, eq=False)
class DriveSettings:
    """All that decides a drive: same settings, same bytes of `run.mcap`."""

    drive: Drive
    imu: ImuSpec
    rate_hz: int = 200
    seed: int = 0

    def __post_init__(self) -> None:
        if not LOWEST_RATE_HZ <= self.rate_hz <= HIGHEST_RATE_HZ:
            raise StandError(
                f"rate = {self.rate_hz} Hz: must be {LOWEST_RATE_HZ} to {HIGHEST_RATE_HZ}"
            )
        samples = self.drive.path.duration * self.rate_hz
        if samples > MOST_SAMPLES:
            raise StandError(
                f"rate = {self.rate_hz} Hz: {samples:.3g} samples in "
                f"{self.drive.path.duration:g} s, must be at most {MOST_SAMPLES:.3g}"
            )
        if self.seed < 0:
            raise StandError(f"seed = {self.seed}: must be 0 or more")

    @property
    def site(self) -> Site:
        """Where the drive begins."""
        start = self.drive.path.start
        return Site(latitude=start.latitude, height=start.height, longitude=start.longitude)

    @property
    def priors(self) -> Priors:
        """What the unit's data sheet says."""
        return priors_of(self.imu, None)


@dataclass(frozen=True, slots=True, eq=False)
class DriveResult:
    """What a drive left behind.

    `start_error` [rad] is how wrong the programmed attitude was, the whole turn; `matchings` and
    `curves` by solution, `refusals` of solutions that gave nothing at all; `scores` at the last
    fix.
    """

    out: Path
    settings: DriveSettings
    samples: int
    fixes: Fixes
    start_error: float
    matchings: dict[str, Matching]
    curves: dict[str, Curve]
    refusals: dict[str, str]
    scores: tuple[Score, ...]


def result_json(result: DriveResult) -> dict[str, Any]:
    """The drive's result for machines."""
    s = result.settings
    return {
        "drive": s.drive.id,
        "imu": s.imu.id,
        "seed": s.seed,
        "rate_hz": s.rate_hz,
        "duration_s": s.drive.path.duration,
        "samples": result.samples,
        "fixes": len(result.fixes),
        "latitude_deg": s.drive.path.start.latitude / DEG,
        "start_sigma_deg": START_SIGMA / DEG,
        "start_error_deg": result.start_error / DEG,
        "versions": versions(),
        "solutions": [_solution_json(name, result) for name in result.matchings],
        "refusals": [
            {"method": METHOD, "window": name, "reason": r} for name, r in result.refusals.items()
        ],
        "estimates": [score_to_json(one, noise_alone(s.imu)) for one in result.scores],
        "unstated": list(unstated(s.imu)),
    }


def _solution_json(name: str, result: DriveResult) -> dict[str, Any]:
    curve, matching = result.curves[name], result.matchings[name]
    corrected = matching.t[matching.corrected]
    counts = [(limit, *needed(curve, limit)) for limit in LIMITS]
    return {
        "solution": name,
        "after": [
            {
                "fixes": p.fixes,
                "error_deg": None if p.undetermined else p.error / DEG,
                "sigma_deg": p.sigma / DEG,
                "undetermined": p.undetermined,
                "noise_only": bool(noise_alone(result.settings.imu)),
                "state": p.state,
            }
            for p in points(curve)
        ],
        "fixes_needed": [
            {"below_deg": limit / DEG, "by_error": error, "by_sigma": sigma}
            for limit, error, sigma in counts
        ],
        "corrections": len(corrected),
        "first_correction_s": float(corrected[0]) if len(corrected) else None,
        "doubts": [
            {
                "fixes": d.count,
                "first_fix": d.first,
                "last_fix": d.last,
                "corrected": d.corrected,
                "text": d.text,
            }
            for d in doubts(matching)
        ],
    }
