"""The stand with its weights and motors: a lean model to simulate, and what torque a motion needs.

The model keeps bodies, inertias and hinges and has no solids, contacts or constraints. Each axis
is driven by the stand's own motor, MuJoCo's ``dcmotor``, with a table's values set on it: PID servo
with rate and torque feedforward, torque limit, cogging, LuGre friction; viscous friction is the
joint's damping.

Semi-implicit Euler, nothing implicit in the forces: ``v' = v + h a(q, v)``, ``q' = q + h v'``. A
motor then delivers what its servo asks for at the start of the step, as a digital servo does, and
its limit acts on that; MuJoCo's implicit integrators would brake it further within the step.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import mujoco
import numpy as np
from mujoco.batch import Batch

from alignment.arrays import Array, set_owned
from alignment.fixed_order import product
from stand.errors import StandError
from stand.physics.mjcf import motor_of
from stand.table.joints import JOINTS
from stand.table.table import Motor, Table

INPUTS = 3  # of each motor: angle, rate, torque
MOVING = 1e-6  # rad/s: an axis that turns faster has its Coulomb friction against it
ROWS = 1000  # states per call: they stay in cache
_INPUTS = (
    mujoco.mjtCtrlInput.mjINPUT_POS
    | mujoco.mjtCtrlInput.mjINPUT_VEL
    | mujoco.mjtCtrlInput.mjINPUT_FF
)
_UNUSED_STAGES = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_SPRING
    | mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    | mujoco.mjtDisableBit.mjDSBL_AUTORESET
)


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """A weight on the inner plate: `mass` [kg] at `offset` (3,) [m].

    `offset` is from the crossing of the gimbal axes, in ENU at zero angles.
    """

    mass: float
    offset: Array

    def __post_init__(self) -> None:
        set_owned(self, offset=(self.offset, (3,), float))


NO_PAYLOAD = Payload(0.0, np.zeros(3))


@dataclass(frozen=True, slots=True)
class Gains:
    """What one servo is set to: [N m / rad], [N m s / rad], [N m / (rad s)], [kg m^2], [N m].

    ``torque = kp (angle error) + kd (rate error) + ki (integral of angle error) + feedforward``,
    kept within `limit`.
    """

    kp: float
    kd: float
    ki: float
    inertia: float
    limit: float


def gains_of(motor: Motor, inertia: float) -> Gains:
    """A closed loop ``s^2 + 2 damping w s + w^2`` around `inertia` [kg m^2]; integrator beside."""
    kp = inertia * motor.bandwidth**2
    ki = 0.0 if motor.integral is None else kp / motor.integral
    return Gains(kp, 2 * motor.damping * motor.bandwidth * inertia, ki, inertia, limit=motor.torque)


def bristle_damping(motor: Motor, inertia: float) -> float:
    """Of a stuck axis without its servo [N m s / rad]: a tenth of what is critical."""
    return 0.2 * sqrt(motor.bristle * inertia)


def motors_of(table: Table) -> tuple[Motor, ...]:
    """The six motors of a table; `StandError` where one is missing."""
    for name, motor in zip(JOINTS, table.motors, strict=True):
        if motor is None:
            raise StandError(f"table {table.id}: axis {name}, motor: required for --motion servo")
    return tuple(m for m in table.motors if m is not None)


def weights_model(
    model: mujoco.MjModel,
    payload: Payload = NO_PAYLOAD,
    motors: Sequence[Motor] = (),
    step: float = 1e-3,
) -> mujoco.MjModel:
    """The stand's inertias on its hinges, and its motors set to `motors` if given.

    Parameters
    ----------
    model : MjModel
        A chain of single hinges; bodies without a hinge are fixed to the one that carries them.
        Each hinge with its actuator, where there are `motors`.
    payload : Payload
        Fixed to the last body that has a hinge.
    motors : sequence of Motor
        One per hinge, tuned to the inertia that the hinge has at zero angles; or none.
    step : float
        Of the simulation [s].
    """
    spec = _spec(model, payload, step)
    bare = spec.compile()
    if not motors:
        return bare
    for joint, motor, inertia in zip(spec.joints, motors, inertias(bare), strict=True):
        joint.damping = [motor.viscous, 0, 0]
        actuator = spec.add_actuator(
            name=model.actuator(motor_of(model, joint.name)).name,
            target=joint.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
        )
        _set_motor(actuator, motor, gains_of(motor, inertia))
    return spec.compile()


def _spec(model: mujoco.MjModel, payload: Payload, step: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.gravity = model.opt.gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags = int(_UNUSED_STAGES)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    carrier = np.where(model.body_jntnum > 0)[0]
    parent, origin = spec.worldbody, np.zeros(3)
    for number, body in enumerate(carrier):
        extra = payload if number == len(carrier) - 1 else NO_PAYLOAD
        parent = _add_body(parent, model, data, int(body), origin, extra)
        origin = data.xpos[body]
    return spec


def _add_body(
    parent: mujoco.MjsBody,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: int,
    origin: Array,
    payload: Payload,
) -> mujoco.MjsBody:
    """A body with all that is fixed to it, axes along the world's at zero angles."""
    fixed = np.where(model.body_weldid == body)[0]
    masses = np.append(model.body_mass[fixed], payload.mass)
    centers = np.vstack([data.xipos[fixed] - data.xpos[body], payload.offset])
    axes = data.ximat[fixed].reshape(-1, 3, 3)
    own = np.einsum("nij,nj,nkj->ik", axes, model.body_inertia[fixed], axes)
    mass = masses.sum()
    center = product(masses, centers) / max(mass, 1e-300)
    arms = centers - center
    spread = (masses * (arms**2).sum(axis=1)).sum() * np.eye(3) - product(masses * arms.T, arms)
    total = own + spread
    added = parent.add_body(
        name=model.body(body).name,
        pos=data.xpos[body] - origin,
        mass=mass,
        ipos=center,
        fullinertia=total[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        explicitinertial=True,
    )
    joint = int(model.body_jntadr[body])
    added.add_joint(
        name=model.joint(joint).name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=data.xaxis[joint],
        armature=model.dof_armature[model.jnt_dofadr[joint]],
    )
    return added


def _set_motor(actuator: mujoco.MjsActuator, motor: Motor, gains: Gains) -> None:
    # an integrator that holds the whole torque needs no more: it does not wind up beyond
    most = gains.limit / gains.ki if gains.ki else 0.0
    actuator.set_to_dcmotor(
        motorconst=[1.0, 1.0],
        resistance=1.0,
        saturation=[gains.limit, 0, 0],
        cogging=[motor.cogging, motor.cogging_per_turn, 0],
        controller=[gains.kp, gains.ki, gains.kd, 0, most, 0],
        lugre=[
            motor.bristle,
            bristle_damping(motor, gains.inertia),
            motor.coulomb,
            motor.static,
            motor.stribeck,
        ],
        ctrlspec=int(_INPUTS),
    )


def inertias(model: mujoco.MjModel) -> Array:
    """What each hinge of a chain turns at zero angles (n,) [kg m^2]: the mass matrix's diagonal."""
    return np.diag(mass_matrices(model, np.zeros((1, model.nv)))[0])


def tilting_moments(model: mujoco.MjModel) -> tuple[float, float]:
    """Heights times masses [kg m] of what rolls only, and of what rolls and pitches.

    Above the crossing of the base's axes, at zero angles; `model` is a `weights_model`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    moments = model.body_mass * (data.xipos[:, 2] - data.xanchor[0, 2])
    return float(moments[1]), float(moments[2:].sum())


def required_torque(
    model: mujoco.MjModel,
    table: Table,
    payload: Payload,
    angles: Array,
    rates: Array,
    accelerations: Array,
) -> Array:
    """As `torque_of`, at once."""
    return torque_of(model, table, payload)(angles, rates, accelerations)


def torque_of(
    model: mujoco.MjModel, table: Table, payload: Payload
) -> Callable[[Array, Array, Array], Array]:
    """Tells the torque (n, 6) [N m] with which the motors drive a motion.

    Parameters
    ----------
    model : MjModel
        The whole stand, whose weights are worked out once.
    table : Table
    payload : Payload

    Returns
    -------
    callable
        Takes angles, rates and accelerations, (n, 6) each, in radians.

    Notes
    -----
    ``M(q) q'' + c(q, q') + g(q)`` by MuJoCo, plus viscous friction, plus Coulomb's against the
    axes that move. Cogging, whose phase no plan knows, is left out.
    """
    motors = motors_of(table)
    viscous, coulomb = (np.array([getattr(m, k) for m in motors]) for k in ("viscous", "coulomb"))
    batch = Batch(weights_model(model, payload), ROWS, nthread=1)

    def needed(angles: Array, rates: Array, accelerations: Array) -> Array:
        torque = np.empty_like(angles)
        for first in range(0, len(angles), ROWS):
            part = slice(first, first + ROWS)
            torque[part] = _inverse_dynamics(batch, angles[part], rates[part], accelerations[part])
        torque += rates * viscous
        return torque + np.where(np.abs(rates) > MOVING, np.sign(rates), 0) * coulomb

    return needed


def _inverse_dynamics(batch: Batch, angles: Array, rates: Array, accelerations: Array) -> Array:
    """``M(q) q'' + c(q, q') + g(q)`` (n, joints) [N m], n up to the size of the batch."""
    n = len(angles)
    bias = batch.bind("qfrc_bias")
    batch.qpos[:n], batch.qvel[:n] = angles, rates
    matrices = _mass_matrices_of(batch, n)
    return bias[:n] + np.einsum("nij,nj->ni", matrices, accelerations)


def mass_matrices(model: mujoco.MjModel, angles: Array) -> Array:
    """Mass matrices (n, joints, joints) at joint angles (n, joints) [rad]."""
    batch = Batch(model, len(angles), nthread=1)
    batch.qpos[:] = angles
    return _mass_matrices_of(batch, len(angles))


def _mass_matrices_of(batch: Batch, n: int) -> Array:
    """From the first n states of a batch; in a chain each hinge is coupled to all that carry it."""
    lower = batch.bind("M")
    batch.forward(np.arange(n), stage=mujoco.mjtStage.mjSTAGE_VEL)
    joints = batch.qvel.shape[1]
    rows, columns = np.tril_indices(joints)
    matrices = np.empty((n, joints, joints))
    matrices[:, rows, columns] = lower[:n]
    matrices[:, columns, rows] = lower[:n]
    return matrices
