"""How a Kalman filter holds what biases do within a record.

Bias instability is a sum of first-order Gauss-Markov processes (`flicker`). Each is a state of its
own, but for those that need none: what the white noise hides anyway is taken for white noise, and
what outlasts the record for a walk of the bias that is a state already.
"""

from dataclasses import dataclass
from math import sqrt

from alignment.information.drift import LASTING, GaussMarkov, flicker
from alignment.options import Priors

FAINT = 0.1  # of white noise's density: a process of less, taken for white, is 5 % of a sigma


@dataclass(frozen=True, slots=True)
class Held:
    """What one triad's biases do, per axis.

    Attributes
    ----------
    bias : float
        Prior of what is constant, and of what walks [u].
    walk : float
        Of that bias [u/sqrt(s)].
    white : float
        Added to white noise [u/sqrt(Hz)].
    states : tuple of GaussMarkov
    """

    bias: float
    walk: float
    white: float
    states: tuple[GaussMarkov, ...]


def held(priors: Priors, sensor: str, noise: float, span: float) -> Held:
    """For `sensor` 'gyro' or 'accel' of white `noise` [u/sqrt(Hz)], in a record of `span` seconds.

    A ramp is a walk that comes as far by the end. Without a prior of the bias nothing walks.
    """
    bias, instability, walk, ramp = (
        float(getattr(priors, f"{sensor}_{name}"))
        for name in ("bias", "instability", "random_walk", "ramp")
    )
    processes = flicker(instability)
    white = [one for one in processes if _density(one) < FAINT * noise**2]
    slow = [one for one in processes if bias > 0 and one.time >= span and one not in white]
    states = tuple(one for one in processes if one not in white and one not in slow)
    apart = sum(one.sigma**2 for one in states if one.time > LASTING)
    return Held(
        bias=sqrt(max(bias**2 - apart, 0.0)),
        walk=sqrt(walk**2 + ramp**2 * span + sum(2 * one.sigma**2 / one.time for one in slow)),
        white=sqrt(sum(map(_density, white))),
        states=states,
    )


def _density(one: GaussMarkov) -> float:
    """Of white noise that does what the process does, seen for much longer than it remembers."""
    return 2 * one.sigma**2 * one.time
