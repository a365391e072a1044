"""The correction as a few lines of Python and of C, which need nothing of this project."""

from collections.abc import Sequence

import numpy as np

from alignment.arrays import Array
from alignment.calibration import TriadConstants

_VECTORS = ("bias", "asymmetry", "k2", "k3", "temperature_bias", "temperature_scale")
_MODEL = (
    "Direction: out of what the unit reports, the truth. It reports, with L = M x,",
    "y = L + a |L| + k2 L^2 + k3 L^3 + sT dT L + G f + G2 f^2 + b + bT dT,",
    "x true rate [rad/s] or force [m/s^2], dT [K] above the reference temperature;",
    "solved for x by x + M^-1 (y - reported(x)), gyros after accelerometers.",
)

_PYTHON = '''"""{head}

{model}
"""

import numpy as np

{constants}

def reported(c, x, f, dT):
    """What a triad reports (n, 3)."""
    L = x @ c["M"].T
    y = L * (1 + c["k2"] * L + c["k3"] * L**2 + c["temperature_scale"] * dT)
    y = y + c["asymmetry"] * np.abs(L) + f @ c["G"].T + f**2 @ c["G2"].T
    return y + c["bias"] + c["temperature_bias"] * dT


def inverse(c, y, f, dT):
    """The truth (n, 3) of what a triad reports (n, 3)."""
    back = np.linalg.inv(c["M"])
    x = y @ back.T
    for _ in range(50):
        more = (y - reported(c, x, f, dT)) @ back.T
        x = x + more
        if np.abs(more).max() <= 1e-15 * max(1.0, np.abs(y).max()):
            break
    return x


def correct(gyro, accel, dT=0.0):
    """Rates [rad/s] and forces [m/s^2] (n, 3) without the unit's errors."""
    gyro, accel = np.atleast_2d(gyro), np.atleast_2d(accel)
    f = inverse(ACCEL, accel, 0 * accel, dT)
    return inverse(GYRO, gyro, f, dT), f
'''

_C = """/* {head}

{model}
   imu_correct(gyro, accel, dT, w, f): gyro, w [rad/s], accel, f [m/s^2], three numbers each. */

#include <math.h>

struct imu_triad {{
    double M[3][3], back[3][3], G[3][3], G2[3][3];
    double bias[3], asymmetry[3], k2[3], k3[3], temperature_bias[3], temperature_scale[3];
}};

{constants}

static void imu_reported(const struct imu_triad *c, const double x[3], const double f[3],
                         double dT, double y[3])
{{
    for (int i = 0; i < 3; i++) {{
        double L = c->M[i][0] * x[0] + c->M[i][1] * x[1] + c->M[i][2] * x[2];
        y[i] = L * (1 + c->k2[i] * L + c->k3[i] * L * L + c->temperature_scale[i] * dT);
        y[i] += c->asymmetry[i] * fabs(L) + c->bias[i] + c->temperature_bias[i] * dT;
        for (int j = 0; j < 3; j++)
            y[i] += c->G[i][j] * f[j] + c->G2[i][j] * f[j] * f[j];
    }}
}}

static void imu_inverse(const struct imu_triad *c, const double y[3], const double f[3],
                        double dT, double x[3])
{{
    for (int i = 0; i < 3; i++)
        x[i] = c->back[i][0] * y[0] + c->back[i][1] * y[1] + c->back[i][2] * y[2];
    for (int step = 0; step < 50; step++) {{
        double r[3], largest = 0, size = 1;
        imu_reported(c, x, f, dT, r);
        for (int i = 0; i < 3; i++) {{
            r[i] = y[i] - r[i];
            size = fmax(size, fabs(y[i]));
        }}
        for (int i = 0; i < 3; i++) {{
            double more = c->back[i][0] * r[0] + c->back[i][1] * r[1] + c->back[i][2] * r[2];
            x[i] += more;
            largest = fmax(largest, fabs(more));
        }}
        if (largest <= 1e-15 * size)
            break;
    }}
}}

void imu_correct(const double gyro[3], const double accel[3], double dT, double w[3], double f[3])
{{
    const double nothing[3] = {{0, 0, 0}};
    imu_inverse(&IMU_ACCEL, accel, nothing, dT, f);
    imu_inverse(&IMU_GYRO, gyro, f, dT, w);
}}
"""


def python_text(gyro: TriadConstants, accel: TriadConstants, head: Sequence[str]) -> str:
    """A module of its own, numpy alone."""
    blocks = [_python(name, c) for name, c in (("GYRO", gyro), ("ACCEL", accel))]
    return _PYTHON.format(
        head="\n".join(map(_quiet, head)), model="\n".join(_MODEL), constants="\n".join(blocks)
    )


def c_text(gyro: TriadConstants, accel: TriadConstants, head: Sequence[str]) -> str:
    """A file of its own, C99."""
    blocks = [_c(name, c) for name, c in (("IMU_GYRO", gyro), ("IMU_ACCEL", accel))]
    return _C.format(
        head="\n   ".join(map(_quiet, head)),
        model="\n".join(f"   {line}" for line in _MODEL),
        constants="\n\n".join(blocks),
    )


def _quiet(line: str) -> str:
    """Text of a file that can end neither comment nor docstring."""
    kept = "".join(c if c.isprintable() else " " for c in line)
    return kept.replace("*/", "* /").replace('"""', "'''").replace("\\", "/")


def _matrices(c: TriadConstants) -> dict[str, Array]:
    return {"M": c.scale_and_axes, "G": c.g_sensitivity, "G2": c.g2_sensitivity}


def _python(name: str, c: TriadConstants) -> str:
    parts = {n: M.tolist() for n, M in _matrices(c).items()}
    parts |= {n: getattr(c, n).tolist() for n in _VECTORS}
    lines = [f'    "{n}": np.array({value!r}),' for n, value in parts.items()]
    return "\n".join([f"{name} = {{", *lines, "}"])


def _c(name: str, c: TriadConstants) -> str:
    matrices = _matrices(c) | {"back": np.linalg.inv(c.scale_and_axes)}
    lines = [f"    .{n} = {_braces(M)}," for n, M in matrices.items()]
    lines += [f"    .{n} = {_braces(getattr(c, n))}," for n in _VECTORS]
    return "\n".join([f"static const struct imu_triad {name} = {{", *lines, "};"])


def _braces(values: Array) -> str:
    if values.ndim == 1:
        return "{" + ", ".join(repr(float(v)) for v in values) + "}"
    return "{" + ", ".join(map(_braces, values)) + "}"
