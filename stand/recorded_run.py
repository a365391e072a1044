"""A run from procedure to result: simulated, recorded, estimated, scored."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell
from alignment.arrays import Array
from stand.calibration.truth import unit_record
from stand.evaluation.review_curves import method_curves, method_innovations
from stand.evaluation.run_result import RunResult, result_json
from stand.evaluation.score import (
    Refusal,
    Score,
    Truths,
    evaluate_each,
    spreads,
)
from stand.folder import folder_beside, recording_folder, refuse_existing, write_file
from stand.motion.plan import PlannedStep
from stand.motion.polynomial import MotionKind
from stand.physics.mjcf import contents_of
from stand.recording.curves import AngleCurves, Phase, innovations_csv
from stand.recording.mcap.writer import EPOCH_NS, McapWriter
from stand.recording.metadata import (
    MODEL_FOLDER,
    NEVER,
    RUN,
    SETTLED,
    describe_estimate,
    describe_schedule,
    describe_settings,
    describe_site,
)
from stand.recording.reviewing import open_review
from stand.recording.urdf import urdf
from stand.report.document import config_document, report_document
from stand.samples import CHANNELS, ImuBlock, TruthBlock
from stand.simulation.collector import DwellCollector, TrueAttitudes
from stand.simulation.settings import Settings, follows_moves, methods_of, run_id
from stand.simulation.simulation import Simulation, begins_of
from stand.simulation.step_record import StepRecord, describe_followed
from stand.table.kinematics import C_NW
from stand.versions import versions

QUEUE = 4  # blocks that may wait for a writer: bounds the memory
LEVELS = {"INFO": 20, "WARN": 30}  # rcl_interfaces/msg/Log

Progress = Callable[[float], None]


def run(
    settings: Settings,
    out: str | PathLike[str] | None = None,
    force: bool = False,
    progress: Progress = lambda done: None,
) -> RunResult:
    """Simulate, record and estimate.

    The recording is written beside `out` and renamed when whole; on any failure nothing is left.

    Parameters
    ----------
    settings : Settings
    out : path, optional
        Folder for `run.mcap`, `run.rrd`, `result.json` and, of a filter, `innovations.csv`; else
        `run_id` among the recordings.
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
    folder = recording_folder(out, run_id(settings))
    refuse_existing(folder, force)
    simulation = Simulation(settings)
    with folder_beside(folder) as beside:
        return _Run(simulation, beside).record(progress, folder)


class _Run:
    """One run under way: the settings, the open recordings and the readings kept so far."""

    def __init__(self, simulation: Simulation, folder: Path) -> None:
        self.simulation, self.folder = simulation, folder
        self.settings, self.stand, self.plan = (
            simulation.settings,
            simulation.stand,
            simulation.plan,
        )
        path = self.settings.table.model
        self.own_model = {} if path is None else contents_of(path)  # the shipped one is no news
        self.saturated = np.zeros(len(CHANNELS), int)
        self.events: list[tuple[int, str, str]] = []
        self.phases = [_phase(step) for step in self.plan.steps]

    def record(self, progress: Progress, out: Path) -> RunResult:
        with ExitStack() as stack:
            # rerun takes a second to import: it does so while the first samples are made
            background = stack.enter_context(ThreadPoolExecutor(1))
            review = background.submit(self._open_review)
            stack.callback(background.submit, _abandon_review, review)
            mcap = stack.enter_context(self._open_mcap())
            for phase in self.phases:
                self._tell(mcap, phase.t_from_ns, "INFO", f"{phase.kind}: {phase.label}")
            collector = self._stream(mcap, review, background, progress)
            records = self.simulation.records()
            begins = begins_of(records)
            self._tell_settling(mcap, records)
            dwells, attitudes = collector.finish(begins)
            scores, refusals = self._evaluate(dwells, attitudes)
            result = RunResult(
                out=out,
                settings=self.settings,
                plan=self.plan,
                samples=self.simulation.total,
                saturated=tuple(int(n) for n in self.saturated),
                records=records,
                scores=tuple(scores),
                spreads=tuple(spreads(scores)),
                refusals=tuple(refusals),
            )
            text = json.dumps(result_json(result), indent=1, allow_nan=False)
            write_file(self.folder / "result.json", text + "\n")
            methods = methods_of(self.settings)
            site, options = self.settings.site, self.settings.options
            found = method_innovations(methods, dwells, site, options)
            if found:
                write_file(self.folder / "innovations.csv", innovations_csv(found))
            mcap.close(metadata=_settled(begins))
            with review.result() as rrd:
                for event in sorted(self.events):
                    rrd.event(*event)
                rrd.angles(self._curves(methods, dwells, attitudes, collector))
                rrd.innovations(found)
                rrd.documents(report_document(result), config_document(result))
                rrd.close()
        return result

    def _stream(
        self,
        mcap: McapWriter,
        review: "Future[Any]",
        background: ThreadPoolExecutor,
        progress: Progress,
    ) -> DwellCollector:
        """Samples block by block into both recordings and the stretches."""
        steps = zip(self.plan.steps, self.plan.rests, strict=True)
        moving = [step.label for step, rests in steps if not rests.all()]
        known = self.settings
        collector = DwellCollector(
            self.plan.stretches,
            known.rate_hz,
            moving,
            self.folder,
            moves=follows_moves(known),
            imu=known.unit,
            sampling=known.sampling,
            stand=self.simulation.encoders_of,
        )
        waiting: list[Future[None]] = []
        done, total, steps_over = 0, self.simulation.total, 0
        for block in self.simulation.blocks():
            lag = self.simulation.following(block)
            truth, readings = block.truth, block.readings
            waiting.append(background.submit(_write_review, review, truth, readings, lag))
            self._watch_saturation(mcap, readings)
            steps_over = self._note_settling(mcap, float(truth.t_ns[-1]) * 1e-9, steps_over)
            mcap.write(truth, readings)
            collector.add(truth, readings)
            done += len(truth)
            progress(done / total)
            if len(waiting) > QUEUE and review.done():
                waiting.pop(0).result()
        for future in waiting:
            future.result()
        return collector

    def _note_settling(self, mcap: McapWriter, t: float, first: int) -> int:
        """How the table did in the steps that are over by `t` [s], from step `first` on, and from
        when their rests count: for who finds the recording interrupted. How many steps are over.
        """
        records = self.simulation.records_until(t, first)
        told = _settled(begins_of(records)) | describe_followed(first, records)
        for name, values in told.items():
            mcap.metadata(name, values)
        return first + len(records)

    def _tell_settling(self, mcap: McapWriter, records: Sequence[StepRecord]) -> None:
        for record in records:
            if record.rests and record.settled is None:
                self._tell(mcap, _ns(record.t_to), "WARN", f"{record.label}: never settled")
            elif record.rests and record.settled:
                told = f"{record.label}: settled after {record.settled:.3f} s"
                self._tell(mcap, _ns(record.t_from + record.settled), "INFO", told)

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

    def _open_mcap(self) -> McapWriter:
        settings = self.settings
        return McapWriter(
            self.folder / "run.mcap",
            model=self.simulation.built,
            errors=self.simulation.errors,
            robot_description=urdf(self.stand),
            epoch_ns=EPOCH_NS,
            metadata=self._metadata(),
            attachments={
                "procedure.toml": ("application/toml", settings.procedure.text.encode()),
                "imu.toml": ("application/toml", settings.imu.text.encode()),
                "table.toml": ("application/toml", settings.table.text.encode()),
            }
            | {
                MODEL_FOLDER + name: ("application/octet-stream", data)
                for name, data in self.own_model.items()
            },
            rate_noise=self.simulation.imu.variances[0],
            force_noise=self.simulation.imu.variances[1],
        )

    def _open_review(self) -> Any:
        settings = self.settings
        return open_review(
            self.folder / "run.rrd",
            model=self.stand,
            run_id=self._unique_id(),
            title=f"{settings.procedure.entry.title}: {settings.imu.title}, seed {settings.seed}",
            duration_s=self.plan.motion.duration,
            rate_hz=settings.rate_hz,
            phases=self.phases,
            w_ie_enu=C_NW.inv().apply(settings.site.w_ie_n),
            properties=self._metadata()[RUN],
            following=settings.motion is MotionKind.SERVO,
            noise_only=settings.options.priors.noise_only,
        )

    def _unique_id(self) -> str:
        """Viewers merge recordings of one id: rate, site and presets must tell apart too."""
        digest = hashlib.sha256(json.dumps(self._metadata(), sort_keys=True).encode())
        return f"{run_id(self.settings)}_{digest.hexdigest()[:8]}"

    def _metadata(self) -> dict[str, dict[str, str]]:
        s = self.settings
        told = describe_settings(s)
        return {
            RUN: {
                **told.pop(RUN),
                "epoch_ns": str(EPOCH_NS),
                "frame_n": "north-east-down",
                "frame_b": "X1 forward, Y1 up, Z1 right at zero table angles",
                "model_sha256": self.stand.sha256,
            }
            | ({"model": next(iter(self.own_model))} if self.own_model else {})
            | versions(),
            "site": describe_site(s.site),
            "estimate": describe_estimate(s.options, methods_of(s)),
            "schedule": describe_schedule(self.plan.steps),
            **told,
            "unit": unit_record(self.simulation.imu.gyro_errors, self.simulation.imu.accel_errors),
            "table_errors": self.simulation.errors.record(),
        }

    def _evaluate(
        self, dwells: Sequence[Dwell], attitudes: TrueAttitudes
    ) -> tuple[list[Score], list[Refusal]]:
        latitude = self.settings.site.latitude
        truths = [
            Truths(C, d.nominal, latitude, mean)
            for d, C, mean in zip(dwells, attitudes, attitudes.means, strict=True)
        ]
        s = self.settings
        return evaluate_each(dwells, truths, s.site, s.options, methods_of(s))

    def _curves(
        self,
        methods: Sequence[str],
        dwells: Sequence[Dwell],
        attitudes: Sequence[Rotation],
        collector: DwellCollector,
    ) -> list[AngleCurves]:
        at_end = {d.label: C for d, C in zip(dwells, attitudes, strict=True)}

        def true_at(label: str, t: Array) -> Rotation:
            return collector.true_at(label, t) or at_end[label]

        s = self.settings
        return method_curves(methods, dwells, attitudes, true_at, s.site, s.options)


def _write_review(
    review: "Future[Any]", truth: TruthBlock, imu: ImuBlock, following: Array | None
) -> None:
    review.result().write(truth, imu, following)


def _abandon_review(review: "Future[Any]") -> None:
    """After whatever waits for the writer; of a review that is closed nothing is left to do."""
    if review.exception() is None:
        review.result().abandon()


def _settled(begins: Mapping[str, float | None]) -> dict[str, dict[str, str]]:
    """The metadata record of dwells that count from a later time than was planned."""
    told = {label: NEVER if t is None else repr(t) for label, t in begins.items()}
    return {SETTLED: told} if told else {}


def _phase(step: PlannedStep) -> Phase:
    return Phase(_ns(step.t_from), _ns(step.t_to), step.kind, step.label)


def _ns(t: float) -> int:
    return round(t * 1e9)
