"""An estimator as all others know it: what it is for, what it needs, how its sigma is predicted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from types import MappingProxyType
from typing import Literal, TypeVar

from alignment.calibration.design import Design
from alignment.calibration.session import Session
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.gains import Functional, Gains
from alignment.methods.fine import Innovations
from alignment.options import Options
from alignment.readings import Dwell, ImuReadings

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")
Takes = Literal["rest", "standing", "turning", "any", "fixes"]
TAKEN: Mapping[Takes, str] = MappingProxyType(
    {
        "rest": "at rest",
        "standing": "that stands, on a base that may rock",
        "turning": "at constant rate",
        "any": "to estimate from",
        "fixes": "with satellite fixes",
    }
)

Estimate = Callable[[Sequence[Dwell], Site, Options], list[AttitudeEstimate]]
EstimateOfRuns = Callable[
    [Sequence[Sequence[Dwell]], Sequence[Site], Options],
    list[list[AttitudeEstimate] | AlignmentError],
]


@dataclass(frozen=True, slots=True)
class Window:
    """A variant of a method's estimates: its name in words.

    `circular`: its errors are zero by construction, and say nothing of the method. `attitude`:
    whether it gives one.
    """

    words: str
    circular: bool = False
    attitude: bool = True


_PLAIN = Window("")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Method:
    """All that lists, rehearsal, comparison and reports need to know of an estimator.

    Attributes
    ----------
    title, source, note : str
        What it is; the paper it is from, by its letter in `alignment.sources`; what a reader of
        its numbers must know.
    estimate : callable
        From the stretches it is for, a site and options; refuses all of them where it refuses one.
    estimate_of_runs : callable or None
        As that, to the bit, of many runs of one procedure at once, where that is faster: of as
        many stretches each, at sites that differ in their gravity alone. Refusals take the place
        of answers; one that is of no run alone is raised.
    alone : bool
        It answers each stretch by itself, as if it were asked of that one only.
    takes : str
        Which stretches it is for: those at 'rest', those of a table that is 'standing' on a base
        that may rock, those 'turning' at a constant rate, 'any' of these, or those with satellite
        'fixes'.
    least_samples : int
        Of a stretch, of its whole turns where only those are used: of fewer it tells nothing.
    gains : callable or None
        Predicts, for rests and steady turns: an `Answer` per estimate, from the planned stretches.
    functional : callable or None
        Predicts, for any motion: how one stretch is answered, from what perfect sensors read.
    design : callable or None
        Predicts, for a method that finds the unit's constants and no attitude: what planned
        stations and moves will tell of them.
    no_prediction : str
        Why it does none of this, in words. Exactly one of the four is there.
    needs_latitude, needs_offset, needs_upright : bool
        ``site.latitude`` must be known; each dwell must hold the offset window and be at a nominal
        attitude; Y1 must be near the vertical.
    carries_nominal : bool
        It carries the attitude that the table was told and finds none: no floor is under that, and
        it counts for no requirement where another method does.
    gyros : int
        How many find the heading: 2 across the vertical, or the 1 nearest to east or west.
    turns_cancel_bias : bool
        Turning the unit between or within stretches takes constant biases out of its heading.
    anomaly : float
        How far gravity that nobody measured may be off its normal value to the method [m/s^2].
    fits_positions : bool
        It fits all positions there are, so that one more makes it surer.
    azimuth_matters : bool
        Its sigma depends on where on the horizon the axes point.
    tells_mean : bool
        Its attitude is the mean one of a stretch, where others tell that at its end.
    follows_moves : bool
        It takes the readings between its stretches too.
    knows_skew : bool
        Its sigmas hold for triads skewed by design (`Priors.gyro_axes`); others refuse such units.
    windows : mapping
        Its variants, by `AttitudeEstimate.window`; one that is not there is plain.
    published_deg : tuple or None
        Deviations (n - 1) of roll, yaw, pitch over the six positions that its paper prints [deg].
    tracks : callable or None
        Gives the attitude over time of one dwell, for curves.
    innovations : callable or None
        Gives what the updates of a filter found beyond expectation.

    Raises
    ------
    ValueError
        It predicts in two ways, or neither predicts nor says why not.
    """

    title: str
    source: str
    note: str
    estimate: Estimate
    alone: bool = False
    estimate_of_runs: EstimateOfRuns | None = None
    takes: Takes = "rest"
    least_samples: int = 2
    gains: Gains | None = None
    functional: Callable[[ImuReadings, Site, Options], Functional] | None = None
    design: Callable[[Session, Site, Options], Design] | None = None
    no_prediction: str = ""
    needs_latitude: bool = False
    needs_offset: bool = False
    needs_upright: bool = False
    carries_nominal: bool = False
    gyros: Literal[1, 2] = 2
    turns_cancel_bias: bool = False
    anomaly: float = 0.0
    fits_positions: bool = False
    azimuth_matters: bool = False
    tells_mean: bool = False
    follows_moves: bool = False
    knows_skew: bool = False
    windows: Mapping[str, Window] = field(default_factory=dict)
    published_deg: tuple[float, float, float] | None = None
    tracks: Callable[[Dwell, Site, Options], list[AttitudeTrack]] | None = None
    innovations: Callable[[Dwell, Site, Options], Innovations] | None = None

    def __post_init__(self) -> None:
        predicting = (self.gains, self.functional, self.design)
        ways = [way is not None for way in predicting] + [bool(self.no_prediction)]
        if sum(ways) != 1:
            raise ValueError(
                f"{self.title}: needs one of gains, functional, design, no_prediction; has "
                f"{sum(ways)}"
            )
        if not self.knows_skew:
            for name in ("estimate", "estimate_of_runs"):
                if getattr(self, name) is not None:
                    object.__setattr__(self, name, _of_square_triads(getattr(self, name)))
        object.__setattr__(self, "windows", MappingProxyType(dict(self.windows)))

    def suited(self, dwell: Dwell) -> bool:
        """Whether the method is for this stretch."""
        if self.takes == "fixes":
            return dwell.fixes is not None
        return self.for_motion(turning=dwell.turn is not None)

    def for_motion(self, *, turning: bool) -> bool:
        """Whether it is for a stretch of a table that does or does not turn steadily."""
        return self.takes in ("any", "turning") if turning else self.takes != "turning"

    @property
    def lacking(self) -> str:
        """What is said where no stretch is one that it is for."""
        return f"no stretch {TAKEN[self.takes]}"

    def window(self, name: str) -> Window:
        """A variant by the estimates' word for it."""
        return self.windows.get(name, Window(name) if name else _PLAIN)


def _of_square_triads(estimate: Callable[[A, B, Options], C]) -> Callable[[A, B, Options], C]:
    """The method, for units whose triads are not skewed by design."""

    @wraps(estimate)
    def checked(dwells: A, site: B, options: Options) -> C:
        priors = options.priors
        if priors.gyro_axes is not None or priors.accel_axes is not None:
            raise AlignmentError(
                "the unit's triads are skewed by design: what is alike on its sensors is neither "
                "alike nor independent on X1, Y1, Z1, and this method's sigmas do not know it"
            )
        return estimate(dwells, site, options)

    return checked
