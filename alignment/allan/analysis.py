"""From readings at rest to noise terms, or to how long a record must be to show them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from alignment.allan.covariance import degrees_of_freedom
from alignment.allan.deviation import FEWEST, Deviation, deviation, octaves
from alignment.allan.fit import (
    MEMORY,
    Fit,
    evidence,
    fit,
    holding,
    interval,
    problem,
    solve,
    worse_with,
)
from alignment.allan.peculiar import AXES, peculiar, scatter
from alignment.allan.stretches import Interruption, between, interruptions
from alignment.allan.terms import KEYS, design, index, value, variance, weight
from alignment.arrays import Array, set_owned
from alignment.cores import over_cores
from alignment.errors import NotAtRest, TooShort
from alignment.noise import check_rest
from alignment.parts import MOST, mean
from alignment.readings import ImuReadings
from alignment.sampling import bursts, evened, repeats, seldom_change, sigma_below, step_of
from alignment.saturation import saturation_doubt

SENSORS = ("gyro", "accel")

SEEN = 10.83  # chi-square of absence (p = 0.001) from which a term is reported
EXPECTED = 25.0  # chi-square expected of a record long enough: nearly all such records exceed SEEN
EXPECTED_OF_WALK = 50.0  # the few long taus that show K scatter more: four in five do
PART = 0.1  # of the whole variance that a term must be at some tau
LONGEST_ADVICE = 87_600 * 3600.0  # s: ten years; beyond that no record is long enough

RESOLVED = 0.1  # of the variance of the noise that rounding may leave unknown
COARSEST = 0.5  # steps of the readings: noise of so much would have been seen
ALIKE_RATE = 0.01  # relative difference of the rates of stretches that are taken together
MOST_PIECES = 64  # of a rest that gaps cut: what more would tell is not worth its time

_Q, _N = index("Q"), index("N")

Sheet = Mapping[tuple[str, str], float]  # (sensor, term) -> value in SI


@dataclass(frozen=True, slots=True)
class FoundTerm:
    """A term that the record shows, with its 95 % interval, in SI (see `terms`)."""

    term: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class MissingTerm:
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
    smoothing : float
        What a low-pass takes, c of ``N^2/tau (1 - 3c/(2 tau))`` [s]; 0 where none is seen.
    step : float
        What the readings are rounded to, 0 if to nothing that is seen [rad/s, m/s^2].
    rounding : float
        White noise of that rounding, as N; it is in the deviation and not in the term N.
    resolved : bool
        False where the noise is lost below the step: then no term can be told.
    """

    sensor: str
    axis: str
    tau: Array
    deviation: Array
    low: Array
    high: Array
    values: Array
    found: tuple[FoundTerm, ...]
    missing: tuple[MissingTerm, ...]
    first_tau: float
    onset: float
    model_error: float
    smoothing: float = 0.0
    step: float = 0.0
    rounding: float = 0.0
    resolved: bool = True

    def __post_init__(self) -> None:
        k = len(self.tau)
        arrays = {name: getattr(self, name) for name in ("tau", "deviation", "low", "high")}
        set_owned(self, **{name: (a, (k,), float) for name, a in arrays.items()})
        set_owned(self, values=(self.values, (len(KEYS),), float))

    @property
    def constant(self) -> bool:
        """Whether every reading is the same: dead, or all of its noise below a step."""
        return not self.deviation.any()

    def fitted(self, tau: Array) -> Array:
        """The fitted deviation at tau [s]."""
        white = self.values[_N] ** 2 + self.rounding**2
        both = variance(self.values, tau, self.onset) + self.rounding**2 / tau
        return np.sqrt(np.maximum(both - 1.5 * white * self.smoothing / tau**2, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class RestRecord:
    """A part of a record at rest, without interruption: its stamps [s] and what it read on average.

    `interval` [s] is that of its samples; `w_ib_b` (3,) [rad/s], `f_b` (3,) [m/s^2] their means.
    """

    t_from: float
    t_to: float
    samples: int
    interval: float
    w_ib_b: Array
    f_b: Array

    def __post_init__(self) -> None:
        set_owned(self, w_ib_b=(self.w_ib_b, (3,), float), f_b=(self.f_b, (3,), float))


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """Six channels, and which parts of the record they are from.

    `stretches` were used together: those between `interruptions` of each rest. `notes` say what the
    stamps and the readings are like, in words.
    """

    channels: tuple[Channel, ...]
    stretches: tuple[RestRecord, ...]
    interruptions: tuple[Interruption, ...]
    notes: tuple[str, ...] = ()

    @property
    def interval(self) -> float:
        """Mean step between samples [s]."""
        return sum(s.interval * s.samples for s in self.stretches) / self.samples

    @property
    def samples(self) -> int:
        """Of all stretches."""
        return sum(s.samples for s in self.stretches)

    @property
    def t_from(self) -> float:
        """The first stamp used [s]."""
        return self.stretches[0].t_from

    @property
    def t_to(self) -> float:
        """The last stamp used [s]."""
        return self.stretches[-1].t_to

    @property
    def duration(self) -> float:
        """Of the analysed stretches together [s]."""
        return self.samples * self.interval


def analyse(
    readings: ImuReadings | Sequence[ImuReadings],
    sheet: Sheet | None = None,
    terms: Iterable[str] = (),
    bandwidths: Mapping[str, float] | None = None,
) -> Analysis:
    """Noise terms of a unit at rest.

    Parameters
    ----------
    readings : ImuReadings, or several
        At rest, each by itself; stamps may jitter or come in bursts. All stretches without gaps or
        changes of rate are taken together: what is slower than one of them, or differs between
        them, is not seen.
    sheet : mapping (sensor, term) -> value in SI, optional
        What the data sheet states; only used to say how long a record must be to show it.
    terms : iterable of {'Q', 'N', 'B', 'K', 'R'}
        Terms that must be shown by at least one channel.
    bandwidths : mapping sensor -> Hz, optional
        Where they are known the fit starts beyond them; else where it sees one.

    Raises
    ------
    TooShort
        Fewer than 96 samples without interruption, or a term of `terms` that no channel shows:
        the message says how long the record must be.
    NotAtRest
        As `alignment.noise.check_rest` says.
    Saturated
        As `alignment.saturation.saturation_doubt` says.

    Notes
    -----
    Leading errors: everything slow that is not one of the five (temperature) is taken for K or R;
    everything fast (vibration, dither) for Q. A term is shown if the curve without it is worse by
    chi-square 10.8 (p = 0.001) and if it is at least a tenth of the variance at some tau. Noise
    that the readings are too coarse for is not told at all; where they are only coarse, the white
    noise of the rounding, step^2/12 a sample, is taken out of N.
    Source: IEEE Std 952-1997 annex C; uncertainty as NIST SP 1065, see `covariance` and `fit`.
    """
    asked = [KEYS[index(term)] for term in terms]
    rests = [readings] if isinstance(readings, ImuReadings) else list(readings)
    parts, events, notes = _stretches(rests)
    for number, (_, part) in enumerate(parts, 1):
        label = "record" if len(parts) == 1 else f"stretch {number}"
        notes += saturation_doubt(label, part)
    intervals = [step for step, _ in parts]

    def of_sensor(sensor: str) -> tuple[list[Array], list[str], list[Seen]]:
        triads = [p.w_ib_b if sensor == "gyro" else p.f_b for _, p in parts]
        means = [mean(triad) for triad in triads]
        step, triads, told = _new_ones(sensor, triads, intervals)
        told += peculiar(sensor, [part for _, part in parts], intervals[0])
        columns = [[triad[:, k] for triad in triads] for k in range(len(AXES))]
        return means, told, [(signals, deviation(signals, step)) for signals in columns]

    channels: list[Channel] = []
    found = over_cores(of_sensor, SENSORS)
    for sensor, (_, told, seen) in zip(SENSORS, found, strict=True):
        notes += told
        known = (bandwidths or {}).get(sensor, np.inf)
        # fits are of few numbers: threads that ask for the interpreter all the time would wait
        for axis, (signals, curve) in zip(AXES, seen, strict=True):
            channels.append(_channel(sensor, axis, signals, curve, sheet, known))
    means = zip(*(means for means, _, _ in found), strict=True)
    stretches = tuple(_stretch(*part, *own) for part, own in zip(parts, means, strict=True))
    result = Analysis(tuple(channels), stretches, tuple(events), tuple(notes))
    for term in asked:
        _refuse_unless_shown(term, result.channels, result.duration)
    return result


Part = tuple[float, ImuReadings]  # a stretch with the interval of its samples [s]
Seen = tuple[list[Array], Deviation]  # a channel's stretches with its curve


def _stretches(rests: Sequence[ImuReadings]) -> tuple[list[Part], list[Interruption], list[str]]:
    """The stretches of each rest, of those of one rate; where all are cut; what to say."""
    parts: list[Part] = []
    events: list[Interruption] = []
    notes: list[str] = []
    for number, rest in enumerate(rests, 1):
        burst = bursts(rest.t)
        if burst is not None:
            notes.append(
                f"{burst.count} bursts of {burst.size:.3g} samples from {rest.t[0]:.6g} s on: the "
                "stamps are those of arrival, even ones by the mean rate are used"
            )
        t = rest.t if burst is None else evened(rest.t)
        found = interruptions(t)
        label = "record" if len(rests) == 1 else f"rest {number}"
        own, told = _at_rest(_pieces(rest, t, found), label)
        parts += own
        notes += told
        events += found
    best = max(parts, key=lambda p: len(p[1]))
    usual = best[0]
    alike = [p for p in parts if abs(p[0] - usual) <= ALIKE_RATE * usual and len(p[1]) >= FEWEST]
    return alike or [best], events, notes


def _pieces(rest: ImuReadings, t: Array, events: list[Interruption]) -> list[Part]:
    """The stretches between `events` that are long enough, the longest one first."""
    found = sorted(between(t, events), key=lambda piece: piece.start - piece.stop)
    most = found[0].stop - found[0].start
    if events and most < FEWEST:
        gaps = sum(event.kind == "gap" for event in events)
        step = float(t[found[0].stop - 1] - t[found[0].start]) / max(1, most - 1)
        raise TooShort(
            f"{gaps} gaps, one in {len(t) / max(1, gaps):.3g} samples: the longest stretch "
            f"without one has {most} samples ({most * step:.3g} s), an Allan variance needs at "
            f"least {FEWEST}"
        )
    enough = [p for p in found[:MOST_PIECES] if p.stop - p.start >= FEWEST] or found[:1]
    return [_piece(rest, t, piece) for piece in enough]


def _piece(rest: ImuReadings, t: Array, piece: slice) -> Part:
    n = piece.stop - piece.start
    step = float(t[piece.stop - 1] - t[piece.start]) / max(1, n - 1)
    return step, replace(rest, t=t[piece], w_ib_b=rest.w_ib_b[piece], f_b=rest.f_b[piece])


def _at_rest(pieces: list[Part], label: str) -> tuple[list[Part], list[str]]:
    """Those at rest, in order of time; raises if the longest, the first, is not."""
    check_rest(pieces[0][1], label)
    still, moved = pieces[:1], []
    for piece in pieces[1:]:
        try:
            check_rest(piece[1], label)
        except NotAtRest:
            moved.append(f"{piece[1].t[0]:.6g} to {piece[1].t[-1]:.6g} s")
        else:
            still.append(piece)
    still.sort(key=lambda piece: piece[1].t[0])
    return still, [f"left out, not at rest: {', '.join(sorted(moved))}"] if moved else []


def _stretch(step: float, part: ImuReadings, w_ib_b: Array, f_b: Array) -> RestRecord:
    times = float(part.t[0]), float(part.t[-1])
    return RestRecord(*times, len(part), step, w_ib_b=w_ib_b, f_b=f_b)


def _new_ones(
    sensor: str, triads: list[Array], intervals: list[float]
) -> tuple[float, list[Array], list[str]]:
    """Mean interval of the new values of a triad (n, 3) per stretch, and these alone."""
    fresh = [repeats(triad) for triad in triads]
    lengths = [len(triad) for triad in triads]
    span = float(np.dot(lengths, intervals))
    if any(starts is None for starts in fresh):
        return span / sum(lengths), triads, []
    kept = [triad[starts] for triad, starts in zip(triads, fresh, strict=True)]
    times = sum(lengths) / sum(map(len, kept))
    step = times * span / sum(lengths)
    return (
        step,
        kept,
        [
            f"{sensor}: every value stands {times:.3g} times: the new ones alone are used, "
            f"{1 / step:.4g} Hz"
        ],
    )


def channel(
    sensor: str,
    axis: str,
    signal: Array | Sequence[Array],
    step: float,
    sheet: Sheet | None = None,
    bandwidth: float = np.inf,
) -> Channel:
    """The Allan deviation of one signal (n,) sampled every `step` [s], and its terms.

    `signal` may be several stretches; `bandwidth` [Hz] is the sensor's, where it is known.

    Raises
    ------
    TooShort
        Fewer than 96 samples.
    """
    signals = [signal] if isinstance(signal, np.ndarray) else list(signal)
    return _channel(sensor, axis, signals, deviation(signals, step), sheet, bandwidth)


def _channel(
    sensor: str,
    axis: str,
    signals: list[Array],
    curve: Deviation,
    sheet: Sheet | None,
    bandwidth: float,
) -> Channel:
    """The same of a curve that is known."""
    step = curve.interval
    if curve.silent:
        return _silent(sensor, axis, curve)
    stated = {key: (sheet or {}).get((sensor, key), 0.0) for key in KEYS}
    fitted, rounding = _fitted(curve, signals, bandwidth)
    weights = np.maximum(fitted.weights, 0.0)
    low, high = _bounds(curve, fitted.weights)
    if not rounding.resolved:
        return _unresolved(sensor, axis, curve, low, high, rounding)
    weights[_N] = max(0.0, weights[_N] - rounding.least)
    found, missing = [], []
    there = np.array([weights[k] > 0 and shown(fitted, k) for k in range(len(KEYS))])
    for k, key in enumerate(KEYS):
        ends = rounding.taken(interval(fitted, k)) if k == _N else interval(fitted, k)
        if there[k]:
            found.append(FoundTerm(key, *(value(w, k, step) for w in (weights[k], *ends))))
        else:
            missing.append(_missing(curve, fitted, k, ends[1], stated[key], there))
    smoothing = 2 * max(0.0, -fitted.weights[_Q]) / max(fitted.weights[_N], 1e-300) * step
    return Channel(
        sensor,
        axis,
        curve.tau,
        np.sqrt(curve.variance),
        low=low,
        high=high,
        values=np.array([value(w, k, step) for k, w in enumerate(weights)]),
        found=tuple(found),
        missing=tuple(missing),
        first_tau=float(curve.tau[fitted.first]),
        onset=fitted.onset * step if fitted.weights[index("B")] > 0 else 0.0,
        model_error=fitted.problem.excess / 2,  # of the deviation: half of that of its square
        smoothing=smoothing,
        step=rounding.step,
        rounding=value(rounding.least, _N, step),
    )


@dataclass(frozen=True, slots=True)
class Rounding:
    """What rounding to `step` adds to the weight of N: from `least` - `doubt` to `most` + `doubt`.

    Nothing where its errors do not add up, as of increments: `memory` is how many samples they
    correlate over. `resolved` as in `Channel`.
    """

    step: float
    least: float = 0.0
    most: float = 0.0
    doubt: float = 0.0
    resolved: bool = True
    memory: float = 1.0

    def taken(self, ends: tuple[float, float]) -> tuple[float, float]:
        """An interval of N without it."""
        low, high = ends
        return max(0.0, low - self.most - self.doubt), max(0.0, high - self.least + self.doubt)


def fitted_signal(signals: Sequence[Array], step: float, bandwidth: float) -> tuple[Fit, Rounding]:
    """The fit behind `channel`, and what rounding adds to its weight of N."""
    return _fitted(deviation(signals, step), signals, bandwidth)


def _fitted(curve: Deviation, signals: Sequence[Array], bandwidth: float) -> tuple[Fit, Rounding]:
    fitted = fit(curve, bandwidth)
    rounding = _rounding(signals, fitted)
    if rounding.memory > 1:
        fitted = fit(curve, min(bandwidth, MEMORY / (rounding.memory * curve.interval)))
    return fitted, rounding


def _rounding(signals: Sequence[Array], fitted: Fit) -> Rounding:
    """How coarse the readings are for their noise."""
    values = _all_or_longest(signals)
    step = step_of(values)
    if step == 0.0:
        seldom = seldom_change(values)
        return Rounding(seldom, resolved=not seldom)
    added = step**2 / 12
    low, high = interval(fitted, _Q)
    if low <= 2 * added and high >= added / 2 and shown(fitted, _Q):
        # Increments, whose rounding is a Q of just that size: it correlates over m samples as
        # exp(-2 pi^2 m sigma^2/step^2), 0.003 being too little to matter.
        memory = 0.3 * step**2 / max(float(fitted.weights[_N]), 0.001 * step**2)
        return Rounding(step, memory=memory)
    spread = float(np.mean(np.concatenate([scatter(signal[:, None]) for signal in signals])))
    left, doubt = sigma_below(step, spread)
    if doubt > RESOLVED * left:
        return Rounding(step, resolved=False)
    return Rounding(step, 0.0 if low <= added <= high else added, added, doubt)


def _all_or_longest(signals: Sequence[Array]) -> Array:
    """All values (n,) of several stretches, or the longest of them if they are too many."""
    if len(signals) == 1 or sum(map(len, signals)) > MOST:
        return max(signals, key=len)
    return np.concatenate(signals)


def _unresolved(
    sensor: str, axis: str, curve: Deviation, low: Array, high: Array, rounding: Rounding
) -> Channel:
    """No term can be told; each is below what would lift the readings over their step."""
    size, span = rounding.step, max(curve.lengths) * curve.interval
    most = {
        "Q": size * curve.interval,
        "N": COARSEST * size * np.sqrt(curve.interval),
        "B": size,
        "K": size * np.sqrt(3 / span),
        "R": size * np.sqrt(2) / span,
    }
    missing = tuple(MissingTerm(key, most[key], most[key], None) for key in KEYS)
    zeros, first = np.zeros(len(KEYS)), float(curve.tau[0])
    deviations = np.sqrt(curve.variance)
    return Channel(
        sensor, axis, curve.tau, deviations, low=low, high=high, values=zeros, found=(),
        missing=missing, first_tau=first, onset=0.0, model_error=0.0, step=size, resolved=False,
    )  # fmt: skip


def shown(fitted: Fit, term: int) -> bool:
    """Whether the record shows a term: it cannot be left out, and is a fair part at some tau."""
    columns = fitted.problem.allowing(0.0).design
    weights = np.maximum(fitted.weights, 0.0)
    return _part(weights, columns, term) >= PART and evidence(fitted, term) >= SEEN


def _part(weights: Array, columns: Array, term: int) -> float:
    """The largest part of the variance that a term is at any tau."""
    return float(np.max(columns[:, term] * weights[term] / (columns @ weights)))


def _bounds(curve: Deviation, weights: Array) -> tuple[Array, Array]:
    """95 % bounds of the deviation: chi-square of its equivalent degrees of freedom."""
    freedom = degrees_of_freedom(curve.lengths, tuple(int(m) for m in curve.m), weights)
    scale = curve.variance * freedom
    return np.sqrt(scale / chdtri(freedom, 0.025)), np.sqrt(scale / chdtri(freedom, 0.975))


def _silent(sensor: str, axis: str, curve: Deviation) -> Channel:
    """A constant signal shows nothing, however long it is."""
    none = np.zeros(len(curve.m))
    missing = tuple(MissingTerm(key, 0.0, 0.0, None) for key in KEYS)
    zeros = np.zeros(len(KEYS))
    return Channel(
        sensor,
        axis,
        curve.tau,
        none,
        low=none,
        high=none,
        values=zeros,
        found=(),
        missing=missing,
        first_tau=float(curve.tau[0]),
        onset=0.0,
        model_error=0.0,
    )


def _missing(
    curve: Deviation, fitted: Fit, term: int, upper: float, stated: float, there: NDArray[np.bool_]
) -> MissingTerm:
    """What is said of a term that is not shown, beside white noise and those that are `there`."""
    step = curve.interval
    largest = upper if np.isfinite(upper) else float(np.max(curve.variance))
    if term == _Q and -fitted.weights[_Q] > largest:  # a low-pass may hide as much as it takes
        hidden = value(-float(fitted.weights[_Q]), term, step)
        return MissingTerm(KEYS[term], hidden, hidden, None)
    assumed = min(weight(stated, term, step), largest) if stated > 0 else largest
    asked, own = holding(fitted.problem, fitted.solution, term)
    others = asked.physical(solve(asked, term, assumed, near=np.maximum(own, 0.0)))
    # what chance alone makes of a walk would hide the term at any length
    others[~there & ~np.isin(np.arange(len(KEYS)), (term, _N))] = 0.0
    return MissingTerm(
        KEYS[term],
        value(largest, term, step),
        value(assumed, term, step),
        needed(np.maximum(others, 0.0), term, sum(curve.lengths), step),
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
    posed = problem(Deviation((n,), 1.0, m, columns @ weights))
    own = weights.copy()
    own[_Q] += posed.lowpass * own[_N]
    enough = EXPECTED_OF_WALK if KEYS[term] == "K" else EXPECTED
    return worse_with(posed, own, term, 0.0) >= enough


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
