"""Streams a run into the review."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from alignment.arrays import Array, IntArray, owned
from alignment.options import of_noise_alone
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR, MILLI_G, STANDARD_GRAVITY
from stand.imu.priors import only
from stand.recording.curves import ANGLES, AngleCurves, InnovationCurves, Phase
from stand.recording.review.estimates import exaggeration, relay, with_gaps
from stand.recording.review.file import DEADLINE_S, check, naming, open_stream
from stand.recording.review.layout import Screen, blueprint
from stand.recording.review.scene import (
    AXIS_LENGTH,
    hinge_columns,
    rate_arrow,
    scene_of,
    solids_of,
    transform,
    turned_axes,
)
from stand.recording.review.style import (
    CHANNELS,
    FOLLOWING,
    GREY,
    METHOD_COLORS,
    PINK,
    RED,
    TIMELINE,
    WHITE,
    XYZ,
    XYZ_PALE,
    YELLOW,
    Color,
    entity_part,
    line_style,
    state_style,
    states_of,
)
from stand.recording.thinning import Moved, Rows, Thinned, bin_length
from stand.samples import AXES, ImuBlock, TruthBlock
from stand.table.joints import JOINTS, Body, StandModel

ROW_BUDGET = 200_000
"""Rows per series: more open slowly and show nothing more on a screen."""
BLOCK_ROWS = 16_384
POSE_HZ = 50
POSE_BUDGET = 100_000
ESTIMATE_BUDGET = 5_000

# A pose is sent when the joints [rad], the rate [rad/s] or the specific force [m/s^2] have left
# these steps: too small to see in 3D, too large for rounding to pass them.
POSE_QUANTA = np.repeat([1e-5, 1e-6, 1e-3], [len(JOINTS), 3, 3])


class ReviewWriter:
    """Streams a run into an .rrd with an embedded, paused blueprint.

    Parameters
    ----------
    path : path
        Of the .rrd; overwritten, and whole after `close` only.
    model : StandModel
    run_id : str
        The recording's id: the viewer takes two files with one id for one recording.
    title : str
    duration_s, rate_hz : float, int
        Decide up front how many samples share a row, see Notes.
    phases : sequence of Phase
    w_ie_enu : (3,)
        Earth rate [rad/s].
    properties : mapping
        Shown with the recording: seed, versions, hashes.
    following : bool
        Whether the joints follow a servo, whose error is shown then.
    noise_only : collection of str
        The sensors ('gyro', 'accel') of which no sheet states more than noise.

    Raises
    ------
    StandError
        `path` cannot be written.

    Notes
    -----
    Up to 200 000 samples each sample is a row; beyond, each bin gives two rows with every
    column's minimum and maximum, so that spikes survive. Poses follow at 50 Hz at most, and
    only where a joint, the specific force or the rate has changed. Nothing depends on the
    length of the blocks.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        model: StandModel,
        run_id: str,
        title: str,
        duration_s: float,
        rate_hz: int,
        phases: Sequence[Phase],
        w_ie_enu: ArrayLike,
        properties: Mapping[str, str | int | float],
        following: bool = False,
        noise_only: Collection[str] = (),
    ) -> None:
        n = round(duration_s * rate_hz)
        w_ie = owned(w_ie_enu, "w_ie_enu", (3,))
        self._model, self._scene, self._w_ie = model, scene_of(model), float(np.linalg.norm(w_ie))
        self._channels = (*CHANNELS, FOLLOWING) if following else CHANNELS
        alone = frozenset(k for k in ANGLES if of_noise_alone(k, noise_only))
        self._screen = Screen(self._scene, duration_s, self._channels, {}, {}, noise_only=alone)
        width = sum(len(channel.names) for channel in self._channels)
        self._samples = Thinned(width, bin_length(n, ROW_BUDGET), BLOCK_ROWS)
        step = max(-(-rate_hz // POSE_HZ), -(-n // POSE_BUDGET), 1)
        self._moved = Moved(step, POSE_QUANTA)
        self._poses = Thinned(len(POSE_QUANTA), 1, BLOCK_ROWS // 4)
        self._open, self._path, self._chunks = True, Path(path), 0
        self._angles: dict[str, float] = {}
        with naming(self._path):
            self._path.open("wb").close()  # what cannot be written is found before the run
        self._stream, self._bytes = open_stream(run_id)
        # Sent first, so that a viewer shows the finished screen while it still reads.
        self._stream.send_blueprint(blueprint(self._screen), make_active=False)
        self._stream.send_recording_name(title)
        if properties:
            texts: dict[str, Any] = {name: str(value) for name, value in properties.items()}
            self._stream.send_property("run", rr.AnyValues(**texts))
        self._send_scene(w_ie)
        self._send_phases(phases)

    def write(self, truth: TruthBlock, imu: ImuBlock, following: Array | None = None) -> None:
        """Take the next samples.

        Parameters
        ----------
        truth : TruthBlock, n rows
        imu : ImuBlock, n rows
            At the same times.
        following : (n, 6) or None
            Demanded minus realised joint angles [rad], of a review made for them.
        """
        if not np.array_equal(truth.t_ns, imu.t_ns):
            raise ValueError("truth and imu must have the same t_ns")
        if (following is not None) != (FOLLOWING in self._channels):
            raise ValueError("following: must be given if and only if the review is made for it")
        for block in self._samples.add(truth.t_ns, _samples(truth, imu, following)):
            self._send_samples(block)
        poses = np.hstack([truth.joints, truth.w_ib_b, truth.f_b])
        for block in self._poses.add(*self._moved.add(truth.t_ns, poses)):
            self._send_poses(block)

    def event(self, t_ns: int, level: str, text: str) -> None:
        """Add a line to the event log; `level` is 'INFO', 'WARN' or 'ERROR'."""
        columns = rr.TextLog.columns(text=[text], level=[level])
        self._send("events", np.array([t_ns], dtype=np.int64), columns)

    def angles(self, curves: Sequence[AngleCurves]) -> None:
        """Add what the estimators found, once, after the last samples.

        The first method is under test, with those that take over from it: their +-3 sigma and
        their axes in 3D are shown. What runs beside it at the same time is a rival.

        Parameters
        ----------
        curves : sequence of AngleCurves
            One per method and dwell, in any order.
        """
        curves = [curve for curve in curves if len(curve.t_ns)]
        methods = tuple(dict.fromkeys(curve.method for curve in curves))
        if not methods:
            return
        tested = relay(sorted(curves, key=lambda curve: methods.index(curve.method)))
        factor = exaggeration(tested)
        self._send_sigmas(tested)
        self._send_estimate(tested, factor)
        names = tuple(dict.fromkeys(curve.method for curve in tested))
        for rank, method in enumerate(methods):
            own = sorted((c for c in curves if c.method == method), key=lambda c: int(c.t_ns[0]))
            self._send_curves(own, rank, width=2.0 if method in names else 1.2)
        self._limit_errors(tested)
        self._screen = self._screen._replace(tested=names, factor=factor)

    def innovations(self, curves: Sequence[InnovationCurves]) -> None:
        """Add what a filter's updates found, once: lines toward N, E, D within their 3 sigma."""
        if not curves:
            return
        rows = with_gaps((c.t_ns, c.values * 1e3) for c in curves)
        self._send_lines("innovations/found", rows, list("NED"), XYZ, 1.2)
        bound = ((c.t_ns, 3e3 * c.sigmas.max(axis=1, keepdims=True) * [1.0, -1.0]) for c in curves)
        rows = with_gaps(bound)
        self._send_lines("innovations/sigma", rows, ["±3σ"] * 2, [GREY] * 2, 1.2)

    def documents(self, report: str, config: str) -> None:
        """Fill the tabs Report and Config.

        Parameters
        ----------
        report : str
            Markdown. No subscripts, superscript minus or emoji: they stop the headless viewer.
        config : str
            Markdown.
        """
        for entity, text in (("report", report), ("config", config)):
            self._log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def close(self) -> None:
        """Write the file and read it back; a second call does nothing.

        Raises
        ------
        StandError
            It cannot be written, or is not there as it was written.
        """
        if not self._open:
            return
        self._open = False
        for block in self._samples.rest():
            self._send_samples(block)
        for block in self._poses.rest():
            self._send_poses(block)
        self._stream.send_blueprint(blueprint(self._screen))
        with naming(self._path):
            data = self._bytes.read(flush_timeout_sec=DEADLINE_S) or b""
            self._stream.disconnect()
            self._path.write_bytes(data)
            check(self._path, len(data), self._chunks)

    def abandon(self) -> None:
        """Drop what was sent: the file stays empty. After `close` this does nothing."""
        if self._open:
            self._open = False
            with suppress(RuntimeError):
                self._bytes.read(flush_timeout_sec=DEADLINE_S)  # rerun warns of what is not read
            self._stream.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _log(self, entity: str, *parts: Any) -> None:
        self._stream.log(entity, *parts, static=True, strict=True)

    def _send(self, entity: str, t_ns: IntArray, columns: Iterable[Any]) -> None:
        time = rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]"))
        self._stream.send_columns(entity, indexes=[time], columns=columns, strict=True)
        self._chunks += 1

    def _send_samples(self, block: Rows) -> None:
        t_ns, values = block
        first = 0
        for channel in self._channels:
            last = first + len(channel.names)
            # A copy: rerun writes later, from another thread, when the buffer is in use again.
            rows = values[:, first:last].copy()
            self._send(channel.entity, t_ns, rr.Scalars.columns(scalars=rows))
            self._extend_range(channel.entity, rows)
            first = last

    def _send_poses(self, block: Rows) -> None:
        t_ns, values = block
        joints, w, f = np.split(values, [len(JOINTS), len(JOINTS) + 3], axis=1)
        for body in self._model.bodies:
            if body.joint is not None:
                self._send_hinge(body, t_ns, joints[:, JOINTS.index(body.joint.name)])
        length = 0.6 * self._scene.radius
        arrows = {"w": rate_arrow(w, self._w_ie), "f": f / STANDARD_GRAVITY}
        for name, arrow in arrows.items():
            columns = rr.Arrows3D.columns(vectors=(arrow * length).astype(np.float32))
            self._send(f"{self._scene.imu}/{name}", t_ns, columns)

    def _send_hinge(self, body: Body, t_ns: IntArray, angle: Array) -> None:
        """The body's pose where its own joint has moved; most stand still most of the time."""
        moved = np.diff(angle, prepend=self._angles.get(body.name, np.nan)) != 0.0
        self._angles[body.name] = angle[-1]
        if moved.any():
            columns = hinge_columns(body, angle[moved])
            self._send(self._scene.entities[body.name], t_ns[moved], columns)

    def _send_phases(self, phases: Sequence[Phase]) -> None:
        if not phases:
            return
        times, values = states_of(phases)
        self._send("phase", np.array(times), rr.StateChange.columns(state=list(values)))
        self._log("phase", state_style(phases))

    def _send_scene(self, w_ie: Array) -> None:
        scene = self._scene
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for body in self._model.bodies:
            entity = scene.entities[body.name]
            if body.joint is None:
                self._log(entity, transform(body.position, body.rotation))
            for kind, solids in solids_of(body.geoms):
                self._log(f"{entity}/solids/{kind}", solids)
        self._log(scene.imu, transform(self._model.imu_position, self._model.imu_rotation))
        self._send_arrow_styles(w_ie)
        for channel in self._channels:
            self._log(channel.entity, line_style(channel.names, channel.colors, width=1.2))

    def _send_arrow_styles(self, w_ie: Array) -> None:
        scene, thin = self._scene, 0.005 * self._scene.radius
        axes = rr.Arrows3D(
            vectors=np.eye(3) * AXIS_LENGTH * scene.radius,
            colors=XYZ,
            radii=1.6 * thin,
            labels=list(AXES),
        )
        self._log(f"{scene.imu}/truth", axes)
        for name, color, label in (("f", PINK, "f"), ("w", YELLOW, "ω")):
            style = rr.Arrows3D.from_fields(colors=[color], radii=[thin], labels=[label])
            self._log(f"{scene.imu}/{name}", style)
        corner = scene.center + scene.radius * np.array([-0.95, -0.8, 0.25])
        directions = np.array([[0.0, 0.0, -1.0], w_ie / max(self._w_ie, 1e-12), [0.0, 1.0, 0.0]])
        world = rr.Arrows3D(
            origins=[corner] * 3,
            vectors=directions * 0.35 * scene.radius,
            colors=[WHITE, YELLOW, RED],
            radii=1.6 * thin,
            labels=["g", "Earth rate", "N"],
        )
        self._log("world/reference", world)

    def _send_curves(self, curves: Sequence[AngleCurves], rank: int, width: float) -> None:
        """One method's errors, an entity per angle, and its angles, all in one entity.

        The rank in the entity's name keeps the method under test first in the legends.
        """
        method = curves[0].method
        color = METHOD_COLORS[rank % len(METHOD_COLORS)]
        for k, angle in enumerate(ANGLES):
            rows = with_gaps((c.t_ns, c.errors[:, k : k + 1] / DEG) for c in curves)
            self._send_lines(
                f"angles/{angle}/{rank}_{entity_part(method)}", rows, [method], [color], width
            )
        rows = with_gaps((c.t_ns, c.angles / DEG) for c in curves)
        names = [f"{angle} {method}" for angle in ANGLES]
        colors = XYZ_PALE if rank else XYZ
        self._send_lines(f"angles/values/{rank}_{entity_part(method)}", rows, names, colors, width)

    def _send_lines(
        self, entity: str, rows: Rows, names: Sequence[str], colors: Sequence[Color], width: float
    ) -> None:
        self._log(entity, line_style(names, colors, width))
        self._send(entity, rows[0], rr.Scalars.columns(scalars=rows[1]))
        self._extend_range(entity.rsplit("/", 1)[0], rows[1])

    def _extend_range(self, plot: str, rows: Array) -> None:
        ranges, rows = self._screen.ranges, rows[np.isfinite(rows)]
        if not len(rows):  # of an angle that is not determined anywhere
            return
        low, high = ranges.get(plot, (np.inf, -np.inf))
        ranges[plot] = min(low, float(rows.min())), max(high, float(rows.max()))

    def _limit_errors(self, tested: Sequence[AngleCurves]) -> None:
        """Keep the method under test in sight where a rival drifts away."""
        for k, angle in enumerate(ANGLES):
            own = [np.maximum(np.abs(c.errors[:, k]), 3.0 * c.sigmas[:, k]) for c in tested]
            sizes = np.concatenate(own)
            sizes = sizes[np.isfinite(sizes)]
            if not len(sizes):
                continue
            limit = float(6.0 * np.percentile(sizes, 90.0) / DEG)
            if 0.0 < limit < np.abs(self._screen.ranges[f"angles/{angle}"]).max():
                self._screen.limits[f"angles/{angle}"] = -limit, limit

    def _send_sigmas(self, curves: Sequence[AngleCurves]) -> None:
        if not any(np.nan_to_num(curve.sigmas).any() for curve in curves):
            return
        for k, angle in enumerate(ANGLES):
            parts = ((c.t_ns, c.sigmas[:, k : k + 1] * [3.0, -3.0] / DEG) for c in curves)
            rows = with_gaps(parts)
            # One name for both lines makes one entry of the legend.
            name = f"±3σ{only(angle in self._screen.noise_only)}"
            self._send_lines(f"angles/{angle}/sigma", rows, [name] * 2, [GREY] * 2, 1.2)

    def _send_estimate(self, curves: Sequence[AngleCurves], factor: float) -> None:
        """Axes turned by the exaggerated error, shown during the dwells only."""
        entity = f"{self._scene.imu}/estimate"
        total = sum(len(curve.t_ns) for curve in curves)
        step, length = -(-total // ESTIMATE_BUDGET), AXIS_LENGTH * self._scene.radius
        style = rr.Arrows3D.from_fields(colors=XYZ_PALE, radii=[0.005 * self._scene.radius])
        self._log(entity, style)
        for curve in curves:
            turned = curve.error_rotations[::step]
            known = np.isfinite(turned).all(axis=1)  # all angles determined
            if known.any():
                vectors = turned_axes(turned[known], factor) * length
                t_ns = curve.t_ns[::step][known]
                self._send(entity, t_ns, rr.Arrows3D.columns(vectors=vectors))
        ends = np.array([curve.t_ns[-1] + 1 for curve in curves])
        hidden = rr.Arrows3D.columns(vectors=np.empty((0, 3))).partition([0] * len(curves))
        self._send(entity, ends, hidden)


def _samples(truth: TruthBlock, imu: ImuBlock, following: Array | None) -> Array:
    """The columns of `CHANNELS`, and of `FOLLOWING` if given, in their units."""
    columns = [
        truth.joints / DEG,
        imu.f_b,
        imu.w_ib_b / DEG,
        (imu.f_b - truth.f_b) / MILLI_G,
        (imu.w_ib_b - truth.w_ib_b) / DEG_PER_HOUR,
    ]
    return np.hstack(columns if following is None else [*columns, following / ARC_SECOND])
