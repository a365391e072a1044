"""Tables of fewer axes than the stand's six: what they cannot do, and what would do instead."""

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, angles_from_C_nb
from alignment.arrays import Array
from alignment.units import DEG
from stand.errors import StandError
from stand.procedure.procedure import Procedure
from stand.procedure.steps import (
    Background,
    ConingStep,
    DwellStep,
    MoveStep,
    ProfileStep,
    RateStep,
    ScorsbyMotion,
    Step,
    SweepStep,
)
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import attitude
from stand.table.table import Table


def refuse_missing(procedure: Procedure, table: Table) -> None:
    """`StandError` where a step or background turns an axis that the table has not."""
    if not table.missing:
        return
    for number, step in enumerate(procedure.entry.step):
        for key, name in _turned(step):
            if name in table.missing:
                raise procedure.fault(number, key, name, table.without(name))
    for number, behind in enumerate(procedure.entry.background, start=1):
        for key, name in _turned(behind):
            if name in table.missing:
                where = f"{procedure.name}: background {number}, {key} = {name}"
                raise StandError(f"{where}: {table.without(name)}")


def _turned(step: Step | Background) -> list[tuple[str, str]]:
    """The axes that a step names, and by which key; a move to zero names none."""
    if isinstance(step, RateStep | SweepStep):
        return [("axis", step.axis)]
    if isinstance(step, MoveStep):
        angles = step.joints_deg or {}
        return [("joints_deg", name) for name, angle in angles.items() if angle != 0]
    if isinstance(step, ScorsbyMotion):
        return [("amplitude_deg", name) for name in step.amplitude_deg]
    if isinstance(step, ConingStep):
        return [("kind", name) for name in JOINTS[3:]]
    if isinstance(step, DwellStep | ProfileStep):
        return []
    return [("axes", name) for name in step.axes]


def same_vertical(
    C_nb: Rotation, joints: Array, sequence: Sequence, model: StandModel, table: Table
) -> str:
    """The attitude with the same vertical that the axes there reach, in words; '' if none.

    `C_nb` is wanted from `joints` (6,) [rad], of which the base's stay.

    Notes
    -----
    At zero base angles middle and inner alone decide the vertical:
    ``up_b = (sin m, cos m cos i, -cos m sin i)``.
    """
    up = C_nb.inv().apply([0.0, 0.0, -1.0])
    both = np.arctan2(up[0], np.hypot(up[1], up[2])), np.arctan2(-up[2], up[1])
    for middle, inner in ((np.arctan2(up[0], up[1]), 0.0), both):  # beyond 90 deg middle alone
        tried = np.array([*joints[:3], 0.0, middle, inner])
        reached = attitude(model, tried)
        same = np.allclose(reached.inv().apply([0.0, 0.0, -1.0]), up, atol=1e-9)
        if same and not table.outside(tried):
            angles = angles_from_C_nb(sequence, reached) / DEG
            named = zip(("roll", "yaw", "pitch"), angles, strict=True)
            told = ", ".join(f"{name} = {round(float(a), 6) + 0.0:g}" for name, a in named)
            return f"; attitude_deg = {{ {told} }} has the same vertical and can be reached"
    return ""
