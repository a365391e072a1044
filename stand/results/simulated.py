"""A run in memory, that prints itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings
from alignment.arrays import Array, set_owned
from alignment.quaternions import multiply
from stand.calibration.truth import unit_record
from stand.evaluation.score import Truths
from stand.imu.model import draw, without
from stand.recording.log import Log, mean_attitude
from stand.recording.mcap.reader import ImuLog
from stand.recording.metadata import RUN, describe_schedule, describe_settings
from stand.report.document import motion_table
from stand.report.notebook import Shown
from stand.report.tables import TableData
from stand.results.recording import Recording
from stand.samples import AXES, CHANNELS, Sampling
from stand.simulation.collector import NS, DwellCollector
from stand.simulation.settings import Settings, follows_moves, methods_of, run_id
from stand.simulation.simulation import Block, Simulation, begins_of
from stand.simulation.step_record import StepRecord
from stand.table.joints import JOINTS
from stand.table.kinematics import C_NW


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Simulated(Shown):
    """A run in memory.

    Attributes
    ----------
    settings : Settings
    t : (n,) s
        End of each sample's interval.
    w_ib_b, f_b : (n, 3)
        Reported angular rate [rad/s] and specific force [m/s^2] in b.
    saturated : (n, 6) bool
        Which of the gyros, then accelerometers, was beyond its range.
    true_w_ib_b, true_f_b : (n, 3)
        What perfect sensors would have reported.
    q_nb : (n, 4)
        True ``C_nb`` at `t` as a quaternion (x, y, z, w).
    joints, encoders : (n, 6) rad
        True joint angles, and what the encoders say, in the order of `JOINTS`.
    stretches : tuple of Dwell
        What is estimated from: rests, and turns at constant rate.
    attitudes : tuple of Rotation
        True ``C_nb`` of each at its end (of a turn at encoder angle zero).
    steps : tuple of StepRecord
        What a simulated servo did; empty of ideal motion.
    schedule : dict
        The steps as a recording describes them.
    """

    settings: Settings
    t: Array
    w_ib_b: Array
    f_b: Array
    saturated: NDArray[np.bool_]
    true_w_ib_b: Array
    true_f_b: Array
    q_nb: Array
    joints: Array
    encoders: Array
    stretches: tuple[Dwell, ...]
    attitudes: tuple[Rotation, ...]
    steps: tuple[StepRecord, ...]
    schedule: dict[str, str]

    def __post_init__(self) -> None:
        n = len(self.t)
        widths = {"saturated": 6, "q_nb": 4, "joints": len(JOINTS), "encoders": len(JOINTS)}
        set_owned(
            self,
            t=(self.t, (n,), float),
            **{
                name: (getattr(self, name), (n, width), bool if name == "saturated" else float)
                for name, width in (dict.fromkeys(_VECTORS, 3) | widths).items()
            },
        )

    def __len__(self) -> int:
        return len(self.t)

    @property
    def C_nb(self) -> Rotation:
        """True attitude at `t`."""
        return Rotation.from_quat(self.q_nb)

    @property
    def name(self) -> str:
        """Procedure, unit, seed."""
        return run_id(self.settings)

    @property
    def log(self) -> Log:
        """The same as `stand.read` gives it of a recording."""
        s = self.settings
        latitude, q_wb = s.site.latitude, (C_NW.inv() * self.C_nb).as_quat()
        return Recording(
            path=self.name,
            topic="",
            simulated=True,
            dwells=self.stretches,
            truths=tuple(
                Truths(C, dwell.nominal, latitude, mean_attitude(self.t, q_wb, dwell))
                for dwell, C in zip(self.stretches, self.attitudes, strict=True)
            ),
            site=s.site,
            options=s.options,
            methods=methods_of(s),
            imu=self._imu_log(),
            readings=ImuReadings(
                self.t, self.w_ib_b, self.f_b, instants=s.sampling is Sampling.INSTANT
            ),
        )

    def _imu_log(self) -> ImuLog:
        told = describe_settings(self.settings)
        own = self.settings.table.model  # of a stand of one's own, which no file has with it
        model = {} if own is None else {"model_file": str(own)}
        return ImuLog(
            path=self.name,
            topic="",
            frame_id="imu",
            t_ns=np.round(self.t * 1e9).astype(np.int64),
            w_ib_b=self.w_ib_b,
            f_b=self.f_b,
            metadata={
                **told,
                RUN: {**told[RUN], **model, "epoch_ns": "0"},
                "unit": self._unit(),
                "schedule": self.schedule,
            },
        )

    def _unit(self) -> dict[str, str]:
        """The constants that the unit was given, as a recording has them."""
        s = self.settings
        own = without(s.imu, s.without)
        return unit_record(draw(own.gyro, s.seed, "gyro"), draw(own.accel, s.seed, "accel"))

    def array(self) -> NDArray[Any]:
        """All samples as a structured array (n,), SI and radians, a field per attribute."""
        named = {name: getattr(self, name) for name in ("t", *_VECTORS, *_OTHERS)}
        kinds = [(name, values.dtype, values.shape[1:]) for name, values in named.items()]
        found = np.empty(len(self), dtype=kinds)
        for name, values in named.items():
            found[name] = values
        return found

    def columns(self) -> dict[str, NDArray[Any]]:
        """All samples as columns (n,) by names with units: ``pandas.DataFrame(run.columns())``."""
        found: dict[str, NDArray[Any]] = {"t_s": self.t}
        for name, unit, axes in _COLUMNS:
            values = getattr(self, name)
            found |= {f"{name}_{a}{unit}": values[:, k] for k, a in enumerate(axes)}
        return found

    def headline(self) -> str:
        s = self.settings
        return (
            f"{s.procedure.entry.title}: {s.imu.title}, seed {s.seed}, {len(self)} samples at "
            f"{s.rate_hz} Hz ({s.sampling.value}), {s.motion.value} motion of {s.table.title}"
        )

    def tables(self) -> Sequence[TableData]:
        rows = tuple(
            (
                d.label,
                "rests" if d.turn is None else "turns",
                f"{d.t_from:.2f}",
                f"{d.t_to:.2f}",
                str(len(d.window())),
            )
            for d in self.stretches
        )
        stretches = TableData(
            "stretches to estimate from", ("label", "kind", "from s", "to s", "samples"), rows
        )
        return [stretches, *([motion_table(self.steps)] if self.steps else [])]


_VECTORS = ("w_ib_b", "f_b", "true_w_ib_b", "true_f_b")
_OTHERS = ("saturated", "q_nb", "joints", "encoders")
_FLOATS = (*_VECTORS, *_OTHERS[1:])
_COLUMNS = (
    ("w_ib_b", "_rad_s", AXES),
    ("f_b", "_m_s2", AXES),
    ("true_w_ib_b", "_rad_s", AXES),
    ("true_f_b", "_m_s2", AXES),
    ("q_nb", "", "xyzw"),
    ("joints", "_rad", JOINTS),
    ("encoders", "_rad", JOINTS),
    ("saturated", "", tuple(name.replace(" ", "_") for name in CHANNELS)),
)


def simulated(settings: Settings, progress: Callable[[float], None]) -> Simulated:
    """A run in memory, by `stand.simulation.simulation` block after block."""
    simulation = Simulation(settings)
    collector = DwellCollector(
        simulation.plan.stretches,
        settings.rate_hz,
        moves=follows_moves(settings),
        imu=settings.unit,
        sampling=settings.sampling,
        stand=simulation.encoders_of,
    )
    found, done = _room(simulation.total), 0
    for block in simulation.blocks():  # put in place while the next one's truth is worked out
        collector.add(block.truth, block.readings)
        rows = slice(done, done + len(block.truth))
        for name, values in _named(block).items():
            found[name][rows] = values
        done = rows.stop
        progress(done / simulation.total)
    records = simulation.records()
    dwells, attitudes = collector.finish(begins_of(records))
    for values in found.values():
        values.flags.writeable = False  # given away, so that nobody copies it
    return Simulated(
        settings=settings,
        **found,
        stretches=tuple(dwells),
        attitudes=tuple(attitudes),
        steps=records,
        schedule=describe_schedule(simulation.plan.steps),
    )


def _room(n: int) -> dict[str, NDArray[Any]]:
    """For the samples, by the names of `Simulated`."""
    widths = {"q_nb": 4, "joints": len(JOINTS), "encoders": len(JOINTS)}
    room: dict[str, NDArray[Any]] = {name: np.empty((n, widths.get(name, 3))) for name in _FLOATS}
    return room | {"t": np.empty(n), "saturated": np.empty((n, len(CHANNELS)), bool)}


def _named(block: Block) -> dict[str, Any]:
    """What a block holds, by the names of `Simulated`."""
    truth, readings = block.truth, block.readings
    return {
        "t": readings.t_ns * NS,
        "w_ib_b": readings.w_ib_b,
        "f_b": readings.f_b,
        "saturated": readings.saturated,
        "true_w_ib_b": truth.w_ib_b,
        "true_f_b": truth.f_b,
        "q_nb": multiply(C_NW.as_quat(), truth.q_wb),
        "joints": truth.joints,
        "encoders": truth.encoders,
    }
