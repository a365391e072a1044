"""Reports: how numbers are written, what each table holds, and that no text breaks a table."""

import re
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from alignment import ESTIMATORS, AttitudeEstimate
from alignment.angles import C_nb_from_angles, Sequence
from alignment.units import DEG
from stand.evaluation.run_result import RunResult
from stand.evaluation.score import Refusal, Score, Truths, score
from stand.imu import load_imu
from stand.procedure.procedure import load_procedure
from stand.report.console import WIDTH, console, render, show
from stand.report.document import (
    angle,
    config_document,
    markdown,
    motion_table,
    number,
    report_document,
    score_tables,
    sigma_text,
)
from stand.report.listing import listing
from stand.report.tables import TableData
from stand.simulation.settings import assembled
from stand.simulation.step_record import StepRecord, record_to_json
from stand.table.table import load_table

YPR, YRP = Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (1.23456, "+1.2346"),
        (-0.0005, "-0.0005"),
        (-0.000499, "-5.0e-04"),
        (4.2e-14, "+4.2e-14"),
        (9.99994, "+9.9999"),
        (-10.006, "-10.01"),
        (179.999, "+180.00"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0123, "± 0.01"),
        (0.5, "± 0.5"),
        (3.6, "± 4"),
        (9.4, "± 9"),
        (9.7, "± 10"),
        (32.4, "± 32"),
        (1e-7, "± 1e-07"),
    ],
)
def test_sigmas_have_one_digit(value, text):
    assert sigma_text(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(-1e-9, "0.0000"), (89.99996, "90.0000"), (-180.0, "-180.0000")]
)
def test_angles_have_four_decimals_and_no_negative_zero(value, text):
    assert angle(value) == text


# --- tables


def scored(
    label: str,
    error_deg: float | None,
    method: str = "rk4",
    window: str = "",
    sequence: Sequence = YPR,
    covariance: np.ndarray | None = None,
    pitch: float = 0.0,
    flags: tuple[str, ...] = (),
    **latitude: float,
) -> Score:
    """An estimate that is off by `error_deg` in yaw; told truth is 0, nominal twice as far."""
    C_nb = C_nb_from_angles(sequence, 0.0, (error_deg or 0.0) * DEG, pitch * DEG)
    estimate = AttitudeEstimate(
        method, label, 0, 10, C_nb, sequence, window, covariance, flags=flags, **latitude
    )
    truth = C_nb_from_angles(sequence, 0.0, 0.0, pitch * DEG)
    nominal = C_nb_from_angles(sequence, 0.0, -(error_deg or 0.0) * DEG, pitch * DEG)
    return score(estimate, Truths() if error_deg is None else Truths(truth, nominal))


def test_a_table_of_errors_with_its_footers():
    sure = np.eye(3) * (0.2 * DEG) ** 2
    rows = [scored("A", 1.0, covariance=sure), scored("B", 3.0, covariance=sure)]
    (table,) = score_tables(rows)
    assert table.title == f"rk4 [deg]: {ESTIMATORS['rk4'].title}"
    assert table.columns == (
        "position",
        "turns",
        "roll",
        "yaw",
        "pitch",
        "error roll",
        "error yaw",
        "error pitch",
    )
    assert table.rows == (
        ("A", "y-p-r", "0.0000", "1.0000", "0.0000", "0 ± 0.2", "+1.0000 ± 0.2", "0 ± 0.2"),
        ("B", "y-p-r", "0.0000", "3.0000", "0.0000", "0 ± 0.2", "+3.0000 ± 0.2", "0 ± 0.2"),
    )
    # yaw errors 1 and 3: n-1 deviation sqrt(2), RMS sqrt(5); to nominal 2 and 6: sqrt(20)
    assert table.footers == (
        ("sigma (n-1)", "", "", "", "", "0", "1.41", "0"),
        ("RMS", "", "", "", "", "0", "2.24", "0"),
        ("RMS nominal", "", "", "", "", "0", "4.47", "0"),
    )
    assert table.notes == (ESTIMATORS["rk4"].note,)


def test_published_deviations_stand_beside_the_papers_own_positions_alone():
    names = [f"{axis}1 {way}" for axis in "XYZ" for way in ("up", "down")]
    (table,) = score_tables([scored(name, 1.0) for name in names])
    assert table.footers[-1] == ("published [S0]", "", "", "", "", "0.214", "0.223", "0.385")
    for others in (names[:5], [*names, "Y1 leaning"]):
        (table,) = score_tables([scored(name, 1.0) for name in others])
        assert not any(row[0].startswith("published") for row in table.footers)


def test_one_position_has_no_deviations():
    (table,) = score_tables([scored("A", 1.0)])
    assert table.footers == ()
    assert table.rows[0][6] == "+1.0000"


def test_a_log_without_truth_shows_heading_and_sigmas():
    sure = np.eye(3) * (0.2 * DEG) ** 2
    rows = [
        scored("A", None, "triad", covariance=sure, latitude=48.5 * DEG, latitude_sigma=0.1 * DEG),
        scored("B", None, "triad", sequence=YRP, pitch=90.0, latitude=48.25 * DEG),
    ]
    (table,) = score_tables(rows)
    assert table.columns[5:] == ("heading", "sigma roll", "sigma yaw", "sigma pitch", "latitude")
    assert table.rows[0][5:] == ("0.0000", "± 0.2", "± 0.2", "± 0.2", "48.500 ± 0.1")
    assert table.rows[1][1:] == ("y-r-p", *["0.0000"] * 2, "90.0000", "none", "", "", "", "48.250")
    assert table.footers == ()


def test_a_singular_position_says_so():
    rows = [scored("A", 0.0, sequence=YPR, pitch=90.0, covariance=np.eye(3))]
    (table,) = score_tables(rows)
    assert table.rows[0][1] == "singular"
    assert "±" not in "".join(table.rows[0])


def test_one_table_per_method_and_window():
    rows = [
        scored("A", 1.0, "six-position", "same"),
        scored("A", 2.0, "six-position", "fresh"),
        scored("A", 3.0, "triad"),
        score(
            AttitudeEstimate(
                "triad", "A + B", 0, 9, None, YPR, "pair", latitude=0.5, latitude_sigma=0.01
            ),
            Truths(),
        ),
    ]
    titles = [table.title for table in score_tables(rows)]
    assert [t.split(" [deg]")[0] for t in titles] == [
        "six-position, same window",
        "six-position, fresh window",
        "triad",
        "triad, opposed pairs",
    ]
    pair = score_tables(rows)[3]
    assert pair.columns == ("positions", "latitude")
    assert pair.rows == (("A + B", "28.648 ± 0.6"),)  # 0.5 rad, 0.01 rad


def test_flags_become_notes_with_their_positions():
    rows = [
        scored("A", 1.0, flags=("both", "only A")),
        scored("B", 1.0, flags=("both",)),
    ]
    (table,) = score_tables(rows)
    assert table.notes[1:] == ("both", "A: only A")


# --- what the servo did


def servo_records() -> tuple[StepRecord, ...]:
    """A rest that settled, a move at its limit, a rest that never settled."""
    arc_s = np.pi / 180 / 3600
    none = np.zeros(6)
    lag = np.array([0, 0, 0, 1, 12.34, 2]) * arc_s
    wild = np.array([0, 1234.5, 0, 0, 0, 0]) * arc_s
    full = np.array([0, 0, 0, 0.2, 0.1, 1.0])
    return (
        StepRecord("X1 up", "dwell", 0, 60, lag, lag / 4, none, full / 10, True, 0.256),
        StepRecord("to Y1 up", "move", 60, 64, wild, wild / 2, full * 0.35, full, False),
        StepRecord("Y1 up", "dwell", 64, 99, none, none, none, none, True),
    )


def test_a_table_of_what_the_servo_did():
    table = motion_table(servo_records())
    assert table.columns == (
        "step",
        "kind",
        "error max arc s",
        "rms arc s",
        "settled after s",
        "saturated s",
        "torque % of limit",
    )
    assert table.rows == (
        ("X1 up", "dwell", "12.3 middle", "3.08", "0.26", "0", "10 inner"),
        ("to Y1 up", "move", "1234 base_pitch", "617", "", "0.35 inner", "100 inner"),
        ("Y1 up", "dwell", "0", "0", "never", "0", "0"),
    )


def test_the_servo_for_machines_has_its_units_in_the_keys():
    json = record_to_json(servo_records()[1])
    assert json["following_max_arc_s"]["base_pitch"] == pytest.approx(1234.5, rel=1e-12)
    assert json["following_rms_arc_s"]["base_pitch"] == pytest.approx(617.25, rel=1e-12)
    assert json["torque_percent"]["outer"] == pytest.approx(20.0, rel=1e-12)
    assert json["saturated_s"]["inner"] == pytest.approx(0.35, rel=1e-12)
    assert (json["t_from_s"], json["t_to_s"], json["settled_after_s"]) == (60, 64, None)
    assert (json["label"], json["kind"], json["rests"]) == ("to Y1 up", "move", False)


# --- markdown and the terminal


def cells(line: str) -> list[str]:
    """Cells of a line of GitHub markdown; an escaped bar parts nothing."""
    assert line.startswith("| ")
    assert line.endswith(" |")
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def test_markdown_is_well_formed():
    rows = [scored("A | B", 1.0), scored("[red]C", -20.0)]
    (table,) = score_tables(rows)
    lines = [line for line in markdown(table).splitlines() if line.startswith("|")]
    width = len(table.columns)
    assert lines[1] == "|---" + "|---:" * (width - 1) + "|"
    shown = [cells(line) for line in lines if line is not lines[1]]
    assert [len(row) for row in shown] == [width] * (1 + 2 + 3)
    assert shown[0] == list(table.columns)
    assert [row[0] for row in shown[1:]] == [
        "A \\| B",
        "[red]C",
        "*sigma (n-1)*",
        "*RMS*",
        "*RMS nominal*",
    ]
    assert shown[2][6] == "-20.00"
    assert shown[3][1] == ""
    assert f"- {ESTIMATORS['rk4'].note}" in markdown(table).splitlines()


def test_the_terminal_shows_every_cell_as_it_is():
    table = TableData(
        "Title [x]",
        ("position", "a"),
        (("[red]A[/]", "1"), ("B", "2")),
        (("sum [b]", "3"),),
        ("N",),
    )
    out = StringIO()
    show(Console(file=out, width=80), [table])
    lines = [line.split() for line in out.getvalue().splitlines()]
    assert lines[0] == ["Title", "[x]"]
    for expected in (["[red]A[/]", "1"], ["B", "2"], ["sum", "[b]", "3"], ["N"]):
        assert expected in lines
    assert render(table) is not None


def test_numbers_keep_their_column_where_words_make_room():
    rows = tuple(("id", "many words that may wrap " * 3, "12345.0") for _ in range(2))
    table = TableData("T", ("id", "title", "base travel deg"), rows)
    out = StringIO()
    show(Console(file=out, width=40), [table])
    text = out.getvalue()
    assert "12345.0" in text
    assert [line.split()[-1] for line in text.splitlines()[1:5] if line.strip()] == [
        "base",
        "travel",
        "deg",
    ]


def test_a_pipe_gets_wide_tables(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert console().width == WIDTH


# --- documents


def result(tmp_path, text: str = "", records: tuple[StepRecord, ...] = ()) -> RunResult:
    procedure, imu = load_procedure("six-position"), load_imu("stim300")
    if text:
        procedure = replace(procedure, text=text)
    settings = assembled(procedure, imu, load_table("laboratory"))
    plan = type("Plan", (), {"motion": type("Motion", (), {"duration": 384.0})})
    scores = (scored("A", 1.0), scored("B", 3.0))
    return RunResult(tmp_path, settings, plan, 76800, (0,) * 6, records, scores, (), ())


def test_the_report_says_what_was_run(tmp_path):
    document = report_document(result(tmp_path))
    assert document.startswith("# Six-position test\n\n")
    assert (
        "Safran STIM300, 10 g accelerometers, seed 0; 384 s at 200 Hz (mean samples), "
        "latitude 48.5 deg, g = 9.8093587 m/s2." in document
    )
    assert "| *RMS* |" in document
    assert "heading = -yaw" in document


def test_the_report_of_a_servo_run_shows_its_steps(tmp_path):
    document = report_document(result(tmp_path, records=servo_records()))
    assert "| to Y1 up | move | 1234 base_pitch | 617 |  | 0.35 inner | 100 inner |" in document
    assert "Joints by the simulated servo: Laboratory three-axis table on a rock" in document
    assert "servo" not in report_document(result(tmp_path))
    nothing = replace(result(tmp_path), scores=(), refusals=(Refusal("a", "b"), Refusal("c", "d")))
    text = report_document(nothing)
    assert text.endswith("a gives no estimate: b\n\nc gives no estimate: d\n")  # two paragraphs


def test_the_configuration_holds_the_files_in_closed_fences(tmp_path):
    document = config_document(result(tmp_path, text="no = 'newline at its end'"))
    assert "## Procedure: six-position\n\n```toml\nno = 'newline at its end'\n```\n" in document
    assert "## IMU: stim300\n\n```toml\n" in document
    assert "## Table: laboratory\n\n```toml\n" in document
    assert [line for line in document.splitlines() if "```" in line] == ["```toml", "```"] * 3


# --- lists


def test_lists_by_hand():
    imus = {row["id"]: row for row in listing("imus")}
    assert imus["stim300"]["ARW deg/rt-h"] == 0.15
    assert imus["stim300"]["bias mg"] == 1.9
    assert imus["ring-laser"]["grade"] == "navigation RLG"
    procedures = {row["id"]: row for row in listing("procedures")}
    assert procedures["six-position-published"]["steady_s"] == 1800.0
    assert procedures["six-position"]["steps"] == "6 dwell"
    # 360 deg thrice at 4 deg/s, there and back, between rests of 26 s
    assert procedures["carousel"]["steady_s"] == 2 * 270.0 + 2 * 26.0
    assert procedures["carousel"]["steps"] == "2 dwell, 1 rate"
    assert procedures["random-sway"]["steps"] == "1 dwell; sway behind"
    tables = {row["id"]: row for row in listing("tables")}
    assert tables["laboratory"]["base deg"] == "±20"
    assert tables["laboratory"]["rate deg/s"] == pytest.approx(200.0, rel=1e-12)
    assert tables["laboratory"]["servo Hz"] == 20.0
    assert tables["laboratory"]["wobble arc s"] == 0.0
    methods = {row["id"]: row["needs latitude"] for row in listing("methods")}
    assert (methods["six-position"], methods["triad"]) == ("yes", "no")


@pytest.mark.parametrize("what", ["procedures", "imus", "tables", "methods"])
def test_every_row_of_a_list_has_the_same_columns(what):
    rows = listing(what)
    assert len({tuple(row) for row in rows}) == 1
    assert all(row["id"] and row["title"] for row in rows)
