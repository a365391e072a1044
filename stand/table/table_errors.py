"""What is wrong with a table: drawn from its class by the seed, or set by the procedure.

Each axis turns truly to ``q + g(q)`` where its encoder stands at q::

    g(q) = placement + c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q - (r/n) cos(n q + phase)

with a rate ripple r, n times round per turn: the true rate is ``q' (1 + r sin(n q + phase))``. The
drive makes q follow the plan; the encoder reports q, rounded to its step.

Each error of each axis has a random stream of its own, so that one that is set, switched off or
new leaves all others as they were.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array, IntArray, set_owned
from alignment.units import ARC_SECOND, DEG
from stand import toml_files as catalogue
from stand.errors import unknown
from stand.table.joints import JOINTS
from stand.table.table import PerTurn, Table

AXES = len(JOINTS)
PERCENT = 0.01

ArcSeconds = Annotated[float, Field(ge=-36000, le=36000)]
Degrees = Annotated[float, Field(ge=-360, le=360)]

# One random stream per error and axis: a number is never given to another error. The first number
# of the key tells the table from the sensors of the IMU, which have 0 to 2.
_TABLE = 3
_STREAMS = {
    "base_tilt": 0,
    "base_azimuth": 1,
    "mounting": 2,
    "placement": 3,
    "encoder_once": 4,
    "encoder_twice": 5,
    "non_orthogonality": 6,
    "wobble": 7,
    "wobble_phase": 8,
    "rate_ripple": 9,
    "ripple_phase": 10,
}
# Cosines and sines, once and twice round: four amplitudes of sigma / sqrt 2 are, squared and
# averaged over a turn (which halves them) and over tables, sigma^2.
_EACH_OF_FOUR = 1 / sqrt(2)


class AxisSetEntry(catalogue.Entry):
    """Errors of one axis as set values; what is absent is drawn (or zero).

    `encoder_once_arc_s`, `encoder_twice_arc_s`: amplitudes of cosine and sine. Amplitude and phase
    of wobble and ripple are set each for itself.
    """

    placement_arc_s: ArcSeconds | None = None
    encoder_once_arc_s: tuple[ArcSeconds, ArcSeconds] | None = None
    encoder_twice_arc_s: tuple[ArcSeconds, ArcSeconds] | None = None
    encoder_step_arc_s: Annotated[float, Field(ge=0, le=36000)] | None = None
    non_orthogonality_arc_s: ArcSeconds | None = None
    wobble_arc_s: ArcSeconds | None = None
    wobble_phase_deg: Degrees | None = None
    rate_ripple_percent: Annotated[float, Field(ge=-50, le=50)] | None = None
    ripple_per_turn: PerTurn | None = None
    ripple_phase_deg: Degrees | None = None


class TableErrorsEntry(catalogue.Entry):
    """Errors of the table as set values; what is absent is drawn, or zero with drawn = false.

    `base_tilt_arc_s`: about east and north; `mounting_arc_s`: about X1, Y1, Z1.
    """

    drawn: bool = True
    base_tilt_arc_s: tuple[ArcSeconds, ArcSeconds] | None = None
    base_azimuth_arc_s: ArcSeconds | None = None
    mounting_arc_s: tuple[ArcSeconds, ArcSeconds, ArcSeconds] | None = None
    axis: dict[str, AxisSetEntry] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _axes(self) -> "TableErrorsEntry":
        for name in self.axis:
            if name not in JOINTS:
                raise ValueError(str(unknown("axis", name, JOINTS)))
        first = self.axis.get(JOINTS[0])
        if first is not None and first.non_orthogonality_arc_s:
            raise ValueError(
                f"axis {JOINTS[0]}, non_orthogonality_arc_s = {first.non_orthogonality_arc_s:g}: "
                "must be 0, no axis carries it (base_azimuth_arc_s and base_tilt_arc_s turn it)"
            )
        return self


def _six() -> Array:
    return np.zeros(AXES)


def _six_pairs() -> Array:
    return np.zeros((AXES, 2))


@dataclass(frozen=True, slots=True, eq=False)
class TableErrors:
    """The errors of one table, in SI; none by default. Arrays (6,) are in the order of `JOINTS`.

    Attributes
    ----------
    base_tilt : (2,) rad
        The whole stand above the pier is turned about east and north,
    base_azimuth : float
        and about up [rad]: components of one rotation vector.
    mounting : (3,) rad
        Rotation vector in b by which the IMU is turned on its plate.
    placement : (6,) rad
        Constant offset of the true angle from the encoder's.
    encoder_once, encoder_twice : (6, 2) rad
        Cosine and sine amplitudes of what goes once and twice round per turn.
    encoder_step : (6,) rad
        Of the encoder's reading; 0: not rounded.
    non_orthogonality : (6,) rad
        How far the axis leans toward the axis that carries it; `outer`, parallel to its own,
        leans toward the one before, as `base_yaw` does. The first is 0.
    wobble, wobble_phase : (6,) rad
        The axis nods by ``wobble (cos, sin)(q + wobble_phase)`` about two lines across it that
        turn with it: once per turn as seen from the IMU. (Seen from the ground the nod goes round
        twice per turn, the first harmonic that an autocollimator can tell from its mirror's seat.)
    rate_ripple : (6,)
        Part of the rate; `ripple_per_turn` (6,) times round, with `ripple_phase` (6,) [rad].
    """

    base_tilt: Array = field(default_factory=lambda: np.zeros(2))
    base_azimuth: float = 0.0
    mounting: Array = field(default_factory=lambda: np.zeros(3))
    placement: Array = field(default_factory=_six)
    encoder_once: Array = field(default_factory=_six_pairs)
    encoder_twice: Array = field(default_factory=_six_pairs)
    encoder_step: Array = field(default_factory=_six)
    non_orthogonality: Array = field(default_factory=_six)
    wobble: Array = field(default_factory=_six)
    wobble_phase: Array = field(default_factory=_six)
    rate_ripple: Array = field(default_factory=_six)
    ripple_per_turn: IntArray = field(default_factory=lambda: np.ones(AXES, np.int64))
    ripple_phase: Array = field(default_factory=_six)

    def __post_init__(self) -> None:
        pairs = ("encoder_once", "encoder_twice")
        sizes = {"base_tilt": (2,), "mounting": (3,)} | dict.fromkeys(pairs, (AXES, 2))
        for name in self.__slots__:
            if name != "base_azimuth":
                kind = np.int64 if name == "ripple_per_turn" else float
                set_owned(self, **{name: (getattr(self, name), sizes.get(name, (AXES,)), kind)})
        if (self.ripple_per_turn < 1).any() or (self.encoder_step < 0).any():
            raise ValueError("ripple_per_turn: must be 1 or more; encoder_step: 0 or more")
        if self.non_orthogonality[0]:
            raise ValueError(f"non_orthogonality of {JOINTS[0]}: must be 0, no axis carries it")

    @property
    def perfect(self) -> bool:
        """Whether nothing is wrong: phases alone do no harm."""
        harmless = {"wobble_phase", "ripple_phase", "ripple_per_turn"}
        return not any(np.any(getattr(self, name)) for name in set(self.__slots__) - harmless)

    @property
    def wobbling(self) -> IntArray:
        """Numbers of the axes that wobble."""
        return np.flatnonzero(self.wobble)

    @property
    def harmonics(self) -> list[tuple[IntArray, IntArray, Array, Array]]:
        """What is periodic in g(q): (axes, times round, cosine, sine amplitudes [rad]) each."""
        ripple = self.rate_ripple / self.ripple_per_turn
        parts = (
            (np.ones(AXES, np.int64), *self.encoder_once.T),
            (np.full(AXES, 2), *self.encoder_twice.T),
            (
                self.ripple_per_turn,
                -ripple * np.cos(self.ripple_phase),
                ripple * np.sin(self.ripple_phase),
            ),
        )
        found = []
        for order, cosine, sine in parts:
            axes = np.flatnonzero((cosine != 0) | (sine != 0))
            if len(axes):
                found.append((axes, order[axes], cosine[axes], sine[axes]))
        return found

    @property
    def waves(self) -> list[tuple[IntArray, IntArray, Array, Array]]:
        """The harmonics and the nods, which go once round."""
        axes = self.wobbling
        once = np.ones(len(axes), np.int64)
        nods = [(axes, once, self.wobble[axes], np.zeros(len(axes)))] if len(axes) else []
        return self.harmonics + nods

    def realised(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """True angles, rates and accelerations where the encoders' are `q`, `v`, `a`, (n, 6) each.

        Notes
        -----
        The chain rule: ``(1 + g') v`` and ``(1 + g') a + g'' v^2``.
        """
        harmonics = self.harmonics
        if not harmonics:
            return (q + self.placement if self.placement.any() else q), v, a
        angle, slope, bend = q + self.placement, np.ones_like(q), np.zeros_like(q)
        still = (q == q[:1]).all(axis=0)
        for whose, at in ((~still, q), (still, q[:1])):  # of an axis that stands still: once
            for every, *parts in harmonics:
                own = whose[every]
                axes, (order, cosine, sine) = every[own], (part[own] for part in parts)
                turned = at[:, axes] * order
                c, s = np.cos(turned), np.sin(turned)
                wave = cosine * c + sine * s
                angle[:, axes] += wave
                slope[:, axes] += order * (sine * c - cosine * s)
                bend[:, axes] -= order**2 * wave
        return angle, slope * v, slope * a + bend * v**2

    def nods(
        self, q: Array, v: Array, a: Array, axes: IntArray | None = None
    ) -> tuple[Array, Array, Array]:
        """Angles, rates and accelerations (n, 2 m) of the nods of m `axes`: of all that wobble.

        About the first, then the second line across each axis; `q`, `v`, `a` (n, 6) as the
        encoders have them.
        """
        axes = self.wobbling if axes is None else axes
        turned, v, a = q[:, axes] + self.wobble_phase[axes], v[:, axes], a[:, axes]
        first, second = self.wobble[axes] * np.cos(turned), self.wobble[axes] * np.sin(turned)

        def paired(x: Array, y: Array) -> Array:
            return np.stack([x, y], axis=2).reshape(len(q), -1)

        return (
            paired(first, second),
            paired(-second * v, first * v),
            paired(-second * a - first * v**2, first * a - second * v**2),
        )

    def readings(self, q: Array) -> Array:
        """What the encoders say at angles `q` (n, 6): rounded to their steps."""
        if not self.encoder_step.any():
            return q
        said = q.copy(order="K")
        for own, whole, step in zip(said.T, q.T, self.encoder_step, strict=True):
            if step and len(q):
                still = (whole == whole[0]).all()
                np.multiply(step, np.rint((whole[:1] if still else whole) / step), out=own)
        said.flags.writeable = False  # given away
        return said

    def record(self) -> dict[str, str]:
        """The values as JSON for a recording's metadata, units in the keys as in a procedure."""
        named = {key: getattr(self, name) / unit for name, (key, unit) in _KEYS.items()}
        return {"axes": json.dumps(JOINTS)} | {
            key: json.dumps(np.asarray(value).tolist()) for key, value in named.items()
        }


_KEYS: dict[str, tuple[str, float]] = {
    "base_tilt": ("base_tilt_arc_s", ARC_SECOND),
    "base_azimuth": ("base_azimuth_arc_s", ARC_SECOND),
    "mounting": ("mounting_arc_s", ARC_SECOND),
    "placement": ("placement_arc_s", ARC_SECOND),
    "encoder_once": ("encoder_once_arc_s", ARC_SECOND),
    "encoder_twice": ("encoder_twice_arc_s", ARC_SECOND),
    "encoder_step": ("encoder_step_arc_s", ARC_SECOND),
    "non_orthogonality": ("non_orthogonality_arc_s", ARC_SECOND),
    "wobble": ("wobble_arc_s", ARC_SECOND),
    "wobble_phase": ("wobble_phase_deg", DEG),
    "rate_ripple": ("rate_ripple_percent", PERCENT),
    "ripple_per_turn": ("ripple_per_turn", 1),
    "ripple_phase": ("ripple_phase_deg", DEG),
}
PERFECT = TableErrors()


def draw(
    table: Table, seed: int, set_values: TableErrorsEntry | None, ideal_motion: bool
) -> TableErrors:
    """The errors of one table.

    Parameters
    ----------
    table : Table
        Its class states standard deviations; steps and times per turn are sizes, phases are
        anywhere in a turn. The encoder's figure is the root mean square over a turn.
    seed : int
    set_values : TableErrorsEntry or None
        Values that are given instead of drawn.
    ideal_motion : bool
        Whether the axes follow the plan exactly. If not, the rate ripple is left out: a simulated
        servo has its own.
    """
    chosen = TableErrorsEntry() if set_values is None else set_values
    drawn = float(chosen.drawn)

    def normal(sigma: float, source: str, axis: int, *size: int) -> Array:
        if not sigma:  # a stream of its own: nobody misses its numbers
            return np.zeros(size)
        return sigma * (drawn * _stream(seed, source, axis).standard_normal(size))

    def whole(name: str, sigma_arc_s: float, size: int) -> Array:
        given = getattr(chosen, _KEYS[name][0])
        if given is not None:
            return np.asarray(given, dtype=float) * ARC_SECOND
        sigma = sigma_arc_s * ARC_SECOND
        return np.array([normal(sigma, name, i) for i in range(size)]) + 0.0

    def each(name: str, otherwise: Callable[[int], Array | float]) -> Array:
        """Of every axis: the set value, or what else it is, in the key's unit; gives SI."""
        key, unit = _KEYS[name]
        given = [getattr(chosen.axis.get(axis), key, None) for axis in JOINTS]
        values = [otherwise(i) if g is None else g for i, g in enumerate(given)]
        return np.array(values, dtype=float) * unit + 0.0  # no -0 where the class states nothing

    sizes = [table.entry.axis[axis].errors for axis in JOINTS]
    geometry = table.entry.geometry
    leans = (0.0, *(s.non_orthogonality_arc_s for s in sizes[1:]))
    ripple = each("rate_ripple", lambda i: normal(sizes[i].rate_ripple_percent, "rate_ripple", i))

    def encoder(name: str) -> Array:
        return each(name, lambda i: normal(sizes[i].encoder_arc_s * _EACH_OF_FOUR, name, i, 2))

    def phase(name: str) -> Array:
        return each(name, lambda i: drawn * _stream(seed, name, i).uniform(-180.0, 180.0))

    return TableErrors(
        base_tilt=whole("base_tilt", geometry.base_tilt_arc_s, 2),
        base_azimuth=float(whole("base_azimuth", geometry.base_azimuth_arc_s, 1).item()),
        mounting=whole("mounting", geometry.mounting_arc_s, 3),
        placement=each("placement", lambda i: normal(sizes[i].placement_arc_s, "placement", i)),
        encoder_once=encoder("encoder_once"),
        encoder_twice=encoder("encoder_twice"),
        encoder_step=each("encoder_step", lambda i: drawn * sizes[i].encoder_step_arc_s),
        non_orthogonality=each(
            "non_orthogonality", lambda i: normal(leans[i], "non_orthogonality", i)
        ),
        wobble=each("wobble", lambda i: normal(sizes[i].wobble_arc_s, "wobble", i)),
        wobble_phase=phase("wobble_phase"),
        rate_ripple=ripple if ideal_motion else np.zeros(AXES),
        ripple_per_turn=each("ripple_per_turn", lambda i: sizes[i].ripple_per_turn).astype(int),
        ripple_phase=phase("ripple_phase"),
    )


def _stream(seed: int, source: str, axis: int) -> np.random.Generator:
    """The random stream of one error on one axis."""
    key = (_TABLE, _STREAMS[source], axis)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
