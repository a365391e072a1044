"""Waves of the joints: sines, Scorsby motion, coning; and how they and random motions fade.

Each is a motion of its own from time 0: offsets about where the joints stand, at rest at zero at
both ends. It fades in over `lead` seconds, goes on at full size for `steady`, and fades out over
`lead` again.
"""

from collections.abc import Callable
from math import ceil

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import C_N_NUE, Sequence, angles_from_C_nb, wrapped
from alignment.arrays import Array
from alignment.units import DEG
from stand.errors import StandError
from stand.motion.polynomial import FIT_PER_PERIOD, Motion, fitted
from stand.procedure.steps import (
    ConingMotion,
    ScorsbyMotion,
    SineMotion,
    SwayMotion,
    VibrationMotion,
    Waving,
)
from stand.samples import AXES
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import attitude

FADE_PERIODS = 2.0  # then a fade adds a few per cent to the peaks of rate and acceleration
RANDOM_FADE = 2.0  # s, at least, of a random motion
FILE_FADE = 10.0  # s, where only a file knows the spectrum
MOST_PIECES = 400_000  # of a motion: 190 MB of polynomials of degree 9
FADE_PIECES = 12  # of the fade itself, beside those of the waves in it
LOCK = 1.0 * DEG  # nearer to +-90 deg the middle gimbal is locked
CLOSE_FIT = (
    1e-12  # rad, of coning's gimbal angles between the points of the fit: 1e-7 of acceleration
)
WHOLE_TURNS = 1e-12  # of a turn that coning may miss whole ones by: 6e-12 of its angle
FINENESS = (1, 2, 4, 8, 16, 32)  # times `FIT_PER_PERIOD`: what coning near gimbal lock may need
BASE = 3  # the first three joints are the rocking base's
SCORSBY_PHASES = {"base_roll": 0.0, "base_pitch": 90.0, "base_yaw": 0.0}  # deg


def fade_of(entry: Waving) -> float:
    """How long a motion fades in and out [s]: its own `fade_s`, or two periods in whole seconds."""
    if entry.fade_s is not None:
        return entry.fade_s
    return float(ceil(_default_fade(entry) - 1e-9))


def _default_fade(entry: Waving) -> float:
    if isinstance(entry, SineMotion):
        return FADE_PERIODS / min(wave.frequency_hz for wave in entry.axes.values())
    if isinstance(entry, ScorsbyMotion):
        return FADE_PERIODS * entry.period_s
    if isinstance(entry, ConingMotion):
        return FADE_PERIODS / abs(entry.frequency_hz)
    if isinstance(entry, VibrationMotion):
        slowest = min(axis.low_hz for axis in entry.axes.values())
        return max(RANDOM_FADE, FADE_PERIODS / slowest)
    assert isinstance(entry, SwayMotion)
    resonances = [axis.frequency_hz for axis in entry.axes.values()]
    return max(RANDOM_FADE, *(FILE_FADE if f is None else FADE_PERIODS / f for f in resonances))


def smooth_step(x: Array) -> Array:
    """From 0 at 0 to 1 at 1, the first four derivatives zero at both (C4)."""
    x = np.clip(x, 0.0, 1.0)
    low = np.minimum(x, 1 - x)  # its other half is the same upside down, and rounds less so
    rise = low**5 * (126 + low * (-420 + low * (540 + low * (-315 + low * 70))))
    return np.where(x > 0.5, 1 - rise, rise)


def envelope(t: Array, steady: float, lead: float) -> Array:
    """Size (n,) of a motion at times (n,) [s]: 0, up to 1, and down to 0 again."""
    return smooth_step(np.minimum(t, 2 * lead + steady - t) / lead)


def sines(entry: SineMotion, steady: float, lead: float) -> Motion:
    """``amplitude sin(2 pi f (t - lead) + phase)`` of each axis, faded.

    Raises
    ------
    StandError
        More pieces than `MOST_PIECES`.
    """
    waves = {
        name: (wave.amplitude_deg, wave.frequency_hz, wave.phase_deg)
        for name, wave in entry.axes.items()
    }
    return _waves(waves, steady, lead)


def scorsby(entry: ScorsbyMotion, steady: float, lead: float) -> Motion:
    """Sines of one period on the base's axes; pitch is a quarter of it ahead unless told."""
    phases = SCORSBY_PHASES | (entry.phase_deg or {})
    waves = {
        name: (amplitude, 1 / entry.period_s, phases[name])
        for name, amplitude in entry.amplitude_deg.items()
    }
    return _waves(waves, steady, lead)


def _waves(waves: dict[str, tuple[float, float, float]], steady: float, lead: float) -> Motion:
    """Sines of amplitude [deg], frequency [Hz] and phase [deg] by the names of their axes."""
    amplitude, frequency, phase = np.zeros((3, len(JOINTS)))
    for name, (a, f, p) in waves.items():
        i = JOINTS.index(name)
        amplitude[i], frequency[i], phase[i] = a * DEG, f, p * DEG

    def angles(t: Array) -> Array:
        turned = 2 * np.pi * frequency * (t - lead)[:, None] + phase
        return envelope(t, steady, lead)[:, None] * amplitude * np.sin(turned)

    fastest = float(frequency.max())
    return fitted(angles, _knots(steady, lead, fastest * FIT_PER_PERIOD, fastest))


def _knots(steady: float, lead: float, rate: float, frequency_hz: float) -> Array:
    """`rate` pieces per second, whole ones in each of fade, steady part and fade."""
    fade_pieces = FADE_PIECES + ceil(lead * rate)
    steady_pieces = max(1, ceil(steady * rate))
    pieces = 2 * fade_pieces + steady_pieces
    if pieces > MOST_PIECES:
        length = 2 * lead + steady
        raise StandError(
            f"frequency_hz = {frequency_hz:g}: {length:g} s of it are {length * frequency_hz:.0f} "
            f"periods, allowed {MOST_PIECES * frequency_hz / rate:.0f}"
        )
    return np.concatenate(
        [
            np.linspace(0.0, lead, fade_pieces + 1),
            np.linspace(lead, lead + steady, steady_pieces + 1)[1:],
            np.linspace(lead + steady, 2 * lead + steady, fade_pieces + 1)[1:],
        ]
    )


def coning(
    entry: ConingMotion, steady: float, lead: float, joints: Array, model: StandModel
) -> Motion:
    """The instrument's axis goes round a cone, by the three gimbals.

    Parameters
    ----------
    entry : ConingMotion
    steady, lead : float
        [s]
    joints : (6,) rad
        Where the stand stands; the base stays there.
    model : StandModel

    Returns
    -------
    Motion
        Offsets from `joints`.

    Raises
    ------
    StandError
        The middle gimbal comes within `LOCK` of +-90 deg, or the cone goes round there, so that
        the outer gimbal would not come back; more pieces than `MOST_PIECES`.

    Notes
    -----
    The rotation vector from the attitude b0 at `joints` is ``half angle (e1 cos p + e2 sin p)``,
    p = 2 pi f (t - lead), with e1, e2 and the cone's axis k right-handed. By the right Jacobian
    of rotations [Bortz 1971] the instrument feels, with u the vector's direction and w = dp/dt,
    ``w_b = w (sin(half angle) k x u - (1 - cos(half angle)) k)``.
    """
    offsets = _coning_offsets(entry, steady, lead, joints, model)
    frequency = abs(entry.frequency_hz)
    # after a whole turn at full size it repeats, and fades out by smaller cones
    until = lead + 1 / frequency if steady > 1 / frequency else 2 * lead + steady
    seen = np.zeros(0)
    for fineness in FINENESS:
        knots = _knots(steady, lead, fineness * FIT_PER_PERIOD * frequency, frequency)
        seen = knots[: 2 + np.searchsorted(knots, until)]
        if _fits(offsets, seen):
            turns, pieces = steady * frequency, fineness * FIT_PER_PERIOD
            whole = round(turns) if abs(turns - round(turns)) < WHOLE_TURNS else 0
            return _repeating(lambda t: offsets(t)[0], knots, whole, pieces)
    raise _round_the_lock(seen, offsets)


Offsets = Callable[[Array], tuple[Array, Array]]


def _coning_offsets(
    entry: ConingMotion, steady: float, lead: float, joints: Array, model: StandModel
) -> Offsets:
    """Of times (n,): the joints' offsets (n, 6) [rad], wrapped, and how far middle is from lock.

    The base at rest, the gimbals turn by yaw, pitch, roll from where they are zero; a middle
    gimbal beyond +-90 deg is the other one of the two sets of angles for the same attitude.
    """
    around = AXES.index(entry.axis)
    first, second = np.eye(3)[(around + 1) % 3], np.eye(3)[(around + 2) % 3]
    zero = attitude(model, np.concatenate([joints[:BASE], np.zeros(3)]))
    start = C_N_NUE * (zero.inv() * attitude(model, joints))
    flip = np.array([1.0, -1.0 if np.cos(joints[BASE + 1]) < 0 else 1.0, 1.0])

    def gimbals(vector: Array) -> Array:
        turned = start * Rotation.from_rotvec(vector)
        roll, yaw, pitch = angles_from_C_nb(Sequence.YAW_PITCH_ROLL, turned).T
        return np.stack([yaw, pitch, roll], axis=1)

    at_rest = gimbals(np.zeros((1, 3)))

    def offsets(t: Array) -> tuple[Array, Array]:
        phase = 2 * np.pi * entry.frequency_hz * (t - lead)[:, None]
        size = entry.half_angle_deg * DEG * envelope(t, steady, lead)[:, None]
        angles = gimbals(size * (np.cos(phase) * first + np.sin(phase) * second))
        moved = np.zeros((len(t), len(JOINTS)))
        moved[:, BASE:] = flip * wrapped(angles - at_rest)
        return moved, np.pi / 2 - np.abs(angles[:, 1])

    return offsets


def _fits(offsets: Offsets, knots: Array) -> bool:
    """Whether polynomials between `knots` follow coning, which keeps clear of gimbal lock."""
    times = _between(knots)
    wanted, room = offsets(times)
    nearest = int(np.argmin(room))
    if room[nearest] < LOCK:
        raise StandError(
            f"gimbal lock at {times[nearest]:.3f} s: middle comes within "
            f"{room[nearest] / DEG:.2f} deg of +-90 deg, allowed {LOCK / DEG:g} deg"
        )
    have, _, _ = fitted(lambda t: offsets(t)[0], knots).joints(times)
    return float(np.abs(have - wanted).max()) < CLOSE_FIT


def _repeating(angles: Callable[[Array], Array], knots: Array, turns: int, pieces: int) -> Motion:
    """Coning between `knots`: of so many whole `turns` at full size, each of `pieces` pieces, one
    is fitted and the others repeat it; of another number (0) all is fitted."""
    fade, odd = divmod(len(knots) - 1 - turns * pieces, 2)
    if turns < 2 or odd:
        return fitted(angles, knots)
    begin = fitted(angles, knots[: fade + pieces + 1]).coefficients
    end = fitted(angles, knots[-fade - 1 :]).coefficients
    steady = np.tile(begin[:, fade:], (1, turns, 1))
    coefficients = np.concatenate([begin[:, :fade], steady, end], axis=1)
    coefficients.flags.writeable = False
    return Motion(knots, coefficients)


def _between(knots: Array) -> Array:
    """The knots and seven times between each two."""
    parts = knots[:-1, None] + np.diff(knots)[:, None] * np.linspace(0, 1, 8, endpoint=False)
    return np.append(parts.ravel(), knots[-1])


def _round_the_lock(knots: Array, offsets: Offsets) -> StandError:
    times = _between(knots)
    _, room = offsets(times)
    nearest = int(np.argmin(room))
    return StandError(
        f"gimbal lock inside the cone, nearest at {times[nearest]:.3f} s: middle comes within "
        f"{room[nearest] / DEG:.2f} deg of +-90 deg and outer goes right round; take a smaller "
        "half_angle_deg or start elsewhere"
    )
