"""The stand's MJCF: the shipped one or a user's own, checked, and read as plain data."""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import copy
import hashlib
import os
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from stand.errors import StandError
from stand.physics.copies import spec_of
from stand.table.joints import JOINTS, Body, Geom, Joint, StandModel

MAIN = "turntable.xml"
SITE = "imu"
NO_SITE = f"MJCF: no site {SITE!r}: the instrument's point and axes"
HASH = "files_sha256"  # the text of a loaded model that holds the hash of its files

# What is read at the site, in the order in which the truth takes it.
SENSORS = (
    mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    mujoco.mjtSensor.mjSENS_GYRO,
    mujoco.mjtSensor.mjSENS_VELOCIMETER,
    mujoco.mjtSensor.mjSENS_MAGNETOMETER,
    mujoco.mjtSensor.mjSENS_FRAMEQUAT,
)

_EAST, _NORTH, _UP = np.eye(3)
_AXES = dict(zip(JOINTS, (_NORTH, _EAST, _UP, _UP, _EAST, _NORTH), strict=True))
_ZERO = np.column_stack([_NORTH, _UP, _EAST])  # X1, Y1, Z1 of the instrument at zero angles
_STRAIGHT = 1e-6  # rad: six digits of a file; what leans on purpose are a table's errors
_KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
_WIDTHS = (3, 3, 4, 4, 6)  # of a solid's size, place, turn, colour and box


def models_folder() -> Path:
    """Where the shipped MJCF lies: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def load_model(path: Path | None = None) -> mujoco.MjModel:
    """The stand, compiled and checked; the caller's own copy, free to change.

    Parameters
    ----------
    path : Path or None
        An MJCF of the user's own (a table's `model`); None for the shipped one.

    Raises
    ------
    StandError
        One line with the file and what is missing: no MJCF that compiles; not the six hinges of
        `JOINTS`, each carried by the one before, at its body's origin and about its axis; no site
        `imu` on the last body; not one ``dcmotor`` of an angle on each hinge; a sensor not there.
    """
    path = models_folder() / MAIN if path is None else path
    return copy.copy(_compiled(path, files_sha256(path)))


def describe(model: mujoco.MjModel) -> StandModel:
    """Read bodies, hinges, solids, masses and the instrument's site from a compiled model.

    A mesh is described by the box around it.

    Raises
    ------
    StandError
        Not a chain of single hinges named as in ``description.JOINTS``, no site `imu`, or a
        solid of another kind than box, cylinder, capsule, sphere, plane and mesh.
    """
    _check_joints(model)
    site, solids = _site(model), _solids(*_drawn(model))
    return StandModel(
        bodies=tuple(_body(model, i, solids) for i in range(model.nbody)),
        imu_body=model.body(model.site_bodyid[site]).name,
        imu_position=model.site_pos[site],
        imu_rotation=_xyzw(model.site_quat[site]),
        sha256=_hash(model),
    )


def motor_of(model: mujoco.MjModel, joint: str) -> int:
    """The actuator that turns a joint.

    Raises
    ------
    StandError
        None, several, or one that a table's servo cannot be set on.
    """
    own = np.flatnonzero(
        (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
        & (model.actuator_trnid[:, 0] == model.joint(joint).id)
    )
    if len(own) != 1:
        raise StandError(
            f"MJCF: joint {joint!r} has {len(own) or 'no'} actuators, must have one: "
            f'<dcmotor joint="{joint}" motorconst="1 1" resistance="1" input="pos"/>'
        )
    motor = int(own[0])
    name = model.actuator(motor).name
    takes_angle = model.actuator_ctrlspec[motor] & int(mujoco.mjtCtrlInput.mjINPUT_POS)
    if model.actuator_gaintype[motor] != mujoco.mjtGain.mjGAIN_DCMOTOR or not takes_angle:
        raise StandError(f"MJCF: actuator {name!r} must be a dcmotor with 'pos' in its input")
    if not np.array_equal(model.actuator_gear[motor], [1, 0, 0, 0, 0, 0]):
        raise StandError(f"MJCF: actuator {name!r} must turn its joint directly, with gear 1")
    return motor


# --- files ---------------------------------------------------------------------------------------


def files_sha256(path: Path) -> str:
    """Hash of the bytes of an MJCF and of all files that it names, in order of their names.

    Raises
    ------
    StandError
        One cannot be read, or is not XML.
    """
    digest = hashlib.sha256()
    for name in sorted(files_of(path), key=lambda p: Path(os.path.relpath(p, path.parent))):
        digest.update(_bytes(name))
    return digest.hexdigest()


def files_of(path: Path) -> list[Path]:
    """An MJCF with the files that it includes, attaches, or takes meshes and textures from."""
    found, waiting = [path], [path]
    while waiting:
        root = _parsed(waiting.pop())
        folders = [path.parent, *(path.parent / d for d in _asset_folders(root))]
        for element in root.iter():
            for name in (v for k, v in element.attrib.items() if k.startswith("file")):
                # one that is not there is for MuJoCo to miss
                file = next((f / name for f in folders if (f / name).is_file()), None)
                if file is not None and file not in found:
                    found.append(file)
                    waiting += [file] if file.suffix == ".xml" else []
    return found


def contents_of(path: Path) -> dict[str, bytes]:
    """The files of an MJCF, itself first, by their names in the folder that holds them all."""
    files = [Path(os.path.abspath(file)) for file in files_of(path)]
    common = os.path.commonpath([file.parent for file in files])
    return {file.relative_to(common).as_posix(): _bytes(file) for file in files}


def _asset_folders(root: ElementTree.Element) -> list[str]:
    names = ("assetdir", "meshdir", "texturedir")
    return [c.attrib[name] for c in root.iter("compiler") for name in names if name in c.attrib]


def _parsed(path: Path) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(_bytes(path))
    except ElementTree.ParseError as error:
        raise StandError(f"{path}: not XML: {error}") from error


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise StandError(f"{path}: cannot read this model: {error.strerror}") from error


@lru_cache(maxsize=8)
def _compiled(path: Path, sha256: str) -> mujoco.MjModel:
    """The model of files of this hash, which travels with it as a text."""
    try:
        spec = _spec(path)
        spec.add_text(name=HASH, data=sha256)
        model = _compile(spec)
        _check(model)
    except (ValueError, StandError) as error:
        said = " ".join(str(error).removeprefix("MJCF: ").split())
        raise StandError(f"{path}: {said}") from error
    return model


def _spec(path: Path) -> mujoco.MjSpec:
    """As MuJoCo reads it; the shipped one in a fifth of the time."""
    if path == models_folder() / MAIN:
        return spec_of(MAIN, contents_of(path))
    return mujoco.MjSpec.from_file(str(path))


def _compile(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """MuJoCo misses what is named by another element first: a hinge by its motor, the site by a
    sensor; said here as what a stand must have."""
    try:
        return spec.compile()
    except ValueError:
        _check_names([joint.name for joint in spec.joints])
        if SITE not in [site.name for site in spec.sites]:
            raise StandError(NO_SITE) from None
        raise


def _hash(model: mujoco.MjModel) -> str:
    """Of the files of a loaded model; '' of one that came from none."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, HASH)
    if number < 0:
        return ""
    first = model.text_adr[number]
    return bytes(model.text_data[first : first + model.text_size[number] - 1]).decode()


# --- what a stand must have ----------------------------------------------------------------------


def _check(model: mujoco.MjModel) -> None:
    _check_joints(model)
    _check_chain(model)
    _check_directions(model)
    for name in JOINTS:
        motor_of(model, name)
    _check_sensors(model)


def _check_joints(model: mujoco.MjModel) -> None:
    for body in range(model.nbody):
        if model.body_jntnum[body] > 1:
            raise StandError(f"MJCF: body {model.body(body).name!r} has several joints, may have 1")
    names = [model.joint(i).name for i in range(model.njnt)]
    _check_names(names)
    for i, name in enumerate(names):
        if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_HINGE:
            raise StandError(f"MJCF: joint {name!r} must be a hinge")
        if np.any(model.jnt_pos[i]) or model.qpos0[i] != 0.0:
            raise StandError(f"MJCF: joint {name!r} must lie at its body's origin, with ref 0")


def _check_names(names: list[str]) -> None:
    if tuple(names) != JOINTS:
        missing = [repr(name) for name in JOINTS if name not in names]
        what = f"no joint {', '.join(missing)}" if missing else f"joints {', '.join(names)}"
        raise StandError(f"MJCF: {what}; must be {', '.join(JOINTS)}")


def _site(model: mujoco.MjModel) -> int:
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, SITE)
    if site < 0:
        raise StandError(NO_SITE)
    return site


def _check_chain(model: mujoco.MjModel) -> None:
    for i, name in enumerate(JOINTS[1:], start=1):
        if model.dof_parentid[i] != i - 1:
            raise StandError(f"MJCF: joint {name!r} must be carried by {JOINTS[i - 1]!r}")
    if model.body_weldid[model.site_bodyid[_site(model)]] != model.jnt_bodyid[-1]:
        raise StandError(f"MJCF: site {SITE!r} must be fixed to the body of {JOINTS[-1]!r}")


def _check_directions(model: mujoco.MjModel) -> None:
    """Attitudes are planned, and servos told of the weight, for hinges in these directions."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for i, (name, axis) in enumerate(_AXES.items()):
        if np.abs(data.xaxis[i] - axis).max() > _STRAIGHT:
            raise StandError(
                f"MJCF: joint {name!r} turns about {_numbers(data.xaxis[i])} at zero angles, must "
                f"about {_numbers(axis)} (east, north, up)"
            )
    axes = data.site_xmat[_site(model)].reshape(3, 3)
    if np.abs(axes - _ZERO).max() > _STRAIGHT:
        raise StandError(
            f"MJCF: site {SITE!r} must have x north, y up, z east at zero angles "
            '(quat=".5 .5 .5 .5" in axes east, north, up)'
        )


def _numbers(vector: Array) -> str:
    return " ".join(f"{x:.6g}" for x in vector + 0.0)


def _check_sensors(model: mujoco.MjModel) -> None:
    at_site = (model.sensor_objtype == mujoco.mjtObj.mjOBJ_SITE) & (
        model.sensor_objid == _site(model)
    )
    for kind in SENSORS:
        if not np.any(at_site & (model.sensor_type == kind)):
            name = kind.name.removeprefix("mjSENS_").lower()
            where = f'objtype="site" objname="{SITE}"' if name == "framequat" else f'site="{SITE}"'
            raise StandError(f"MJCF: no sensor <{name} {where}/>")


# --- as plain data -------------------------------------------------------------------------------


def _body(model: mujoco.MjModel, i: int, solids: tuple[Geom, ...]) -> Body:
    first, count = model.body_geomadr[i], model.body_geomnum[i]
    return Body(
        name=model.body(i).name,
        parent=model.body(model.body_parentid[i]).name,
        position=model.body_pos[i],
        rotation=_xyzw(model.body_quat[i]),
        joint=_joint(model, model.body_jntadr[i]) if model.body_jntnum[i] else None,
        geoms=solids[first : first + count] if count else (),
        mass=float(model.body_mass[i]),
        center=model.body_ipos[i],
        inertia=model.body_inertia[i],
        inertia_rotation=_xyzw(model.body_iquat[i]),
    )


def _joint(model: mujoco.MjModel, i: int) -> Joint:
    return Joint(name=model.joint(i).name, axis=model.jnt_axis[i])


def _drawn(model: mujoco.MjModel) -> tuple[tuple[str, ...], bytes, bytes]:
    """All that describes the solids: names, kinds, and sizes, places, turns, colours, boxes."""
    names = tuple(model.geom(i).name for i in range(model.ngeom))
    told = (model.geom_size, model.geom_pos, model.geom_quat, model.geom_rgba, model.geom_aabb)
    numbers = np.hstack([np.asarray(part, dtype=float) for part in told])
    return names, model.geom_type.tobytes(), numbers.tobytes()


@lru_cache(maxsize=8)
def _solids(names: tuple[str, ...], kinds: bytes, numbers: bytes) -> tuple[Geom, ...]:
    """Of what `_drawn` tells: hundreds, the same in every table of a stand, so read once."""
    told = np.frombuffer(numbers).reshape(len(names), sum(_WIDTHS))
    sizes, places, turns, colours, boxes = np.split(told, np.cumsum(_WIDTHS[:-1]), axis=1)
    sizes, places, turns = sizes.copy(), places.copy(), _xyzw(turns)
    words = [_kind(*one) for one in zip(names, np.frombuffer(kinds, np.int32), strict=True)]
    for i in np.flatnonzero([word == "mesh" for word in words]):
        center, sizes[i] = np.split(boxes[i], 2)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.roll(turns[i], 1))
        words[i], places[i] = "box", places[i] + turn.reshape(3, 3) @ center
    colours = colours.copy()
    for array in (sizes, places, turns, colours):
        array.flags.writeable = False
    return tuple(map(Geom, names, words, sizes, places, turns, colours))


def _kind(name: str, number: int) -> str:
    kind = _KINDS.get(mujoco.mjtGeom(number))
    if kind is None:
        allowed = ", ".join(_KINDS.values())
        raise StandError(f"MJCF: geom {name!r} must be one of {allowed}")
    return kind


def _xyzw(wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.roll(wxyz, -1, axis=-1)
