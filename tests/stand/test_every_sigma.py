"""Every place that shows a number: noise alone is said, a heading that cannot stand is not given.

One rule for all answers of the Python face, their tables, JSON and pages: beside a sigma for which
no sheet states more than noise stands "noise only", whichever sensor tells the quantity, and a
heading whose sigma is above 30 deg is told nowhere.
"""

import json
import re
from itertools import chain

import pytest
from procedures import HALF_TURN

import stand
from stand.calibration.file import record_to_json
from stand.campaigns.summary import summary_json
from stand.evaluation.aligned import alignment_json
from stand.evaluation.comparison import to_json as comparison_json
from stand.evaluation.side_by_side import side_by_side_json
from stand.evaluation.windows import scatter_to_json
from stand.rehearsal.result_json import rehearsal_json
from stand.report import campaign, certificate, log_page, proposal, rehearsal, run_page

ONLY, NO = "noise only", "not determined"
COLUMNS = "quantity", "sigma", "noise_only"
WALKS = {
    "gyro": "angle_random_walk_deg_rt_h",
    "accel": "velocity_random_walk_m_s_rt_h",
}
BIASES = {"gyro": "turn_on_bias_deg_h", "accel": "turn_on_bias_mg"}
ASKED = "methods = METHODS\n[require]\nheading_deg = 20"
SWEEP = """
title = "Sweep"
procedure = "half.toml"
imu = "unit.toml"
rate_hz = 5
runs = 2
[[vary]]
key = "imu.gyro.angle_random_walk_deg_rt_h"
values = [{walk}]
"""
SIGMA = re.compile(r"\b(sigma|predicted|expanded|stated|true table)\b")
NO_SIGMA = ("sigma before", "sigma (n-1)", "used", "known before")
BESIDE = ("means", "estimated beside")  # of readings, of table and seat
PLUS_MINUS = re.compile(r"± ?[>\d][^±|;,<]*")


def sheet(path, walk: float, **biases: float) -> str:
    """A unit's file: noise of both sensors, biases of those that are named."""
    stated = 'kind = "assumed", source = "made up here"'
    text = 'title = "Made up"\ngrade = "test"\nevidence = "none"\n'
    for sensor, key in WALKS.items():
        size = walk if sensor == "gyro" else 0.004
        text += f"[{sensor}]\n{key} = {{ value = {size}, {stated} }}\n"
        if sensor in biases:
            text += f"{BIASES[sensor]} = {{ value = {biases[sensor]}, {stated} }}\n"
    path.write_text(text)
    return str(path)


def made_with(folder, walk: float, methods=("triad", "two-position"), **biases: float):
    procedure = HALF_TURN.replace('methods = ["triad"]', ASKED)
    (folder / "half.toml").write_text(procedure.replace("METHODS", json.dumps(methods)))
    (folder / "sweep.toml").write_text(SWEEP.replace("{walk}", f"{walk}"))
    unit = sheet(folder / "unit.toml", walk, **biases)
    return stand.settings(str(folder / "half.toml"), imu=unit, rate_hz=5, seed=1, methods=methods)


def answers(folder, made):
    """What every command answers of a unit: its name, what prints itself, its JSON, its page."""
    run = stand.run(made, out=folder / "run")
    log = stand.read(folder / "run")
    told = json.loads((folder / "run" / "result.json").read_text())
    yield "run", run, told, lambda: run_page.page(folder / "run" / "run.mcap")
    found = stand.align(log, windows_s=[8.0])
    shown = alignment_json(found) | {"windows": [scatter_to_json(row) for row in found.windows]}
    yield "align", found, shown, lambda: log_page.page(log)
    pair = stand.side_by_side(log, log)
    yield "side by side", pair, side_by_side_json(pair), str
    planned = stand.rehearse(made, verify=3)
    yield "rehearse", planned, rehearsal_json(planned), lambda: rehearsal.page(planned)
    compared = stand.compare(made, runs=2, workers=1)
    yield "compare", compared, comparison_json(compared), str
    swept = stand.campaign(folder / "sweep.toml", out=folder / "swept", workers=1).run()
    summary = swept.summary()
    yield "campaign", swept, summary_json(summary), lambda: campaign.page(summary)


def more_answers(folder):
    """What is made of the bench: a calibration, a proposed test."""
    constants = stand.calibrate(stand.read(folder / "run"))
    yield "calibrate", constants, record_to_json(constants), lambda: certificate.page(constants)
    unit = str(folder / "unit.toml")
    best = stand.propose(heading_deg=20.0, imu=unit, latitude_deg=48.5, rate_hz=5)
    yield "propose", best, proposal.to_json(best), lambda: proposal.page(best)


def cells(table):
    """A table's cells with their columns."""
    for row in table.rows:
        yield from zip(table.columns, row, strict=True)


# what is no sigma of an estimate: priors, scatter, gravity, what the readings show
OTHERS = {"spreads", "gravity", "nuisance", "budget", "prior_sigma", "residuals", "covariance"}
OTHERS |= {"sigmas_of_means", "contributions"}
OF_SIGMA = re.compile("sigma|stated|predicted|expanded")


def numbers(told, path=(), known=False):
    """Sigmas in JSON: where they are, and whether beside them, or above, noise alone is said."""
    if isinstance(told, dict):
        known = bool(told.get("noise_only", known))
        for key, value in told.items():
            yield from numbers(value, (*path, key), known)
    elif isinstance(told, list):
        for one in told:
            yield from numbers(one, path, known)
    elif isinstance(told, float) and OF_SIGMA.match(path[-1]) and not set(path) & OTHERS:
        yield path, known


@pytest.mark.slow
def test_a_sigma_of_noise_alone_says_so_in_every_cell(tmp_path):
    made, seen = made_with(tmp_path, 0.05), set()
    for name, found, told, drawn in chain(answers(tmp_path, made), more_answers(tmp_path)):
        page = drawn()
        for table in found.tables():
            for column, cell in cells(table):
                if table.title.startswith(BESIDE):
                    continue
                is_sigma = SIGMA.search(column) and not column.startswith(NO_SIGMA)
                if (is_sigma and cell) or (PLUS_MINUS.search(cell)):
                    assert cell.count(ONLY) or cell == NO, (name, table.title, column, cell)
                    seen.add(name)
        for where, known in numbers(told):
            assert known, (name, where)
        text = re.sub("<[^>]*>", "|", page)
        for part in PLUS_MINUS.findall(text):
            # a log's first sentence says it of all of its sigmas, at its end
            of_all = name == "align" and "(±: of noise only)" in text
            assert ONLY in part or "mGal" in part or "%" in part or of_all, (name, part)
        assert not page or ONLY in page, name
        assert name != "calibrate" or told["parameters"]  # as without a sheet: all of them
        lacking = "states no drift of the gyros"
        assert name == "side by side" or lacking in page + str(told), name
    assert seen == {
        *("run", "align", "side by side", "rehearse", "compare", "campaign", "propose"),
        "calibrate",
    }


@pytest.mark.parametrize("known", ["gyro", "accel"])
def test_each_sensor_says_it_of_what_it_tells(tmp_path, known):
    """Biases of gyros alone: heading has them, tilts are of noise; and the other way round."""
    made = made_with(tmp_path, 0.05, **{known: 1.0})
    table, *_ = stand.run(made, out=tmp_path / "run").tables()
    for column, cell in cells(table):
        if column.startswith("error"):
            assert (ONLY in cell) is (("yaw" in column) is (known == "accel")), (column, cell)
    for p in stand.rehearse(made).predictions:
        of_gyros = "heading" in p.quantity or "gyro" in p.quantity
        assert p.noise_only is (of_gyros is (known == "accel")), p.quantity
    swept = stand.campaign(tmp_path / "sweep.toml", out=tmp_path / "swept", workers=1).run()
    rows = swept.columns()
    for quantity, sigma, alone in zip(*(rows[c] for c in COLUMNS), strict=True):
        of_gyros = quantity.startswith(("heading", "yaw", "gyro", "latitude"))
        assert alone == (sigma > 0 and of_gyros is (known == "accel")), quantity
    assert rows["noise_only"].any()


OF_GYROS = {"heading", "yaw", "latitude"}
OF_ROW = re.compile("sigma|scatter|rms|achieved|error")
FOUND = re.compile("(error_|rms_|error_nominal_)?(heading|yaw|latitude)_deg")
VALUES = ("estimate", "error", "rms", "mean", "low", "high", "predicted", "scatter_deg")


def headings(told):
    """Where JSON has a number of a heading, yaw or latitude that was found."""
    if isinstance(told, list):
        for one in told:
            yield from headings(one)
    elif isinstance(told, dict):
        of = told.get("quantity") in OF_GYROS
        for key, value in told.items():
            mine = (FOUND.fullmatch(key) and "method" in told) or (of and key in VALUES)
            if isinstance(value, float) and mine:
                yield key, told
            yield from headings(value)


@pytest.mark.slow
def test_a_heading_that_cannot_stand_is_told_nowhere(tmp_path):
    """A bias of 20 deg/h is 115 deg of heading at rest."""
    made = made_with(tmp_path, 0.05, ("triad", "inertial"), gyro=20.0, accel=1.0)
    for name, found, told, _ in answers(tmp_path, made):
        for table in found.tables():
            for row in table.rows:
                named = dict(zip(table.columns, row, strict=True))
                own = [c for k, c in named.items() if re.search("heading|yaw|latitude", k)]
                if OF_GYROS & set(row):
                    own += [c for k, c in named.items() if OF_ROW.match(k)]
                assert not re.search(r"\d", " ".join(own)), (name, table.title, row)
        assert not list(headings(told)), name
