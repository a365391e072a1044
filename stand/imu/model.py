"""One unit, switched on: turns the truth into what the instrument reports.

Signal path of one triad, x true in b (rates, or forces at each accelerometer's own place)::

    y = M x                                   axes: misalignment, non-orthogonality
    y = y (1 + s + s_T dT + n (y/full scale)^2) + a |y|      scale factor and its faults
    y = y + G f + G2 f^2  (gyros),  y + K2 y^2  (accelerometers)
    y = y + bias + b_T dT + instability + walk + ramp t
    y = low-pass(y + white noise)             bandwidth, with its lag
    y = clip(y, range), flagged
    y = rounded                               per sample, or as accumulated increments

A triad that is skewed by design (`TriadSpec.axes`, rows A) feels ``A x`` for x, and reports the
components ``A^-1 y``: bias, noise, range and rounding are of its sensors, along their own axes.

A low-pass acts on what is continuous: on the truth between the samples, as far as it is known
(`Sensed`), each term worked out of it at the ends of the samples as of their means, and on the
white noise. Drifts are held over a sample, as without it. Terms that are not linear are taken of a
mean, not before it: of a turn by w dt in a sample they are wrong by (w dt)^2/12 of themselves.

Constants are drawn once per seed with the stated value as standard deviation (a ramp keeps its
size and draws its sign). Each term, sensor and axis has a random stream of its own, so that a
term that is switched off or changed leaves all others as they were.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, set_owned
from alignment.cross import cross_matrix
from alignment.skew import components, spread
from stand.errors import unknown
from stand.imu.filter import LowPass, noise_variance
from stand.imu.preset import ClockSpec, ImuSpec, TriadSpec
from stand.imu.processes import Drift, WhiteNoise
from stand.samples import ImuBlock, Sampling, Sensed, TruthBlock

# Terms that can be switched off: the fields of the spec each one sets to nothing.
TERMS = {
    "turn-on-bias": ("bias",),
    "bias-instability": ("instability",),
    "white-noise": ("noise",),
    "random-walk": ("random_walk",),
    "ramp": ("ramp",),
    "scale-factor": ("scale",),
    "asymmetry": ("asymmetry",),
    "non-linearity": ("nonlinearity",),
    "misalignment": ("misalignment",),
    "non-orthogonality": ("non_orthogonality",),
    "g-sensitivity": ("g_sensitivity",),
    "g2-sensitivity": ("g2_sensitivity",),
    "second-order": ("second_order",),
    "temperature": ("bias_temperature", "scale_temperature"),
    "bandwidth": ("bandwidth",),
    "range": ("range",),
    "quantisation": ("resolution", "increment_lsb"),
    "size-effect": (),
    "clock-offset": ("offset",),
    "jitter": ("jitter",),
    "latency": ("latency",),
}

# One random stream per source: a number is never given to another source.
_STREAMS = {
    "bias": 0,
    "scale": 1,
    "misalignment": 2,
    "noise": 3,
    "instability": 4,
    "random_walk": 5,
    "ramp": 6,
    "asymmetry": 7,
    "nonlinearity": 8,
    "non_orthogonality": 9,
    "g_sensitivity": 10,
    "g2_sensitivity": 11,
    "second_order": 12,
    "bias_temperature": 13,
    "scale_temperature": 14,
    "clock_offset": 15,
    "jitter": 16,
    "filtered_noise": 17,
    "known": 18,
}
_SENSORS = {"gyro": 0, "accel": 1, "clock": 2}
AXES = 3


def stream(seed: int, sensor: str, source: str, axis: int) -> np.random.Generator:
    """The random stream of one error source on one axis."""
    key = (_SENSORS[sensor], _STREAMS[source], axis)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def streams(seed: int, sensor: str, source: str) -> list[np.random.Generator]:
    """The three axes' streams."""
    return [stream(seed, sensor, source, axis) for axis in range(AXES)]


@dataclass(frozen=True, slots=True, eq=False)
class UnitErrors:
    """The constants one triad was given, in SI (units as in `TriadSpec`).

    `matrix` (3, 3) takes true to reported at small input: axes and linear scale factor. `bias`,
    `ramp`, `asymmetry`, `nonlinearity`, `second_order`, `bias_temperature`,
    `scale_temperature` (3,); `g_sensitivity`, `g2_sensitivity` (3, 3).
    """

    matrix: Array
    bias: Array
    ramp: Array
    asymmetry: Array
    nonlinearity: Array
    second_order: Array
    bias_temperature: Array
    scale_temperature: Array
    g_sensitivity: Array
    g2_sensitivity: Array

    def __post_init__(self) -> None:
        square = ("matrix", "g_sensitivity", "g2_sensitivity")
        shapes = {name: (3, 3) if name in square else (3,) for name in self.__slots__}
        set_owned(self, **{n: (getattr(self, n), shape, float) for n, shape in shapes.items()})


def draw(spec: TriadSpec, seed: int, sensor: str) -> UnitErrors:
    """One triad's constants: of a stated spread drawn normally, of a stated maximum within it."""

    def drawn(field: str, *size: int) -> Array:
        """Normal with the stated standard deviation; evenly within a stated maximum."""
        if not getattr(spec, field):  # each has streams of its own: nobody misses these numbers
            return np.zeros((AXES, *size))
        rngs = streams(seed, sensor, field)
        if field in spec.bounded:
            unit = np.stack([s.uniform(-sqrt(3), sqrt(3), size) for s in rngs])
        else:
            unit = np.stack([s.standard_normal(size) for s in rngs])
        return getattr(spec, field) * unit

    yz_zx_xy = drawn("non_orthogonality")
    # a case turned by some angles reads components x - angles x x
    axes = np.eye(3) - cross_matrix(drawn("misalignment"))
    if spec.axes is not None:
        axes = np.array(spec.axes) @ axes
    axes = axes + _symmetric(yz_zx_xy) / 2
    ramps = np.zeros(AXES)
    if spec.ramp:
        ramps = np.stack([s.standard_normal() for s in streams(seed, sensor, "ramp")])
    errors = UnitErrors(
        matrix=(1 + drawn("scale"))[:, None] * axes,
        bias=drawn("bias"),
        ramp=spec.ramp * np.sign(ramps),
        asymmetry=drawn("asymmetry"),
        nonlinearity=drawn("nonlinearity"),
        second_order=drawn("second_order"),
        bias_temperature=drawn("bias_temperature"),
        scale_temperature=drawn("scale_temperature"),
        g_sensitivity=drawn("g_sensitivity", 3),
        g2_sensitivity=drawn("g2_sensitivity", 3),
    )
    return _with_known(errors, spec, seed, sensor) if spec.known else errors


def _with_known(errors: UnitErrors, spec: TriadSpec, seed: int, sensor: str) -> UnitErrors:
    """Constants that are known by value in place of drawn ones."""
    scale = errors.matrix.diagonal() - 1
    axes = errors.matrix / (1 + scale)[:, None]
    found = {f: np.array(getattr(errors, f)) for f in UnitErrors.__slots__}
    found |= {"scale": np.array(scale), "misalignment": np.array(axes)}
    rngs = streams(seed, sensor, "known")
    for one in spec.known:
        value = one.value + one.sigma * float(rngs[one.axis].standard_normal())
        if one.term == "k3":
            value *= spec.full_scale**2
        found[one.field][one.axis if one.toward is None else (one.axis, one.toward)] = value
    matrix = (1 + found.pop("scale"))[:, None] * found.pop("misalignment")
    return UnitErrors(**found | {"matrix": matrix})


def _symmetric(pairs: Array) -> Array:
    """Axes of each pair (Y-Z, Z-X, X-Y) leaning together by an angle: half of it each."""
    yz, zx, xy = pairs
    return np.array([[0, xy, zx], [xy, 0, yz], [zx, yz, 0]])


@dataclass(frozen=True, slots=True, eq=False)
class Temperature:
    """Temperature of the unit over the run: straight lines between points.

    `t` (m,) [s], increasing; `value` (m,) [deg C]; constant outside.
    """

    t: Array
    value: Array

    def __post_init__(self) -> None:
        m = len(self.t)
        set_owned(self, t=(self.t, (m,), float), value=(self.value, (m,), float))
        if m == 0 or (np.diff(self.t) <= 0).any():
            raise ValueError("t: must hold a time at least, and increase")

    def at(self, t: Array) -> Array:
        """Temperature [deg C] at times (n,) [s]."""
        return np.interp(t, self.t, self.value)


def without(spec: ImuSpec, terms: Collection[str]) -> ImuSpec:
    """The same unit with some error terms (names of `TERMS`) switched off."""
    for term in terms:
        if term not in TERMS:
            raise unknown("error term", term, TERMS)
    off = {field for term in terms for field in TERMS[term]}

    def cleared(part: TriadSpec | ClockSpec) -> TriadSpec | ClockSpec:
        plain = type(part)()
        cleared = {f: getattr(plain, f) for f in off if hasattr(part, f)}
        if isinstance(part, TriadSpec):
            cleared["known"] = tuple(one for one in part.known if one.field not in off)
        return replace(part, **cleared)

    places = np.zeros((3, 3)) if "size-effect" in terms else spec.places
    return replace(
        spec,
        gyro=cleared(spec.gyro),
        accel=cleared(spec.accel),
        clock=cleared(spec.clock),
        places=places,
    )


class Triad:
    """Three like sensors at work; (3, n) arrays inside."""

    def __init__(
        self,
        imu: ImuSpec,
        sensor: str,
        seed: int,
        rate_hz: int,
        sampling: Sampling = Sampling.MEAN,
    ) -> None:
        spec = imu.gyro if sensor == "gyro" else imu.accel
        self.spec, self.errors = spec, draw(spec, seed, sensor)
        white = spec.noise * np.sqrt(rate_hz)
        self.sigma = white * np.sqrt(noise_variance(spec.bandwidth, rate_hz, sampling))
        self._dt = 1 / rate_hz
        self._noise = WhiteNoise(streams(seed, sensor, "noise"))
        self._drift = Drift(
            lambda source: streams(seed, sensor, source),
            spec.instability,
            spec.random_walk,
            imu.corners,
            rate_hz,
        )
        self._filter: LowPass | None = None
        if np.isfinite(spec.bandwidth):
            start = [s.standard_normal(2) for s in streams(seed, sensor, "filtered_noise")]
            self._filter = LowPass(spec.bandwidth, rate_hz, sampling, white, np.stack(start))
        self._lsb = spec.increment_lsb if imu.increments else spec.resolution * self._dt
        self._accumulate = imu.increments
        self._sum = np.zeros((AXES, 1))  # of increments so far, unrounded

    @property
    def variances(self) -> Array:
        """Of one sample in b (3,), by white noise and by rounding: a step's square over 12, of
        increments over 6, for both ends of each are rounded."""
        step = self._lsb / self._dt
        variance = self.sigma**2 + step**2 / (6 if self._accumulate else 12)
        across = np.ones(AXES) if self.spec.axes is None else spread(self.spec.axes).diagonal()
        return variance * across

    def report(
        self,
        x: Array,
        f: Array,
        t: Array,
        warmth: Array | None,
        others: tuple[Array, Array] | None = None,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Reported values and saturation flags (3, n).

        `x` true input, `f` specific force (3, n) for g-sensitivity, `t` (n,) [s], `warmth` (n,)
        [K] above reference or None; `others`: x and f at the ends of samples that are means, or as
        means up to samples that are instants, or None.
        """
        y, other = self._deterministic(x, f, t, warmth), None
        if self._filter is not None and others is not None:
            other = self._deterministic(*others, t, warmth)
        y = self._filtered(y, other)
        flags = np.zeros(y.shape, bool)
        limit = self.spec.range
        if max(y.max(), -y.min()) > limit:
            flags = np.abs(y) > limit
            np.clip(y, -limit, limit, out=y)
        y = self._rounded(y)
        return y if self.spec.axes is None else components(y.T, self.spec.axes).T, flags

    def _filtered(self, y: Array, other: Array | None) -> Array:
        """What comes out of the low-pass, with all noise, of (3, n) and `other` as of `report`."""
        normals = self._noise.take(y.shape[1]) if self.sigma else None
        if self._filter is None and normals is not None:
            normals *= self.sigma
            y += normals
        if self._drift:
            drift = self._drift.take(y.shape[1])
            y += drift
            if other is not None:
                other += drift
        return y if self._filter is None else self._filter.apply(y, other, normals)

    def _deterministic(self, x: Array, f: Array, t: Array, warmth: Array | None) -> Array:
        e, s = self.errors, self.spec
        linear = _product(e.matrix, x)
        y = linear
        if e.nonlinearity.any() or e.second_order.any() or warmth is not None:
            gain = (e.nonlinearity / s.full_scale**2)[:, None] * linear
            gain += e.second_order[:, None]
            gain *= linear
            if warmth is not None:
                gain += e.scale_temperature[:, None] * warmth
            gain += 1.0
            y = linear * gain
        if e.asymmetry.any():
            y = y + e.asymmetry[:, None] * np.abs(linear)
        if e.g_sensitivity.any():
            y += _product(e.g_sensitivity, f)
        if e.g2_sensitivity.any():
            y += _product(e.g2_sensitivity, f * f)
        if s.ramp:
            y += e.ramp[:, None] * t
        if warmth is not None:
            y += e.bias_temperature[:, None] * warmth
        y += e.bias[:, None]
        return y

    def _rounded(self, y: Array) -> Array:
        """Rounded to the resolution, or differences of the rounded running integral."""
        if self._lsb == 0.0:
            return y
        step = self._lsb / self._dt
        if not self._accumulate:
            return step * np.rint(y / step)
        total = np.cumsum(np.hstack([self._sum, y / step]), axis=1)
        self._sum = total[:, -1:]
        return step * np.diff(np.rint(total), axis=1)


def _product(matrix: Array, x: Array) -> Array:
    """``matrix @ x`` for (3, 3) and (3, n), row by row: BLAS may round by the length of x."""
    y = np.empty((AXES, x.shape[1]))
    for row, (a, b, c) in zip(y, matrix, strict=True):
        np.multiply(a, x[0], out=row)
        row += b * x[1]
        row += c * x[2]
    return y


def _rows(values: Array) -> Array:
    return np.ascontiguousarray(values.T)


class Imu:
    """One unit.

    Parameters
    ----------
    spec : ImuSpec
    seed : int
        Same seed, same bytes, whatever the blocks' lengths.
    rate_hz : int
        Sample rate, which sets the noise of a sample.
    temperature : Temperature or None
        None for the reference temperature throughout.
    sampling : Sampling
        What the samples are that it is given, and that it reports.
    """

    def __init__(
        self,
        spec: ImuSpec,
        seed: int,
        rate_hz: int,
        temperature: Temperature | None = None,
        sampling: Sampling = Sampling.MEAN,
    ) -> None:
        self.spec, self._temperature = spec, temperature
        self._gyro = Triad(spec, "gyro", seed, rate_hz, sampling)
        self._accel = Triad(spec, "accel", seed, rate_hz, sampling)
        self.clock = Clock(spec.clock, seed, rate_hz)

    @property
    def gyro_errors(self) -> UnitErrors:
        """The gyros' constants."""
        return self._gyro.errors

    @property
    def accel_errors(self) -> UnitErrors:
        """The accelerometers' constants."""
        return self._accel.errors

    @property
    def gyro_sigma(self) -> float:
        """Standard deviation of one sample's white rate noise, filtered [rad/s]."""
        return self._gyro.sigma

    @property
    def accel_sigma(self) -> float:
        """Standard deviation of one sample's white force noise, filtered [m/s^2]."""
        return self._accel.sigma

    @property
    def variances(self) -> tuple[Array, Array]:
        """Of one sample's rates (3,) [(rad/s)^2] and forces (3,) [(m/s^2)^2] in b: noise and
        rounding."""
        return self._gyro.variances, self._accel.variances

    def report(self, sensed: Sensed | TruthBlock) -> ImuBlock:
        """The next block of samples; each block must be asked for once, in order.

        `sensed` is what the sensors feel over the unit's own sample intervals, stamped with the
        times the unit gives them; of a `TruthBlock` nothing else is known.
        """
        t = sensed.t_ns * 1e-9
        warmth = None
        if self._temperature is not None:
            warmth = self._temperature.at(t) - self.spec.reference_temperature
        w, f = _rows(sensed.w_ib_b), _rows(sensed.f_b)
        of_gyros = of_accels = None
        others = sensed.others if isinstance(sensed, Sensed) and self.spec.filtered else None
        if others is not None:
            w_other, f_other = (_rows(values) for values in others)
            of_gyros, of_accels = (w_other, f_other), (f_other, f_other)
        y, too_fast = self._gyro.report(w, f, t, warmth, of_gyros)
        g, too_hard = self._accel.report(f, f, t, warmth, of_accels)
        flags = np.vstack([too_fast, too_hard])
        for made in (y, g, flags):
            made.flags.writeable = False  # given away, as columns
        return ImuBlock(sensed.t_ns, y.T, g.T, flags.T)


class Clock:
    """When the unit really samples: its clock runs fast, trembles, and tells it late.

    Sample k is stamped k / rate, but ends at ``k (1 + offset) / rate + jitter_k - latency``.
    """

    def __init__(self, spec: ClockSpec, seed: int, rate_hz: int) -> None:
        self.spec, self._rate = spec, rate_hz
        self.offset = spec.offset * float(
            stream(seed, "clock", "clock_offset", 0).standard_normal()
        )
        self._tremble = stream(seed, "clock", "jitter", 0)
        self._edge: float | None = None  # the last sample's end

    def edges(self, first: int, last: int) -> Array:
        """Ends of samples `first` to `last` (the n + 1 edges of n samples) [s], in order once."""
        ticks = np.arange(first if self._edge is None else first + 1, last + 1)
        edges = ticks * (1 + self.offset) / self._rate - self.spec.latency
        if self.spec.jitter:
            most = 0.4 / self._rate  # neighbours never change places
            jitter = self.spec.jitter * self._tremble.standard_normal(len(ticks))
            edges += np.clip(jitter, -most, most)
        if self._edge is not None:
            edges = np.concatenate([[self._edge], edges])
        self._edge = float(edges[-1])
        return edges
