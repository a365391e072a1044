"""A drive from path to result: simulated, recorded, solved by vector matching, scored."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError
from alignment.navigation import C_en, geodetic
from alignment.units import DEG
from alignment.vectors import Curve, Fixes, Matching, against
from alignment.vectors.method import METHOD, answer, options_of
from alignment.vectors.solutions import SOLUTIONS
from stand.drive import Drive, fixes_of, priors_of, programmed, readings_of, reported, sense
from stand.errors import StandError
from stand.folder import refuse_existing, written_beside
from stand.imu import Imu, ImuSpec
from stand.log import DRIVE, RUN, describe_drive, describe_estimate, describe_site
from stand.milestones import LIMITS, doubts, needed, points
from stand.physics.kinematics import C_NW
from stand.recording.interchange.writer import EPOCH_NS, Satellites, write_drive
from stand.report.vectors import picture
from stand.samples import ImuBlock, TruthBlock
from stand.score import Score, Truths, score, score_to_json
from stand.session import versions
from stand.simulation import HIGHEST_RATE_HZ

LOWEST_RATE_HZ = 20  # means over longer samples are not exact: see `Path.means`
START_SIGMA = 0.5 * DEG  # of the programmed start about each axis, as published
PICTURE = "errors.png"
_FIXES, _START = 101, 102  # random streams: numbers that no term of a unit has

Progress = Callable[[float], None]


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
        if self.seed < 0:
            raise StandError(f"seed = {self.seed}: must be 0 or more")

    @property
    def site(self) -> Site:
        """Where the drive begins."""
        start = self.drive.path.start
        return Site(start.latitude, start.height, longitude=start.longitude)

    @property
    def priors(self) -> Priors:
        """What the unit's data sheet says."""
        return priors_of(self.imu, self.site.gravity)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Driven:
    """What was simulated."""

    truth: TruthBlock
    unit: Imu
    imu: ImuBlock
    readings: ImuReadings
    fixes: Fixes
    start: Rotation


def run_id(settings: DriveSettings) -> str:
    """The default name of a drive: path, unit, seed."""
    return f"{settings.drive.id}_{settings.imu.id}_seed{settings.seed}"


def run_drive(
    settings: DriveSettings, out: Path, force: bool = False, progress: Progress = lambda done: None
) -> DriveResult:
    """Simulate, solve, and record.

    The recording is written beside `out` and renamed when whole; on any failure nothing is left.

    Parameters
    ----------
    settings : DriveSettings
    out : Path
        Folder for `run.mcap`, `result.json` and `errors.png`.
    force : bool
        Replace an existing recording.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        `out` exists (and not `force`), or cannot be written.
    """
    refuse_existing(out, force)
    driven = _simulated(settings, lambda done: progress(0.4 * done))
    matchings, refusals = _solved(settings, driven, lambda done: progress(0.4 + 0.4 * done))
    result = _scored(settings, out, driven, matchings, refusals)
    with written_beside(out) as beside:
        text = json.dumps(result_json(result), indent=1, allow_nan=False)
        _record(beside / "run.mcap", result, driven, text)
        progress(0.9)
        (beside / "result.json").write_text(text + "\n", encoding="utf-8")
        path = settings.drive.path
        title = f"{settings.drive.title}: {settings.imu.title}, seed {settings.seed}"
        (beside / PICTURE).write_bytes(picture(title, matchings, driven.fixes, path))
    progress(1.0)
    return result


def _simulated(settings: DriveSettings, progress: Progress) -> _Driven:
    path, rate = settings.drive.path, settings.rate_hz
    sensed = sense(path, rate, progress)
    unit = Imu(settings.imu, settings.seed, rate)
    block = reported(sensed, unit)
    q_wb = (C_NW.inv() * path.at(sensed.t_ns * 1e-9).C_nb).as_quat()
    nothing = np.zeros((len(block), 0))
    return _Driven(
        TruthBlock(sensed.t_ns, sensed.w_ib_b, sensed.f_b, q_wb, nothing, nothing),
        unit,
        block,
        readings_of(block),
        fixes_of(path, settings.drive.satellite, _stream(settings.seed, _FIXES)),
        programmed(path, START_SIGMA, _stream(settings.seed, _START)),
    )


def _stream(seed: int, source: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(source,)))


def _solved(
    settings: DriveSettings, driven: _Driven, progress: Progress
) -> tuple[dict[str, Matching], dict[str, str]]:
    """Every solution, or why there is none."""
    options = options_of(settings.priors, START_SIGMA)
    matchings, refusals = {}, {}
    for k, (name, solve) in enumerate(SOLUTIONS.items(), start=1):
        try:
            matchings[name] = solve(driven.readings, driven.fixes, driven.start, options)
        except AlignmentError as error:
            refusals[name] = str(error)
        progress(k / len(SOLUTIONS))
    return matchings, refusals


def _scored(
    settings: DriveSettings,
    out: Path,
    driven: _Driven,
    matchings: Mapping[str, Matching],
    refusals: Mapping[str, str],
) -> DriveResult:
    truth = settings.drive.path.at(driven.fixes.t).C_nb
    known, priors = Truths(truth[-1]), settings.priors
    answers = [answer(name, settings.drive.id, m, priors) for name, m in matchings.items()]
    return DriveResult(
        out,
        settings,
        len(driven.readings),
        driven.fixes,
        (driven.start * truth[0].inv()).magnitude(),
        dict(matchings),
        {name: against(m, truth) for name, m in matchings.items()},
        dict(refusals),
        tuple(score(estimate, known) for estimate in answers),
    )


def _record(path: Path, result: DriveResult, driven: _Driven, text: str) -> None:
    s = result.settings
    write_drive(
        path,
        truth=driven.truth,
        imu=driven.imu,
        satellites=_satellites(driven.fixes),
        epoch_ns=EPOCH_NS,
        metadata=_metadata(s, driven),
        attachments={
            "drive.toml": ("application/toml", s.drive.text.encode()),
            "imu.toml": ("application/toml", s.imu.text.encode()),
            "result.json": ("application/json", text.encode()),
        },
        rate_noise=np.full(3, driven.unit.gyro_sigma**2),
        force_noise=np.full(3, driven.unit.accel_sigma**2),
    )


def _satellites(fixes: Fixes) -> Satellites:
    latitude, longitude, height = geodetic(fixes.position)
    v_n = np.einsum("mji,mj->mi", C_en(latitude, longitude), fixes.velocity)
    return Satellites(
        np.round(fixes.t * 1e9).astype(np.int64),
        np.stack([latitude, longitude, height], axis=1),
        C_NW.apply(v_n, inverse=True),
        fixes.position_sigma**2 + fixes.position_drift**2,
        fixes.velocity_sigma**2 + fixes.velocity_drift**2,
    )


def _metadata(s: DriveSettings, driven: _Driven) -> dict[str, dict[str, str]]:
    return {
        RUN: {
            "drive": s.drive.id,
            "imu": s.imu.id,
            "seed": str(s.seed),
            "rate_hz": str(s.rate_hz),
            "sampling": "mean",
            "epoch_ns": str(EPOCH_NS),
            "frame_n": "north-east-down",
            "frame_b": "X1 forward, Y1 up, Z1 right",
        }
        | versions(),
        "site": describe_site(s.site),
        "estimate": describe_estimate(Options(priors=s.priors), [METHOD]),
        DRIVE: describe_drive(s.drive.id, s.drive.text, driven.fixes, driven.start, START_SIGMA),
        "imu": {"toml": s.imu.text},
    }


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
        "estimates": [score_to_json(scored) for scored in result.scores],
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
                "error_deg": p.error / DEG,
                "sigma_deg": p.sigma / DEG,
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
