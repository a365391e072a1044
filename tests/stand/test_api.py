"""The Python interface: its examples run, its results print, its unit serves others."""

import doctest
import inspect
import json
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

import stand
from alignment.errors import AlignmentError
from stand.imu import Imu, load_imu
from stand.imu.unit import Unit
from stand.samples import Sensed

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.IGNORE_EXCEPTION_DETAIL
FUNCTIONS = [name for name in stand.__all__ if name not in ("StandError", "__version__")]
RATE = 100


@pytest.fixture(scope="module")
def run():
    return stand.simulate(stand.settings("two-position", imu="ring-laser", rate_hz=5, seed=3))


# --- the face


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_example_of_every_name_runs(name):
    found = doctest.DocTestFinder(recurse=False).find(getattr(stand, name), name)
    assert sum(len(test.examples) for test in found) > 0
    runner = doctest.DocTestRunner(optionflags=FLAGS & ~doctest.IGNORE_EXCEPTION_DETAIL)
    told: list[str] = []
    for test in found:
        runner.run(test, out=told.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(told)


def test_every_argument_is_documented():
    for name in FUNCTIONS:
        function = getattr(stand, name)
        for argument in inspect.signature(function).parameters:
            if argument not in ("mistaken", "scenario", "imu"):
                assert f"{argument} :" in function.__doc__ or f"{argument}, " in function.__doc__
        assert "Raises" in function.__doc__


def test_the_face_is_listed_and_nothing_else_answers():
    assert set(stand.__all__) <= set(dir(stand))
    with pytest.raises(AttributeError, match="has no attribute 'simulat'"):
        _ = stand.simulat


def test_import_loads_nothing_heavy():
    code = (
        "import sys, stand\n"
        "heavy = {'mujoco', 'scipy', 'numpy', 'rerun', 'mcap', 'typer', 'rich', 'pydantic'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "assert stand.__version__\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_python_m_stand_is_the_command():
    told = subprocess.run(
        [sys.executable, "-m", "stand", "--version"], capture_output=True, text=True, check=True
    )
    assert told.stdout == f"stand {stand.__version__}\n"


def test_six_lines_of_a_notebook(tmp_path):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    settings = stand.settings("two-position", imu="stim300", rate_hz=5)
    run = stand.simulate(settings)
    found = stand.align(run)
    axes = Figure().subplots()
    axes.plot(run.t, run.w_ib_b - run.true_w_ib_b)
    fit = found.estimates[-1]  # of both positions: one alone has a heading sigma above 30 deg
    axes.set(title=f"heading {np.degrees(fit.heading):.2f} deg", xlabel="t [s]")
    assert len(axes.lines) == 3
    FigureCanvasAgg(axes.figure).print_png(tmp_path / "errors.png")


# --- a run in memory


def test_a_run_in_memory_is_the_recorded_one(run, tmp_path):
    result = stand.run(run.settings, out=tmp_path / "a")
    log = stand.read(result.out)
    np.testing.assert_array_equal(log.imu.w_ib_b, run.w_ib_b)
    np.testing.assert_array_equal(log.imu.f_b, run.f_b)
    recorded, memory = stand.align(log), stand.align(run)
    assert [e.label for e in recorded.estimates] == [e.label for e in memory.estimates]
    for a, b in zip(recorded.scores, memory.scores, strict=True):
        assert a.estimate.heading == b.estimate.heading
        assert a.heading_error == b.heading_error
        np.testing.assert_array_equal(a.estimate.covariance, b.estimate.covariance)
    # a path, a folder and several of them are read as they stand
    assert stand.align(str(result.out / "run.mcap"), "triad").logs[0].topic == "/imu/data"
    assert stand.align([result.out], "triad").scores[0].heading_error is not None


def test_what_is_true_in_memory(run):
    """Y1 up, X1 to the north at 48.5 deg: 9.96651 and 11.26509 deg/h, 9.8093587 m/s^2 by hand."""
    first = run.stretches[0]
    k = int(np.searchsorted(run.t, first.t_to)) - 1
    deg_h = np.pi / 180 / 3600
    assert run.true_w_ib_b[k] / deg_h == pytest.approx([9.96651, 11.26509, 0.0], abs=0.05)
    assert run.true_f_b[k] == pytest.approx([0.0, 9.8093587, 0.0], abs=5e-3)
    # C_nb takes Y1 to the zenith, -d of north-east-down, within the table's errors
    assert run.C_nb[k].apply([0, 1, 0]) == pytest.approx([0, 0, -1], abs=1e-3)
    with pytest.raises(ValueError, match="read-only"):
        run.t[0] = 1.0


def test_a_run_as_arrays_and_columns(run):
    table, columns = run.array(), run.columns()
    assert table.shape == (len(run),)
    np.testing.assert_array_equal(table["w_ib_b"], run.w_ib_b)
    np.testing.assert_array_equal(table["saturated"], run.saturated)
    assert all(values.shape == (len(run),) for values in columns.values())
    np.testing.assert_array_equal(columns["f_b_Y1_m_s2"], run.f_b[:, 1])
    np.testing.assert_array_equal(columns["joints_outer_rad"], run.joints[:, 3])
    assert len(columns) == 1 + 12 + 4 + 12 + 6


def test_results_print_themselves(run):
    told = repr(run)
    assert told.startswith("Two positions, 180 degrees apart: Ring-laser navigation class, seed 3")
    assert "first" in told
    html = run._repr_html_()
    assert "<td>first</td>" in html
    found = stand.align(run, method="triad")
    assert "triad" in repr(found)
    assert "<table>" in found._repr_html_()
    answer = repr(stand.rehearse(run.settings))
    assert len(answer.splitlines()) > 5
    assert "Rehearsal(" not in answer
    assert "stim300" in repr(stand.catalogue("imus"))
    assert repr(stand.settings("six-position")).count("\n") == 0


# --- the unit in another simulator


def motion(n=1000):
    """A rate that swings and gravity that leans, at the samples' ends."""
    t = np.arange(1, n + 1) / RATE
    w = 0.3 * np.sin(t[:, None] * [1.0, 1.7, 2.3])
    f = np.stack([np.sin(t), 9.8 + 0 * t, np.cos(t)], axis=1)
    return t, w, f


@pytest.mark.parametrize("imu", ["stim300", "ln200s", "adis16470", "hg9900"])
def test_blocks_change_no_bit(imu):
    t, w, f = motion()
    whole = stand.unit(imu, rate_hz=RATE, seed=4).report(t, w, f)
    unit = stand.unit(imu, rate_hz=RATE, seed=4)
    cuts = [0, 1, 3, 250, 251, 700, len(t)]
    parts = [unit.report(t[a:b], w[a:b], f[a:b]) for a, b in pairwise(cuts)]
    for k in range(4):
        np.testing.assert_array_equal(np.concatenate([part[k] for part in parts]), whole[k])


def test_it_is_the_unit_of_the_stand():
    t, w, f = motion(50)
    ours = Imu(load_imu("stim300"), 4, RATE).report(Sensed(np.arange(1, 51) * 10**7, w, f))
    told = stand.unit("stim300", rate_hz=RATE, seed=4).report(t.tolist(), w.tolist(), f.tolist())
    np.testing.assert_array_equal(told.w_ib_b, ours.w_ib_b)
    np.testing.assert_array_equal(told.f_b, ours.f_b)


def test_an_ideal_unit_reports_the_truth_and_a_biased_one_its_bias():
    t, w, f = motion(50)
    told = stand.unit("ideal", rate_hz=RATE).report(t, w, f)
    np.testing.assert_array_equal(told.w_ib_b, w)
    bias = [term for term in stand.imu.TERMS if term != "turn-on-bias"]
    unit = stand.unit("ring-laser", rate_hz=RATE, seed=2, without=bias)
    told = unit.report(t, w, f)
    assert told.w_ib_b - w == pytest.approx(np.tile(unit.gyro_errors.bias, (50, 1)), abs=1e-15)
    assert np.abs(unit.gyro_errors.bias).max() > 0


@pytest.mark.parametrize("imu", ["stim300", "ln200s", "adis16470", "hg9900"])
def test_a_state_goes_through_json(imu):
    t, w, f = motion()
    unit = stand.unit(imu, rate_hz=RATE, seed=4, without=["scale-factor"])
    unit.report(t[:333], w[:333], f[:333])
    saved = json.loads(json.dumps(unit.state()))
    on = unit.report(t[333:], w[333:], f[333:])
    again = Unit.from_state(saved).report(t[333:], w[333:], f[333:])
    for a, b in zip(on, again, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_state_of_something_else_is_refused():
    state = stand.unit("stim300", rate_hz=RATE).state()
    for wrong in (
        {},
        state | {"version": 2},
        {k: v for k, v in state.items() if k != "inside"},
        state | {"inside": {}},
        state | {"inside": 3},
    ):
        with pytest.raises(stand.StandError, match=r"^state: "):
            Unit.from_state(wrong)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda t, w, f: (t, w[:, :2], f), "w_ib_b: shape (50, 2), must be (50, 3) as t has 50"),
        (lambda t, w, f: (t, w, f[:-1]), "f_b: shape (49, 3), must be (50, 3) as t has 50"),
        (lambda t, w, f: (t[:, None], w, f), "t: shape (50, 1), must be (n,)"),
        (lambda t, w, f: (t[::-1], w, f), "t: sample 1 at 0.49 s, must be at 0.51 s: each sample"),
        (lambda t, w, f: (t * 2, w, f), "t: sample 1 at 0.04 s, must be at 0.03 s: each sample of"),
        (lambda t, w, f: (t + 0.003, w, f), "t: sample 0 at 0.013 s, must be a whole number of 1/"),
        (lambda t, w, f: (t, w * np.nan, f), "w_ib_b: holds values that are not finite"),
        (lambda t, w, f: (t, "fast", f), "w_ib_b: must be numbers: "),
    ],
)
def test_misuse_costs_one_line(change, line):
    unit = stand.unit("stim300", rate_hz=RATE)
    with pytest.raises(stand.StandError) as raised:
        unit.report(*change(*motion(50)))
    assert str(raised.value).startswith(line)
    unit.report(*motion(50))  # and leaves the unit as it was


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: stand.unit("stim300", rate_hz=0), "rate = 0 Hz: must be a whole number, 1 to"),
        (lambda: stand.unit("stim300", rate_hz=10, seed=-1), "seed = -1: must be 0 or more"),
        (lambda: stand.unit("stim30", rate_hz=10), "unknown imu 'stim30': did you mean stim300?"),
        (lambda: stand.unit("ideal", rate_hz=10, rate=5), "unknown argument 'rate': did you mean "),
        (lambda: stand.unit("ideal", rate_hz=10, without="range"), "without = 'range': must be a"),
        (lambda: stand.catalogue("imu"), "unknown catalogue 'imu': did you mean imus? known: "),
        (lambda: stand.align([]), "no recording to align"),
        (lambda: stand.align(3), "recording: int, must be a path or of stand.read"),
        (lambda: stand.align("none.mcap"), "none.mcap: no such file"),
        (lambda: stand.allan("none.mcap", terms=["X"]), "unknown term 'X'"),
        (lambda: stand.read("x", start_attitude_deg=[1, 2]), "start_attitude_deg = [1, 2]: must b"),
        (lambda: stand.read("x", fix_sigma=[5, 0]), "--fix-sigma 5,0: both must be above 0"),
        (lambda: stand.rehearse(None, verify=0), "verify = 0: must be 1 or more"),
        (lambda: stand.compare(None, runs=0), "runs = 0: must be 1 or more"),
        (lambda: stand.compare(None, runs=1.5), "runs = 1.5: must be a whole number, 1 or more"),
        (lambda: stand.compare(None, workers=0), "workers = 0: must be 1 or more"),
        (lambda: stand.rehearse(None, verify="a"), "verify = 'a': must be a whole number, 1 or"),
        (lambda: stand.compare("static"), "settings = 'static': must be of stand.settings(...)"),
        (lambda: stand.rehearse("static"), "settings = 'static': must be of stand.settings(...)"),
        (lambda: stand.simulate("static"), "settings = 'static': must be of stand.settings(...)"),
        (lambda: stand.run("static"), "settings = 'static': must be of stand.settings(...)"),
        (lambda: stand.read(None), "recording = None: must be a path"),
        (lambda: stand.catalogue(None), "unknown catalogue None: known: imus, methods, "),
        (lambda: stand.settings(3), "procedure = 3: must be an id, a path, or one that is load"),
        (lambda: stand.unit("ideal", rate_hz=10, seed=0.5), "seed = 0.5: must be a whole number"),
    ],
)
def test_a_wrong_argument_costs_one_line(call, line):
    with pytest.raises(stand.StandError) as raised:
        call()
    assert str(raised.value).startswith(line)
    assert "\n" not in str(raised.value)


def test_a_unit_that_feels_between_the_samples_is_refused(tmp_path):
    text = load_imu("stim300").text
    path = tmp_path / "late.toml"
    path.write_text(text + "\n[sampling.latency_ms]\nvalue = 2.0\nkind = 'typical'\nsource = 'x'\n")
    with pytest.raises(stand.StandError, match=r"late: sensors at .*: add without = \['size-eff"):
        stand.unit(path, rate_hz=RATE)
    assert stand.unit(path, rate_hz=RATE, without=["latency"]).without == ("latency",)


def test_a_refusal_keeps_its_type(run):
    with pytest.raises(stand.StandError, match="two-position_ring-laser_seed3: "):
        stand.align(run, method="carousel")
    with pytest.raises(AlignmentError, match=r"two-position_ring-laser_seed3: .*not at rest"):
        stand.allan(run, t_from_s=200, t_to_s=400)  # the half turn is in it
