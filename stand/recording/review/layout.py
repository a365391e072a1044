"""The blueprint: which views there are, where they stand, what they show at first."""

from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from stand.imu.priors import only
from stand.recording.curves import ANGLES
from stand.recording.review.scene import Scene
from stand.recording.review.style import FOLLOWING, TIMELINE, Channel

BACKGROUND = (24, 26, 30)
LINKED = rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
SHARED_VIEW = "5c0dca6a-e63f-9cf7-f657-2602590474cc"


class Layout(rrb.Blueprint):
    """A blueprint whose one time axis shows the whole run at first.

    Linked views share the range of a hidden view of a fixed id, for which rerun has no call; what
    a linked view is given itself is ignored, and without a range it shows a minute.
    """

    duration_s: float
    begin_s: float = 0.0

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        super()._log_to_stream(stream)
        # Room for the legends beside the curves.
        ends = [self.begin_s + part * self.duration_s for part in (-0.01, 1.14)]
        edges = [rr.TimeRangeBoundary.absolute(seconds=t) for t in ends]
        whole = rr.TimeRange(start=edges[0], end=edges[1])
        stream.log(f"view/{SHARED_VIEW}/TimeAxis", rrb.TimeAxis(view_range=whole))


class Screen(NamedTuple):
    """What the layout is made for: the plots of samples, and how they are shown.

    `ranges` are the extremes of each plot by its entity, `limits` what its axis shows if that is
    less; `tested` are the methods whose axes are shown in 3D, their error times `factor`;
    `noise_only` the angles whose sigmas are of noise alone.
    """

    scene: Scene
    duration_s: float
    channels: tuple[Channel, ...]
    ranges: dict[str, tuple[float, float]]
    limits: dict[str, tuple[float, float]]
    tested: tuple[str, ...] = ()
    factor: float = 1.0
    noise_only: frozenset[str] = frozenset()


def blueprint(screen: Screen) -> rrb.Blueprint:
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


def excerpt_blueprint(
    channels: tuple[Channel, ...],
    span: tuple[float, float],
    ranges: dict[str, tuple[float, float]],
    phases: bool,
) -> rrb.Blueprint:
    """The plots of samples alone, over a stretch of time."""
    top = [rrb.StateTimelineView(origin="phase", name="Phase", time_view=LINKED)] if phases else []
    plots = [_plot_of(c.entity, c.title, ranges.get(c.entity), None) for c in channels]
    shares = [*([0.1 * len(plots)] if phases else []), *([1.0] * len(plots))]
    layout = Layout(
        rrb.Vertical(*top, *plots, row_shares=shares),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )
    layout.begin_s, layout.duration_s = span[0], span[1] - span[0]
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
        *(_plot(screen, f"angles/{k}", _error_title(screen, k)) for k in shown),
    ]
    return rrb.Vertical(*rows, row_shares=[0.1 * len(rows)] + [1.0] * (len(rows) - 1))


def _error_title(screen: Screen, angle: str) -> str:
    known = f"angles/{angle}" in screen.ranges
    sigma = f", ±3σ{only(angle in screen.noise_only)} [deg]"
    return f"{angle.capitalize()} error" + (sigma if known else ": not determined")


def _plot(screen: Screen, origin: str, title: str) -> rrb.TimeSeriesView:
    return _plot_of(origin, title, screen.ranges.get(origin), screen.limits.get(origin))


def _plot_of(
    origin: str,
    title: str,
    span: tuple[float, float] | None,
    limits: tuple[float, float] | None,
) -> rrb.TimeSeriesView:
    """A plot that tells its range in the title: low plots have room for few axis labels."""
    return rrb.TimeSeriesView(
        origin=origin,
        # minus zero is zero
        name=title if span is None else f"{title}, {span[0] + 0.0:.3g} to {span[1] + 0.0:.3g}",
        axis_x=LINKED,
        axis_y=rrb.ScalarAxis(range=limits) if limits else None,
        plot_legend=rrb.Corner2D.RightTop,
    )
