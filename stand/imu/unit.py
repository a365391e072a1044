"""The sensor model alone: what a unit of the catalogue reports of anybody's truth."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array
from stand.errors import StandError, whole
from stand.imu.model import Imu, without
from stand.imu.preset import ImuSpec, imu_from
from stand.imu.snapshot import put_back, taken
from stand.samples import Sampling, Sensed
from stand.toml_files import Source

VERSION = 1  # of a saved state
ON_GRID = 1e-3  # of a sample: a time this near to the rate's grid is on it
HIGHEST_RATE_HZ = 10_000
_BETWEEN = ("size-effect", "clock-offset", "jitter", "latency")


class Reported(NamedTuple):
    """What a unit reports of some samples.

    Attributes
    ----------
    t : (n,) s
        End of each sample's interval.
    w_ib_b, f_b : (n, 3)
        Angular rate [rad/s] and specific force [m/s^2] in b, with all errors.
    saturated : (n, 6) bool
        Which of the three gyros, then accelerometers, was beyond its range.
    """

    t: Array
    w_ib_b: Array
    f_b: Array
    saturated: NDArray[np.bool_]


class Unit:
    """One unit, switched on; `stand.unit` makes it.

    Block after block of truth goes in and readings come out; where the blocks are cut changes no
    bit of them. `gyro_errors` and `accel_errors` are the constants that this unit was given.
    """

    def __init__(
        self,
        spec: ImuSpec,
        rate_hz: int,
        seed: int = 0,
        switched_off: Sequence[str] = (),
        sampling: Sampling = Sampling.MEAN,
    ) -> None:
        if rate_hz != int(rate_hz) or not 1 <= rate_hz <= HIGHEST_RATE_HZ:
            raise StandError(
                f"rate = {rate_hz:g} Hz: must be a whole number, 1 to {HIGHEST_RATE_HZ}"
            )
        whole("seed", seed)
        self.sheet, self.rate_hz, self.seed = spec, int(rate_hz), seed
        self.without = tuple(switched_off)
        own = without(spec, self.without)
        if own.places.any() or not own.clock.perfect:
            raise StandError(
                f"{spec.id}: sensors at places of their own or a clock that is wrong feel what is "
                f"between the samples: add without = {list(_BETWEEN)}"
            )
        self.sampling = sampling
        self._imu = Imu(own, seed, self.rate_hz, sampling=sampling)
        self._tick: int | None = None  # of the last sample
        self.gyro_errors, self.accel_errors = self._imu.gyro_errors, self._imu.accel_errors

    def __repr__(self) -> str:
        so_far = "" if self._tick is None else f", reported to {self._tick / self.rate_hz:g} s"
        return f"{self.sheet.title}: {self.rate_hz} Hz, seed {self.seed}{so_far}"

    def report(self, t: ArrayLike, w_ib_b: ArrayLike, f_b: ArrayLike) -> Reported:
        """The next samples.

        Parameters
        ----------
        t : (n,) s
            Ends of the samples' intervals: on the grid k / rate, each once and in order. The first
            block may begin at any.
        w_ib_b, f_b : (n, 3)
            True angular rate against inertial space [rad/s] and specific force [m/s^2] in b (at
            rest the Earth's rate, and gravity upward): means over the interval that ends at `t`,
            or values at `t` for an instrument that samples instants. What a low-pass is fed between
            those is worked out of four: two samples after a sudden stop still hold some of it.

        Raises
        ------
        StandError
            Shapes that do not fit, values that are not finite, times beside the grid, left out or
            said twice.
        """
        times = _finite("t", t, 1)
        n = len(times)
        w, f = _finite("w_ib_b", w_ib_b, 2), _finite("f_b", f_b, 2)
        for name, values in (("w_ib_b", w), ("f_b", f)):
            if values.shape != (n, 3):
                raise StandError(f"{name}: shape {values.shape}, must be ({n}, 3) as t has {n}")
        if n == 0:
            return Reported(times, w, f, np.zeros((0, 6), bool))
        ticks = self._ticks(times)
        t_ns = (ticks * 1_000_000_000 + self.rate_hz // 2) // self.rate_hz
        block = self._imu.report(Sensed(t_ns, w, f))
        self._tick = int(ticks[-1])
        assert block.saturated is not None
        return Reported(times, block.w_ib_b, block.f_b, block.saturated)

    def _ticks(self, t: Array) -> NDArray[np.int64]:
        """Numbers of the samples."""
        rate = self.rate_hz
        ticks = np.round(t * rate).astype(np.int64)
        off = np.flatnonzero(np.abs(t * rate - ticks) > ON_GRID)
        if len(off):
            k = int(off[0])
            raise StandError(f"t: sample {k} at {t[k]:.9g} s, must be a whole number of 1/{rate} s")
        before = int(ticks[0]) - 1 if self._tick is None else self._tick
        wrong = np.flatnonzero(np.diff(ticks, prepend=before) != 1)
        if len(wrong):
            k = int(wrong[0])
            due = (int(ticks[k - 1]) if k else before) + 1
            raise StandError(
                f"t: sample {k} at {t[k]:.9g} s, must be at {due / rate:.9g} s: each sample of "
                f"{rate} Hz once, in order"
            )
        return ticks

    def state(self) -> dict[str, Any]:
        """All that decides its further readings, as plain data that JSON keeps exactly.

        Raises
        ------
        StandError
            Its data sheet was changed after it was read: the text would tell of another unit.
        """
        said = imu_from(_source(self.sheet.id, self.sheet.text))
        if repr((said.gyro, said.accel)) != repr((self.sheet.gyro, self.sheet.accel)):
            raise StandError(f"state: {self.sheet.id} is not as its text says: write it as a file")
        return {
            "version": VERSION,
            "imu": {"id": self.sheet.id, "toml": self.sheet.text},
            "rate_hz": self.rate_hz,
            "seed": self.seed,
            "without": list(self.without),
            "sampling": self.sampling.value,
            "tick": self._tick,
            "inside": taken(self._imu),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> "Unit":
        """The unit that goes on where another one stood.

        Raises
        ------
        StandError
            Not a state that `state` gave.
        """
        if state.get("version") != VERSION:
            raise StandError(f"state: version {state.get('version')!r}, must be {VERSION}")
        try:
            sheet = state["imu"]
            spec = imu_from(_source(sheet["id"], sheet["toml"]))
            sampling = Sampling(state["sampling"])
            unit = cls(spec, state["rate_hz"], state["seed"], state["without"], sampling)
            unit._tick = state["tick"]
            put_back(unit._imu, state["inside"])
        except (KeyError, TypeError, ValueError) as error:
            raise StandError(f"state: not that of a unit: {error!r}") from error
        return unit


def _source(name: str, text: str) -> Source:
    return Source(name, f"{name}.toml", text)


def _finite(name: str, values: ArrayLike, dimensions: int) -> Array:
    try:
        found = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise StandError(f"{name}: must be numbers: {error}") from error
    if found.ndim != dimensions:
        must = "(n,)" if dimensions == 1 else "(n, 3)"
        raise StandError(f"{name}: shape {found.shape}, must be {must}")
    if not np.isfinite(found).all():
        raise StandError(f"{name}: holds values that are not finite")
    return found
