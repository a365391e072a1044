"""Covariances of a small rotation about n, told as angles with what each source adds."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence as Order
from alignment.angles import SequenceRule, angle_jacobian, angles_from_C_nb, near_singular
from alignment.arrays import Array
from alignment.earth import Site
from alignment.gains import Mirror
from alignment.information.circle import Rival
from alignment.information.result import DETERMINED
from alignment.units import DEG
from stand.rehearsal.result import Contribution, Prediction
from stand.rehearsal.verification import AGREES
from stand.table.known_errors import KNOWN

Parts = dict[str, Array]  # covariance (3, 3) about n [rad^2] by source

BEYOND = "heading beyond first order"
_HIDDEN = "accelerometer turn-on bias"
_NO_TURN = np.zeros(3)
_ANGLES = ("roll", "yaw", "pitch")
# how sources of `alignment.information` and of this package are told
_NAMES = {
    "bias": "turn-on bias",
    "noise": "white noise",
    "bias-instability": "bias instability",
    "random-walk": "random walk",
    "misalignment": "case misalignment",
}


def angles(
    method: str,
    window: str,
    label: str,
    C_nb: Rotation,
    parts: Parts,
    why: Callable[[], str],
    bias: Array = _NO_TURN,
) -> Iterator[Prediction]:
    """Heading (or the yaw of a vertical X1), pitch and roll; `bias` (3,) a known turn about n."""
    for quantity, j in rows_of_angles(C_nb).items():
        sizes = {name: float(np.sqrt(max(j @ P @ j, 0.0))) for name, P in parts.items()}
        off = float(j @ bias)
        yield prediction(method, window, label, quantity, ("deg", DEG), sizes, DETERMINED, why, off)


def rows_of_angles(C_nb: Rotation) -> dict[str, Array]:
    """What each angle (3,) is of a small rotation about n."""
    order = SequenceRule.REGULAR.sequence_at(C_nb)
    rows: dict[str, Array] = dict(
        zip(_ANGLES, angle_jacobian(order, *angles_from_C_nb(order, C_nb)), strict=True)
    )
    level = angles_from_C_nb(Order.YAW_PITCH_ROLL, C_nb)
    if not near_singular(Order.YAW_PITCH_ROLL, level):
        rows["heading"] = -angle_jacobian(Order.YAW_PITCH_ROLL, *level)[1]
        del rows["yaw"]
    return {name: rows[name] for name in ("heading", "yaw", "pitch", "roll") if name in rows}


def prediction(
    method: str,
    window: str,
    label: str,
    quantity: str,
    unit: tuple[str, float],
    sizes: dict[str, float],
    limit: float,
    why: Callable[[], str],
    bias: float = 0.0,
) -> Prediction:
    """A prediction by the sizes of its sources; none where their total is not below `limit`.

    A `bias` that is known has a row of its own, `KNOWN`.
    """
    sigma = float(np.linalg.norm(list(sizes.values())))
    total = float(np.hypot(sigma, bias))
    known: dict[str, Any] = {"method": method, "window": window, "label": label}
    known |= {"quantity": quantity, "unit": unit[0], "per": unit[1]}
    if not total < limit:
        what = "sigma" if sigma >= abs(bias) else "error that is known"
        reason = f"{what} of {total / unit[1]:.3g} {unit[0]} is beyond first order"
        reason = "; ".join(part for part in (f"not determined: {reason}", why()) if part)
        return Prediction(**known, sigma=None, contributions=(), reason=reason, beyond=total)
    named = sorted((sizes | {KNOWN: abs(bias)}).items(), key=lambda item: -item[1])
    contributions = tuple(Contribution(name, s) for name, s in named if s > 1e-6 * total)
    return Prediction(**known, sigma=sigma, contributions=contributions, bias=bias)


def withheld(
    found: Iterable[Prediction], quantities: Sequence[str], reason: str
) -> Iterator[Prediction]:
    """The predictions, without a number for these quantities if there is a reason."""
    for p in found:
        if reason and p.determined and p.quantity in quantities:
            why = f"not determined: {reason}"
            p = replace(p, sigma=None, bias=0.0, contributions=(), reason=why)
        yield p


def unmistaken(
    found: Iterable[Prediction], mirrors: Sequence[Mirror], C_nb: Rotation
) -> Iterator[Prediction]:
    """The predictions, without a number for what another attitude would change too often.

    That is where its root mean square is larger than sigma by more than is promised of
    predictions: such errors are mostly small and now and then wide, which no sigma says.
    """
    rows = rows_of_angles(C_nb)
    for p in found:
        for other in mirrors:
            if p.sigma is None:
                break
            row = rows.get(p.quantity)
            off = other.biases.get(p.quantity, 0.0) if row is None else float(row @ other.turn)
            if other.odds * off**2 > (AGREES[1] ** 2 - 1) * p.sigma**2:
                told = (
                    f"one that is {abs(off) / p.per:.2g} {p.unit} off fits the readings nearly as "
                    f"well (chi-square {other.chi2:.1f} more): a turn about a second axis would "
                    "tell"
                )
                (p,) = withheld([p], (p.quantity,), told)
        yield p


def unbent(found: Iterable[Prediction], size: float, gravity: float) -> Iterator[Prediction]:
    """The predictions, without a number for a tilt, or a bias in it, that the force's size tells.

    Where an accelerometer's bias hides in a tilt of t standard deviations s about a level axis,
    the force across the turns' axis is less by ``(s t)^2 g/2``, and its `size` [m/s^2] is known so
    well: of a sigma by first order ``1 - 3 k`` are left, ``k = (s^2 g/2 / size)^2``.
    """
    for p in found:
        per = gravity if p.quantity.startswith("accelerometer") else 1.0
        told = per > 1 or p.quantity in ("pitch", "roll")
        hidden = [c.sigma for c in p.contributions if told and c.source == _HIDDEN]
        tilt = max(hidden, default=0.0) / per
        less = tilt**2 * gravity / 2
        why = (
            f"a bias that hides in a tilt of {tilt / DEG:.2g} deg makes the force {less:.2g} m/s^2 "
            f"less, and its size is known to {size:.2g}: more than first order matters; see "
            "--verify"
        )
        beyond = 1 - 3 * (less / size) ** 2 < AGREES[0]
        yield from withheld([p], (p.quantity,), why if beyond else "")


def uncrossed(
    found: Iterable[Prediction], parts: Parts, mirrors: Sequence[Mirror], off: float
) -> Iterator[Prediction]:
    """The predictions, without a number for a bias that tilts through axes that are off change.

    A tilt t of an attitude with `parts` leaves ``g t`` along an axis, and axes by which it is
    `off` [m/s^2] per radian make a bias of it across: a product, which first order has not.
    """
    tilts = sum(parts.values(), np.zeros((3, 3)))[:2, :2]
    wide = sum(other.odds * float(other.turn[:2] @ other.turn[:2]) for other in mirrors)
    tilt = float(np.sqrt(np.linalg.eigvalsh(tilts)[-1] + wide))
    for p in found:
        sigma = p.sigma if p.quantity.startswith("accelerometer") else None
        if sigma is not None and (tilt * off) ** 2 > (AGREES[1] ** 2 - 1) * sigma**2:
            told = (
                f"a tilt that is unsure by {tilt / DEG:.2g} deg makes {tilt * off / p.per:.2g} "
                f"{p.unit} of it by axes that are off: more than first order matters; see --verify"
            )
            (p,) = withheld([p], (p.quantity,), told)
        yield p


def by_gyros(parts: Parts, C_nb: Rotation, site: Site) -> list[str]:
    """The angles that gyros tell, as they do heading, and not accelerometers: by what limits them.

    Where another heading fits as well, another such tilt does; and where the plumb line leans, any
    tilt along it.
    """
    gyros = sum((P for name, P in parts.items() if name.startswith("gyro")), np.zeros((3, 3)))
    total = sum(parts.values(), np.zeros((3, 3)))
    if any(site.deflection):
        _, anywhere = site.leaning(np.asarray(np.inf))
        gyros, total = gyros + anywhere, total + anywhere
    return [q for q, j in rows_of_angles(C_nb).items() if j @ gyros @ j > 0.5 * (j @ total @ j)]


def rounder(parts: Parts, other: Rival, site: Site) -> Parts:
    """The same with what the circle of headings adds to its first order, and what a heading that is
    not sure does to tilt where the plumb line of the `site` leans."""
    variance = float(sum(parts.values(), np.zeros((3, 3)))[2, 2])
    more = max(other.ratio**2 - 1, 0.0) * variance
    beyond = np.diag([0.0, 0.0, more])
    if any(site.deflection):
        less, leaning = site.leaning(np.asarray(variance + more))
        beyond += leaning
        parts = {name: less @ P @ less.T for name, P in parts.items()}
    if BEYOND in parts:
        beyond += parts[BEYOND]
    return parts | {BEYOND: beyond} if beyond.any() else parts


def name_of(source: str) -> str:
    """How a source is told."""
    sensor, _, rest = source.partition(" ")
    return f"{sensor} {_NAMES.get(rest, rest)}" if rest else source
