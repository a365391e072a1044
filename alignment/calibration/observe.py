"""Readings of stretches made into what a calibration is solved for, and gross mistakes refused."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.calibration.bench import Warmth
from alignment.calibration.result import LeftOut
from alignment.calibration.session import Move, Session, Station
from alignment.earth import Site
from alignment.errors import AlignmentError, NotAtRest, Saturated, TooShort
from alignment.information.model import Stretch
from alignment.noise import GAP, check_at_rest
from alignment.readings import EDGE, Dwell, ImuReadings
from alignment.saturation import saturation_doubt
from alignment.units import DEG

MARGIN = 0.25  # s: of a station that a move's readings reach into, so that lags have died away
PART = 0.25  # of a station, at most
LEAST_TURN = 30 * DEG  # between two rests, below which there is one position only
WRONG_AXES = 0.5  # part of gravity that no scale factor or misalignment makes
WRONG_RATE = 0.5  # part of a rate, likewise
WRONG_MOVE = 20 * DEG  # of a move by the gyros from the encoders' rotation
DEGREES = 180 / np.pi
ALIKE = 0.2  # relative, within which a ratio is 57.3 or 1/57.3
LARGEST_STEP = 0.2  # rad in a sample of a move: beyond, two samples do not describe the turn
ENDS = 20  # parts of a turn, of which the first and the last tell where it began and ended
SETTLING = 1.0  # s: after a run-up, in which a servo and the axes that it shook come to rest
AXES = ("X1", "Y1", "Z1")


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """A session, its readings `y` (m,) in the model's order, and what was left out of it."""

    session: Session
    y: Array
    left_out: tuple[LeftOut, ...] = ()

    def __post_init__(self) -> None:
        set_owned(self, y=(self.y, (None,), float))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A stretch's station, and its coefficients (h, 6)."""

    dwell: Dwell
    station: Station
    values: Array


def observed(dwells: Sequence[Dwell], site: Site, warmth: Warmth | None = None) -> Observed:
    """Stations and moves of the stretches of one recording.

    Parameters
    ----------
    dwells : sequence of Dwell
        At rest or turning at constant rate, with the attitudes that the table was told; those at
        rest with readings of the moves beside them where these are to count.
    site : Site
    warmth : callable, optional
        The temperature, where it changes.

    Raises
    ------
    AlignmentError
        No stretch can be used; a single position; readings along other axes than told, or turns at
        another rate than the encoder's.
    Saturated
        Readings at full scale in a stretch.
    """
    if not dwells:
        raise AlignmentError("no stretch: a calibration needs rests, or turns at constant rate")
    seen: list[_Seen | None] = []
    left_out: list[LeftOut] = []
    refused: list[AlignmentError] = []
    ordered = sorted(dwells, key=lambda dwell: dwell.t_from)
    for dwell in ordered:
        try:
            seen.append(_seen(dwell, warmth))
        except Saturated:
            raise
        except (NotAtRest, TooShort) as error:
            left_out.append(LeftOut(dwell.label, str(error)))
            refused.append(error)
            seen.append(None)
    kept = [one for one in seen if one is not None]
    _check_axes(kept, site)
    if refused and _one_position(kept):
        raise refused[0]  # what is left is too little, and that is why
    _check_positions(kept)
    numbers = {id(one): k for k, one in enumerate(kept)}
    moves = []
    for one, other in pairwise(seen):
        if one is not None and other is not None:
            move = _move(one, other, (numbers[id(one)], numbers[id(other)]), warmth)
            if isinstance(move, LeftOut):
                left_out.append(move)
            elif move is not None:
                moves.append(move)
    values = [one.values for one in kept]
    y = [v[:, :3].ravel() for v in values] + [np.zeros(3 * len(moves))]
    y += [v[:, 3:].ravel() for v in values]
    interval = float(np.median([one.dwell.readings.interval for one in kept]))
    session = Session(tuple(one.station for one in kept), tuple(moves), interval)
    return Observed(session, np.concatenate(y), tuple(left_out))


def _seen(dwell: Dwell, warmth: Warmth | None) -> _Seen:
    if dwell.nominal is None:
        raise AlignmentError(
            f"{dwell.label}: its attitude is not known: give its attitude_deg or a schedule"
        )
    window = dwell.window()
    saturation_doubt(dwell.label, window)
    warm = 0.0 if warmth is None else float(np.mean(warmth(window.t)))
    joints = np.zeros(0) if dwell.joints is None else dwell.joints.angles
    if dwell.turn is None:
        check_at_rest(dwell)
        stretch = Stretch(dwell.label, dwell.t_from, dwell.t_to - dwell.t_from, _stood(dwell))
        values = np.concatenate([window.w_ib_b.mean(axis=0), window.f_b.mean(axis=0)])[None]
        return _Seen(dwell, Station(stretch, joints, warmth=warm), values)
    stretch, values = _turn(dwell, window)
    round_ = -1 if dwell.joints is None else dwell.joints.going_round
    return _Seen(dwell, Station(stretch, joints, round_, warm), values)


def _stood(dwell: Dwell) -> Rotation:
    """``C_nb`` where the encoders say that the table stood, else where it was told to."""
    there = None if dwell.joints is None else dwell.joints.C_nb
    assert dwell.nominal is not None
    return dwell.nominal if there is None else there


def _turn(dwell: Dwell, window: ImuReadings) -> tuple[Stretch, Array]:
    """A turn's whole turns, and constant, cosine and sine (3, 6) against the encoder."""
    assert dwell.turn is not None
    first = int(np.searchsorted(dwell.readings.t, window.t[0]))
    angle = dwell.turn.angle[first : first + len(window)]
    rate = _rate(window.t, angle)
    if rate == 0.0:
        raise AlignmentError(f"{dwell.label}: the encoder does not turn")
    _check_rate(dwell, window, rate)
    joints, start = dwell.joints, float(window.t[0])
    stretch = Stretch(
        dwell.label,
        start,
        float(window.t[-1]) - start,
        _stood(dwell),
        rate=rate,
        axis_b=dwell.turn.axis_b if joints is None or joints.axis_b is None else joints.axis_b,
        angle=float(angle[0]),
    )
    driven = joints is not None and joints.C_nb is not None  # by a servo, which has to settle
    first = int(np.searchsorted(window.t, start + SETTLING)) if driven else 0
    whole = (window.t > window.t[first]) & (window.t <= start + stretch.span.length + EDGE)
    there = np.concatenate([[first], np.flatnonzero(whole)])
    own = _rate(window.t[there], angle[there])  # of just these turns
    stretch = replace(stretch, rate=own, duration=stretch.span.length * rate / own)
    values = np.concatenate([window.w_ib_b, window.f_b], axis=1)[whole]
    # what comes twice a turn is of no use, but would leak where turns are not whole
    waves = [f(k * angle[whole]) for k in ((1, 2) if first else (1,)) for f in (np.cos, np.sin)]
    A = np.stack([np.ones(len(values)), *waves], axis=1)
    found, *_ = np.linalg.lstsq(A, values, rcond=None)
    return stretch, found[:3]


def _rate(t: Array, angle: Array) -> float:
    """Mean rate from the first stamp to the last, which gyros' means are set against.

    However uneven the turning: by the line through all and what its ends are off, each a mean over
    some samples, which a rounded encoder needs.
    """
    slope, offset = np.polyfit(t - t[0], angle, 1)
    off = angle - offset - slope * (t - t[0])
    few = max(1, len(t) // ENDS)
    return float(slope + (off[-few:].mean() - off[:few].mean()) / (t[-1] - t[0]))


def _move(
    one: _Seen, other: _Seen, numbers: tuple[int, int], warmth: Warmth | None
) -> Move | LeftOut | None:
    """From one stretch into the next, where their readings reach that far."""
    label = f"{one.dwell.label} to {other.dwell.label}"
    t_from = one.dwell.t_to - _reach(one.dwell)
    t_to = other.dwell.t_from + _reach(other.dwell)
    for dwell in (one.dwell, other.dwell):
        step = dwell.readings.interval
        part = dwell.readings.between(t_from, t_to)
        if len(part) < 2 or part.t[0] - step > t_from + step or part.t[-1] < t_to - step:
            continue
        if float(np.diff(part.t).max()) > GAP * step:
            return LeftOut(label, "samples are missing in the move")
        fastest = float(np.abs(part.w_ib_b).max()) * step
        if fastest > LARGEST_STEP:
            return LeftOut(label, f"{fastest:.2g} rad in a sample: at most {LARGEST_STEP:g}")
        try:
            saturation_doubt(label, part)
        except Saturated as error:
            return LeftOut(label, str(error))
        start = float(part.t[0]) - part.interval
        return Move(
            label=label,
            first=numbers[0],
            last=numbers[1],
            readings=part,
            angle_from=_angle(one.dwell, start),
            angle_to=_angle(other.dwell, float(part.t[-1])),
            **({} if warmth is None else {"warmth": warmth(part.t)}),
        )
    return None


def _reach(dwell: Dwell) -> float:
    return min(MARGIN, PART * (dwell.t_to - dwell.t_from))


def _angle(dwell: Dwell, t: float) -> float:
    """Of the encoder at a time [s]; 0 at rest."""
    if dwell.turn is None:
        return 0.0
    return float(np.interp(t, dwell.readings.t, dwell.turn.angle))


# --- gross mistakes ------------------------------------------------------------------------------


def _check_rate(dwell: Dwell, window: ImuReadings, rate: float) -> None:
    assert dwell.turn is not None
    share = float(window.w_ib_b.mean(axis=0) @ dwell.turn.axis_b) / rate
    if abs(share - 1) <= WRONG_RATE:
        return
    why = "another axis, joint or rate"
    if abs(share + 1) <= WRONG_RATE:
        why = "mirrored axes, or an encoder that counts the other way"
    elif abs(share * DEGREES - 1) < ALIKE:
        why = "an encoder in degrees that was taken for radians"
    elif abs(share / DEGREES - 1) < ALIKE:
        why = "an encoder in radians that was taken for degrees"
    raise AlignmentError(
        f"{dwell.label}: the gyros turn {share:.4g} times as fast as the encoder, must be "
        f"{1 - WRONG_RATE:g} to {1 + WRONG_RATE:g}: {why}"
    )


def _check_axes(seen: Sequence[_Seen], site: Site) -> None:
    """Refuse specific forces that no scale factor or misalignment explains."""
    f_n = site.f_n
    rests = [one for one in seen if one.dwell.turn is None]
    expected = np.array([_C_nb(one).inv().apply(f_n) for one in rests]).reshape(-1, 3)
    read = np.array([one.values[0, 3:] for one in rests]).reshape(-1, 3)
    off = np.linalg.norm(read - expected, axis=1) / site.gravity
    if not len(off) or off.max() <= WRONG_AXES:
        return
    worst = int(off.argmax())
    axes = ""
    if np.linalg.matrix_rank(expected, tol=0.1 * site.gravity) == 3:
        A = np.linalg.lstsq(expected, read, rcond=None)[0].T
        axes = _in_words(A)
    said = ", ".join(f"{x:.2f}" for x in read[worst])
    should = ", ".join(f"{x:.2f}" for x in expected[worst])
    raise AlignmentError(
        f"{rests[worst].dwell.label}: the accelerometers read ({said}) m/s^2, at the attitude told "
        f"({should}) is expected: {axes or 'other axes, another unit of force or other attitudes'}"
    )


def _in_words(A: Array) -> str:
    """Which axes the sensors lie along by a matrix (3, 3) from what was expected; '' if unclear."""
    size = np.abs(A)
    along = size.argmax(axis=1)
    if sorted(along.tolist()) != [0, 1, 2]:
        return ""
    scale = float(np.exp(np.mean(np.log(size[np.arange(3), along]))))
    signs = np.sign(A[np.arange(3), along])
    if abs(scale - 1) > WRONG_AXES:
        return f"forces {scale:.3g} times as large as they should be: another unit"
    moved = [
        f"{AXES[i]} reads {'-' if signs[i] < 0 else ''}{AXES[k]}"
        for i, k in enumerate(along.tolist())
        if signs[i] < 0 or k != i
    ]
    P = np.zeros((3, 3))
    P[np.arange(3), along] = signs
    kind = "mirrored axes" if np.linalg.det(P) < 0 else "other axes"
    return f"{kind}: {', '.join(moved)}"


def _C_nb(one: _Seen) -> Rotation:
    return one.station.stretch.C_pb


def _check_positions(seen: Sequence[_Seen]) -> None:
    if _one_position(seen):
        raise AlignmentError(
            f"one position only: no two of {len(seen)} rests are {LEAST_TURN / DEG:.0f} deg or "
            "more apart: another position, or a turn, is needed"
        )


def _one_position(seen: Sequence[_Seen]) -> bool:
    if any(one.dwell.turn is not None for one in seen):
        return False
    if not seen:
        return True
    quats = np.array([_C_nb(one).as_quat() for one in seen])
    widest = 2 * np.arccos(np.clip(np.abs(quats @ quats.T).min(), 0, 1))
    return bool(widest < LEAST_TURN)
