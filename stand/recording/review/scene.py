"""The stand and the arrows at its instrument, drawn in 3D."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.units import DEG
from stand.recording.review.style import entity_part
from stand.table.joints import Body, Geom, StandModel

AXIS_LENGTH = 0.35
"""Of the axes at the instrument, in radii of the stand."""


class Scene(NamedTuple):
    """Where the bodies are drawn: the entity of each, and the sphere around all [m]."""

    entities: dict[str, str]
    imu: str
    center: Array
    radius: float


def scene_of(model: StandModel) -> Scene:
    """Entities of the bodies, and the sphere around their solids at zero angles."""
    entities: dict[str, str] = {}
    poses: dict[str, tuple[Array, Array]] = {}
    balls = []
    for i, body in enumerate(model.bodies):
        place, turn = poses.get(body.parent, (np.zeros(3), np.eye(3)))
        place, turn = place + turn @ body.position, turn @ _matrix(body.rotation)
        poses[body.name] = place, turn
        entities[body.name] = f"{entities[body.parent]}/{entity_part(body.name)}" if i else "world"
        balls += [place + turn @ geom.position for geom in body.geoms if geom.kind != "plane"]
    spread = np.array(balls) if balls else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    center = (spread.min(axis=0) + spread.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(spread - center, axis=1).max()) or 1.0
    return Scene(entities, f"{entities[model.imu_body]}/imu", center, radius)


def turned_axes(error_rotations: Array, factor: float) -> Array:
    """Unit axes (m, 3, 3), one per row, turned by `factor` times the error, at most 60 degrees."""
    turns = error_rotations * factor
    norms = np.linalg.norm(turns, axis=1, keepdims=True)
    turns *= np.minimum(1.0, 60.0 * DEG / np.maximum(norms, 1e-12))
    return Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)


def rate_arrow(w: Array, w_ie: float) -> Array:
    """Rates on a log scale: 0.25 long at Earth rate, as much longer per factor of 100."""
    size = np.linalg.norm(w, axis=1, keepdims=True)
    tiny = max(w_ie, 1e-12) / 100.0
    length = 0.125 * np.log10(np.maximum(size / tiny, 1.0))
    return w / np.maximum(size, 1e-15) * length


def hinge_columns(body: Body, angle: Array) -> Any:
    assert body.joint is not None
    turned = Rotation.from_quat(body.rotation) * Rotation.from_rotvec(
        angle[:, None] * body.joint.axis
    )
    place = np.tile(body.position, (len(angle), 1))
    return rr.Transform3D.columns(translation=place, quaternion=turned.as_quat())


def _matrix(rotation: Array) -> Array:
    return Rotation.from_quat(rotation).as_matrix()


def transform(position: Array, rotation: Array) -> rr.Transform3D:
    return rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=rotation))


def solids_of(geoms: Sequence[Geom]) -> Iterator[tuple[str, Any]]:
    """Each kind's solids as one batch; planes are left out: the view draws its own floor."""
    for kind, draw in _DRAWN.items():
        same = [geom for geom in geoms if geom.kind == kind]
        if same:
            yield kind, draw(*(np.array([getattr(geom, a) for geom in same]) for a in _DRAWN_BY))


_DRAWN_BY = ("size", "position", "rotation", "rgba")


def _boxes(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Boxes3D:
    return rr.Boxes3D(half_sizes=size, centers=position, **_looks(rotation, rgba))


def _cylinders(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Cylinders3D:
    return rr.Cylinders3D(
        radii=size[:, 0], lengths=2.0 * size[:, 1], centers=position, **_looks(rotation, rgba)
    )


def _capsules(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Capsules3D:
    # Rerun's capsule begins at its origin, ours is centred.
    start = position - size[:, 1:2] * _matrix(rotation)[:, :, 2]
    return rr.Capsules3D(
        radii=size[:, 0], lengths=2.0 * size[:, 1], translations=start, **_looks(rotation, rgba)
    )


def _spheres(size: Array, position: Array, rotation: Array, rgba: Array) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(radii=size[:, 0], centers=position, **_looks(rotation, rgba))


_DRAWN = {"box": _boxes, "cylinder": _cylinders, "capsule": _capsules, "sphere": _spheres}


def _looks(rotation: Array, rgba: Array) -> dict[str, Any]:
    return {
        "quaternions": rotation,
        "colors": np.rint(rgba * 255.0).astype(np.uint8),
        "fill_mode": "solid",
    }
