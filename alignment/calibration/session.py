"""A test on a table as a calibration takes it: stations, moves between them, what each pose shows.

A station at rest is told by the means of its channels; one that turns at constant rate by constant,
cosine and sine of each against the encoder's angle, over whole turns. A move is told by the
integral of the gyros from one station into the next against the rotation of the encoders.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.calibration.bench import Bench, Leanings
from alignment.cross import cross_matrix
from alignment.earth import Site
from alignment.information.model import Stretch, sensor_inputs
from alignment.readings import ImuReadings

SEAT = ("mounting about", "seat about")
_NORTH = Rotation.identity()


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """A stretch, and where the table's axes stood.

    `joints` (j,) [rad], the turning one's at zero; `going_round`: which that is, -1 at rest;
    empty where only the attitude was told. `warmth`: above the reference temperature [K].
    """

    stretch: Stretch
    joints: Array
    going_round: int = -1
    warmth: float = 0.0

    def __post_init__(self) -> None:
        set_owned(self, joints=(self.joints, (None,), float))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Move:
    """From one station into another: perfect or real readings from the one's to the other's.

    `first`, `last`: numbers of the stations. `angle_from`, `angle_to` [rad]: of the encoder of a
    station that turns, at the start and the end of the readings. `readings`: whole samples.
    `warmth`: above the reference temperature [K], of every sample (n,) or of all.
    """

    label: str
    first: int
    last: int
    readings: ImuReadings
    angle_from: float = 0.0
    angle_to: float = 0.0
    warmth: Array = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        set_owned(self, warmth=(self.warmth, (None,), float))

    @property
    def t_from(self) -> float:
        """Where the first sample's interval begins [s]."""
        return float(self.readings.t[0]) - self.readings.interval

    @property
    def length(self) -> float:
        """[s]"""
        return float(self.readings.t[-1]) - self.t_from


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """One recording: `stations` in time, `moves`, and the `interval` between samples [s]."""

    stations: tuple[Station, ...]
    moves: tuple[Move, ...]
    interval: float

    @property
    def turning(self) -> bool:
        """Whether any station turns."""
        return any(s.stretch.rate for s in self.stations)

    @property
    def warm(self) -> bool:
        """Whether the temperature differs from station to station, or from the reference."""
        return any(s.warmth for s in self.stations)


class Poses:
    """What is nominal of a session's stations and moves, and how the table's errors turn it.

    `own`: where there are several sessions, the name of this one, for which the unit was mounted
    anew.

    Attributes
    ----------
    w, f : (n, 3)
        Nominal true rate [rad/s] and force [m/s^2] at the unit's point, in b, at n nodes.
    turning : (n, 3) rad/s
        Rate of the table's own turning, in b.
    leanings : Leanings
        Of all nodes, then of the two ends of every move.
    slopes : (n, 3, l) 1/s
        Rate that each error adds as the turning axis goes round.
    carried : (n, 3, l)
        Turns of b against what turns: of the unit's own arm, as seen in b.
    edges : (s + 1,)
        Nodes of each station.
    project : list of (h, k)
        From a station's nodes to its coefficients.
    """

    def __init__(self, session: Session, bench: Bench, site: Site, own: str = "") -> None:
        self.session, self.site = session, site
        seen = [sensor_inputs(s.stretch, _NORTH, site) for s in session.stations]
        self.counts = [len(w) for w, *_ in seen]
        self.edges = np.cumsum([0, *self.counts])
        self.w, self.f, self.C_bn = (np.concatenate([one[k] for one in seen]) for k in range(3))
        self.project = [one[3] for one in seen]
        rates = [s.stretch.rate * s.stretch.axis_b for s in session.stations]
        self.turning = np.repeat(np.array(rates), self.counts, axis=0)
        self.warmth = np.repeat([s.warmth for s in session.stations], self.counts)
        self.ends = self._ends()
        self.leanings = self._leanings(bench)
        if own:
            self.leanings = _mounted_anew(self.leanings, own)
        self.slopes, self.carried = self._slopes()

    @property
    def orders(self) -> list[int]:
        """How many coefficients each station has."""
        return [len(p) for p in self.project]

    def of_nodes(self) -> Array:
        """Turns (n, 3, l) of b at the nodes."""
        return self.leanings.turns[: self.edges[-1]]

    def of_ends(self) -> tuple[Array, Array]:
        """Turns (m, 3, l) of b where the moves begin, and where they end."""
        ends = self.leanings.turns[self.edges[-1] :]
        return ends[0::2], ends[1::2]

    @cached_property
    def expected(self) -> Array:
        """Rotation (m, 3, 3) of each move, inertial: takes b at its end to b at its start."""
        w_ie = self.site.w_ie_n
        found = np.empty((len(self.session.moves), 3, 3))
        for k, (move, (start, end)) in enumerate(zip(self.session.moves, self.ends, strict=True)):
            earth = Rotation.from_rotvec(w_ie * move.length)
            found[k] = (start.inv() * earth * end).as_matrix()
        return found

    def _ends(self) -> list[tuple[Rotation, Rotation]]:
        """``C_nb`` where each move begins and where it ends."""

        def at(number: int, angle: float) -> Rotation:
            stretch = self.session.stations[number].stretch
            return stretch.C_pb * Rotation.from_rotvec(angle * stretch.axis_b)

        return [(at(m.first, m.angle_from), at(m.last, m.angle_to)) for m in self.session.moves]

    def _leanings(self, bench: Bench) -> Leanings:
        if bench.table is None:
            return _of_attitudes(self, bench)
        joints, rounds = [], []
        for station, count in zip(self.session.stations, self.counts, strict=True):
            angles = np.tile(station.joints, (count, 1))
            if count > 1:
                angles[:, station.going_round] = 2 * np.pi * np.arange(count) / count
            joints.append(angles)
            rounds.append(np.full(count, station.going_round if count > 1 else -1))
        for move in self.session.moves:
            for number, angle in ((move.first, move.angle_from), (move.last, move.angle_to)):
                station = self.session.stations[number]
                angles = np.array(station.joints)
                if station.going_round >= 0:
                    angles[station.going_round] = angle
                joints.append(angles[None])
                rounds.append(np.full(1, -1))
        return bench.table(np.concatenate(joints), np.concatenate(rounds))

    def _slopes(self) -> tuple[Array, Array]:
        turns = self.of_nodes()
        slopes, carried = np.zeros_like(turns), np.zeros_like(turns)
        seat = np.array([_of_seat(name) for name in self.leanings.names], bool)
        for k, station in enumerate(self.session.stations):
            stretch = station.stretch
            if stretch.rate:
                own = slice(self.edges[k], self.edges[k + 1])
                slopes[own] = stretch.rate * _by_angle(turns[own])
                # what goes round with b is beyond the turning axis; along it only the seat is
                steady = turns[own].mean(axis=0)
                steady -= np.outer(stretch.axis_b, stretch.axis_b @ steady) * ~seat
                carried[own] = steady
        return slopes, carried


def _of_seat(name: str) -> bool:
    return (name.partition(": ")[2] or name).startswith(SEAT)


def _mounted_anew(found: Leanings, own: str) -> Leanings:
    """With the seat's own part in one of several recordings, as large as what stays."""
    seat = [k for k, name in enumerate(found.names) if _of_seat(name)]
    return Leanings(
        (*found.names, *(f"{own}: {found.names[k]}" for k in seat)),
        np.concatenate([found.sigmas, found.sigmas[seat]]),
        np.concatenate([found.turns, found.turns[:, :, seat]], axis=2),
        found.axes,
    )


def _by_angle(turns: Array) -> Array:
    """Derivative (k, 3, l) by the angle of what goes round with it, by Fourier."""
    k = len(turns)
    orders = np.fft.rfftfreq(k, 1 / k)
    orders[-1] = 0.0  # the highest has no sign
    return np.fft.irfft(1j * orders[:, None, None] * np.fft.rfft(turns, axis=0), k, axis=0)


def _of_attitudes(poses: Poses, bench: Bench) -> Leanings:
    """Where only attitudes were told: the whole is tilted, the unit seated, each station placed.

    What turns is placed on either side of its axis.
    """
    stations = poses.session.stations
    ends = [one for pair in poses.ends for one in pair]
    C_bn = np.concatenate([poses.C_bn, *(e.inv().as_matrix()[None] for e in ends)])
    whose = np.repeat(np.arange(len(stations)), poses.counts).tolist()
    whose += [k for m in poses.session.moves for k in (m.first, m.last)]
    names = ["tilt about north", "tilt about east", "azimuth"]
    sigmas = [bench.tilt, bench.tilt, bench.azimuth]
    parts = [C_bn]
    names += [f"seat about {axis}" for axis in ("X1", "Y1", "Z1")]
    sigmas += [bench.seat] * 3
    parts.append(np.tile(np.eye(3), (len(C_bn), 1, 1)))
    for k, station in enumerate(stations):
        at_zero = station.stretch.C_pb.inv().as_matrix()
        own = (np.array(whose) == k)[:, None, None]
        parts.append(own * (C_bn @ at_zero.T))
        names += [f"position of {station.stretch.label} about {a}" for a in ("X1", "Y1", "Z1")]
        sigmas += [bench.placement] * 3
        if station.stretch.rate:  # beyond the axis: where in b it is
            parts.append(own * np.eye(3))
            names += [f"axis of {station.stretch.label} about {a}" for a in ("X1", "Y1", "Z1")]
            sigmas += [bench.placement] * 3
    kept = np.flatnonzero(np.array(sigmas) > 0)
    turns = np.concatenate(parts, axis=2)[:, :, kept]
    return Leanings(
        tuple(names[i] for i in kept), np.array(sigmas)[kept], turns, np.zeros((len(turns), 3, 0))
    )


# --- what is felt --------------------------------------------------------------------------------


def turned(x: Array, d: Array) -> Array:
    """``exp(-d x) x`` to second order, (n, 3) each: a vector's components in a b turned by d."""
    once = np.cross(d, x)
    return x - once + np.cross(d, once) / 2


@dataclass(frozen=True, slots=True, eq=False)
class TrueInput:
    """True rates `w`, forces `f` at the unit's point, and at each accelerometer's place, (n, 3)."""

    w: Array
    f: Array
    at_places: Array


def true_input(poses: Poses, arm: Array, errors: Array, gravity: float, places: Array) -> TrueInput:
    """What the sensors feel with the table's `errors` (l,), `gravity` [m/s^2] off, and `places`.

    `arm` (3,) [m] from the crossing of the table's axes to the unit's point, in b.

    A table in steady turning: its arm swings, and does not speed up.
    """
    d, more, beyond = (part @ errors for part in (poses.of_nodes(), poses.slopes, poses.carried))
    w = turned(poses.w, d) + more
    f = turned(poses.f, d) * (1 + gravity / poses.site.gravity)
    own = turned(poses.turning, d) + more

    def swung(r: Array) -> Array:
        v = np.cross(own, turned(np.tile(r, (len(own), 1)), beyond))
        return np.cross(own, v) + 2 * np.cross(w - own, v)

    at_places = np.stack(
        [f[:, i] + swung(arm + place)[:, i] for i, place in enumerate(places)], axis=1
    )
    return TrueInput(w, f + swung(arm), at_places)


def by_errors(poses: Poses, bench: Bench, places: Array) -> tuple[Array, Array]:
    """Derivatives (n, 3, l) of rate, and force at the `places`, by the table's errors, at none."""
    turns = poses.of_nodes()
    own = cross_matrix(poses.turning)
    w, f = cross_matrix(poses.w) @ turns + poses.slopes, cross_matrix(poses.f) @ turns
    changed = own @ turns + poses.slopes
    for i, place in enumerate(places):
        r = cross_matrix(bench.arm + place)
        v = -r @ changed + own @ r @ poses.carried
        swing = np.cross(poses.turning, bench.arm + place)
        f[:, i] += (own @ v - cross_matrix(swing) @ changed)[:, i]
    return w, f


def by_place(poses: Poses) -> Array:
    """Derivative (n, 3, 9) of each accelerometer's force by the places (3, 3), row by row."""
    own = poses.turning
    earth = 2 * cross_matrix(poses.w - own)
    by_arm = cross_matrix(own) @ cross_matrix(own) + earth @ cross_matrix(own)
    found = np.zeros((len(own), 3, 9))
    for i in range(3):
        found[:, i, 3 * i : 3 * i + 3] = by_arm[:, i]
    return found
