"""A drive from path to result: simulated, recorded, solved by vector matching, scored."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, Options
from alignment.errors import AlignmentError
from alignment.methods.vectors import Fixes, Matching, against
from alignment.methods.vectors.method import METHOD, answer, options_of
from alignment.methods.vectors.solutions import SOLUTIONS
from alignment.navigation import C_en, geodetic
from stand.evaluation.drive_result import START_SIGMA, DriveResult, DriveSettings, result_json
from stand.evaluation.score import Truths, score
from stand.folder import folder_beside, recording_folder, refuse_existing, write_file
from stand.imu import Imu
from stand.imu.priors import noise_alone
from stand.recording.mcap.writer import EPOCH_NS, DriveWriter, Satellites
from stand.recording.metadata import DRIVE, RUN, describe_drive, describe_estimate, describe_site
from stand.report.vectors import picture
from stand.samples import Sensed, TruthBlock
from stand.table.kinematics import C_NW
from stand.vehicle.path import Path as Driven
from stand.vehicle.scenario import fixes_of, joined, readings_of, sense_blocks, started
from stand.versions import versions

PICTURE = "errors.png"
_FIXES, _START = 101, 102  # random streams: numbers that no term of a unit has

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class DriveSamples:
    """What the solutions of a drive are given: readings, fixes, the start as programmed."""

    readings: ImuReadings
    fixes: Fixes
    start: Rotation


def run_id(settings: DriveSettings) -> str:
    """The default name of a drive: path, unit, seed."""
    return f"{settings.drive.id}_{settings.imu.id}_seed{settings.seed}"


def run_drive(
    settings: DriveSettings,
    out: str | PathLike[str] | None = None,
    force: bool = False,
    progress: Progress = lambda done: None,
) -> DriveResult:
    """Simulate, solve, and record.

    The recording is written beside `out` and renamed when whole; on any failure nothing is left.

    Parameters
    ----------
    settings : DriveSettings
    out : path, optional
        Folder for `run.mcap`, `result.json` and `errors.png`; else `run_id` among the recordings.
    force : bool
        Replace an existing recording.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        `out` exists (and not `force`), or cannot be written.
    """
    folder = recording_folder(out, run_id(settings))
    refuse_existing(folder, force)
    with folder_beside(folder) as beside, _opened(beside / "run.mcap", settings) as file:
        driven = _simulated(settings, file, lambda done: progress(0.5 * done))
        result = solved(settings, driven, folder, lambda d: progress(0.5 + 0.4 * d))
        text = json.dumps(result_json(result), indent=1, allow_nan=False)
        write_file(beside / "result.json", text + "\n")
        write_file(beside / PICTURE, drawn(result))
    progress(1.0)
    return result


def solved(
    settings: DriveSettings,
    driven: DriveSamples,
    out: Path,
    progress: Progress = lambda done: None,
) -> DriveResult:
    """The drive's solutions of what was simulated, or of what is left of it."""
    matchings, refusals = _solved(settings, driven, progress)
    return _scored(settings, out, driven, matchings, refusals)


def drawn(result: DriveResult, note: str = "") -> bytes:
    """The errors of each solution over time as a PNG; `note` behind its title."""
    s = result.settings
    title = f"{s.drive.title}: {s.imu.title}, seed {s.seed}{note}"
    alone = bool(noise_alone(s.imu))
    return picture(title, result.matchings, result.fixes, s.drive.path, noise_only=alone)


def _opened(path: Path, s: DriveSettings) -> DriveWriter:
    """The recording, with all that is known before the drive."""
    unit, fixes = _unit(s), _fixes(s)
    return DriveWriter(
        path,
        satellites=_satellites(fixes),
        epoch_ns=EPOCH_NS,
        metadata=_metadata(s, fixes),
        attachments={
            "drive.toml": ("application/toml", s.drive.text.encode()),
            "imu.toml": ("application/toml", s.imu.text.encode()),
        },
        rate_noise=unit.variances[0],
        force_noise=unit.variances[1],
    )


def _unit(settings: DriveSettings) -> Imu:
    return Imu(settings.imu, settings.seed, settings.rate_hz)


def _fixes(settings: DriveSettings) -> Fixes:
    s = settings
    return fixes_of(s.drive.path, s.drive.satellite, _stream(s.seed, _FIXES))


def _start(settings: DriveSettings) -> Rotation:
    return started(settings.drive, START_SIGMA, _stream(settings.seed, _START))


def _simulated(settings: DriveSettings, file: DriveWriter, progress: Progress) -> DriveSamples:
    """Block by block into the recording."""
    path, unit, blocks = settings.drive.path, _unit(settings), []
    for sensed in sense_blocks(path, settings.rate_hz):
        blocks.append(unit.report(sensed))
        file.write(_truth(path, sensed), blocks[-1])
        progress(float(sensed.t_ns[-1]) * 1e-9 / path.duration)
    return DriveSamples(readings_of(joined(blocks)), _fixes(settings), _start(settings))


def _truth(path: Driven, sensed: Sensed) -> TruthBlock:
    nothing = np.zeros((len(sensed.t_ns), 0))
    return TruthBlock(
        t_ns=sensed.t_ns,
        w_ib_b=sensed.w_ib_b,
        f_b=sensed.f_b,
        q_wb=(C_NW.inv() * path.at(sensed.t_ns * 1e-9).C_nb).as_quat(),
        joints=nothing,
        joint_rates=nothing,
    )


def _stream(seed: int, source: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(source,)))


def _solved(
    settings: DriveSettings, driven: DriveSamples, progress: Progress
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
    driven: DriveSamples,
    matchings: Mapping[str, Matching],
    refusals: Mapping[str, str],
) -> DriveResult:
    truth = settings.drive.path.at(driven.fixes.t).C_nb
    known, priors = Truths(truth[-1]), settings.priors
    answers = [answer(name, settings.drive.id, m, priors) for name, m in matchings.items()]
    return DriveResult(
        out=out,
        settings=settings,
        samples=len(driven.readings),
        fixes=driven.fixes,
        start_error=(driven.start * truth[0].inv()).magnitude(),
        matchings=dict(matchings),
        curves={name: against(m, truth) for name, m in matchings.items()},
        refusals=dict(refusals),
        scores=tuple(score(estimate, known) for estimate in answers),
    )


def _satellites(fixes: Fixes) -> Satellites:
    latitude, longitude, height = geodetic(fixes.position)
    v_n = np.einsum("mji,mj->mi", C_en(latitude, longitude), fixes.velocity)
    return Satellites(
        t_ns=np.round(fixes.t * 1e9).astype(np.int64),
        place=np.stack([latitude, longitude, height], axis=1),
        v=C_NW.apply(v_n, inverse=True),
        place_variance=fixes.position_sigma**2 + fixes.position_drift**2,
        v_variance=fixes.velocity_sigma**2 + fixes.velocity_drift**2,
    )


def _metadata(s: DriveSettings, fixes: Fixes) -> dict[str, dict[str, str]]:
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
        DRIVE: describe_drive(s.drive.id, s.drive.text, fixes, _start(s), START_SIGMA),
        "imu": {"toml": s.imu.text},
    }
