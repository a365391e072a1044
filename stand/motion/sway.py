"""Random motions of the joints: sway by a spectrum, vibration in a band. Gaussian, zero mean.

Drawn in the frequency domain (every bin a normal cosine and sine), over twice the motion's length
so that nothing repeats, and faded like every wave.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, factorial, sqrt
from pathlib import Path

import numpy as np

from alignment.arrays import Array
from alignment.units import DEG
from stand.columns import Columns, read_columns
from stand.errors import StandError
from stand.motion.polynomial import Motion, b_spline
from stand.motion.waves import smooth_step
from stand.procedure.steps import SwayEntry, SwayMotion, VibrationEntry, VibrationMotion
from stand.table.joints import JOINTS

# Of the fastest frequency. With 4 steps per period B-splines of degree 11 repeat a wave at 3 and 5
# times its frequency, with 1/3^10 and 1/5^10 of its acceleration: both together 2e-5; of the angle
# 2e-6. Half as many steps of degree 7 would leave 1e-3, twice as many 1e-5: but what is felt on a
# smooth long piece takes a third fewer instants than on two short ones.
PER_PERIOD = 4
DEGREE = 11
REST = 6  # steps at each end of a fade in which B-splines weigh nothing, or are at full size
FADE_REST = 2  # of these, steps before the fade begins, and after its end
FADE_STEPS = 36  # at least: what `REST` cuts of a fade is 0.3 % of its height at most
# of the weights at a step and beside it on either side, over 11!: their sum there
SEEN = (15_724_248, 9_738_114, 2_203_488, 152_637, 2_036, 1)
MOST_STEPS = 1_000_000  # of a motion: 580 MB of polynomials of degree 11
MOST_DRAWN = 8_000_000  # steps of the series drawn: a slow wave beside a fast one needs many
SLOWEST_BINS = 8.0  # frequency bins up to the slowest wave
CUTOFF = 5.0  # of a resonance's frequency, where nothing else is said
MOST_ROWS = 100_000  # of a density file
SMALLEST_RMS_DEG, LARGEST_RMS_DEG = 1e-9, 180.0  # of a density file
HEADER = ("frequency_hz", "density_deg2_hz")

RngOf = Callable[[str], np.random.Generator]
Power = Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class Spectrum:
    """What one axis does.

    Attributes
    ----------
    slowest : float or None
        Hz that the bins must resolve; None for a density from a file, whose bins are exact.
    fastest : float
        Hz; there is nothing above.
    power : callable
        From edges of bins (k + 1,) [Hz], the first 0, to the variance of the angle in each (k,)
        [rad^2].
    """

    slowest: float | None
    fastest: float
    power: Power


def sway(entry: SwayMotion, steady: float, lead: float, rng_of: RngOf, folder: Path) -> Motion:
    """Random rocking of the given densities.

    Parameters
    ----------
    entry : SwayMotion
    steady, lead : float
        [s]; `lead` must be what `stand.motion.waves.fade_of` says, or any other above 0.
    rng_of : callable
        The random generator of an axis by its name.
    folder : Path
        Where density files are.

    Raises
    ------
    StandError
        A density file that is not right, or a motion that needs too many steps.
    """
    spectra = {name: _spectrum(name, axis, folder) for name, axis in entry.axes.items()}
    return _drawn(spectra, steady, lead, rng_of)


def vibration(entry: VibrationMotion, steady: float, lead: float, rng_of: RngOf) -> Motion:
    """Jitter with an even density of angular acceleration; arguments as of `sway`."""
    spectra = {
        name: Spectrum(axis.low_hz, axis.high_hz, _even_acceleration(axis))
        for name, axis in entry.axes.items()
    }
    return _drawn(spectra, steady, lead, rng_of)


def _spectrum(name: str, axis: SwayEntry, folder: Path) -> Spectrum:
    if axis.psd_file is not None:
        return _from_file(folder / axis.psd_file, axis.psd_file, axis.rms_deg)
    assert axis.frequency_hz is not None
    assert axis.rms_deg is not None
    cutoff = CUTOFF * axis.frequency_hz if axis.cutoff_hz is None else axis.cutoff_hz
    power = _resonance(axis.frequency_hz, axis.damping, cutoff, axis.rms_deg * DEG)
    return Spectrum(axis.frequency_hz, cutoff, power)


def _resonance(f0: float, damping: float, cutoff: float, rms: float) -> Power:
    """White noise through a resonator, cut at `cutoff`; scaled so that the cut costs nothing."""

    def power(edges: Array) -> Array:
        f = (edges[:-1] + edges[1:]) / 2
        shape = np.diff(edges) / ((f0**2 - f**2) ** 2 + (2 * damping * f0 * f) ** 2)
        shape[f > cutoff] = 0.0
        return shape * (rms**2 / shape.sum())

    return power


def _even_acceleration(axis: VibrationEntry) -> Power:
    def power(edges: Array) -> Array:
        inside = np.diff(np.clip(edges, axis.low_hz, axis.high_hz))
        f = (edges[:-1] + edges[1:]) / 2
        accelerated = (axis.rms_deg_s2 * DEG) ** 2 * inside / inside.sum()
        return accelerated / (2 * np.pi * f) ** 4

    return power


def _from_file(path: Path, file: str, rms_deg: float | None) -> Spectrum:
    """A density [deg^2/Hz] from rows of a CSV file: straight lines between them, 0 outside."""
    columns = read_columns(path, file, MOST_ROWS)
    _check_density(columns)
    f, density = columns.values.T
    total = np.concatenate([[0.0], np.cumsum(np.diff(f) * (density[1:] + density[:-1]) / 2)])
    own_deg = sqrt(total[-1])
    if own_deg < SMALLEST_RMS_DEG or (rms_deg is None and own_deg > LARGEST_RMS_DEG):
        allowed = f"{SMALLEST_RMS_DEG:g} to {LARGEST_RMS_DEG:g}"
        raise StandError(f"{file}: rms = {own_deg:g} deg: must be {allowed}")
    scale = (DEG * (1.0 if rms_deg is None else rms_deg / own_deg)) ** 2

    def power(edges: Array) -> Array:
        below = np.clip(edges, f[0], f[-1])
        row = np.clip(np.searchsorted(f, below, side="right") - 1, 0, len(f) - 2)
        further = below - f[row]
        slope = (density[row + 1] - density[row]) / (f[row + 1] - f[row])
        return scale * np.diff(total[row] + further * (density[row] + slope * further / 2))

    return Spectrum(None, float(f[-1]), power)


def _check_density(columns: Columns) -> None:
    if columns.values.shape[1] != 2 or columns.names not in (None, HEADER):
        raise StandError(f"{columns.file}: must have two columns: {', '.join(HEADER)}")
    f, density = columns.values.T
    if len(f) < 2:
        raise StandError(f"{columns.file}: has one row, must have two or more")
    close = np.append(False, np.diff(f) < 1e-6 * (1 - 1e-6))  # as written, to rounding
    rules = (
        (0, f, (f < 0) | (f > 1000), "must be from 0 to 1000"),
        (0, f, close, "must increase from row to row, by 1e-6"),
        (1, density, density < 0, "must not be negative"),
        (1, density, density > 1e9, "must be at most 1e9"),
    )
    for column, values, wrong, allowed in rules:
        if wrong.any():
            row = int(np.argmax(wrong))
            raise columns.fault(row, HEADER[column], f"{values[row]:g}", allowed)


@dataclass(frozen=True, slots=True)
class _Grid:
    """`count` steps [s] of the motion, out of a series of `drawn` steps."""

    step: float
    count: int
    drawn: int


def _drawn(spectra: Mapping[str, Spectrum], steady: float, lead: float, rng_of: RngOf) -> Motion:
    grid = _grid(spectra, steady, lead)
    number = np.arange(grid.count + 1)
    since = np.minimum(number, number[::-1]) - FADE_REST
    fade = smooth_step(since / (lead / grid.step - 2 * FADE_REST))
    size = np.clip((fade - fade[REST]) / (1 - 2 * fade[REST]), 0.0, 1.0)
    weights = np.zeros((grid.count + DEGREE, len(JOINTS)))
    beside = DEGREE // 2
    for name, spectrum in spectra.items():
        weights[beside:-beside, JOINTS.index(name)] = size * _series(spectrum, grid, rng_of(name))
    return b_spline(weights, grid.step, degree=DEGREE)


def _grid(spectra: Mapping[str, Spectrum], steady: float, lead: float) -> _Grid:
    """Steps for the fastest axis and the fade; bins fine enough for the slowest axis."""
    fastest = max(spectrum.fastest for spectrum in spectra.values())
    length = 2 * lead + steady
    count = ceil(length * max(PER_PERIOD * fastest, FADE_STEPS / lead))
    if count > MOST_STEPS:
        raise StandError(
            f"{length:g} s with frequencies up to {fastest:g} Hz, faded in {lead:g} s, are {count} "
            f"steps, allowed {MOST_STEPS}"
        )
    step = length / count
    slowest = [s.slowest for s in spectra.values() if s.slowest is not None]
    resolved = SLOWEST_BINS / (min(slowest) * step) if slowest else 0.0
    if resolved > MOST_DRAWN:
        raise StandError(
            f"frequencies from {min(slowest):g} to {fastest:g} Hz: too far apart for one motion, "
            f"allowed a ratio of {MOST_DRAWN / SLOWEST_BINS / PER_PERIOD:.0f}; make two of it"
        )
    return _Grid(step, count, _quick_length(max(2 * count, ceil(resolved))))


def _quick_length(least: int) -> int:
    """The next number of small factors, which Fourier transforms are quick with; even."""
    unit = 1 << max(least.bit_length() - 3, 1)
    return ceil(least / unit) * unit


def _series(spectrum: Spectrum, grid: _Grid, rng: np.random.Generator) -> Array:
    """Weights of B-splines (count + 1,) whose sum is a Gaussian series of the given power.

    Bin k is the frequency k / (drawn step); what is below the first one's upper edge goes to it.
    """
    bins = 1 + ceil(spectrum.fastest * grid.drawn * grid.step)
    edges = (np.arange(1, bins + 1) + 0.5) / (grid.drawn * grid.step)
    amplitude = np.sqrt(spectrum.power(np.concatenate([[0.0], edges])))
    turn = 2 * np.pi * np.arange(1, bins + 1) / grid.drawn
    sums = np.full(bins, float(SEEN[0]))
    for beside, part in enumerate(SEEN[1:], start=1):
        sums += 2 * part * np.cos(beside * turn)
    amplitude /= sums / factorial(DEGREE)
    cosine, sine = rng.standard_normal((2, bins))
    transform = np.zeros(grid.drawn // 2 + 1, dtype=complex)
    transform[1 : bins + 1] = amplitude * (cosine - 1j * sine) * (grid.drawn / 2)
    return np.fft.irfft(transform, grid.drawn)[: grid.count + 1]
