"""What readings cannot tell apart, in words made from the directions themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import heading_from_C_nb
from alignment.arrays import Array, set_owned
from alignment.information.model import AXES, Parameter, Stretch

SOUGHT = ("table attitude", "gyro bias", "accelerometer bias")

_PIVOT = 1e-6  # part of a direction that can carry its name
_MINOR = 0.05  # part of the largest term below which one goes unsaid
_NOTHING = 1e-10  # part of the largest term: rounding
_ALONG = 1e-6  # sine of the angle within which a direction is that of an axis
_N_AXES = ("north", "east", "down")


@dataclass(frozen=True, slots=True, eq=False)
class Combination:
    """Errors that together leave every reading as it is.

    Attributes
    ----------
    vector : (p,)
        Of the parameters (SI); only its direction counts.
    name : str
        What it is told of: 'heading', 'roll', 'gyro bias X1', ...
    text : str
        For a person.
    """

    vector: Array
    name: str
    text: str

    def __post_init__(self) -> None:
        set_owned(self, vector=(self.vector, (len(self.vector),), float))


def attitude_axes(C_nb: Rotation) -> Array:
    """Columns: axes in n of a turn that changes heading, roll, pitch alone, of a level b.

    Of a b whose X1 is vertical: down, north, east.
    """
    heading = heading_from_C_nb(C_nb)
    h = 0.0 if heading is None else heading
    return np.array([[0, np.cos(h), -np.sin(h)], [0, np.sin(h), np.cos(h)], [1, 0, 0]])


def _attitude_names(C_nb: Rotation) -> tuple[str, str, str]:
    if heading_from_C_nb(C_nb) is None:
        return "azimuth", "tilt about north", "tilt about east"
    return "heading", "roll", "pitch"


def combinations(
    vectors: Array, found: Sequence[Parameter], stretches: Sequence[Stretch], C_np: Rotation
) -> tuple[Combination, ...]:
    """Directions (p, u) that readings do not see, each by one error it can be named by.

    Heading, roll and pitch name theirs first (those of the first stretch), then the other errors
    in their order: reduced to echelon form, so that each name occurs in one combination only.
    """
    poses = C_np * Rotation.concatenate([s.C_pb for s in stretches])
    axes = attitude_axes(poses[0])
    names = [*_attitude_names(poses[0]), *(p.label for p in found[3:])]
    sizes = np.array([p.size for p in found])
    turned = vectors.copy()
    turned[:3] = axes.T @ vectors[:3]
    echelon = _echelon(turned / sizes[:, None])
    one_place = not any(s.rate for s in stretches) and bool(
        np.all((poses[0].inv() * poses).magnitude() < _ALONG)
    )
    where = _situation(stretches, poses, one_place)
    result = []
    for scaled, pivot in echelon:
        vector = scaled * sizes
        told = _sentence(scaled, vector, pivot, names, found, poses[0] if one_place else None)
        vector[:3] = axes @ vector[:3]
        result.append(Combination(vector, names[pivot], f"{where}: {told}"))
    return tuple(result)


def _echelon(vectors: Array) -> list[tuple[Array, int]]:
    """Reduced echelon form of directions (p, u): each 1 at its pivot, where the others are 0."""
    left = [v / np.linalg.norm(v) for v in vectors.T]
    done: list[tuple[Array, int]] = []
    for i in range(len(vectors)):
        if not left:
            break
        best = max(range(len(left)), key=lambda k: abs(left[k][i]))
        if abs(left[best][i]) < _PIVOT * np.abs(left[best]).max():
            continue
        pivot = left.pop(best)
        pivot = pivot / pivot[i]
        left = [v - v[i] * pivot for v in left]
        done = [(v - v[i] * pivot, k) for v, k in done] + [(pivot, i)]
    return [(np.where(np.abs(v) > _NOTHING * np.abs(v).max(), v, 0.0), i) for v, i in done]


def _situation(stretches: Sequence[Stretch], poses: Rotation, one_place: bool) -> str:
    if one_place:
        return "at rest in one position"
    turning = [s.rate for s in stretches if s.rate]
    said = []
    rests = [poses[k] for k, s in enumerate(stretches) if not s.rate]
    apart: list[Rotation] = []
    for pose in rests:
        if all((pose.inv() * other).magnitude() > _ALONG for other in apart):
            apart.append(pose)
    if apart:
        said.append(f"at rest in {len(apart)} position{'s' if len(apart) > 1 else ''}")
    if turning:
        both = min(turning) < 0 < max(turning)
        said.append("turning both ways" if both else "turning one way")
    return " and ".join(said)


def _sentence(
    scaled: Array,
    vector: Array,
    pivot: int,
    names: Sequence[str],
    found: Sequence[Parameter],
    C_nb: Rotation | None,
) -> str:
    """One combination, scaled and in SI: its name, and what it cannot be told from, per unit."""
    others = np.where(np.arange(len(scaled)) == pivot, 0.0, np.abs(scaled))
    if others.max() < _PIVOT:
        return f"no reading depends on {names[pivot]}"
    heard = others >= _MINOR * others.max()
    one = found[pivot]
    amounts = vector * one.per / vector[pivot]
    sources = np.array([p.source for p in found])
    parts = []
    for source in dict.fromkeys(sources[heard].tolist()):
        mine = np.flatnonzero((sources == source) & (np.arange(len(scaled)) != pivot))
        first = found[int(mine[0])]
        along = _along(amounts[mine], C_nb) if source.endswith(" bias") else ""
        if along:
            said = [(f"{source} {along}", float(np.linalg.norm(amounts[mine])))]
        else:
            said = [(names[i], abs(float(amounts[i]))) for i in mine.tolist() if heard[i]]
        parts += [f"{name} ({x / first.per:.3g} {first.unit} per {one.unit})" for name, x in said]
    return f"{names[pivot]} cannot be told from {' and '.join(parts)}"


def _along(vector: Array, C_nb: Rotation | None) -> str:
    """The axis of b, else of n at the only attitude, that a vector in b lies along; '' if none."""
    if len(vector) < 3:
        return ""
    size = np.linalg.norm(vector)
    named: list[tuple[tuple[str, ...], Array]] = [(AXES, vector)]
    if C_nb is not None:
        named.append((_N_AXES, C_nb.apply(vector)))
    for names, components in named:
        i = int(np.argmax(np.abs(components)))
        if np.linalg.norm(np.delete(components, i)) <= _ALONG * size:
            return names[i] if names is AXES else f"along {names[i]}"
    return ""
