"""The stand's geometry as plain rotation matrices: an oracle that shares no code with the stand.

World axes east, north, up. Numbers below are read off the drawing (models/turntable.xml), not
computed: base axes cross at (0, 0, 0.60), gimbal axes at (0, 0, 1.28), the instrument's point
lies (0.04, 0.06, 0.05) from there when every joint is at zero.
"""

import numpy as np

EARTH_RATE = 7.292115e-5
BASE = np.array([0.0, 0.0, 0.60])
CROSSING = np.array([0.0, 0.0, 1.28])
LEVER = np.array([0.04, 0.06, 0.05])
ZERO = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # columns X1 = north, Y1 = up, Z1 = east

EAST, NORTH, UP = np.eye(3)
AXES = (NORTH, EAST, UP, UP, EAST, NORTH)  # base roll, pitch, yaw, outer, middle, inner


def skew(v):
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0, -x], [-y, x, 0]])


def turn(axis, angle):
    """Rodrigues' formula; `angle` (n,) gives (n, 3, 3)."""
    K = skew(axis)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def pose(q):
    """Attitude C_wb (n, 3, 3) and place (n, 3) of the instrument at joint angles (n, 6)."""
    R = [turn(axis, q[:, i]) for i, axis in enumerate(AXES)]
    base = R[0] @ R[1] @ R[2]
    gimbals = R[3] @ R[4] @ R[5]
    place = BASE + np.einsum("nij,nj->ni", base, CROSSING - BASE + gimbals @ LEVER)
    return base @ gimbals @ ZERO, place


def sensors(q, v, a, latitude, gravity):
    """Angular rate and specific force in b (n, 3), by differentiating the chain in closed form.

    The place is r = BASE + B (CROSSING - BASE + G LEVER): its velocity and acceleration follow
    from the rates and angular accelerations of B and G with the product rule, written out.
    """
    B, w_B, dw_B = _group(q[:, :3], v[:, :3], a[:, :3], AXES[:3])
    G, w_G, dw_G = _group(q[:, 3:], v[:, 3:], a[:, 3:], AXES[3:])
    arm = G @ LEVER
    d_arm = np.cross(w_G, arm)
    dd_arm = np.cross(dw_G, arm) + np.cross(w_G, d_arm)
    s = CROSSING - BASE + arm

    def to_world(x):
        return np.einsum("nij,nj->ni", B, x)

    velocity = np.cross(w_B, to_world(s)) + to_world(d_arm)
    acceleration = (
        np.cross(dw_B, to_world(s))
        + np.cross(w_B, np.cross(w_B, to_world(s)))
        + 2 * np.cross(w_B, to_world(d_arm))
        + to_world(dd_arm)
    )
    earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    rate = w_B + to_world(w_G) + earth
    force = acceleration + 2 * np.cross(earth, velocity) + gravity * UP
    C_wb = B @ G @ ZERO
    return np.einsum("nji,nj->ni", C_wb, rate), np.einsum("nji,nj->ni", C_wb, force)


def _group(q, v, a, axes):
    """Rotation, rate and angular acceleration of three hinges in series, in their base's axes."""
    n = len(q)
    R = np.broadcast_to(np.eye(3), (n, 3, 3))
    w, dw = np.zeros((n, 3)), np.zeros((n, 3))
    for i, axis in enumerate(axes):
        along = R @ axis
        dw = dw + a[:, i : i + 1] * along + v[:, i : i + 1] * np.cross(w, along)
        w = w + v[:, i : i + 1] * along
        R = R @ turn(axis, q[:, i])
    return R, w, dw


# A faulty table, by the product rule alone: a jet is a quantity with its first and second
# derivative in time. Shares no formula with `sensors` above, nor with the stand.


def jet_cos(x, shift=0.0):
    """cos(x + shift) of a jet of numbers."""
    c, s = np.cos(x[0] + shift), np.sin(x[0] + shift)
    return c, -s * x[1], -s * x[2] - c * x[1] ** 2


def jet_turn(axis, angle):
    """Rotation about a fixed axis by a jet of angles: R, K R x', (K x'' + K K x'^2) R."""
    R, K = turn(axis, angle[0]), skew(axis)
    rate, acceleration = (x[:, None, None] for x in angle[1:])
    return R, rate * (K @ R), acceleration * (K @ R) + rate**2 * (K @ K @ R)


def jet_product(A, B):
    return A[0] @ B[0], A[1] @ B[0] + A[0] @ B[1], A[2] @ B[0] + 2 * A[1] @ B[1] + A[0] @ B[2]


def fixed(matrix, n):
    R = np.broadcast_to(matrix, (n, 3, 3))
    return R, np.zeros((n, 3, 3)), np.zeros((n, 3, 3))


def rotation(vector):
    """Rotation by a vector (3,) [rad]."""
    angle = np.linalg.norm(vector)
    return turn(vector / angle, np.array([angle]))[0] if angle else np.eye(3)


def leaning(axis, toward, angle):
    return np.cos(angle) * axis + np.sin(angle) * toward


def faulty_sensors(
    q,
    v,
    a,
    latitude,
    gravity,
    base=(0.0, 0.0, 0.0),
    mounting=(0.0, 0.0, 0.0),
    axes=AXES,
    waves=(),
    wobbles=(),
):
    """Angular rate, specific force in b (n, 3) and attitude C_wb (n, 3, 3) of a faulty table.

    `base`: rotation vector in east, north, up of all above the pier; `mounting` in b; `axes`: the
    hinges' directions; `waves`: (axis, c, k, shift), ``c cos(k q + shift)`` added to that angle;
    `wobbles`: (axis, c, shift, first line, second line): nods by ``c cos(q + shift)`` about the
    first, then ``c sin(q + shift)`` about the second, both turning with the axis.
    """
    n = len(q)
    M = fixed(rotation(np.asarray(base)), n)
    arms = []
    for i, axis in enumerate(axes):
        encoder = (q[:, i], v[:, i], a[:, i])
        angle = encoder
        for number, c, k, shift in waves:
            if number == i:
                wave = jet_cos([k * x for x in encoder], shift)
                angle = [x + c * y for x, y in zip(angle, wave, strict=True)]
        M = jet_product(M, jet_turn(axis, angle))
        for number, c, shift, first, second in wobbles:
            if number == i:
                nod = [c * x for x in jet_cos(encoder, shift)]
                M = jet_product(M, jet_turn(first, nod))
                nod = [c * x for x in jet_cos(encoder, shift - np.pi / 2)]
                M = jet_product(M, jet_turn(second, nod))
        arms += [M] if i in (2, 5) else []
    _, velocity, acceleration = (
        b @ (CROSSING - BASE) + g @ LEVER for b, g in zip(*arms, strict=True)
    )
    earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    C = M[0] @ ZERO @ rotation(np.asarray(mounting))
    spin = np.einsum("nij,nkj->nik", M[1], M[0])  # R' R^T = [w x]
    rate = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1) + earth
    force = acceleration + 2 * np.cross(earth, velocity) + gravity * UP
    return np.einsum("nji,nj->ni", C, rate), np.einsum("nji,nj->ni", C, force), C


# A stand whose axes cross nowhere: each hinge at its own offset from the one that carries it.


def jet_apply(A, p):
    """A jet of matrices times a jet of vectors (n, 3)."""

    def times(M, x):
        return np.einsum("nij,nj->ni", M, x)

    return (
        times(A[0], p[0]),
        times(A[1], p[0]) + times(A[0], p[1]),
        times(A[2], p[0]) + 2 * times(A[1], p[1]) + times(A[0], p[2]),
    )


def offset_sensors(q, v, a, latitude, gravity, offsets):
    """Angular rate, specific force in b (n, 3) and attitude C_wb of a stand with offset axes.

    `offsets` (7, 3): the first hinge from the world's origin, each next one from the one before,
    and the instrument's point from the last, east, north, up at zero angles. The place is
    ``o_0 + R_1 (o_1 + R_2 (o_2 + ... R_6 o_6))``, differentiated by the product rule.
    """
    n = len(q)
    still = np.zeros((n, 3))
    place = (np.broadcast_to(offsets[6], (n, 3)), still, still)
    M = fixed(np.eye(3), n)
    for i in reversed(range(6)):
        R = jet_turn(AXES[i], (q[:, i], v[:, i], a[:, i]))
        M = jet_product(R, M)
        turned = jet_apply(R, place)
        place = (offsets[i] + turned[0], turned[1], turned[2])
    earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    spin = np.einsum("nij,nkj->nik", M[1], M[0])  # R' R^T = [w x]
    rate = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1) + earth
    force = place[2] + 2 * np.cross(earth, place[1]) + gravity * UP
    C = M[0] @ ZERO
    return np.einsum("nji,nj->ni", C, rate), np.einsum("nji,nj->ni", C, force), C
