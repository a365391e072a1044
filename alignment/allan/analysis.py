"""From readings at rest to noise terms, or to how long a record must be to show them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from alignment.allan.covariance import degrees_of_freedom
from alignment.allan.deviation import Deviation, deviation, octaves
from alignment.allan.fit import Fit, evidence, fit, interval, problem, solve, worse_with
from alignment.allan.stretches import Interruption, interruptions, longest
from alignment.allan.terms import KEYS, design, index, value, variance, weight
from alignment.arrays import Array, set_owned
from alignment.errors import NotAtRest, TooShort
from alignment.readings import ImuReadings
from alignment.units import DEG, STANDARD_GRAVITY

SENSORS = ("gyro", "accel")
AXES = ("x", "y", "z")

SEEN = 10.83  # chi-square of absence (p = 0.001) from which a term is reported
EXPECTED = 25.0  # chi-square expected of a record long enough: nearly all such records exceed SEEN
EXPECTED_OF_WALK = 50.0  # the few long taus that show K scatter more: four in five do
PART = 0.1  # of the whole variance that a term must be at some tau
LONGEST_ADVICE = 87_600 * 3600.0  # s: ten years; beyond that no record is long enough

REST_RATE = 0.1 * DEG  # rad/s between successive 1 s means
REST_FORCE = 0.5 * DEG * STANDARD_GRAVITY  # m/s^2 between them: half a degree of tilt
REST_SIGMAS = 8.0  # of those differences themselves: noise is no motion

Sheet = Mapping[tuple[str, str], float]  # (sensor, term) -> value in SI


@dataclass(frozen=True, slots=True)
class Found:
    """A term that the record shows, with its 95 % interval, in SI (see `terms`)."""

    term: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Missing:
    """A term that the record does not show.

    `upper` is the largest value that the record allows (95 %; SI); `needed` [s] how long a record
    must be to show `assumed` (the data sheet's value, or else `upper`), None if no length would do.
    """

    term: str
    upper: float
    assumed: float
    needed: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One sensor's Allan deviation and terms.

    Attributes
    ----------
    sensor, axis : str
        Of `SENSORS`, `AXES`.
    tau : (k,) s
    deviation, low, high : (k,)
        With 95 % bounds by equivalent degrees of freedom [rad/s, m/s^2].
    values : (5,)
        The fitted curve's terms in SI, in the order of `terms.KEYS`, shown or not.
    found, missing : tuple
        Every term is in one of them.
    first_tau : float
        From which on the terms describe the curve [s].
    onset : float
        Shortest correlation time of the bias instability [s], an octave or so; 0: none is seen.
    model_error : float
        Relative error of the deviation that the five terms leave, 0 if within their certainty.
    """

    sensor: str
    axis: str
    tau: Array
    deviation: Array
    low: Array
    high: Array
    values: Array
    found: tuple[Found, ...]
    missing: tuple[Missing, ...]
    first_tau: float
    onset: float
    model_error: float

    def __post_init__(self) -> None:
        k = len(self.tau)
        arrays = {name: getattr(self, name) for name in ("tau", "deviation", "low", "high")}
        set_owned(self, **{name: (a, (k,), float) for name, a in arrays.items()})
        set_owned(self, values=(self.values, (len(KEYS),), float))

    def fitted(self, tau: Array) -> Array:
        """The fitted deviation at tau [s]."""
        return np.sqrt(variance(self.values, tau, self.onset))


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """Six channels, and which part of the record they are from.

    `interval` is the mean step [s]; samples from `t_from` to `t_to` [s] (stamps) were used,
    the longest stretch between `interruptions` of the whole.
    """

    channels: tuple[Channel, ...]
    interval: float
    samples: int
    t_from: float
    t_to: float
    interruptions: tuple[Interruption, ...]

    @property
    def duration(self) -> float:
        """Of the analysed stretch [s]."""
        return self.samples * self.interval


def analyse(
    readings: ImuReadings, sheet: Sheet | None = None, terms: Iterable[str] = ()
) -> Analysis:
    """Noise terms of a unit at rest.

    Parameters
    ----------
    readings : ImuReadings
        At rest; stamps may jitter. Of a record with gaps or changes of rate, the longest stretch
        without them is taken.
    sheet : mapping (sensor, term) -> value in SI, optional
        What the data sheet states; only used to say how long a record must be to show it.
    terms : iterable of {'Q', 'N', 'B', 'K', 'R'}
        Terms that must be shown by at least one channel.

    Raises
    ------
    TooShort
        Fewer than 96 samples without interruption, or a term of `terms` that no channel shows:
        the message says how long the record must be.
    NotAtRest
        Successive 1 s means differ by more than 0.1 deg/s or 0.5 deg of tilt, and by more than 8
        of their own standard deviations.

    Notes
    -----
    Leading errors: everything slow that is not one of the five (temperature) is taken for K or R;
    everything fast (vibration, dither) for Q. A term is shown if the curve without it is worse by
    chi-square 10.8 (p = 0.001) and if it is at least a tenth of the variance at some tau.
    Source: IEEE Std 952-1997 annex C; uncertainty as NIST SP 1065, see `covariance` and `fit`.
    """
    asked = [KEYS[index(term)] for term in terms]
    events = interruptions(readings.t)
    part = longest(readings.t, events)
    t = readings.t[part]
    step = float(t[-1] - t[0]) / max(1, len(t) - 1)
    _check_rest(t, readings.w_ib_b[part], REST_RATE, "rate", 1 / DEG, "deg/s")
    _check_rest(t, readings.f_b[part], REST_FORCE, "specific force", 1.0, "m/s^2")
    channels = tuple(
        channel(sensor, axis, np.ascontiguousarray(values[part, k]), step, sheet)
        for sensor, values in zip(SENSORS, (readings.w_ib_b, readings.f_b), strict=True)
        for k, axis in enumerate(AXES)
    )
    for term in asked:
        _refuse_unless_shown(term, channels, len(t) * step)
    return Analysis(channels, step, len(t), float(t[0]), float(t[-1]), tuple(events))


def channel(
    sensor: str, axis: str, signal: Array, step: float, sheet: Sheet | None = None
) -> Channel:
    """The Allan deviation of one signal (n,) sampled every `step` [s], and its terms.

    Raises
    ------
    TooShort
        Fewer than 96 samples.
    """
    curve = deviation(signal, step)
    stated = {key: (sheet or {}).get((sensor, key), 0.0) for key in KEYS}
    if curve.silent:
        return _silent(sensor, axis, curve)
    fitted = fit(curve)
    low, high = _bounds(curve, fitted.weights)
    found, missing = [], []
    for k, key in enumerate(KEYS):
        ends = interval(fitted, k)
        if shown(fitted, k):
            values = (fitted.weights[k], *ends)
            found.append(Found(key, *(value(w, k, step) for w in values)))
        else:
            missing.append(_missing(curve, fitted, k, ends[1], stated[key]))
    return Channel(
        sensor,
        axis,
        curve.tau,
        np.sqrt(curve.variance),
        low,
        high,
        np.array([value(w, k, step) for k, w in enumerate(fitted.weights)]),
        tuple(found),
        tuple(missing),
        float(curve.tau[fitted.first]),
        fitted.onset * step if fitted.weights[index("B")] > 0 else 0.0,
        fitted.problem.excess / 2,  # of the deviation: half of that of its square
    )


def shown(fitted: Fit, term: int) -> bool:
    """Whether the record shows a term: it cannot be left out, and is a fair part at some tau."""
    return _part(fitted.weights, fitted.problem.design, term) >= PART and (
        evidence(fitted, term) >= SEEN
    )


def _part(weights: Array, columns: Array, term: int) -> float:
    """The largest part of the variance that a term is at any tau."""
    return float(np.max(columns[:, term] * weights[term] / (columns @ weights)))


def _bounds(curve: Deviation, weights: Array) -> tuple[Array, Array]:
    """95 % bounds of the deviation: chi-square of its equivalent degrees of freedom."""
    freedom = degrees_of_freedom(curve.n, tuple(int(m) for m in curve.m), weights)
    scale = curve.variance * freedom
    return np.sqrt(scale / chdtri(freedom, 0.025)), np.sqrt(scale / chdtri(freedom, 0.975))


def _silent(sensor: str, axis: str, curve: Deviation) -> Channel:
    """A constant signal shows nothing, however long it is."""
    none = np.zeros(len(curve.m))
    missing = tuple(Missing(key, 0.0, 0.0, None) for key in KEYS)
    zeros = np.zeros(len(KEYS))
    return Channel(
        sensor, axis, curve.tau, none, none, none, zeros, (), missing, float(curve.tau[0]), 0.0, 0.0
    )


def _missing(curve: Deviation, fitted: Fit, term: int, upper: float, stated: float) -> Missing:
    step = curve.interval
    largest = upper if np.isfinite(upper) else float(np.max(curve.variance))
    assumed = min(weight(stated, term, step), largest) if stated > 0 else largest
    others = solve(fitted.problem, term, assumed, near=fitted.weights)
    return Missing(
        KEYS[term],
        value(largest, term, step),
        value(assumed, term, step),
        needed(others, term, curve.n, step),
    )


def needed(weights: Array, term: int, n: int, step: float) -> float | None:
    """How long a record [s] must be to show a term of these weights, None if no length would do.

    The curve that is expected of the longer record goes through the very test that real ones do,
    with room for chance: chi-square 25 (K: 50) where 10.8 is asked. The value is then known to
    about 20 % (95 %). Lengths go in steps of 1.41, from n samples of `step` [s] to ten years.
    """
    most = int(2 * np.log2(max(1.0, LONGEST_ADVICE / (n * step))))
    lengths = [int(np.ceil(n * 2 ** (k / 2))) for k in range(most + 1)]
    enough = [0, *range(4, most, 4), most] if most > 0 else []
    low = 0
    for high in enough[1:]:
        if _expected(weights, term, lengths[high]):
            break
        low = high
    else:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _expected(weights, term, lengths[middle]) else (middle, high)
    return lengths[high] * step


def _expected(weights: Array, term: int, n: int) -> bool:
    m = octaves(n)
    m = np.unique([1, *m[::-2]])  # half of them tell nearly as much, in a third of the time
    columns = design(m)
    if _part(weights, columns, term) < PART:
        return False
    posed = problem(Deviation(n, 1.0, m, columns @ weights))
    enough = EXPECTED_OF_WALK if KEYS[term] == "K" else EXPECTED
    return worse_with(posed, weights, term, 0.0) >= enough


def _refuse_unless_shown(term: str, channels: tuple[Channel, ...], duration: float) -> None:
    if any(found.term == term for channel in channels for found in channel.found):
        return
    needs = {
        f"{c.sensor} {c.axis}": m.needed for c in channels for m in c.missing if m.term == term
    }
    lengths = {name: t for name, t in needs.items() if t is not None}
    if not lengths:
        raise TooShort(
            f"{term} is not identifiable: at no tau is it a tenth of the variance, in a record of "
            "any length at this rate"
        )
    first, last = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
    raise TooShort(
        f"{term} is not identifiable in {duration / 3600:.3g} h: needs "
        f"{lengths[first] / 3600:.3g} h ({first}) to {lengths[last] / 3600:.3g} h ({last})"
    )


def _check_rest(t: Array, values: Array, least: float, what: str, scale: float, unit: str) -> None:
    """Raise `NotAtRest` where successive 1 s means jump."""
    size = max(1, round(len(t) / max(float(t[-1] - t[0]), 1e-9))) if len(t) > 1 else 1
    blocks = len(t) // size
    if blocks < 3:
        return
    means = values[: blocks * size].reshape(blocks, size, -1).mean(axis=1)
    jumps = np.abs(np.diff(means, axis=0))
    sigma = 1.4826 * np.median(jumps, axis=0)
    beyond = jumps / np.maximum(least, REST_SIGMAS * sigma)
    worst = int(np.argmax(beyond.max(axis=1)))
    if beyond[worst].max() > 1:
        axis = int(np.argmax(beyond[worst]))
        raise NotAtRest(
            f"not at rest near {t[(worst + 1) * size]:.1f} s: {what} {AXES[axis]} jumps by "
            f"{jumps[worst, axis] * scale:.3g} {unit} between 1 s means"
        )
