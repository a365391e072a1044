"""The stand's kinematics alone, at work: hinges in MuJoCo, evaluated at prescribed states.

Every joint gets an armature of 1e15, so that an applied force of 1e15 q'' yields exactly q''
whatever the rest of the stand weighs, and MuJoCo's own sensors are read at (q, q', q'').

A real table's axis that wobbles has two small hinges across it. What never moves needs no hinge:
it is in the place of the others.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from itertools import count
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray
from alignment.earth import Site
from alignment.fixed_order import product
from stand.physics.mjcf import SENSORS, SITE
from stand.table.joints import JOINTS, across
from stand.table.kinematics import C_NW
from stand.table.table_errors import TableErrors

ARMATURE = 1e15  # kg m^2: dwarfs every real inertia by 1e12, so q'' comes back to rounding
ROWS = 1000  # evaluations per call: the state rows stay in cache
_NOD = " nods "  # in names of hinges, behind the axis'
HINGES = 6  # at most on one body of MuJoCo's

JointState = tuple[Array, Array, Array]  # angles, rates, accelerations


_UNUSED_STAGES = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_SPRING
    | mujoco.mjtDisableBit.mjDSBL_DAMPER
    | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


class Common(NamedTuple):
    """What all hinges of a truth have in common.

    `site`: ``latitude`` needed. `places` (3, 3) or None: row i is where an accelerometer is added,
    in b, from the instrument's point [m]. `threads`: of MuJoCo.
    """

    site: Site
    places: Array | None
    threads: int


def _compiled(chain: "Chain", common: Common) -> mujoco.MjModel:
    """A model of hinges on one body at the instrument's point.

    Notes
    -----
    A chain of hinges is the same rigid motion as the hinges in series on its last body, each
    with the axis and anchor it has at zero angles; that spares five bodies' arithmetic. More
    than MuJoCo allows on one body go to others in the same place.
    """
    site, places = common.site, common.places
    spec = mujoco.MjSpec()
    spec.option.gravity = C_NW.inv().apply(-site.f_n)
    spec.option.magnetic = C_NW.inv().apply(site.w_ie_n)
    spec.option.disableflags = int(_UNUSED_STAGES)
    body = _weighted(spec.worldbody, pos=chain.origin, quat=chain.quat)
    hinges = zip(chain.names, chain.axes, chain.anchors, strict=True)
    for number, (name, axis, anchor) in enumerate(hinges):
        if number and number % HINGES == 0:
            body = _weighted(body)
        body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            pos=anchor,
            armature=ARMATURE,
        )
    body.add_site(name=SITE)
    for kind in SENSORS:  # those of the stand at the same site
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=SITE)
    for i, place in enumerate(() if places is None else places):
        body.add_site(name=f"place{i}", pos=place)
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=f"place{i}",
        )
    return spec.compile()


class Chain(NamedTuple):
    """Names, axes and anchors (h, 3) in b at zero angles of hinges, and where b is in w then."""

    names: tuple[str, ...]
    axes: Array
    anchors: Array
    origin: Array
    quat: Array

    def of(self, axes: IntArray, angles: Array) -> "Chain":
        """The hinges of these axes and of their nods, the others at `angles` (h,) [rad] of all h.

        Notes
        -----
        One that stands, F, goes before those that carry it: ``H F = F (F^-1 H F)`` turns their
        axes and anchors, and where b is in w takes it in.
        """
        own = {JOINTS[number] for number in axes}
        moves = np.array([name.partition(_NOD)[0] in own for name in self.names])
        lines, anchors, origin = self.axes.copy(), self.anchors.copy(), self.origin
        C_wb = Rotation.from_quat(self.quat, scalar_first=True).as_matrix()
        for k in np.flatnonzero(~moves):
            C = Rotation.from_rotvec(angles[k] * lines[k]).as_matrix()
            moved = anchors[k] - product(C, anchors[k])
            lines[:k] = product(lines[:k], C)
            anchors[:k] = product(anchors[:k] - moved, C)
            origin, C_wb = origin + product(C_wb, moved), product(C_wb, C)
        return Chain(
            names=tuple(self.names[k] for k in np.flatnonzero(moves)),
            axes=lines[moves],
            anchors=anchors[moves],
            origin=origin,
            quat=Rotation.from_matrix(C_wb).as_quat(scalar_first=True),
        )


def chain_of(
    model: mujoco.MjModel, errors: TableErrors, data: mujoco.MjData | None = None
) -> Chain:
    """The hinges of the whole stand.

    Parameters
    ----------
    model : MjModel
        The stand as built, with single hinges named as `JOINTS` and the site `imu`.
    errors : TableErrors
        Behind each axis that wobbles come two hinges across it, `nods` of it.
    data : MjData or None
        At zero angles, of a model of these sizes: worked in where many are made.
    """
    at_zero: Any = mujoco.MjData(model) if data is None else data
    mujoco.mj_kinematics(model, at_zero)
    sid = model.site(SITE).id
    origin, C_wb = at_zero.site_xpos[sid].copy(), at_zero.site_xmat[sid].reshape(3, 3).copy()
    names, axes, anchors = zip(*_hinges(model, at_zero, errors), strict=True)
    return Chain(
        names=names,
        axes=product(C_wb.T, np.array(axes).T).T,
        anchors=product(C_wb.T, (np.array(anchors) - origin).T).T,
        origin=origin,
        quat=Rotation.from_matrix(C_wb).as_quat(scalar_first=True),
    )


def _rebuild(lean: mujoco.MjModel, chain: Chain) -> None:
    """Make of a lean model that of another table of as many hinges, to the bit as its compiler.

    Which leaves what has a length of one within 1e-14 as it is.
    """
    lean.body_pos[1] = lean.body_ipos[1] = chain.origin
    lean.body_quat[1] = lean.body_iquat[1] = chain.quat
    lean.jnt_axis[:], lean.jnt_pos[:] = chain.axes, chain.anchors


def _weighted(parent: mujoco.MjsBody, **place: Array) -> mujoco.MjsBody:
    return parent.add_body(mass=1.0, inertia=[1, 1, 1], explicitinertial=True, **place)


def _hinges(
    model: mujoco.MjModel, data: mujoco.MjData, errors: TableErrors
) -> Iterator[tuple[str, Array, Array]]:
    """Name, axis and anchor in w at zero angles of the six hinges and of the nods behind them."""
    for number, name in enumerate(JOINTS):
        joint = model.joint(name).id
        axis, anchor = data.xaxis[joint], data.xanchor[joint]
        yield name, axis, anchor
        if errors.wobble[number]:
            body = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
            first = product(body, across(model.jnt_axis[joint]))
            yield f"{name}{_NOD}first", first, anchor
            yield f"{name}{_NOD}second", np.cross(axis, first), anchor


class Hinges:
    """A lean model at work: the hinges of `axes` (m,) and of their nods, in one batch of `ROWS`."""

    def __init__(self, chain: Chain, axes: IntArray, common: Common) -> None:
        self.axes, self.names = axes, chain.names
        self._lean = _compiled(chain, common)
        self.batch = Batch(self._lean, ROWS, nthread=common.threads)
        self._sensors = self.batch.bind("sensordata")

    def take(self, chain: Chain) -> None:
        """Be those of another chain of the same names."""
        _rebuild(self._lean, chain)
        self.batch.set_models(self._lean)

    def states(self, errors: TableErrors, true: JointState, encoders: JointState) -> JointState:
        """Angles, rates and accelerations of the hinges, from those of the six axes."""
        own = true if len(self.axes) == len(JOINTS) else [x[:, self.axes] for x in true]
        wobbling = self.axes[errors.wobble[self.axes] != 0]
        if len(wobbling):
            order = _order(errors, self.axes)
            nods = errors.nods(*encoders, wobbling)
            own = [np.hstack(both)[:, order] for both in zip(own, nods, strict=True)]
        angles, rates, accelerations = own
        return angles, rates, accelerations

    def sensed(self, joints: Array, rates: Array, accelerations: Array) -> Array:
        """Sensors (n, s) at states of the hinges."""
        n = len(joints)
        raw = np.empty((n, self._sensors.shape[1]))
        for first in range(0, n, ROWS):
            part = slice(first, min(first + ROWS, n))
            raw[part] = self._evaluate(joints[part], rates[part], accelerations[part])
        return raw

    def _evaluate(self, joints: Array, rates: Array, accelerations: Array) -> Array:
        n = len(joints)
        self.batch.qpos[:n] = joints
        self.batch.qvel[:n] = rates
        np.multiply(accelerations, ARMATURE, out=self.batch.qfrc_applied[:n])
        self.batch.forward(None if n == ROWS else np.arange(n))
        return self._sensors[:n]


def _order(errors: TableErrors, axes: IntArray) -> IntArray:
    """Columns of the angles of `axes`, then their nods, as the lean model's hinges take them."""
    order: list[int] = []
    nods = count(len(axes))
    for place, number in enumerate(axes):
        order += [place, *((next(nods), next(nods)) if errors.wobble[number] else ())]
    return np.array(order)
