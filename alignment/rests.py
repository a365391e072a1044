"""Where a record stands still: rests, and steady turns about the vertical, found by themselves.

Nothing is known of the procedure. A rest is a time over which the means of short blocks stay where
they are, for rates and forces alike, as far as the noise seen there can tell; a table that turns
slowly moves the means of longer blocks. A steady turn about the vertical leaves the specific force
alone: it shows by a rate that the rests do not have.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles, Sequence, SequenceRule
from alignment.arrays import Array, set_owned
from alignment.errors import NotAtRest, TooShort
from alignment.levelling import level
from alignment.noise import GAP, REST_RATE, REST_SIGMAS, check_rest
from alignment.readings import ImuReadings

SHORTEST = 3.0  # s: below it a pause of the hand that turns the unit
BLOCK = 0.5  # s
LONG = 16  # blocks, whose means show what moves slowly
# Of blocks that follow one another: below it no table moves from one position to another, and an
# accelerometer's bias or a gyro's drifts over minutes.
TILT = np.radians(0.1)  # of specific force, also of means over LONG blocks
RATE = np.radians(0.1)  # rad/s
SLOW_RATE = np.radians(0.01)  # rad/s, of means over LONG blocks
LEAST_TURN = np.radians(0.02)  # rad/s: above the Earth's rate up and down, twice 15 deg/h
GREAT_BIAS = np.radians(1.0)  # rad/s: no gyro's, where it points along the vertical as well
ALONG = np.cos(np.radians(2.0))  # of the vertical
_AROUND = 2  # blocks to either side from which noise is read
_JUMPS = 8  # the same for jumps between means

Kind = Literal["rest", "turn"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Found:
    """A stretch without change.

    Attributes
    ----------
    kind : str
        'rest', or 'turn' about the vertical.
    t_from, t_to : float
        [s]
    w_ib_b, f_b : (3,)
        Means [rad/s], [m/s^2].
    noise : (6,)
        Standard deviations of single samples of rates and forces.
    rate : float
        Of a turn, about up [rad/s]; else 0.
    """

    kind: Kind
    t_from: float
    t_to: float
    w_ib_b: Array
    f_b: Array
    noise: Array
    rate: float = 0.0

    def __post_init__(self) -> None:
        set_owned(
            self,
            w_ib_b=(self.w_ib_b, (3,), float),
            f_b=(self.f_b, (3,), float),
            noise=(self.noise, (6,), float),
        )

    @property
    def up_b(self) -> Array:
        """The vertical in b, of length 1."""
        return self.f_b / np.linalg.norm(self.f_b)


def find_stretches(readings: ImuReadings, shortest: float = SHORTEST) -> list[Found]:
    """Rests and steady turns about the vertical, in order of time; none where nothing rests.

    Parameters
    ----------
    readings : ImuReadings
        n >= 2. Gaps part stretches.
    shortest : float
        Of a stretch [s].

    Returns
    -------
    list of Found
        Each begins and ends within 1 s of the change (`BLOCK` and the block beside it), or within
        8 s of a change that is slow (0.1 deg in as much).

    Raises
    ------
    TooShort
        Fewer than two samples.

    Notes
    -----
    Blocks follow one another within `TILT` and `RATE`, or `REST_SIGMAS` standard deviations of
    their means where those are more: from second differences of the samples around, or from the
    jumps of the means around, whichever is less (a vibration averages out, a motion is smooth).
    What remains is judged by `check_rest`, as every method does; what fails is parted where means
    of more and more blocks differ. A rate is a turn where it differs from that of the rests along
    the vertical, by more than the rests differ across it. A record that turns evenly from end to
    end is taken for a gyro bias below 1 deg/s.
    """
    if len(readings) < 2:
        raise TooShort(f"{len(readings)} samples: at least 2 are needed")
    steps = np.diff(readings.t)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    per = max(1, round(BLOCK / readings.interval))
    found = []
    for a, b in pairwise([0, *gaps.tolist(), len(readings)]):
        if b - a >= 2 * per:
            part = ImuReadings(readings.t[a:b], readings.w_ib_b[a:b], readings.f_b[a:b])
            blocks = _Blocks.of(part, per)
            found += [blocks.summary(*edges) for edges in blocks.still()]
    return _turns_told([one for one in found if one.t_to - one.t_from >= shortest])


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Readings without a gap in blocks of `per` samples: their means (m, 3), and how far noise
    moves those (m,)."""

    part: ImuReadings
    per: int
    w: Array
    f: Array
    sigma_w: Array
    sigma_f: Array

    @classmethod
    def of(cls, part: ImuReadings, per: int) -> "_Blocks":
        count = len(part) // per
        w, f = (_means(values, per, count) for values in (part.w_ib_b, part.f_b))
        return cls(part, per, w, f, _sigmas(part.w_ib_b, w, per), _sigmas(part.f_b, f, per))

    @property
    def tilt(self) -> float:
        """`TILT` as a specific force."""
        return TILT * float(np.linalg.norm(self.f, axis=1).mean())

    def still(self) -> list[tuple[int, int]]:
        """First and last block (exclusive) of each stretch without change."""
        jumps = _apart(self.w, RATE, self.sigma_w) | _apart(self.f, self.tilt, self.sigma_f)
        moving = np.zeros(len(self.f), bool)
        moving[1:] |= jumps
        moving[:-1] |= jumps
        found = []
        for a, b in _runs(~moving):
            slow = _slow(self.w[a:b], SLOW_RATE, self.sigma_w[a:b], LONG)
            slow |= _slow(self.f[a:b], self.tilt, self.sigma_f[a:b], LONG)
            for c, d in _between(slow, LONG):
                found += self._settled(a + c, a + d, LONG)
        return found

    def _settled(self, a: int, b: int, among: int) -> list[tuple[int, int]]:
        """Those of blocks a to b at rest, where means of more than `among` blocks tell it."""
        try:
            check_rest(self._samples(a, b), "")
        except (NotAtRest, TooShort):
            among *= 2
            if 2 * among > b - a:
                return []
            slow = _slow(self.f[a:b], self.tilt, self.sigma_f[a:b], among)
            parts = [self._settled(a + c, a + d, among) for c, d in _between(slow, among)]
            return [edges for part in parts for edges in part]
        return [(a, b)]

    def _samples(self, a: int, b: int) -> ImuReadings:
        """The samples of blocks a to b; the last block has those that are left over."""
        end = len(self.part) if b == len(self.f) else b * self.per
        r, of = self.part, slice(a * self.per, end)
        return ImuReadings(r.t[of], r.w_ib_b[of], r.f_b[of])

    def summary(self, a: int, b: int) -> Found:
        """What blocks a to b read, as a rest."""
        inside, t = self._samples(a, b), self.part.t
        w, f = inside.w_ib_b, inside.f_b
        return Found(
            kind="rest",
            t_from=float(t[a * self.per - 1] if a else t[0] - self.part.interval),
            t_to=float(inside.t[-1]),
            w_ib_b=w.mean(axis=0),
            f_b=f.mean(axis=0),
            noise=np.concatenate([w.std(axis=0), f.std(axis=0)]),
        )


def _means(values: Array, per: int, count: int) -> Array:
    """Means (count, 3) of successive `per` samples."""
    return np.asarray(values[: count * per].reshape(count, per, 3).mean(axis=1))


def _sigmas(values: Array, means: Array, per: int) -> Array:
    """Standard deviation (m,) of each mean (m, 3) over `per` samples, of the worst axis."""
    count = len(means)
    jumps = np.abs(np.diff(means, axis=0, append=means[-1:])).max(axis=1)
    by_jumps = _median_around(jumps, _JUMPS) * 1.4826 / np.sqrt(2)
    if len(values) < 3:
        return by_jumps
    second = np.abs(np.diff(values, 2, axis=0, append=values[[-1, -1]]))
    inside = np.median(second[: count * per].reshape(count, per, 3), axis=1)
    by_samples = _median_around(inside.max(axis=1), _AROUND) * 1.4826 / np.sqrt(6 * per)
    return np.minimum(by_samples, by_jumps)


def _median_around(values: Array, reach: int) -> Array:
    """Running median (m,) over `reach` to either side; ends are repeated."""
    padded = np.pad(values, reach, mode="edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    )


def _apart(means: Array, floor: float, sigmas: Array) -> np.ndarray:
    """Which successive means (m, 3) differ by more than `floor` and noise."""
    noise = np.maximum(sigmas[:-1], sigmas[1:]) * np.sqrt(2)
    return np.linalg.norm(np.diff(means, axis=0), axis=1) > np.maximum(floor, REST_SIGMAS * noise)


def _slow(means: Array, floor: float, sigmas: Array, among: int) -> np.ndarray:
    """Which blocks (m,) lie where the means of `among` blocks before and after differ."""
    slow = np.zeros(len(means), bool)
    among = min(among, len(means) // 2)
    if among < 2:
        return slow
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(means, axis=0)])
    windows = (sums[among:] - sums[:-among]) / among
    noise = REST_SIGMAS * np.sqrt(2 / among) * float(np.median(sigmas))
    off = np.linalg.norm(windows[among:] - windows[:-among], axis=1) > max(floor, noise)
    slow[among : among + len(off)] = off
    return slow


def _between(slow: np.ndarray, least: int) -> list[tuple[int, int]]:
    """Runs that are not slow; of those beside a slow one such as are long enough to be judged."""
    return [(a, b) for a, b in _runs(~slow) if b - a >= least or b - a == len(slow)]


def _runs(true: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _turns_told(found: Ordered[Found]) -> list[Found]:
    """The same with turns told from rests by their rates."""
    quiet = [one for one in found if not _must_turn(one)]
    if quiet:
        calm = min(quiet, key=lambda one: float(np.linalg.norm(one.w_ib_b)))
        near = [o for o in quiet if np.linalg.norm(o.w_ib_b - calm.w_ib_b) < 5 * REST_RATE]
        bias = np.median([one.w_ib_b for one in near], axis=0)
        across = [np.linalg.norm(np.cross(one.w_ib_b - bias, one.up_b)) for one in near]
        noise = max(float(_error(one).max()) for one in near)
        least = max(LEAST_TURN, 6 * float(np.median(across)), REST_SIGMAS * noise)
    else:
        bias, least = np.zeros(3), LEAST_TURN
    told = []
    for one in found:
        rate = float((one.w_ib_b - bias) @ one.up_b)
        told.append(replace(one, kind="turn", rate=rate) if abs(rate) > least else one)
    return told


def _must_turn(one: Found) -> bool:
    rate = float(np.linalg.norm(one.w_ib_b))
    return rate > GREAT_BIAS and abs(float(one.w_ib_b @ one.up_b)) > ALONG * rate


def _error(one: Found) -> Array:
    """Standard deviations (3,) of a mean rate, by one independent sample a block."""
    return one.noise[:3] / np.sqrt(max(1.0, (one.t_to - one.t_from) / BLOCK))


def attitudes(readings: ImuReadings, found: Ordered[Found]) -> list[Rotation]:
    """``C_nb`` of each stretch: levelled, and turned about the vertical as the gyros say.

    The yaw of the first is zero: nobody says where north is. From one stretch to the next the
    rates of the readings less the mean of the two rests are integrated, sample by sample: good to
    a scale error of the turn and to bias instability over it, for naming what was meant.
    """
    chain: list[Rotation] = []
    for k, one in enumerate(found):
        rule = SequenceRule.REGULAR.sequence_for(one.up_b)
        if not chain:
            chain.append(_turned(one, rule, 0.0))
            continue
        before = found[k - 1]
        carried = chain[-1] * _carried(readings, before, one)
        chain.append(_nearest(one, rule, carried))
    return chain


def _carried(readings: ImuReadings, one: Found, other: Found) -> Rotation:
    """Rotation from b at the end of `one` (of a turn: its begin) to b at the begin of `other`."""
    t_from = one.t_to if one.kind == "rest" else one.t_from
    first, last = np.searchsorted(readings.t, [t_from, other.t_from], "right")
    bias = np.mean([o.w_ib_b - o.rate * o.up_b for o in (one, other)], axis=0)
    t = readings.t[max(0, first - 1) : last]
    if len(t) < 2:
        return Rotation.identity()
    w = readings.w_ib_b[first : first + len(t) - 1] - bias
    turns = Rotation.from_rotvec(w * np.diff(t)[:, None])
    return _product(turns)


def _product(turns: Rotation) -> Rotation:
    """Of all turns in order, pairwise."""
    while len(turns) > 1:
        if len(turns) % 2:
            turns = Rotation.concatenate([turns, Rotation.identity(1)])
        turns = turns[::2] * turns[1::2]
    return turns[0]


def _turned(one: Found, rule: Sequence, yaw: float) -> Rotation:
    roll, pitch = level(one.f_b, rule)
    return C_nb_from_angles(rule, float(roll), yaw, float(pitch))


def _nearest(one: Found, rule: Sequence, carried: Rotation) -> Rotation:
    """The levelled attitude with the yaw that brings it nearest to the carried one."""
    level_ = _turned(one, rule, 0.0)
    off = (carried * level_.inv()).as_quat()
    return _turned(one, rule, -2 * float(np.arctan2(off[2], off[3])))
