"""A run from procedure to result: plan, truth, readings, recording, estimates, scores."""

import hashlib
import json
import platform
import shutil
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, Options, Site
from alignment.angles import angles_from_C_nb, near_singular, wrapped
from alignment.estimate import AttitudeTrack, angle_sigmas
from alignment.units import DEG
from stand import __version__
from stand.dwells import DwellCollector
from stand.errors import StandError
from stand.imu import Imu, ImuSpec, Temperature, without
from stand.log import RUN, describe_estimate, describe_schedule, describe_site
from stand.physics.description import StandModel
from stand.physics.kinematics import C_NW
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Sampling, Truth, sample_count
from stand.plan import Plan, PlannedStep, plan
from stand.procedure import Procedure
from stand.recording.curves import AngleCurves, Phase
from stand.recording.interchange.writer import EPOCH_NS, McapWriter
from stand.recording.urdf import urdf
from stand.report.document import config_document, report_document
from stand.samples import ImuBlock, Sensed, TruthBlock
from stand.score import (
    Refusal,
    Score,
    Spread,
    Truths,
    evaluate_each,
    score_to_json,
    spread_to_json,
    spreads,
)
from stand.table import Table

HIGHEST_RATE_HZ = 10_000
BLOCK = 1000  # samples, or a second of them if that is more: a chunk of the recording
QUEUE = 4  # blocks that may wait for a writer: bounds the memory
LEVELS = {"INFO": 20, "WARN": 30}  # rcl_interfaces/msg/Log
CHANNELS = ("gyro X1", "gyro Y1", "gyro Z1", "accel X1", "accel Y1", "accel Z1")

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """All that decides a run: same settings, same bytes of `run.mcap`.

    `imu` as it is to be simulated; `without` names the error terms that were switched off in it.
    """

    procedure: Procedure
    imu: ImuSpec
    table: Table
    site: Site
    options: Options
    rate_hz: int = 200
    sampling: Sampling = Sampling.MEAN
    seed: int = 0
    without: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.rate_hz <= HIGHEST_RATE_HZ:
            raise StandError(f"rate = {self.rate_hz} Hz: must be 1 to {HIGHEST_RATE_HZ}")
        if self.seed < 0:
            raise StandError(f"seed = {self.seed}: must be 0 or more")


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """What a run left behind."""

    out: Path
    settings: Settings
    plan: Plan
    samples: int
    saturated: tuple[int, ...]
    scores: tuple[Score, ...]
    spreads: tuple[Spread, ...]
    refusals: tuple[Refusal, ...]


def run(settings: Settings, out: Path, force: bool, progress: Progress) -> RunResult:
    """Simulate, record and estimate.

    The recording is written beside `out` and renamed when whole; on any failure nothing is left.

    Parameters
    ----------
    settings : Settings
    out : Path
        Folder for `run.mcap`, `run.rrd`, `result.json`.
    force : bool
        Replace an existing recording.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        `out` exists (and not `force`), or cannot be written; the plan is impossible.
    AlignmentError
        The estimates are.
    """
    refuse_existing(out, force)
    model = load_model()
    stand = describe(model)
    planned = plan(settings.procedure, stand, settings.table)
    if any(ESTIMATORS[m].needs_latitude for m in methods_of(settings)):
        settings.site.horizontal_rate()  # refuses poles before the work, not after
    _check_samples(settings, planned)
    beside = _new_folder(out)
    try:
        under_way = _Run(settings, stand, planned, beside)
        truth = Truth(model, settings.site, under_way.imu.spec.places)
        result = under_way.record(truth, progress, out)
        _put_in_place(beside, out)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return result


def _check_samples(settings: Settings, planned: Plan) -> None:
    """Every dwell and its offset window hold two whole samples at least."""
    least = 3 / settings.rate_hz
    window = settings.options.offset_window
    if window < least and any(ESTIMATORS[m].needs_offset for m in methods_of(settings)):
        raise StandError(
            f"{settings.procedure.name}: estimate, offset_window_s = {window:g}: must be "
            f"{least:g} or more at {settings.rate_hz} Hz"
        )
    for index, step in enumerate(planned.steps):
        duration = step.t_to - step.t_from
        if step.kind == "dwell" and duration < least:
            allowed = f"must be {least:g} or more at {settings.rate_hz} Hz"
            raise settings.procedure.fault(index, "duration_s", duration, allowed)


def methods_of(settings: Settings) -> tuple[str, ...]:
    """What the procedure wants estimated."""
    return settings.procedure.entry.estimate.methods


def refuse_existing(out: Path, force: bool) -> None:
    """An existing recording stays unless `force`; anything else stays in any case."""
    if not out.exists() and not out.is_symlink():
        return
    if not out.is_dir() or (any(out.iterdir()) and not (out / "run.mcap").exists()):
        raise StandError(f"--out {out}: exists and is not a recording; choose another folder")
    if not force and any(out.iterdir()):
        raise StandError(f"--out {out}: a recording is there; --force replaces it")


def _new_folder(out: Path) -> Path:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return Path(mkdtemp(prefix=f".{out.name}.", suffix=".partial", dir=out.parent))
    except OSError as error:
        raise StandError(f"--out {out}: cannot write there: {error.strerror}") from error


def _put_in_place(beside: Path, out: Path) -> None:
    old = beside.with_suffix(".old")
    if out.exists():
        out.rename(old)
    beside.chmod(0o755)  # temporary folders are made for their owner alone
    beside.rename(out)
    shutil.rmtree(old, ignore_errors=True)


class _Run:
    """One run under way: the settings, the open recordings and the readings kept so far."""

    def __init__(self, settings: Settings, stand: StandModel, planned: Plan, folder: Path) -> None:
        self.settings, self.stand, self.plan, self.folder = settings, stand, planned, folder
        self.imu = Imu(
            without(settings.imu, settings.without),
            settings.seed,
            settings.rate_hz,
            _temperature(settings.procedure),
        )
        self.saturated = np.zeros(len(CHANNELS), int)
        self.events: list[tuple[int, str, str]] = []
        self.phases = [_phase(step) for step in planned.steps]

    def record(self, truth: Truth, progress: Progress, out: Path) -> RunResult:
        with ExitStack() as stack:
            # rerun takes a second to import: it does so while the first samples are made
            background = stack.enter_context(ThreadPoolExecutor(1))
            review = background.submit(self._open_review)
            mcap = stack.enter_context(self._open_mcap())
            for phase in self.phases:
                self._tell(mcap, phase.t_from_ns, "INFO", f"{phase.kind}: {phase.label}")
            dwells, attitudes, samples = self._stream(truth, mcap, review, background, progress)
            scores, refusals = self._evaluate(dwells, attitudes)
            result = RunResult(
                out,
                self.settings,
                self.plan,
                samples,
                tuple(int(n) for n in self.saturated),
                tuple(scores),
                tuple(spreads(scores)),
                tuple(refusals),
            )
            text = json.dumps(result_json(result), indent=1, allow_nan=False)
            (self.folder / "result.json").write_text(text + "\n", encoding="utf-8")
            mcap.close({"result.json": ("application/json", text.encode())})
            with review.result() as rrd:
                for event in sorted(self.events):
                    rrd.event(*event)
                refused = [r.method for r in refusals]
                rrd.angles(self._curves(dwells, attitudes, refused))
                rrd.documents(report_document(result), config_document(result))
                rrd.close()
        return result

    def _stream(
        self,
        truth: Truth,
        mcap: McapWriter,
        review: "Future[Any]",
        background: ThreadPoolExecutor,
        progress: Progress,
    ) -> tuple[list[Dwell], list[Rotation], int]:
        """Samples block by block into both recordings and the dwells."""
        settings = self.settings
        collector = DwellCollector(self.plan.dwells, settings.rate_hz)
        total = sample_count(self.plan.motion.duration, settings.rate_hz)
        waiting: list[Future[None]] = []
        done, block_s = 0, max(1.0, BLOCK / settings.rate_hz)
        for block in truth.blocks(self.plan.motion, settings.rate_hz, settings.sampling, block_s):
            reported = self.imu.report(self._sensed(truth, block, done))
            waiting.append(background.submit(_write_review, review, block, reported))
            self._watch_saturation(mcap, reported)
            mcap.write(block, reported)
            collector.add(block, reported)
            done += len(block)
            progress(done / total)
            if len(waiting) > QUEUE and review.done():
                waiting.pop(0).result()
        for future in waiting:
            future.result()
        return *collector.finish(), done

    def _tell(self, mcap: McapWriter, t_ns: int, level: str, text: str) -> None:
        """An event for both recordings."""
        mcap.log(t_ns, LEVELS[level], text)
        self.events.append((t_ns, level, text))

    def _watch_saturation(self, mcap: McapWriter, reported: ImuBlock) -> None:
        assert reported.saturated is not None
        counts = reported.saturated.sum(axis=0)
        self.saturated += counts
        for channel in np.flatnonzero(counts):
            first = int(np.argmax(reported.saturated[:, channel]))
            text = f"{CHANNELS[channel]} beyond its range in {counts[channel]} samples"
            self._tell(mcap, int(reported.t_ns[first]), "WARN", text)

    def _sensed(self, truth: Truth, block: TruthBlock, first: int) -> Sensed:
        """What the sensors feel at their own places and times; the truth where those are its."""
        spec, motion = self.imu.spec, self.plan.motion
        if spec.clock.perfect and not spec.places.any():
            return Sensed(block.t_ns, block.w_ib_b, block.f_b)
        edges = self.imu.clock.edges(first, first + len(block))
        return truth.sensed(motion, edges, block.t_ns, self.settings.sampling)

    def _open_mcap(self) -> McapWriter:
        settings = self.settings
        return McapWriter(
            self.folder / "run.mcap",
            model=self.stand,
            robot_description=urdf(self.stand),
            epoch_ns=EPOCH_NS,
            metadata=self._metadata(),
            attachments={
                "procedure.toml": ("application/toml", settings.procedure.text.encode()),
                "imu.toml": ("application/toml", settings.imu.text.encode()),
                "table.toml": ("application/toml", settings.table.text.encode()),
            },
            rate_noise=np.full(3, self.imu.gyro_sigma**2),
            force_noise=np.full(3, self.imu.accel_sigma**2),
        )

    def _open_review(self) -> Any:
        from stand.recording.review import ReviewWriter

        settings = self.settings
        return ReviewWriter(
            self.folder / "run.rrd",
            model=self.stand,
            run_id=self._unique_id(),
            title=f"{settings.procedure.entry.title}: {settings.imu.title}, seed {settings.seed}",
            duration_s=self.plan.motion.duration,
            rate_hz=settings.rate_hz,
            phases=self.phases,
            w_ie_enu=C_NW.inv().apply(settings.site.w_ie_n),
            properties=self._metadata()[RUN],
        )

    def _unique_id(self) -> str:
        """Viewers merge recordings of one id: rate, site and presets must tell apart too."""
        digest = hashlib.sha256(json.dumps(self._metadata(), sort_keys=True).encode())
        return f"{run_id(self.settings)}_{digest.hexdigest()[:8]}"

    def _metadata(self) -> dict[str, dict[str, str]]:
        s = self.settings
        return {
            RUN: {
                "procedure": s.procedure.id,
                "imu": s.imu.id,
                "table": s.table.id,
                "seed": str(s.seed),
                "rate_hz": str(s.rate_hz),
                "sampling": s.sampling.value,
                "without": ",".join(s.without),
                "epoch_ns": str(EPOCH_NS),
                "frame_n": "north-east-down",
                "frame_b": "X1 forward, Y1 up, Z1 right at zero table angles",
                "model_sha256": self.stand.sha256,
            }
            | versions(),
            "site": describe_site(s.site),
            "estimate": describe_estimate(s.options, methods_of(s)),
            "schedule": describe_schedule(self.plan.steps),
            "procedure": {"toml": s.procedure.text},
            "imu": {"toml": s.imu.text},
            "table": {"toml": s.table.text},
            "unit": self._drawn(),
        }

    def _drawn(self) -> dict[str, str]:
        """The constants this unit was given, in SI: what an estimator would have to find."""
        triads = {"gyro": self.imu.gyro_errors, "accel": self.imu.accel_errors}
        return {
            f"{sensor}_{name}": json.dumps(getattr(errors, name).tolist())
            for sensor, errors in triads.items()
            for name in errors.__slots__
        }

    def _evaluate(
        self, dwells: Sequence[Dwell], attitudes: Sequence[Rotation]
    ) -> tuple[list[Score], list[Refusal]]:
        latitude = self.settings.site.latitude
        truths = [Truths(C, d.nominal, latitude) for d, C in zip(dwells, attitudes, strict=True)]
        s = self.settings
        return evaluate_each(dwells, truths, s.site, s.options, methods_of(s))

    def _curves(
        self, dwells: Sequence[Dwell], attitudes: Sequence[Rotation], refused: Collection[str]
    ) -> list[AngleCurves]:
        s = self.settings
        found = []
        for method in methods_of(s):
            make = ESTIMATORS[method].tracks
            if make is None or method in refused:
                continue
            for dwell, C_nb in zip(dwells, attitudes, strict=True):
                tracks = make(dwell, s.site, s.options)
                found += [curves(track, C_nb) for track in tracks if not _singular(track, C_nb)]
        return found


def _singular(track: AttitudeTrack, C_nb: Rotation) -> bool:
    """Whether the track's angles cannot be told apart where the unit stands."""
    return bool(near_singular(track.sequence, angles_from_C_nb(track.sequence, C_nb)))


def _write_review(review: "Future[Any]", truth: TruthBlock, imu: ImuBlock) -> None:
    review.result().write(truth, imu)


def _temperature(procedure: Procedure) -> Temperature | None:
    profile = procedure.entry.temperature
    if profile is None:
        return None
    return Temperature(np.array(profile.time_s), np.array(profile.temperature_C))


def _phase(step: PlannedStep) -> Phase:
    return Phase(_ns(step.t_from), _ns(step.t_to), step.kind, step.label)


def _ns(t: float) -> int:
    return round(t * 1e9)


def curves(track: AttitudeTrack, C_nb: Rotation) -> AngleCurves:
    """A track with its errors against the true attitude, for the review."""
    angles = angles_from_C_nb(track.sequence, track.C_nb)
    true_angles = angles_from_C_nb(track.sequence, C_nb)
    return AngleCurves(
        track.method,
        track.label,
        np.round(track.t * 1e9).astype(np.int64),
        angles,
        wrapped(angles - true_angles),
        np.nan_to_num(angle_sigmas(track.sequence, angles, track.covariance)),
        (C_nb.inv() * track.C_nb).as_rotvec(),
    )


def run_id(settings: Settings) -> str:
    """The default name of a run: procedure, unit, seed."""
    return f"{settings.procedure.id}_{settings.imu.id}_seed{settings.seed}"


@cache
def versions() -> dict[str, str]:
    """Versions of all that has a say in the numbers."""
    packages = ("mujoco", "numpy", "scipy", "ruckig")
    return {
        "stand_version": __version__,
        "python_version": platform.python_version(),
    } | {f"{package}_version": version(package) for package in packages}


def result_json(result: RunResult) -> dict[str, Any]:
    """The run's result for machines."""
    s = result.settings
    return {
        "procedure": s.procedure.id,
        "imu": s.imu.id,
        "table": s.table.id,
        "seed": s.seed,
        "rate_hz": s.rate_hz,
        "sampling": s.sampling.value,
        "latitude_deg": None if s.site.latitude is None else s.site.latitude / DEG,
        "height_m": s.site.height,
        "gravity_m_s2": s.site.gravity,
        "duration_s": result.plan.steps[-1].t_to,
        "samples": result.samples,
        "without": list(s.without),
        "saturated_samples": dict(zip(CHANNELS, result.saturated, strict=True)),
        "versions": versions(),
        "estimates": [score_to_json(scored) for scored in result.scores],
        "spreads": [spread_to_json(spread) for spread in result.spreads],
        "refusals": [{"method": r.method, "reason": r.reason} for r in result.refusals],
    }
