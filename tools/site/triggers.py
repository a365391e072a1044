"""Wrong inputs, a line each: what they are answered with are the examples of the index of faults.

    python tools/site/faults.py tools/site/triggers.py   # some 10 s; all tests take minutes

What a command line can do wrong is a line of `LINES`, what Python can a call of `CALLS`. Files that
they name are made by `furnished`. `faults.py` notes what was said; here it only must be a known
fault.
"""

from __future__ import annotations

import gzip
import os
import shlex
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import stand
from alignment.errors import Fault
from stand.cli.app import app, guarded
from stand.imu.unit import Unit
from stand.proposal.wanted import load_wanted
from stand.report.templates import template

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = "--gyro-unit rad/s --accel-unit m/s^2"
IN_ORDER = f"--columns t,gx,gy,gz,ax,ay,az {OPTIONS}"

SWEEP = """
title = "Two rests"
procedure = "short.toml"
imu = "hg9900"
rate_hz = 5
methods = ["triad"]
runs = 1
[[vary]]
name = "rest [s]"
key = "{key}"
values = {values}
"""
PROCEDURE = """
title = "Short"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
[[step]]
kind = "dwell"
label = "up"
duration_s = 20
"""
TWICE = (
    PROCEDURE
    + """
[[step]]
kind = "dwell"
label = "up"
duration_s = 20
"""
)
WITH = {  # as `short.toml` with another text in place of the first
    "window.toml": ('["triad"]', '["six-position"]\noffset_window_s = 0.1'),
    "behind.toml": ('["triad"]', '["six-position"]\noffset_window_s = 20.0'),
    "rocked.toml": ('["triad"]', '["two-position"]'),
    "hour.toml": ("duration_s = 20", "duration_s = 400000"),
}
ROCKING = """
[[background]]
kind = "sway"
axes.base_yaw = { rms_deg = 0.1, frequency_hz = 1.0, damping = 0.2 }
"""

MADE = "campaign sweep.toml --out made"  # the first time it is one

LINES = f"""
film sample --out x.avi
film sample --out x.mp4 --size 321x180
film sample --out x.mp4 --size big
film sample --out x.mp4 --speed 0
film sample --out x.mp4 --from 20 --to 10
film sample --out x.mp4 --method triads
film sample --out x.mp4 --joints out=outer
film sample --out x.mp4 --joints outer=outward
film log.csv --out x.mp4
picture sample --at 75 --out x.jpg
picture sample --at 7500 --out x.png
picture sample --at 75 --camera front --out x.png
report sample --out sample
report log.csv --film {OPTIONS}
report log.mcap --film
view log.csv --out x.txt {OPTIONS}
propose --heading 0.5 --procedure short.toml
propose short.toml --heading 0.5
propose asks.toml
compare
compare --only S0
compare --published --only S9
compare short.toml --format f8le
compare short.toml --runs 0
compare short.toml --runs 10000001
compare short.toml --stretches over.toml
run short.toml --out short.toml/x
picture sample --at 75 --camera 0,0,0 --out x.png
view log.csv --to nan --out x.rrd {OPTIONS}
import log.csv --wrap 1e300 --out x.mcap {OPTIONS}
import log.csv --gyro-scale 1e300 --out x.mcap {OPTIONS}
compare short.toml --runs 1 --keep sample
compare short.toml --runs 1 --keep log.csv
compare short.toml --runs 1 --scheduler nowhere
compare short.toml --runs 1 --scheduler tcp://127.0.0.1:1
compare empty.toml --runs 1
compare sample sample --methods triads
export sample --out x.xlsx
export sample --out x --format xlsx
export short.toml --out nowhere/x.csv
export short.toml --out sample
export hour.toml --out x.csv
new imu .x
campaign record
campaign sweep.toml --case 2
campaign nowhere
campaign sample
campaign sweep.toml --out sample
campaign step.toml --plan
campaign key.toml --plan
campaign deeper.toml --plan
campaign whole.toml --plan
campaign twice.toml --plan
campaign entry.toml --plan
campaign many.toml --plan
campaign dots.toml --plan
{MADE}
{MADE}
campaign step.toml --out made --resume
campaign record made --case 9 --seed 0
campaign record made --case 1 --seed 9
run short.toml --without nothing
run window.toml --rate 5
run short.toml --rate 0
rehearse short.toml --verify 0
rehearse rocked.toml
rehearse behind.toml
align
align nowhere
align .
align log.csv --rate 0
align log.csv --stamps never {OPTIONS}
align log.csv --sampling never {OPTIONS}
align sample --sampling instant
align log.csv --topic /imu {OPTIONS}
align log.csv --stretches log.csv {OPTIONS}
align log.csv --columns t,sec,nanosec,gx,gy,gz,ax,ay,az {OPTIONS}
align log.csv --columns t,gx,gy,gz,ax,ay {OPTIONS}
align log.csv --columns t,gx,gy,gz,ax,ay,az,- {OPTIONS}
align log.csv --columns t=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=9 {OPTIONS}
align stamps.csv {IN_ORDER}
align iso.csv --wrap 5 --time-unit iso {IN_ORDER}
align alike.csv --columns t=t,gx=g,gy=3,gz=4,ax=5,ay=6,az=7 {OPTIONS}
align one.csv {IN_ORDER}
align twice.gz {IN_ORDER}
import twice.gz
import log.bin
import log.mcap --topic /imu/dat
import words.npz
import book.xlsx
align book.xlsx {IN_ORDER}
import empty.zip
import objects.npy
align log.bin --format f8le --columns t=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=7 {OPTIONS}
align log.bin --format f8le --skip-bytes 99999 {IN_ORDER}
align words.npz {OPTIONS}
align names.npy {IN_ORDER}
align narrow.npy {IN_ORDER}
align wide.npy {IN_ORDER}
align log.csv --method vectors {OPTIONS}
align log.mcap --method vectors
align sample --method vectors --start-attitude 0,0 --start-sigma 1
align sample --method vectors --start-attitude 0,0,0 --start-sigma 0
align sample --method vectors --start-attitude 0,0,0 --start-sigma 1 --fix-sigma 0,1
align sample --from 5 --to 1
align sample --stretches joint.toml
allan sample --from 5 --to 1
stretches log.csv --shortest 0 {OPTIONS}
calibrate log.csv {OPTIONS}
calibrate huge.json
apply huge.json log.csv --out x.mcap {OPTIONS}
drive weaving --rate 0
drive weaving --seed -1
align untimed.csv {IN_ORDER}
align weeks.npz --columns week=1,tow=2,gx=3,gy=4,gz=5,ax=6,ay=7,az=8 {OPTIONS}
align timed.npz {IN_ORDER}
align turns.toml
align sample --stretches turns.toml
align sample --stretches over.toml --method multi-position
align sample --stretches unknown.toml --method multi-position --latitude 48.5
align still.csv --method single-gyro {IN_ORDER}
align cut.npy {IN_ORDER}
align plain.h5 --topic x {OPTIONS}
import short.npz
run short.toml --model nowhere.xml
report log.mcap --out sample
recover log.mcap
recover nowhere
recover log.csv
recover sample/run.mcap
list nothing
"""


def unit(**more: object) -> Unit:
    return stand.unit("ideal", **({"rate_hz": 10, "seed": 0} | more))  # pyright: ignore[reportArgumentType]


def blocks(t: object, w: object = ((0, 0, 0),), f: object = ((0, 0, 9.8),)) -> None:
    unit().report(t, w, f)  # pyright: ignore[reportArgumentType]


def other_text() -> None:
    made = unit()
    made.sheet = replace(made.sheet, text=made.sheet.text.replace("[gyro]", "[gyro]\nrange_deg_s = "
        '{ value = 400, kind = "typical", source = "by hand" }'))  # fmt: skip
    made.state()


def state(**more: object) -> None:
    Unit.from_state(unit().state() | more)


CALLS: tuple[Callable[[], object], ...] = (
    lambda: unit(rate_hz=0.5),
    lambda: blocks([[0.1]]),
    lambda: blocks([np.nan]),
    lambda: blocks(["now"]),
    lambda: blocks([0.1], [[0, 0]]),
    lambda: blocks([0.13]),
    lambda: blocks([0.1, 0.3], [[0, 0, 0]] * 2, [[0, 0, 9.8]] * 2),
    other_text,
    lambda: state(version="0"),
    lambda: state(seed="x"),
    lambda: state(inside={}),
    lambda: state(sampling="never"),
    lambda: stand.read(3),  # pyright: ignore[reportArgumentType]
    lambda: stand.align(3),  # pyright: ignore[reportArgumentType]
    lambda: stand.align([]),
    lambda: stand.simulate("six-position"),  # pyright: ignore[reportArgumentType]
    lambda: stand.settings("short.toml", without=["nothing"]),
    lambda: stand.unit("stim300", rate_hz=10, without=["nothing"]),
    lambda: stand.catalogue("unit"),
    lambda: stand.allan("sample", terms=["X"]),
    lambda: template("units", "mine"),
    lambda: load_wanted("mine"),
    lambda: stand.calibrate([]),
    lambda: stand.compare(stand.settings("short.toml"), 0),
    lambda: stand.settings("short.toml", seed="x"),  # pyright: ignore[reportArgumentType]
    lambda: stand.settings("short.toml", seed=-1),
    lambda: stand.rehearse(stand.settings("short.toml"), verify=0),
)


def said(line: str) -> int:
    """Exit code of a command in this process."""
    return guarded(lambda: app(shlex.split(line), standalone_mode=False))


@pytest.fixture(scope="module")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that a line names."""
    folder = tmp_path_factory.mktemp("triggers")
    copytree(ROOT / "recordings" / "sample", folder / "sample")
    texts = {"short.toml": PROCEDURE, "twice-up.toml": TWICE, "rocked.toml": PROCEDURE + ROCKING}
    texts |= {name: PROCEDURE.replace(*change) for name, change in WITH.items()}
    texts["rocked.toml"] += ROCKING
    texts["empty.toml"] = PROCEDURE.replace('"dwell"', '"move"').replace(
        "duration_s = 20", "joints_deg = { outer = 10 }"
    )
    rest = "step.up.duration_s"
    sweeps = {
        "sweep": (rest, [20, 30]), "step": ("step.down.duration_s", [20]), "key": ("steps.up", [1]),
        "deeper": (f"{rest}.value", [1]), "whole": ("site", [1]), "dots": ("step..x", [1]),
        "entry": ("imu", [1]), "many": (rest, list(range(1, 200_000))),
    }  # fmt: skip
    texts |= {f"{name}.toml": SWEEP.format(key=k, values=v) for name, (k, v) in sweeps.items()}
    texts["twice.toml"] = texts["sweep.toml"].replace("short.toml", "twice-up.toml")
    texts["asks.toml"] = 'title = "x"\n[require]\nheadings_deg = 1\n'
    texts["joint.toml"] = (
        '[[stretch]]\nkind = "turn"\nlabel = "a"\nfrom_s = 1.0\nto_s = 9.0\njoint = "out"\n'
        "attitude_deg = { roll = 0.0, yaw = 0.0, pitch = 0.0 }\n"
    )
    rows = [f"{k / 10},0,1e-5,0,0,9.81,{k % 2 * 1e-3}" for k in range(300)]
    texts["log.csv"] = "t,gx,gy,gz,ax,ay,az\n" + "\n".join(rows) + "\n"
    texts["one.csv"] = rows[0] + "\n"
    texts["stamps.csv"] = "\n".join(["now" + rows[1][3:], *rows[1:]]) + "\n"
    texts["iso.csv"] = "2026-01-01T00:00:00" + rows[0][3:] + "\n2026-01-01T00:00:01" + rows[1][3:]
    texts["untimed.csv"] = "\n".join([*rows[:50], "now" + rows[50][3:]]) + "\n"
    texts["still.csv"] = texts["log.csv"].replace(",0,1e-5,0,", ",0,9e-5,9e-5,")
    stretch = (
        '[[stretch]]\nkind = "dwell"\nlabel = "{}"\nfrom_s = {}\nto_s = {}\n'
        "attitude_deg = {{ roll = 0.0, yaw = {}, pitch = 0.0 }}\n"
    )
    texts["over.toml"] = stretch.format("a", 1, 30, 0) + stretch.format("b", 20, 40, 90)
    texts["unknown.toml"] = "".join(
        stretch.format(*four).rpartition("attitude")[0]
        for four in (("a", 1, 30, 0), ("b", 70, 90, 0))
    )
    texts["alike.csv"] = texts["log.csv"].replace("t,gx,gy", "t,g,g")
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    _arrays(folder, np.array([[float(x) for x in row.split(",")] for row in rows]))
    return folder


def _arrays(folder: Path, table: np.ndarray) -> None:
    """The kinds of file that are no text."""
    table.astype("<f8").tofile(folder / "log.bin")
    (folder / "twice.gz").write_bytes(gzip.compress(gzip.compress(table.tobytes())))
    np.savez(folder / "words.npz", words=np.array(["a", "b"]))
    np.save(folder / "objects.npy", np.array([{}], object), allow_pickle=True)
    np.save(folder / "names.npy", table.astype(str))
    week = np.column_stack([np.full(300, -5.0), table])
    np.savez(folder / "weeks.npz", table=week)
    np.savez(folder / "timed.npz", table=np.where(table[:, :1] == 1.0, np.nan, table))
    np.savez(folder / "short.npz", t=np.zeros(1))
    np.save(folder / "cut.npy", table)
    (folder / "cut.npy").write_bytes((folder / "cut.npy").read_bytes()[:-99])
    np.save(folder / "narrow.npy", table[:, :6])
    np.save(folder / "wide.npy", np.column_stack([table, table]))
    with zipfile.ZipFile(folder / "book.xlsx", "w") as book:
        book.writestr("xl/workbook.xml", "<workbook/>")
    with zipfile.ZipFile(folder / "empty.zip", "w") as book:
        book.writestr("read.me", "nothing")
    (folder / "huge.json").write_bytes(b" " * (65 << 20))
    assert said(f"import {folder}/log.csv {OPTIONS} --out {folder}/log.mcap") == 0


@pytest.mark.parametrize("line", LINES.strip().splitlines())
def test_line(furnished: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.chdir(furnished)
    monkeypatch.setitem(os.environ, "MUJOCO_GL", "egl")
    assert said(line) in (1, 2) or line.startswith(("import", "rehearse", MADE))


@pytest.mark.parametrize("call", CALLS)
def test_call(furnished: Path, monkeypatch: pytest.MonkeyPatch, call: Callable[[], object]) -> None:
    monkeypatch.chdir(furnished)
    with pytest.raises(Fault):
        call()
