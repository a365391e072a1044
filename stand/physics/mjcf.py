"""The stand's MJCF: loaded from the package's own files, checked, and read as plain data."""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import copy
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.resources import files

import mujoco
import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError
from stand.table.joints import JOINTS, Body, Geom, Joint, StandModel

FILES = ("parts/imu.xml", "turntable.xml")
SITE = "imu"

_KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}


def load_model() -> mujoco.MjModel:
    """The stand, compiled and checked; the caller's own copy, free to change."""
    return copy.copy(_compiled())


def describe(model: mujoco.MjModel) -> StandModel:
    """Read bodies, hinges, solids, masses and the instrument's site from a compiled model.

    Raises
    ------
    StandError
        Not a chain of single hinges named as in ``description.JOINTS``, no site `imu`, or a
        solid of another kind than box, cylinder, capsule, sphere and plane.
    """
    _check_joints(model)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, SITE)
    if site < 0:
        raise StandError(f"MJCF: no site {SITE!r}: the instrument's point and axes")
    return StandModel(
        bodies=tuple(_body(model, i) for i in range(model.nbody)),
        imu_body=model.body(model.site_bodyid[site]).name,
        imu_position=model.site_pos[site],
        imu_rotation=_xyzw(model.site_quat[site]),
        sha256=files_sha256(),
    )


def files_sha256() -> str:
    """Hash of the MJCF files' bytes, in order of their names."""
    digest = hashlib.sha256()
    for _, content in _contents():
        digest.update(content)
    return digest.hexdigest()


def _contents() -> Iterator[tuple[str, bytes]]:
    folder = files("stand") / "models"
    for name in sorted(FILES):
        yield name, folder.joinpath(*name.split("/")).read_bytes()


@cache
def _compiled() -> mujoco.MjModel:
    # From memory: works from a zipped wheel, in any working folder, and reads what is hashed.
    with mujoco.MjVfs() as vfs:
        for name, content in _contents():
            vfs[name] = content
        model = mujoco.MjModel.from_xml_path("turntable.xml", vfs=vfs)
    _check_joints(model)
    return model


def _check_joints(model: mujoco.MjModel) -> None:
    for body in range(model.nbody):
        if model.body_jntnum[body] > 1:
            raise StandError(f"MJCF: body {model.body(body).name!r} has several joints, may have 1")
    names = tuple(model.joint(i).name for i in range(model.njnt))
    if names != JOINTS:
        raise StandError(f"MJCF: joints {', '.join(names)}; must be {', '.join(JOINTS)}")
    for i, name in enumerate(names):
        if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_HINGE:
            raise StandError(f"MJCF: joint {name!r} must be a hinge")
        if np.any(model.jnt_pos[i]) or model.qpos0[i] != 0.0:
            raise StandError(f"MJCF: joint {name!r} must lie at its body's origin, with ref 0")


def _body(model: mujoco.MjModel, i: int) -> Body:
    first = model.body_geomadr[i]
    return Body(
        name=model.body(i).name,
        parent=model.body(model.body_parentid[i]).name,
        position=model.body_pos[i],
        rotation=_xyzw(model.body_quat[i]),
        joint=_joint(model, model.body_jntadr[i]) if model.body_jntnum[i] else None,
        geoms=tuple(_geom(model, first + k) for k in range(model.body_geomnum[i])),
        mass=float(model.body_mass[i]),
        center=model.body_ipos[i],
        inertia=model.body_inertia[i],
        inertia_rotation=_xyzw(model.body_iquat[i]),
    )


def _joint(model: mujoco.MjModel, i: int) -> Joint:
    return Joint(name=model.joint(i).name, axis=model.jnt_axis[i])


def _geom(model: mujoco.MjModel, i: int) -> Geom:
    kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[i]))
    if kind is None:
        raise StandError(
            f"MJCF: geom {model.geom(i).name!r} must be one of {', '.join(_KINDS.values())}"
        )
    return Geom(
        name=model.geom(i).name,
        kind=kind,
        size=model.geom_size[i],
        position=model.geom_pos[i],
        rotation=_xyzw(model.geom_quat[i]),
        rgba=model.geom_rgba[i],
    )


def _xyzw(wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.roll(wxyz, -1, axis=-1)
