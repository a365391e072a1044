"""Damaged texts: TOML of every kind, metadata of a recording, result.json, columns of a motion.

Bytes are damaged as those of logs are; or a value is replaced by what no number, name or list of
that place can be, or a line is cut out or doubled. Each is taken, or refused in one line.
"""

import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import stand
from stand.columns import read_columns
from stand.errors import located
from stand.imu import load_imu
from stand.procedure.procedure import load_procedure
from stand.recording.mcap.reader import read_metadata
from stand.recording.metadata import (
    drive_of,
    epoch_of,
    interrupted_at,
    planned_stretches,
    recorded_imu,
    recorded_steps,
    settings_of,
    settled_stretches,
)
from stand.recording.named_stretches import load_stretches
from stand.simulation.simulation import Simulation
from stand.simulation.step_record import StepRecord, record_to_json, records_from_json
from stand.table.table import load_table
from stand.vehicle.scenario import load_drive

ROOT = Path(__file__).resolve().parents[1]
KINDS = ("TOML", "planned", "metadata", "result", "columns")
Read = Callable[[Path], object]

# what stands in a text as a value, a key or a bracket
_VALUE = re.compile(rb'"[^"\n]*"|-?\d[\d.eE+-]*|true|false|null|[\[\]{},=:]')
_ODD = (
    *("0", "-1", "1e308", "-1e308", "1e400", "nan", "inf", "NaN", "Infinity", "1e-320"),
    *("9223372036854775808", "-9223372036854775809", "1" + "0" * 400, "0x7fffffff", "1_000"),
    *('""', '"a"', '"\\u0000"', '"\\u001b[2J"', '"../../etc/passwd"', '"=1+1"', "\n", "#"),
    *("true", "null", "[]", "{}", "[1, 2, 3]", "[[1]]", "1979-05-27", "''", "=", "[" * 2000),
    '"' + "a" * 5000 + '"',
)
ODD = (*(text.encode() for text in _ODD), b'"\xff\xfe"')

STRETCHES = """[site]
latitude_deg = 48.5
[[stretch]]
kind = "dwell"
label = "a"
from_s = 0.0
to_s = 10.0
attitude_deg = { roll = 0, yaw = 0, pitch = 90 }
[[stretch]]
kind = "turn"
label = "b"
from_s = 12.0
to_s = 20.5
axis = "Y1"
joint = "inner"
"""


def seeds() -> dict[str, list[tuple[bytes, Read]]]:
    """By kind, texts that are right, and how they are read."""
    found: dict[str, list[tuple[bytes, Read]]] = {kind: [] for kind in KINDS}
    loaders: Mapping[str, Callable[[str], object]] = {
        "procedures": load_procedure,
        "imus": load_imu,
        "tables": load_table,
        "trajectories": load_drive,
    }
    for folder, load in loaders.items():
        for path in sorted((ROOT / "stand" / folder).glob("*.toml")):
            found["TOML"].append((path.read_bytes(), lambda path, load=load: load(str(path))))
    found["TOML"].append((STRETCHES.encode(), lambda path: load_stretches(path).stretches()))
    for name in ("two-position", "static"):
        text = (ROOT / "stand" / "procedures" / f"{name}.toml").read_bytes()
        found["planned"].append((text, _planned))
    metadata = read_metadata(next((ROOT / "recordings" / "sample").rglob("run.mcap")))
    for extra in ({}, {"settled": {"X1 up": "12.5"}}):
        found["metadata"].append((json.dumps(metadata | extra).encode(), _metadata))
    found["result"].append((json.dumps({"steps": [_step()] * 2}).encode(), _result))
    rows = ["time_s,inner_deg", *(f"{k / 10},{k}" for k in range(30))]
    found["columns"].append(
        ("\n".join(rows).encode(), partial(read_columns, file="p", most_rows=50))
    )
    return found


def altered_record(data: bytes, rng: np.random.Generator) -> bytes:
    """A record's text altered, in metadata as JSON: what a file can hold are names and texts."""
    metadata = json.loads(data)
    name = str(rng.choice(sorted(metadata)))
    record = metadata[name]
    key = str(rng.choice(sorted(record)))
    record[key] = altered(record[key].encode(), rng).decode(errors="replace")
    if rng.random() < 0.1:
        del record[key]
    return json.dumps(metadata).encode()


def _planned(path: Path) -> None:
    """As far as before the first sample."""
    Simulation(stand.settings(str(path), rate_hz=10))


def _metadata(path: Path) -> None:
    """All that is read of a recording's records."""
    known = json.loads(path.read_bytes())
    with located(str(path)):
        planned = planned_stretches(known)
        for read in (settings_of, drive_of, interrupted_at, recorded_imu, recorded_steps, epoch_of):
            read(known)
        settled_stretches(planned, known)


def _result(path: Path) -> None:
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return  # whose reader says so
    records_from_json(str(path), text)


def _step() -> dict[str, Any]:
    six = np.linspace(0.0, 1e-3, 6)
    return record_to_json(
        StepRecord(
            label="a",
            kind="dwell",
            t_from=0.0,
            t_to=10.0,
            following_max=six,
            following_rms=six,
            saturated=six,
            torque_ratio=six,
            rests=True,
            settled=0.5,
        )
    )


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """A value or two replaced, or a line cut out, doubled or moved."""
    for _ in range(int(rng.integers(1, 4))):
        places = list(_VALUE.finditer(data))
        lines = data.split(b"\n")
        at = int(rng.integers(0, len(lines)))
        match int(rng.integers(0, 6)):
            case 0:
                del lines[at]
                data = b"\n".join(lines)
            case 1:
                lines.insert(int(rng.integers(0, len(lines) + 1)), lines[at])
                data = b"\n".join(lines)
            case _ if places:
                place = places[int(rng.integers(0, len(places)))]
                odd = ODD[int(rng.integers(0, len(ODD)))]
                data = data[: place.start()] + odd + data[place.end() :]
    return data
