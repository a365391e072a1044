"""A calibration in the forms that others use: each says in which direction it goes."""

import json
import re
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path

import numpy as np

from alignment.arrays import Array
from alignment.calibration import Key, TriadConstants, constants_of, derived_of
from alignment.options import SENSORS
from alignment.units import ARC_SECOND, DEG_PER_HOUR, MICRO_G
from stand.calibration.file import CalibrationRecord
from stand.calibration.snippets import c_text, python_text
from stand.calibration.units import AXES, unit_of
from stand.errors import StandError, unknown
from stand.folder import refuse_files, write_files
from stand.imu.known import FIELDS
from stand.imu.preset import imu_from
from stand.imu.priors import NOISE_ONLY
from stand.toml_files import Source

NOT_MOMENTARY = ("lag", "lever_arm")
NOT_LINEAR = (
    *("asymmetry", "k2", "k3", "g2_sensitivity"),
    *("temperature_bias", "temperature_scale"),
    *NOT_MOMENTARY,
)


def exported(
    record: CalibrationRecord,
    out: str | PathLike[str],
    form: str | None = None,
    *,
    force: bool = False,
) -> list[Path]:
    """Write a calibration for others.

    Parameters
    ----------
    record : CalibrationRecord
    out : path
        Its ending says the form, unless `form` does.
    form : str, optional
        Of `FORMS`.
    force : bool
        Replace what is there.

    Raises
    ------
    StandError
        A form that is not known, something is there (and not `force`), or the unit cannot be told
        in this form.
    """
    path = Path(out)
    kind = form or _ENDINGS.get(path.suffix.lower(), "")
    if kind not in FORMS:
        raise unknown("format", form or path.suffix or str(path), (*FORMS, *_ENDINGS))
    files = FORMS[kind](record, path)
    refuse_files(files, force=force)
    return write_files(files)


# --- imu_tk --------------------------------------------------------------------------------------


def imu_tk_files(record: CalibrationRecord, out: Path) -> dict[Path, str]:
    """Two files, of accelerometers and of gyros, as imu_tk loads them: T, K and b."""
    return {
        out.with_name(f"{out.stem}_{name}{out.suffix}"): _imu_tk_text(record, sensor)
        for name, sensor in (("acc", "accel"), ("gyro", "gyro"))
    }


def _imu_tk_text(record: CalibrationRecord, sensor: str) -> str:
    """21 numbers, after which it reads no further: T, K, b of ``T K (X - b)``."""
    c = _constants(record, sensor)
    back = np.linalg.inv(c.scale_and_axes)
    K = back.diagonal()
    blocks = ["\n".join(_numbers(row) for row in M) for M in (back / K, np.diag(K))]
    blocks.append("\n".join(repr(float(b)) for b in c.bias))
    unit = "rad/s" if sensor == "gyro" else "m/s^2"
    notes = [
        f"Correction of the readings X [{unit}]: x = T K (X - b).",
        *_left(record, sensor, (*NOT_LINEAR, "g_sensitivity")),
    ]
    return "\n\n".join(blocks) + "\n\n" + "".join(f"# {line}\n" for line in notes)


# --- Kalibr --------------------------------------------------------------------------------------


def kalibr_files(record: CalibrationRecord, out: Path) -> dict[Path, str]:
    """One file in the form of Kalibr's model scale-misalignment."""
    return {out: _kalibr_text(record)}


def _kalibr_text(record: CalibrationRecord) -> str:
    """What the unit does to the truth, in the frame i in which the accelerometers' M is lower
    triangular, as Kalibr has it."""
    gyro, accel = (_constants(record, s) for s in ("gyro", "accel"))
    M_a, C_ib = lower_triangular(accel.scale_and_axes)
    M_g, C_gi = lower_triangular(gyro.scale_and_axes @ C_ib.T)
    A = gyro.g_sensitivity @ C_ib.T
    T = np.eye(4)
    T[:3, :3] = C_ib
    lines = [
        "# Kalibr-style: what the unit does to the truth.",
        "# accelerometers read M a + b, gyroscopes M C_gyro_i w + A a + b; w [rad/s], a [m/s^2]",
        "# in i; T_i_b takes b (X1 forward, Y1 up, Z1 right) to i. b: no key of Kalibr's.",
        *(f"# {line}" for s in ("gyro", "accel") for line in _left(record, s, NOT_LINEAR)),
        "imu0:",
        "  model: scale-misalignment",
        *_yaml("T_i_b", T, 2),
        "  accelerometers:",
        *_yaml("M", M_a, 4),
        f"    b: {_flow(accel.bias)}",
        "  gyroscopes:",
        *_yaml("M", M_g, 4),
        *_yaml("C_gyro_i", C_gi, 4),
        *_yaml("A", A, 4),
        f"    b: {_flow(gyro.bias)}",
    ]
    return "\n".join(lines) + "\n"


def lower_triangular(M: Array) -> tuple[Array, Array]:
    """``M = L C``: L (3, 3) lower triangular with a positive diagonal, C a rotation."""
    Q, R = np.linalg.qr(M.T)
    signs = np.sign(R.diagonal())
    return np.asarray((R * signs[:, None]).T), np.asarray((Q * signs).T)


def _yaml(name: str, M: Array, indent: int) -> list[str]:
    pad = " " * indent
    return [f"{pad}{name}:", *(f"{pad}- {_flow(row)}" for row in M)]


def _flow(values: Array) -> str:
    return "[" + ", ".join(repr(float(v) + 0.0) for v in values) + "]"


# --- snippets ------------------------------------------------------------------------------------


def python_files(record: CalibrationRecord, out: Path) -> dict[Path, str]:
    """A module with a function `correct`."""
    gyro, accel = (_constants(record, s) for s in ("gyro", "accel"))
    return {out: python_text(gyro, accel, _head(record))}


def c_files(record: CalibrationRecord, out: Path) -> dict[Path, str]:
    """A file with a function `imu_correct`."""
    gyro, accel = (_constants(record, s) for s in ("gyro", "accel"))
    return {out: c_text(gyro, accel, _head(record))}


def _head(record: CalibrationRecord) -> list[str]:
    named = record.unit.get("title") or record.unit.get("id") or "a unit"
    serial = record.unit.get("serial")
    left = [line for s in ("gyro", "accel") for line in _left(record, s, NOT_MOMENTARY)]
    return [f"Correction of {named}" + (f", serial {serial}" if serial else ""), *left]


# --- a preset ------------------------------------------------------------------------------------


def preset_files(record: CalibrationRecord, out: Path) -> dict[Path, str]:
    """A preset that replays this one unit: `stand run --imu X.toml`.

    Raises
    ------
    StandError
        The data sheet that the calibration carries is not right.
    """
    sheet = _without_known(record.unit.get("toml") or _sheet(record))
    known, left = [], []
    has_range = {s: _has_range(sheet, s) for s in ("gyro", "accel")}
    for p in record.calibration.parameters:
        key = p.key
        if key.term not in FIELDS or (key.term == "k3" and not has_range[key.sensor]):
            left.append(f"# not replayed: {key.sensor} {key.term} {AXES[key.axis]}")
            continue
        unit, size = unit_of(key)
        known.append(_known(key, p.value / size, unit, p.sigma / size))
    text = "\n".join(
        [
            "# One unit as it was calibrated: what is known is drawn about its value with its",
            "# sigma, each apart; the rest is as its data sheet says. Direction: what the unit",
            "# does to the truth.",
            *_of_noise(record),
            *_apart(record),
            *left,
            "known = [",
            *(f"  {line}," for line in known),
            "]",
            sheet,
        ]
    )
    imu_from(Source(out.stem, str(out), text))  # its faults are told before it is written
    return {out: text}


def _of_noise(record: CalibrationRecord) -> list[str]:
    """Of which sensors no sheet told drift or anything else but noise."""
    words = {"gyro": "gyros", "accel": "accelerometers"}
    named = " and ".join(words[sensor] for sensor in SENSORS if sensor in record.noise_only)
    return [f"# Sigmas of {named}: {NOISE_ONLY}, no drift is in them."] if named else []


def _apart(record: CalibrationRecord) -> list[str]:
    """What a preset loses where sigmas are of one cause: how gyros lie to accelerometers."""
    c = record.calibration
    known = [d.sigma for d in c.derived if d.quantity == "gyro_to_accel"]
    if not known:
        return []
    alone = derived_of(c.keys, c.values, np.diag(c.sigmas**2))
    drawn = [d.sigma for d in alone if d.quantity == "gyro_to_accel"]
    told, left = (float(np.sqrt(np.mean(np.square(s)))) / ARC_SECOND for s in (known, drawn))
    return [
        f"# Not in it: correlations. Gyros are known against accelerometers to {told:.2g} arcsec,",
        f"# in units drawn from this file they scatter by {left:.2g}; calibration.json has it all.",
    ]


def _without_known(sheet: str) -> str:
    """The sheet without constants by value, as this module writes them: new ones take their place.

    Raises
    ------
    StandError
        They stand there otherwise.
    """
    text = re.sub(r"^known = \[\n(?:  \{.*\},\n)*\]\n", "", sheet, flags=re.MULTILINE)
    if imu_from(Source("sheet", "data sheet of the calibration", text)).entry.known:
        raise StandError(
            "data sheet of the calibration: known: must not be there, a calibration takes its place"
        )
    return text


def _has_range(sheet: str, sensor: str) -> bool:
    spec = imu_from(Source("sheet", "data sheet of the calibration", sheet))
    triad = spec.gyro if sensor == "gyro" else spec.accel
    return bool(np.isfinite(triad.full_scale))


def _known(key: Key, value: float, unit: str, sigma: float) -> str:
    toward = "" if key.toward is None else f', toward = "{AXES[key.toward]}"'
    return (
        f'{{ sensor = "{key.sensor}", term = "{key.term}", axis = "{AXES[key.axis]}"{toward}, '
        f'value = {value!r}, unit = "{unit}", sigma = {sigma!r} }}'
    )


def _sheet(record: CalibrationRecord) -> str:
    """A data sheet of what was found, where nobody has another: rms of the axes."""
    title = record.unit.get("title") or record.source.get("recording") or "calibrated unit"
    said = 'kind = "assumed", source = "rms of the axes, as calibrated"'
    lines = [f"title = {json.dumps(title)}", 'grade = "reference"', 'evidence = "none"']
    for sensor, bias, unit in (
        ("gyro", "turn_on_bias_deg_h", DEG_PER_HOUR),
        ("accel", "turn_on_bias_mg", 1e3 * MICRO_G),
    ):
        lines.append(f"[{sensor}]")
        for term, name, size in (("bias", bias, unit), ("scale", "scale_factor_ppm", 1e-6)):
            own = [
                p.value
                for p in record.calibration.parameters
                if (p.key.sensor, p.key.term) == (sensor, term)
            ]
            if own:
                rms = float(np.sqrt(np.mean(np.square(own)))) / size
                lines.append(f"{name} = {{ value = {rms!r}, {said} }}")
    return "\n".join(lines) + "\n"


# --- shared --------------------------------------------------------------------------------------


def _constants(record: CalibrationRecord, sensor: str) -> TriadConstants:
    c = record.calibration
    return constants_of(c.keys, c.values, "gyro" if sensor == "gyro" else "accel")


def _left(record: CalibrationRecord, sensor: str, terms: tuple[str, ...]) -> list[str]:
    """What of a triad a form cannot say, of such terms."""
    own = [p.key.term for p in record.calibration.parameters if p.key.sensor == sensor]
    told = [term for term in dict.fromkeys(own) if term in terms]
    return [f"not in this form: {sensor} {', '.join(told)}"] if told else []


def _numbers(row: Array) -> str:
    return " ".join(repr(float(v) + 0.0) for v in row)


FORMS: Mapping[str, Callable[[CalibrationRecord, Path], dict[Path, str]]] = {
    "toml": preset_files,
    "imu_tk": imu_tk_files,
    "kalibr": kalibr_files,
    "python": python_files,
    "c": c_files,
}
_ENDINGS = {
    ".toml": "toml",
    ".calib": "imu_tk",
    ".yaml": "kalibr",
    ".yml": "kalibr",
    ".py": "python",
    ".c": "c",
    ".h": "c",
}
