"""The review: an .rrd that opens in the rerun viewer as a finished screen.

The one module that imports rerun, which takes 0.7 s: import it only where a review is made.
"""

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike
from rerun.blueprint.components import LinkAxis
from rerun.chunk import RrdReader
from rerun.components import AggregationPolicy
from rerun.error_utils import RerunWarning
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray, owned
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR, MILLI_G, STANDARD_GRAVITY
from stand.errors import StandError
from stand.recording.curves import ANGLES, AngleCurves, InnovationCurves, Phase
from stand.recording.thinning import Moved, Rows, Thinned, bin_length, min_max_bins
from stand.recording.viewer import view
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import JOINTS, Body, Geom, StandModel

__all__ = ["ReviewWriter", "view"]

TIMELINE = "sim_time"
ROW_BUDGET = 200_000
"""Rows per series: more open slowly and show nothing more on a screen."""
BLOCK_ROWS = 16_384
DEADLINE_S = 20.0
"""For rerun to encode what it was given, which takes a fraction of a second."""
POSE_HZ = 50
POSE_BUDGET = 100_000
CURVE_BUDGET = 20_000
ESTIMATE_BUDGET = 5_000
AXIS_LENGTH = 0.35
"""Of the axes at the instrument, in radii of the stand."""

# Okabe and Ito's palette, its dark blues lightened for a dark background: distinct to
# colour-blind eyes too.
Color = tuple[int, int, int]
ORANGE, SKY, GREEN = (230, 159, 0), (86, 180, 233), (0, 178, 130)
YELLOW, RED, PINK = (240, 228, 66), (230, 95, 30), (214, 134, 178)
GREY, WHITE = (140, 140, 140), (235, 235, 235)
XYZ = (RED, GREEN, SKY)
XYZ_PALE = ((255, 178, 140), (140, 230, 200), (190, 228, 255))
METHOD_COLORS = (SKY, ORANGE, PINK, YELLOW, GREEN)
# One per kind of step, darker ones for what fills most of a run.
KIND_COLORS = {
    "dwell": (38, 110, 170),
    "move": (190, 120, 30),
    "rate": (17, 119, 51),
    "sweep": (68, 170, 153),
    "sine": (180, 80, 220),
    "scorsby": (221, 204, 119),
    "coning": (136, 204, 238),
    "sway": (204, 102, 119),
    "vibration": (136, 34, 85),
    "profile": (221, 221, 221),
}
BACKGROUND = (24, 26, 30)


LINKED = rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
SHARED_VIEW = "5c0dca6a-e63f-9cf7-f657-2602590474cc"


class Channel(NamedTuple):
    """One plot of streamed samples: its entity, its columns with their colours, its title."""

    entity: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    title: str


AXES = ("X1", "Y1", "Z1")
CHANNELS = (
    Channel("stand/base", JOINTS[:3], (SKY, ORANGE, GREEN), "Base angles [deg]"),
    Channel("stand/table", JOINTS[3:], (SKY, ORANGE, GREEN), "Table angles [deg]"),
    Channel("imu/accel", AXES, XYZ, "Specific force of the IMU [m/s²]"),
    Channel("imu/gyro", AXES, XYZ, "Angular rate of the IMU [deg/s]"),
    Channel("residual/accel", AXES, XYZ, "Accelerometers minus truth [mg]"),
    Channel("residual/gyro", AXES, XYZ, "Gyros minus truth [deg/h]"),
)
FOLLOWING = Channel(
    "stand/following",
    JOINTS,
    (YELLOW, PINK, RED, SKY, ORANGE, GREEN),
    "Following error [arc s]",
)
"""Of a servo run: demanded minus realised angle of every axis."""

# A pose is sent when the joints [rad], the rate [rad/s] or the specific force [m/s^2] have left
# these steps: too small to see in 3D, too large for rounding to pass them.
POSE_QUANTA = np.repeat([1e-5, 1e-6, 1e-3], [len(JOINTS), 3, 3])


class Layout(rrb.Blueprint):
    """A blueprint whose one time axis shows the whole run at first.

    Linked views share the range of a hidden view of a fixed id, for which rerun has no call; what
    a linked view is given itself is ignored, and without a range it shows a minute.
    """

    duration_s: float

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        super()._log_to_stream(stream)
        # Room for the legends beside the curves.
        ends = (-0.01 * self.duration_s, 1.14 * self.duration_s)
        edges = [rr.TimeRangeBoundary.absolute(seconds=t) for t in ends]
        whole = rr.TimeRange(start=edges[0], end=edges[1])
        stream.log(f"view/{SHARED_VIEW}/TimeAxis", rrb.TimeAxis(view_range=whole))


class Scene(NamedTuple):
    """Where the bodies are drawn: the entity of each, and the sphere around all [m]."""

    entities: dict[str, str]
    imu: str
    center: Array
    radius: float


class Screen(NamedTuple):
    """What the layout is made for: the plots of samples, and how they are shown.

    `ranges` are the extremes of each plot by its entity, `limits` what its axis shows if that is
    less; `tested` are the methods whose axes are shown in 3D, their error times `factor`.
    """

    scene: Scene
    duration_s: float
    channels: tuple[Channel, ...]
    ranges: dict[str, tuple[float, float]]
    limits: dict[str, tuple[float, float]]
    tested: tuple[str, ...] = ()
    factor: float = 1.0


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
    ) -> None:
        n = round(duration_s * rate_hz)
        w_ie = owned(w_ie_enu, "w_ie_enu", (3,))
        self._model, self._scene, self._w_ie = model, _scene(model), float(np.linalg.norm(w_ie))
        self._channels = (*CHANNELS, FOLLOWING) if following else CHANNELS
        self._screen = Screen(self._scene, duration_s, self._channels, {}, {})
        width = sum(len(channel.names) for channel in self._channels)
        self._samples = Thinned(width, bin_length(n, ROW_BUDGET), BLOCK_ROWS)
        step = max(-(-rate_hz // POSE_HZ), -(-n // POSE_BUDGET), 1)
        self._moved = Moved(step, POSE_QUANTA)
        self._poses = Thinned(len(POSE_QUANTA), 1, BLOCK_ROWS // 4)
        self._open, self._path, self._chunks = True, Path(path), 0
        self._angles: dict[str, float] = {}
        with _told(self._path):
            self._path.open("wb").close()  # what cannot be written is found before the run
        self._stream, self._bytes = _open_stream(run_id)
        # Sent first, so that a viewer shows the finished screen while it still reads.
        self._stream.send_blueprint(_blueprint(self._screen), make_active=False)
        self._stream.send_recording_name(title)
        if properties:
            told: dict[str, Any] = {name: str(value) for name, value in properties.items()}
            self._stream.send_property("run", rr.AnyValues(**told))
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
        tested = _relay(sorted(curves, key=lambda curve: methods.index(curve.method)))
        factor = _exaggeration(tested)
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
        rows = _with_gaps((c.t_ns, c.values * 1e3) for c in curves)
        self._send_lines("innovations/found", rows, list("NED"), XYZ, 1.2)
        bound = ((c.t_ns, 3e3 * c.sigmas.max(axis=1, keepdims=True) * [1.0, -1.0]) for c in curves)
        rows = _with_gaps(bound)
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
        self._stream.send_blueprint(_blueprint(self._screen))
        with _told(self._path):
            data = self._bytes.read(flush_timeout_sec=DEADLINE_S) or b""
            self._stream.disconnect()
            self._path.write_bytes(data)
            _check(self._path, len(data), self._chunks)

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
        arrows = {"w": _rate_arrow(w, self._w_ie), "f": f / STANDARD_GRAVITY}
        for name, arrow in arrows.items():
            columns = rr.Arrows3D.columns(vectors=(arrow * length).astype(np.float32))
            self._send(f"{self._scene.imu}/{name}", t_ns, columns)

    def _send_hinge(self, body: Body, t_ns: IntArray, angle: Array) -> None:
        """The body's pose where its own joint has moved; most stand still most of the time."""
        moved = np.diff(angle, prepend=self._angles.get(body.name, np.nan)) != 0.0
        self._angles[body.name] = angle[-1]
        if moved.any():
            columns = _hinge_columns(body, angle[moved])
            self._send(self._scene.entities[body.name], t_ns[moved], columns)

    def _send_phases(self, phases: Sequence[Phase]) -> None:
        if not phases:
            return
        states = [(phase.t_from_ns, _state(phase)) for phase in phases]
        followed = {phase.t_from_ns for phase in phases}
        states += [(phase.t_to_ns, "") for phase in phases if phase.t_to_ns not in followed]
        times, values = zip(*sorted(states), strict=True)
        self._send("phase", np.array(times), rr.StateChange.columns(state=list(values)))
        named = {_state(phase): phase for phase in phases}
        style = rr.StateConfiguration(
            values=list(named),
            labels=[phase.label for phase in named.values()],
            colors=_shaded([phase.kind for phase in named.values()]),
        )
        self._log("phase", style)

    def _send_scene(self, w_ie: Array) -> None:
        scene = self._scene
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for body in self._model.bodies:
            entity = scene.entities[body.name]
            if body.joint is None:
                self._log(entity, _transform(body.position, body.rotation))
            for kind, solids in _solids(body.geoms):
                self._log(f"{entity}/solids/{kind}", solids)
        self._log(scene.imu, _transform(self._model.imu_position, self._model.imu_rotation))
        self._send_arrow_styles(w_ie)
        for channel in self._channels:
            self._log(channel.entity, _lines(channel.names, channel.colors, width=1.2))

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
            rows = _with_gaps((c.t_ns, c.errors[:, k : k + 1] / DEG) for c in curves)
            self._send_lines(
                f"angles/{angle}/{rank}_{_part(method)}", rows, [method], [color], width
            )
        rows = _with_gaps((c.t_ns, c.angles / DEG) for c in curves)
        names = [f"{angle} {method}" for angle in ANGLES]
        colors = XYZ_PALE if rank else XYZ
        self._send_lines(f"angles/values/{rank}_{_part(method)}", rows, names, colors, width)

    def _send_lines(
        self, entity: str, rows: Rows, names: Sequence[str], colors: Sequence[Color], width: float
    ) -> None:
        self._log(entity, _lines(names, colors, width))
        self._send(entity, rows[0], rr.Scalars.columns(scalars=rows[1]))
        self._extend_range(entity.rsplit("/", 1)[0], rows[1])

    def _extend_range(self, plot: str, rows: Array) -> None:
        ranges = self._screen.ranges
        low, high = ranges.get(plot, (np.inf, -np.inf))
        ranges[plot] = min(low, float(np.nanmin(rows))), max(high, float(np.nanmax(rows)))

    def _limit_errors(self, tested: Sequence[AngleCurves]) -> None:
        """Keep the method under test in sight where a rival drifts away."""
        for k, angle in enumerate(ANGLES):
            own = [np.maximum(np.abs(c.errors[:, k]), 3.0 * c.sigmas[:, k]) for c in tested]
            limit = float(6.0 * np.percentile(np.concatenate(own), 90.0) / DEG)
            if 0.0 < limit < np.abs(self._screen.ranges[f"angles/{angle}"]).max():
                self._screen.limits[f"angles/{angle}"] = -limit, limit

    def _send_sigmas(self, curves: Sequence[AngleCurves]) -> None:
        if not any(curve.sigmas.any() for curve in curves):
            return
        for k, angle in enumerate(ANGLES):
            parts = ((c.t_ns, c.sigmas[:, k : k + 1] * [3.0, -3.0] / DEG) for c in curves)
            rows = _with_gaps(parts)
            # One name for both lines makes one entry of the legend.
            self._send_lines(f"angles/{angle}/sigma", rows, ["±3σ"] * 2, [GREY] * 2, 1.2)

    def _send_estimate(self, curves: Sequence[AngleCurves], factor: float) -> None:
        """Axes turned by the exaggerated error, shown during the dwells only."""
        entity = f"{self._scene.imu}/estimate"
        total = sum(len(curve.t_ns) for curve in curves)
        step, length = -(-total // ESTIMATE_BUDGET), AXIS_LENGTH * self._scene.radius
        style = rr.Arrows3D.from_fields(colors=XYZ_PALE, radii=[0.005 * self._scene.radius])
        self._log(entity, style)
        for curve in curves:
            vectors = _turned_axes(curve.error_rotations[::step], factor) * length
            self._send(entity, curve.t_ns[::step], rr.Arrows3D.columns(vectors=vectors))
        ends = np.array([curve.t_ns[-1] + 1 for curve in curves])
        hidden = rr.Arrows3D.columns(vectors=np.empty((0, 3))).partition([0] * len(curves))
        self._send(entity, ends, hidden)


def _open_stream(run_id: str) -> tuple[rr.RecordingStream, rr.BinaryStream]:
    """A stream into memory, and where its bytes can be read at the end.

    Not into the file: rerun writes that in a thread of its own, and where this fails (the disk is
    full) it says so on the terminal, then either waits for ever or leaves a file without its end.
    """
    stream = rr.RecordingStream("imu_test_stand", recording_id=run_id, send_properties=False)
    if not rr.is_enabled(stream):
        raise StandError("rerun is switched off: unset the environment variable RERUN")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream, stream.binary_stream()


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Faults of the disk and of rerun's encoder are told with the file's name."""
    try:
        yield
    except OSError as error:
        raise StandError(f"{path}: cannot be written: {error.strerror}") from error
    except (RuntimeError, RerunWarning) as error:
        raise StandError(f"{path}: cannot be written: {error}") from error


def _check(path: Path, size: int, chunks: int) -> None:
    """The file has all its bytes, its footer and at least the `chunks` that were sent."""
    there = path.stat().st_size
    if there != size:
        raise StandError(f"{path}: cannot be written: {there} bytes are there, must be {size}")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RerunWarning)  # of a file without footer
        found = sum(1 for _ in RrdReader(path).stream())
    if found < chunks:
        raise StandError(f"{path}: cannot be written: {found} chunks, must be {chunks} or more")


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


def _shaded(kinds: Sequence[str]) -> list[Color]:
    """Colours of successive phases; of neighbours of one kind every other one is darker."""
    colors: list[Color] = []
    darker = False
    for before, kind in zip(["", *kinds], kinds, strict=False):
        darker = kind == before and not darker
        red, green, blue = KIND_COLORS.get(kind, GREY)
        part = 0.75 if darker else 1.0
        colors.append((round(part * red), round(part * green), round(part * blue)))
    return colors


def _state(phase: Phase) -> str:
    """A state's name: with its kind, since a dwell and a move may bear one label."""
    return f"{phase.kind} {phase.label}"


def _part(name: str) -> str:
    return rr.escape_entity_path_part(name)


def _lines(names: Sequence[str], colors: Sequence[Color], width: float) -> rr.SeriesLines:
    """Style of a plot's series; the default aggregation would average spikes away."""
    return rr.SeriesLines(
        names=list(names),
        colors=list(colors),
        widths=[width] * len(names),
        aggregation_policy=AggregationPolicy.MinMax,
    )


def _with_gaps(parts: Iterable[Rows]) -> Rows:
    """Rows of several dwells, thinned, each closed by a row of NaN that breaks the line."""
    dwells = list(parts)
    m = bin_length(sum(len(t_ns) for t_ns, _ in dwells), CURVE_BUDGET)
    times, rows = [], []
    for t_ns, values in dwells:
        thin_t, thin = min_max_bins(t_ns, values, m)
        times += [thin_t, thin_t[-1:] + 1]
        rows += [thin, np.full((1, values.shape[1]), np.nan)]
    return np.concatenate(times), np.concatenate(rows)


def _relay(curves: Iterable[AngleCurves]) -> list[AngleCurves]:
    """Curves that follow one another in time, the first come first served."""
    taken: list[AngleCurves] = []
    for curve in curves:
        first, last = curve.t_ns[0], curve.t_ns[-1]
        if all(last <= other.t_ns[0] or other.t_ns[-1] <= first for other in taken):
            taken.append(curve)
    return sorted(taken, key=lambda curve: int(curve.t_ns[0]))


def _exaggeration(curves: Sequence[AngleCurves]) -> float:
    """The power of ten that shows the median error as 2 to 20 degrees, if that is more."""
    errors = np.concatenate([np.linalg.norm(curve.error_rotations, axis=1) for curve in curves])
    shown = 20.0 * DEG / max(float(np.median(errors)), 1e-9)
    return float(10.0 ** np.clip(np.floor(np.log10(shown)), 0.0, 6.0))


def _turned_axes(error_rotations: Array, factor: float) -> Array:
    """Unit axes (m, 3, 3), one per row, turned by `factor` times the error, at most 60 degrees."""
    turns = error_rotations * factor
    norms = np.linalg.norm(turns, axis=1, keepdims=True)
    turns *= np.minimum(1.0, 60.0 * DEG / np.maximum(norms, 1e-12))
    return Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)


def _rate_arrow(w: Array, w_ie: float) -> Array:
    """Rates on a log scale: 0.25 long at Earth rate, as much longer per factor of 100."""
    size = np.linalg.norm(w, axis=1, keepdims=True)
    tiny = max(w_ie, 1e-12) / 100.0
    length = 0.125 * np.log10(np.maximum(size / tiny, 1.0))
    return w / np.maximum(size, 1e-15) * length


def _hinge_columns(body: Body, angle: Array) -> Any:
    assert body.joint is not None
    turned = Rotation.from_quat(body.rotation) * Rotation.from_rotvec(
        angle[:, None] * body.joint.axis
    )
    place = np.tile(body.position, (len(angle), 1))
    return rr.Transform3D.columns(translation=place, quaternion=turned.as_quat())


def _matrix(rotation: Array) -> Array:
    return Rotation.from_quat(rotation).as_matrix()


def _transform(position: Array, rotation: Array) -> rr.Transform3D:
    return rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=rotation))


def _solids(geoms: Sequence[Geom]) -> Iterator[tuple[str, Any]]:
    """Each kind's solids as one batch; planes are left out: the view draws its own floor."""
    for kind, draw in _DRAWN.items():
        same = [geom for geom in geoms if geom.kind == kind]
        if same:
            yield kind, draw(*(np.array([getattr(geom, a) for geom in same]) for a in _DRAWN_BY))


_DRAWN_BY = ("size", "position", "rotation", "rgba")


def _boxes(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Boxes3D:
    return rr.Boxes3D(half_sizes=size, centers=position, **_looks(rotation, rgba))


def _cylinders(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Cylinders3D:
    return rr.Cylinders3D(
        radii=size[:, 0], lengths=2.0 * size[:, 1], centers=position, **_looks(rotation, rgba)
    )


def _capsules(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Capsules3D:
    # Rerun's capsule begins at its origin, ours is centred.
    start = position - size[:, 1:2] * _matrix(rotation)[:, :, 2]
    return rr.Capsules3D(
        radii=size[:, 0], lengths=2.0 * size[:, 1], translations=start, **_looks(rotation, rgba)
    )


def _spheres(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(radii=size[:, 0], centers=position, **_looks(rotation, rgba))


_DRAWN = {"box": _boxes, "cylinder": _cylinders, "capsule": _capsules, "sphere": _spheres}


def _looks(rotation: Array, rgba: Array) -> dict[str, Any]:
    return {
        "quaternions": rotation,
        "colors": np.rint(rgba * 255.0).astype(np.uint8),
        "fill_mode": "solid",
    }


def _scene(model: StandModel) -> Scene:
    """Entities of the bodies, and the sphere around their solids at zero angles."""
    entities: dict[str, str] = {}
    poses: dict[str, tuple[Array, Array]] = {}
    balls = []
    for i, body in enumerate(model.bodies):
        place, turn = poses.get(body.parent, (np.zeros(3), np.eye(3)))
        place, turn = place + turn @ body.position, turn @ _matrix(body.rotation)
        poses[body.name] = place, turn
        entities[body.name] = f"{entities[body.parent]}/{_part(body.name)}" if i else "world"
        balls += [place + turn @ geom.position for geom in body.geoms if geom.kind != "plane"]
    spread = np.array(balls) if balls else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    center = (spread.min(axis=0) + spread.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(spread - center, axis=1).max()) or 1.0
    return Scene(entities, f"{entities[model.imu_body]}/imu", center, radius)


def _blueprint(screen: Screen) -> rrb.Blueprint:
    """The whole screen: the stand and the texts left, everything over time right."""
    left = rrb.Vertical(_stand_view(screen), _texts(), row_shares=[3, 2])
    layout = Layout(
        rrb.Horizontal(left, _plots(screen), column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )
    layout.duration_s = screen.duration_s
    return layout


def _stand_view(screen: Screen) -> rrb.Spatial3DView:
    title = "Stand, true axes"
    if screen.tested:
        title += f"; pale: {', '.join(screen.tested)}, error x{screen.factor:,.0f}"
    look = screen.scene.center
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=look + screen.scene.radius * np.array([1.6, -1.8, 1.0]),
        look_target=look,
        eye_up=(0.0, 0.0, 1.0),
    )
    return rrb.Spatial3DView(
        origin="world",
        name=title,
        eye_controls=eye,
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.25),
        background=[*BACKGROUND],
    )


def _texts() -> rrb.Tabs:
    return rrb.Tabs(
        rrb.TextDocumentView(origin="report", name="Report"),
        rrb.TextLogView(origin="events", name="Events"),
        rrb.TextDocumentView(origin="config", name="Config"),
        active_tab=0,
    )


def _plots(screen: Screen) -> rrb.Vertical:
    plots = {c.entity: _plot(screen, c.entity, c.title) for c in screen.channels}
    following = [plots[c.entity] for c in screen.channels if c is FOLLOWING]
    shown = ANGLES if screen.tested else ()
    values = [_plot(screen, "angles/values", "Estimated angles [deg]")] if shown else []
    if "innovations" in screen.ranges:
        values.append(_plot(screen, "innovations", "Innovations of the filter [mm], ±3σ"))
    rows = [
        rrb.StateTimelineView(origin="phase", name="Phase", time_view=LINKED),
        rrb.Tabs(plots["stand/table"], plots["stand/base"], *following, *values, active_tab=0),
        plots["imu/accel"],
        plots["imu/gyro"],
        rrb.Tabs(plots["residual/accel"], plots["residual/gyro"], active_tab=0),
        *(_plot(screen, f"angles/{k}", f"{k.capitalize()} error, ±3σ [deg]") for k in shown),
    ]
    return rrb.Vertical(*rows, row_shares=[0.1 * len(rows)] + [1.0] * (len(rows) - 1))


def _plot(screen: Screen, origin: str, title: str) -> rrb.TimeSeriesView:
    """A plot that tells its range in the title: low plots have room for few axis labels."""
    low, high = screen.ranges.get(origin, (0.0, 0.0))
    limits = screen.limits.get(origin)
    return rrb.TimeSeriesView(
        origin=origin,
        name=f"{title}, {low:.3g} to {high:.3g}" if origin in screen.ranges else title,
        axis_x=LINKED,
        axis_y=rrb.ScalarAxis(range=limits) if limits else None,
        plot_legend=rrb.Corner2D.RightTop,
    )
