"""From a procedure to a motion: when each step runs and how the joints get there."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil

import numpy as np

from alignment.angles import C_nb_from_angles
from alignment.arrays import Array
from alignment.units import DEG
from stand.errors import StandError
from stand.motion.missing_axes import refuse_missing, same_vertical
from stand.motion.moves import (
    Piece,
    joined,
    move_piece,
    ramp_times,
    rest_piece,
    shifted,
    turning_piece,
)
from stand.motion.plan import Plan, PlannedStep, Turning
from stand.motion.polynomial import Motion, summed
from stand.motion.profile import profile
from stand.motion.sway import sway, vibration
from stand.motion.waves import coning, fade_of, scorsby, sines
from stand.procedure.procedure import Procedure
from stand.procedure.steps import (
    Background,
    ConingStep,
    DwellStep,
    MoveStep,
    ProfileStep,
    RampsEntry,
    RateStep,
    ScorsbyMotion,
    ScorsbyStep,
    SineMotion,
    SineStep,
    Step,
    SwayMotion,
    SwayStep,
    SweepStep,
    VibrationMotion,
    VibrationStep,
)
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import attitude, gimbal_angles
from stand.table.table import Table

BASE = 3  # the first three joints are the rocking base's
_Wave = SineMotion | ScorsbyMotion | SwayMotion | VibrationMotion
LONGEST_MOVE = 7000.0  # s; the planner's own profiles end at 7600 s
_TURN = 2 * np.pi
_MOVE_LIMITS = ("rate_deg_s", "acceleration_deg_s2", "jerk_deg_s3")
_STEP_STREAM, _BACKGROUND_STREAM = 0, 1  # random streams of steps and of backgrounds


def plan(procedure: Procedure, model: StandModel, table: Table, seed: int = 0) -> Plan:
    """Plan every step, from all joints at zero.

    A move is as fast as its limits allow; the rest that follows it lasts to the next whole
    second, and so do ramps and fades, so that steps are steady from times a person can read.

    Raises
    ------
    StandError
        An axis that the table has not, a target outside its travel, a move limit above the
        table's, a profile or spectrum file that is not right, a gimbal lock. Whether the whole
        motion keeps the table's limits is for `stand.motion.limits` to say.
    """
    refuse_missing(procedure, table)
    track = _Track(procedure, model, table, seed)
    for number, step in enumerate(procedure.entry.step):
        _ADD[type(step)](track, number, step)
    for number, behind in enumerate(procedure.entry.background):
        track.add_background(number, behind)
    motion = summed([joined(track.pieces), *track.overlays])
    return Plan(tuple(track.steps), motion, np.array(track.rests))


@dataclass(slots=True, eq=False)
class _Track:
    """A plan in the making: where the joints stand, what has been planned so far."""

    procedure: Procedure
    model: StandModel
    table: Table
    seed: int
    joints: Array = field(default_factory=lambda: np.zeros(len(JOINTS)))
    t: float = 0.0
    steps: list[PlannedStep] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    overlays: list[Motion] = field(default_factory=list)
    rests: list[np.ndarray] = field(default_factory=list)

    def note(
        self,
        number: int,
        step: Step,
        t_to: float,
        steady: tuple[float, float],
        moving: np.ndarray,
        label: str = "",
        turning: Turning | None = None,
    ) -> None:
        """A step that ends at `t_to`, with the joints where they now stand."""
        zeroed = self.joints.copy()
        if turning is not None:
            zeroed[turning.axis] = 0.0
        planned = PlannedStep(
            number,
            step.kind,
            label or step.label,
            self.t,
            t_to=t_to,
            steady_from=steady[0],
            steady_to=steady[1],
            joints=self.joints,
            C_nb=attitude(self.model, zeroed),
            turning=turning,
        )
        self.steps.append(planned)
        self.rests.append(~moving)
        self.t = t_to

    def dwell(self, number: int, step: DwellStep) -> None:
        self.pieces.append(rest_piece(self.joints, step.duration_s))
        end = self.t + step.duration_s
        self.note(number, step, end, (self.t, end), np.zeros(len(JOINTS), bool))

    def move(self, number: int, step: MoveStep) -> None:
        target = _target(self.procedure, number, step, self.joints, self.model, self.table)
        moving = self.joints != target
        limits = _limits(self.procedure, number, step, moving, self.table, _MOVE_LIMITS)
        _check_duration(self.procedure, number, self.joints, target, limits[0])
        try:
            piece = move_piece(self.joints, target, *limits)
        except ArithmeticError as error:
            allowed = f"no profile within these limits ({' '.join(str(error).split())[:80]})"
            raise self.procedure.fault(number, "limits", "too extreme", allowed) from error
        arrival = self.t + float(piece.knots[-1])
        end = max(_whole_second(arrival), arrival)
        self.joints = target
        self.pieces += [piece, rest_piece(target, end - arrival)]
        self.note(number, step, end, (arrival, end), moving)

    def turn(self, number: int, step: RateStep | SweepStep) -> None:
        rates = (step.rate_deg_s,) if isinstance(step, RateStep) else step.rates_deg_s
        both = step.directions == "both"
        for rate in rates:
            name = step.label if isinstance(step, RateStep) else f"{step.label} {rate:g} deg/s"
            self._turn_once(number, step, rate * DEG, f"{name} +" if both else name)
            if both:
                self._turn_once(number, step, -rate * DEG, f"{name} -")

    def _turn_once(self, number: int, step: RateStep | SweepStep, rate: float, label: str) -> None:
        axis = JOINTS.index(step.axis)
        time = step.duration_s
        if time is None:
            assert step.turns is not None
            time = step.turns * _TURN / abs(rate)
        moving = np.arange(len(JOINTS)) == axis
        ramp = ramp_times(abs(rate), *self._ramp_limits(number, step, moving, axis))
        piece, target = turning_piece(self.joints, axis, rate, ramp, time)
        angle = float(piece.coefficients[-1, len(ramp) - 1, axis])  # where the ramp ends
        turning = Turning(axis, rate, self._axis_b(axis), angle)
        steady = _whole_second(self.t + ramp[-1])
        begin = max(steady - ramp[-1], self.t)
        arrival = begin + float(piece.knots[-1])
        end = max(_whole_second(arrival), arrival)
        self.pieces += [
            rest_piece(self.joints, begin - self.t),
            piece,
            rest_piece(target, end - arrival),
        ]
        self.joints = target
        self.note(number, step, end, (steady, steady + time), moving, label, turning)

    def _ramp_limits(
        self, number: int, step: RateStep | SweepStep, moving: np.ndarray, axis: int
    ) -> tuple[float, float]:
        keys = _MOVE_LIMITS[1:]
        limits = _limits(self.procedure, number, step, moving, self.table, keys)
        return float(limits[0][axis]), float(limits[1][axis])

    def _axis_b(self, axis: int) -> Array:
        """The axis in b: its hinge turns the instrument about it."""
        turned = self.joints.copy()
        turned[axis] += 1.0
        relative = attitude(self.model, self.joints).inv() * attitude(self.model, turned)
        return relative.as_rotvec()

    def wave(
        self, number: int, step: SineStep | ScorsbyStep | ConingStep | SwayStep | VibrationStep
    ) -> None:
        lead = fade_of(step)
        if isinstance(step, ConingStep):
            motion = self._guarded(
                number, lambda: coning(step, step.duration_s, lead, self.joints, self.model)
            )
        else:
            motion = self._wave_of(step, step.duration_s, lead, (_STEP_STREAM, number), number)
        length = _whole_second(2 * lead + step.duration_s)
        self.pieces.append(rest_piece(self.joints, length))
        self.overlays.append(shifted(motion, self.t))
        steady = self.t + lead
        moving = np.any(motion.coefficients != 0, axis=(0, 1))
        self.note(number, step, self.t + length, (steady, steady + step.duration_s), moving)

    def profile(self, number: int, step: ProfileStep) -> None:
        path = self.procedure.folder / step.file
        motion = self._guarded(number, lambda: profile(path, self.joints, step.file))
        self.pieces.append(Piece(motion.knots, motion.coefficients))
        end, _, _ = motion.joints([motion.duration])
        moving = np.any(motion.coefficients[:-1] != 0, axis=(0, 1))
        self.joints = end[0]
        arrival = self.t + motion.duration
        t_to = max(_whole_second(arrival), arrival)
        self.pieces.append(rest_piece(self.joints, t_to - arrival))
        self.note(number, step, t_to, (self.t, arrival), moving)

    def add_background(self, number: int, behind: Background) -> None:
        """A motion behind steps: it fades in with the first and out with the last."""
        labels = [step.label for step in self.procedure.entry.step]
        first = 0 if behind.first is None else labels.index(behind.first)
        last = len(labels) - 1 if behind.last is None else labels.index(behind.last)
        name = f"{self.procedure.name}: background {number + 1}"
        if first > last:
            raise StandError(
                f'{name}, last = "{behind.last}": must not come before first = "{behind.first}"'
            )
        t_from = min(s.t_from for s in self.steps if s.number == first)
        t_to = max(s.t_to for s in self.steps if s.number == last)
        lead = fade_of(behind)
        steady = t_to - t_from - 2 * lead
        if steady <= 0:
            raise StandError(
                f"{name}, fade_s = {lead:g}: must be below half of the {t_to - t_from:g} s it runs"
            )
        try:
            motion = self._wave_of(behind, steady, lead, (_BACKGROUND_STREAM, number), None)
        except StandError as error:
            raise StandError(f"{name}: {error}") from error
        self.overlays.append(shifted(motion, t_from))
        moving = np.any(motion.coefficients != 0, axis=(0, 1))
        for i, step in enumerate(self.steps):
            if first <= step.number <= last:
                self.rests[i] = self.rests[i] & ~moving

    def _wave_of(
        self, entry: _Wave, steady: float, lead: float, stream: tuple[int, int], number: int | None
    ) -> Motion:
        def rng_of(axis: str) -> np.random.Generator:
            return np.random.default_rng([self.seed, 0x5A11, *stream, JOINTS.index(axis)])

        def make() -> Motion:
            if isinstance(entry, SineMotion):
                return sines(entry, steady, lead)
            if isinstance(entry, ScorsbyMotion):
                return scorsby(entry, steady, lead)
            if isinstance(entry, SwayMotion):
                return sway(entry, steady, lead, rng_of, self.procedure.folder)
            return vibration(entry, steady, lead, rng_of)

        return make() if number is None else self._guarded(number, make)

    def _guarded(self, number: int, make: Callable[[], Motion]) -> Motion:
        """Faults of a motion are told with the file and the step."""
        try:
            return make()
        except StandError as error:
            label = self.procedure.entry.step[number].label
            raise StandError(
                f'{self.procedure.name}: step {number + 1} "{label}": {error}'
            ) from error


_ADD: dict[type, Callable] = {
    DwellStep: _Track.dwell,
    MoveStep: _Track.move,
    RateStep: _Track.turn,
    SweepStep: _Track.turn,
    SineStep: _Track.wave,
    ScorsbyStep: _Track.wave,
    ConingStep: _Track.wave,
    SwayStep: _Track.wave,
    VibrationStep: _Track.wave,
    ProfileStep: _Track.profile,
}


def _whole_second(t: float) -> float:
    return float(ceil(t - 1e-9))


def _target(
    procedure: Procedure, index: int, step: MoveStep, joints: Array, model: StandModel, table: Table
) -> Array:
    if step.joints_deg is not None:
        target = np.array(joints)
        for name, angle in step.joints_deg.items():
            target[JOINTS.index(name)] = angle * DEG
        outside = table.outside(target)
        if outside:
            i = outside[0]
            assert JOINTS[i] not in table.missing  # refused before
            raise procedure.fault(
                index, f"joints_deg, {JOINTS[i]}", step.joints_deg.get(JOINTS[i]), _travel(table, i)
            )
        return target
    assert step.attitude_deg is not None
    wanted = step.attitude_deg
    angles = np.array([wanted.roll, wanted.yaw, wanted.pitch]) * DEG
    C_nb = C_nb_from_angles(wanted.sequence, *angles)
    candidates = [
        np.concatenate([joints[:BASE], _nearest_turn(gimbals, joints[BASE:], table)])
        for gimbals in gimbal_angles(model, joints[:BASE], C_nb)
    ]
    reachable = [c for c in candidates if not table.outside(c)]
    if not reachable:
        i = _least_outside(candidates, table)
        if JOINTS[i] in table.missing:
            value = f"{np.degrees(_wanted(candidates, i)):.3f} deg on axis {JOINTS[i]}"
            other = same_vertical(C_nb, joints, wanted.sequence, model, table)
            raise procedure.fault(index, "attitude_deg", value, table.without(JOINTS[i]) + other)
        i = table.outside(candidates[0])[0]
        value = f"{np.degrees(candidates[0][i]):.3f} deg on axis {JOINTS[i]}"
        raise procedure.fault(index, "attitude_deg", value, _travel(table, i))
    return min(reachable, key=lambda c: float(np.abs(c - joints).max()))


def _least_outside(candidates: list[Array], table: Table) -> int:
    """An axis that cannot follow, of the attitude's set of angles that asks the least of others."""
    return min((table.outside(c) for c in candidates), key=len)[0]


def _wanted(candidates: list[Array], axis: int) -> float:
    return min((float(c[axis]) for c in candidates), key=abs)


def _nearest_turn(gimbals: Array, present: Array, table: Table) -> Array:
    """The equivalents of `gimbals` (3,) nearest to `present`, inside travel where there are any."""
    low, high = np.array(table.low[BASE:]), np.array(table.high[BASE:])
    nearest = gimbals + _TURN * np.round((present - gimbals) / _TURN)
    nearest = np.where(nearest > high + 1e-9, nearest - _TURN, nearest)
    return np.where(nearest < low - 1e-9, nearest + _TURN, nearest)


def _travel(table: Table, i: int) -> str:
    low, high = table.low[i] / DEG, table.high[i] / DEG
    return f"table {table.id} allows {low:g} to {high:g} deg on {JOINTS[i]}"


def _limits(
    procedure: Procedure,
    index: int,
    step: RampsEntry,
    moving: np.ndarray,
    table: Table,
    keys: tuple[str, ...],
) -> list[Array]:
    """Limits (6,) of what `keys` name: the step's, the procedure's, the table's."""
    general = procedure.entry.move_limits
    own = {
        "rate_deg_s": table.rate,
        "acceleration_deg_s2": table.acceleration,
        "jerk_deg_s3": table.jerk,
    }

    def limit(key: str) -> Array:
        value = getattr(step, key)
        if value is None:
            value = getattr(general, key)
            return own[key] if value is None else np.minimum(own[key], value * DEG)
        too_much = np.flatnonzero(moving & (value * DEG > own[key] * (1 + 1e-12)))
        if len(too_much):
            i = int(too_much[0])
            allowed = f"table {table.id} allows up to {own[key][i] / DEG:g} on {JOINTS[i]}"
            raise procedure.fault(index, key, value, allowed)
        return np.minimum(own[key], value * DEG)

    return [limit(key) for key in keys]


def _check_duration(
    procedure: Procedure, index: int, joints: Array, target: Array, rate: Array
) -> None:
    needed = np.abs(target - joints) / rate
    if needed.max() > LONGEST_MOVE:
        i = int(np.argmax(needed))
        value = f"{rate[i] / DEG:g} on {JOINTS[i]}"
        allowed = f"the move would take {needed[i]:.0f} s, allowed {LONGEST_MOVE:.0f}"
        raise procedure.fault(index, "rate_deg_s", value, allowed)
