"""What is known before a calibration: the unit's data sheet, the table, the seat, gravity."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, set_owned
from alignment.calibration.gravity import NORMAL_SIGMA
from alignment.calibration.result import Key
from alignment.errors import AlignmentError
from alignment.information.model import InstrumentErrors, TriadErrors, assumed
from alignment.options import SENSORS, Priors
from alignment.units import DEG, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY

MEASURED_GRAVITY = 2e-6  # m/s^2 (0.2 mGal): of a measured value that comes without a sigma
LAG = 1e-2  # s: of a delay that no sheet states
PLACE = 2e-3  # m: of an accelerometer's place from where the sheet, or the seat, has it

# terms that may be freed where a sheet states none, and a usual size of gyros and accelerometers
USUAL: Mapping[str, tuple[float, float]] = {
    "bias": (100 * DEG_PER_HOUR, 5000 * MICRO_G),
    "scale": (1000 * PPM, 1000 * PPM),
    "misalignment": (1e-3, 1e-3),
    "non_orthogonality": (2e-4, 2e-4),
    "asymmetry": (20 * PPM, 20 * PPM),
    "k2": (0.0, 10 * MICRO_G / STANDARD_GRAVITY**2),
    "k3": (20 * PPM / (400 * DEG) ** 2, 2 * MICRO_G / STANDARD_GRAVITY**3),
    "g_sensitivity": (0.1 * DEG_PER_HOUR / STANDARD_GRAVITY, 0.0),
    "g2_sensitivity": (0.1 * DEG_PER_HOUR / STANDARD_GRAVITY**2, 0.0),
}
SHEET = {"k2": "quadratic", "k3": "cubic"}  # where the sheet has another word


@dataclass(frozen=True, slots=True, eq=False)
class Leanings:
    """How a table's errors turn b at k poses: ``C_true = C_nominal exp(turns @ errors)``.

    `names`, `sigmas` [rad] (l,) of the errors; `turns` (k, 3, l); `axes` (k, 3, j): of b, as each
    joint turns.
    """

    names: tuple[str, ...]
    sigmas: Array
    turns: Array
    axes: Array

    def __post_init__(self) -> None:
        n = len(self.names)
        set_owned(
            self,
            sigmas=(self.sigmas, (n,), float),
            turns=(self.turns, (None, 3, n), float),
            axes=(self.axes, (len(self.turns), 3, None), float),
        )


IntArray = NDArray[np.int64]
Warmth = Callable[[Array], Array]
"""Temperature above the reference [K] at times (n,) [s]."""
LeaningsAt = Callable[[Array, IntArray], Leanings]
"""Of joint angles (k, j) [rad] and, of each pose, the axis that goes round (-1: none)."""


def _no_lags() -> Array:
    return np.zeros(2)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bench:
    """What is known of unit, table, seat and gravity: standard deviations in SI.

    Pairs are of gyros, then accelerometers.

    Attributes
    ----------
    unit : InstrumentErrors
        As the sheet states them; a zero says that there is no such error.
    lag, lag_sigma : (2,) s
        Expected delay of slow signals beyond half a sample, and how far it may be off.
    temperature_bias, temperature_scale : (2,) 1/K
    places, place_sigma : (3, 3) m, float
        Row i: where accelerometer i sits, in b, from the unit's point.
    steps : (2,)
        To which readings are rounded; 0: not at all, or their integral is.
    dither : (2,)
        Standard deviation of a sample's noise before it is rounded.
    known : tuple of (Key, float, float)
        Constants of this one unit by value, with their standard deviations, SI.
    arm : (3,) m
        From the crossing of the table's axes to the unit's point, in b.
    arm_sigma : float
        How far that may be off along each axis [m].
    table : callable or None
        How the table's errors turn b: `Leanings` of joint angles. None: each stretch has only the
        attitude that was told, with the sigmas below.
    joint_noise : (j,) rad
        Of an axis's true angle at each rest anew, about what its encoder says.
    placement, seat, tilt, azimuth : rad
        Where there is no `table`: of each attitude anew, of the unit on the table, of the whole.
    gravity_sigma : m/s^2
    warmth : callable or None
        The unit's temperature above its reference [K] at times (n,) [s]; None: it stays there.
    means : bool
        Whether a sample is a mean over its interval; else an instant at its end.
    """

    unit: InstrumentErrors = field(default_factory=InstrumentErrors)
    lag: Array = field(default_factory=_no_lags)
    lag_sigma: Array = field(default_factory=lambda: np.full(2, LAG))
    temperature_bias: Array = field(default_factory=_no_lags)
    temperature_scale: Array = field(default_factory=_no_lags)
    places: Array = field(default_factory=lambda: np.zeros((3, 3)))
    place_sigma: float = PLACE
    steps: Array = field(default_factory=_no_lags)
    dither: Array = field(default_factory=_no_lags)
    known: tuple[tuple[Key, float, float], ...] = ()
    arm: Array = field(default_factory=lambda: np.zeros(3))
    arm_sigma: float = 0.0
    table: LeaningsAt | None = None
    joint_noise: Array = field(default_factory=lambda: np.zeros(0))
    placement: float = 0.0
    seat: float = 0.0
    tilt: float = 0.0
    azimuth: float = 0.0
    gravity_sigma: float = 0.0
    warmth: Warmth | None = None
    means: bool = True

    def __post_init__(self) -> None:
        pairs = ("lag", "lag_sigma", "temperature_bias", "temperature_scale", "steps", "dither")
        shapes: dict[str, tuple[int | None, ...]] = dict.fromkeys(pairs, (2,))
        shapes |= {"places": (3, 3), "arm": (3,), "joint_noise": (None,)}
        set_owned(self, **{n: (getattr(self, n), shape, float) for n, shape in shapes.items()})

    def sheet(self, sensor: str, term: str) -> Array:
        """What is stated of a term (3,), SI; of what no sheet has zeros."""
        if term in ("temperature_bias", "temperature_scale", "lag"):
            name = "lag_sigma" if term == "lag" else term
            return np.full(3, getattr(self, name)[SENSORS.index(sensor)])
        return np.asarray(getattr(getattr(self.unit, sensor), SHEET.get(term, term)))


WIDE = 10.0  # times the usual size, of what nobody stated


def freed(bench: Bench, terms: Collection[str], times: float = 1.0) -> Bench:
    """The same with `times` a usual size of `terms` (keys of `USUAL`) where none is stated.

    Raises
    ------
    AlignmentError
        There is no such term.
    """
    for term in terms:
        if term not in USUAL:
            raise AlignmentError(f"term {term!r}: must be one of {', '.join(USUAL)}")

    def triad(one: TriadErrors, k: int) -> TriadErrors:
        names = {term: SHEET.get(term, term) for term in terms}
        free: dict[str, Any] = {
            name: np.where(getattr(one, name) > 0, getattr(one, name), times * USUAL[term][k])
            for term, name in names.items()
        }
        return replace(one, **free)

    unit = replace(bench.unit, gyro=triad(bench.unit.gyro, 0), accel=triad(bench.unit.accel, 1))
    return replace(bench, unit=unit)


def from_priors(priors: Priors) -> Bench:
    """What `Priors` tell; biases, scale factors and axes that they do not state are wide."""
    unit, _ = assumed(priors)

    def triad(one: TriadErrors, k: int) -> TriadErrors:
        wide: dict[str, Any] = {}
        for term in ("bias", "scale", "misalignment", "non_orthogonality"):
            own = getattr(one, term)
            there = (own > 0) & np.isfinite(own)
            wide[term] = np.where(there, own, WIDE * USUAL[term][k])
        return replace(one, **wide)

    lag = priors.lag + np.array([0.0, priors.accel_later])
    return Bench(
        unit=InstrumentErrors(triad(unit.gyro, 0), triad(unit.accel, 1)),
        lag=lag,
        lag_sigma=np.maximum(abs(lag), LAG),
        placement=priors.turn,
        seat=priors.seat,
        tilt=priors.nominal,
        azimuth=priors.azimuth,
        gravity_sigma=NORMAL_SIGMA,
        arm_sigma=priors.lever_arm,
        place_sigma=max(priors.places, PLACE),
    )


def trusting(bench: Bench) -> Bench:
    """The same of a table and a seat without errors: what such trust costs, or `--trust-table`."""

    def none(joints: Array, going_round: IntArray) -> Leanings:
        nothing = np.zeros((len(joints), 3, 0))
        return Leanings((), np.zeros(0), nothing, nothing)

    free = np.zeros(len(bench.joint_noise))
    return replace(
        bench,
        table=None if bench.table is None else none,
        joint_noise=free,
        placement=0.0,
        seat=0.0,
        tilt=0.0,
        azimuth=0.0,
    )
