"""Sweeps: every value goes where its path leads, and a wrong one is told in one line."""

import numpy as np
import pytest
from swept import SWEEP, written

from alignment.units import DEG
from stand.campaigns.sweep import SweepEntry, count_of, identity, load_sweep
from stand.errors import StandError
from stand.simulation.monte_carlo import Trials
from stand.toml_files import Source, parse


def sweep_of(folder, text):
    return load_sweep(written(folder, text))


def varied(folder, *tables, head=""):
    """A sweep with other things varied."""
    top = SWEEP.partition("[[vary]]")[0].replace("runs = 6\n", f"runs = 6\n{head}\n")
    return sweep_of(folder, top + "".join(f"[[vary]]\n{table}\n" for table in tables))


def test_every_value_with_every_other_the_last_the_fastest(tmp_path):
    made = load_sweep(written(tmp_path))
    assert made.values == ((10, 0.001), (10, 0.01), (20, 0.001), (20, 0.01))
    assert made.labels == ("rest [s]", "imu.gyro.angle_random_walk_deg_rt_h")
    assert [case.number for case in made.cases()] == [1, 2, 3, 4]
    settings = made.case(3).settings
    rests = [s.duration_s for s in settings.procedure.entry.step if s.kind == "dwell"]
    assert rests == [20, 20]
    # 0.001 deg/rt h in SI: deg is pi/180, a root hour 60 root seconds
    assert settings.unit.gyro.noise == pytest.approx(0.001 * np.pi / 180 / 60, rel=1e-12)
    assert settings.unit.accel.noise == made.case(1).settings.unit.accel.noise


def test_what_a_sheet_states_keeps_kind_and_source(tmp_path):
    stated = load_sweep(written(tmp_path)).case(1).settings.imu.entry.gyro
    walk = stated.angle_random_walk_deg_rt_h
    assert (walk.value, walk.kind) == (0.001, "maximum")
    assert "Honeywell" in walk.source


def test_a_term_that_the_sheet_lacks_is_assumed(tmp_path):
    key = 'key = "imu.gyro.bias_instability_deg_h"\nvalues = [0.002]'
    term = varied(tmp_path, key).case(1).settings.imu.entry.gyro.bias_instability_deg_h
    assert (term.value, term.kind) == (0.002, "assumed")


@pytest.mark.parametrize(
    ("table", "found"),
    [
        (
            'key = "site.latitude_deg"\nvalues = [-30]',
            lambda s: abs(s.site.latitude / DEG + 30) < 1e-12,
        ),
        (
            'key = "step.1.duration_s"\nvalues = [15]',
            lambda s: s.procedure.entry.step[0].duration_s == 15,
        ),
        ('key = "rate_hz"\nvalues = [5]', lambda s: s.rate_hz == 5),
        ('key = "true_table"\nvalues = [true]', lambda s: s.true_table),
        ('key = "motion"\nvalues = ["servo"]', lambda s: s.motion.value == "servo"),
        ('key = "imu"\nvalues = ["stim300"]', lambda s: s.imu.id == "stim300"),
        ('key = "table"\nvalues = ["precision"]', lambda s: s.table.id == "precision"),
        ('key = "procedure"\nvalues = ["short.toml"]', lambda s: s.procedure.id == "short"),
        (
            'key = "table.axis.outer.errors.placement_arc_s"\nvalues = [7]',
            lambda s: s.table.entry.axis["outer"].errors.placement_arc_s == 7,
        ),
        (
            'key = "estimate.offset_window_s"\nvalues = [4.5]',
            lambda s: s.options.offset_window == 4.5,
        ),
    ],
)  # fmt: skip
def test_any_key_by_its_path(tmp_path, table, found):
    assert found(varied(tmp_path, table).case(1).settings)


def test_zipped_the_first_with_the_first(tmp_path):
    walk = 'key = "imu.gyro.angle_random_walk_deg_rt_h"\nvalues = [0.001, 0.002, 0.003]'
    where = 'key = "site.latitude_deg"\nvalues = [10, 20, 30]'
    made = varied(tmp_path, walk, where, head='combine = "zip"')
    assert made.values == ((0.001, 10), (0.002, 20), (0.003, 30))
    with pytest.raises(StandError, match="vary: have 3, 1 values, must have as many each"):
        varied(tmp_path, walk, 'key = "rate_hz"\nvalues = [5]', head='combine = "zip"')


def test_a_latin_hypercube_has_one_sample_in_every_part(tmp_path):
    """Of 20 samples one in each twentieth of either range, by factors on a logarithmic one."""
    walk = (
        'key = "imu.gyro.angle_random_walk_deg_rt_h"\n'
        'range = { low = 0.001, high = 0.1, scale = "log" }'
    )
    where = 'key = "site.latitude_deg"\nrange = { low = -40, high = 60 }'
    unit = 'key = "rate_hz"\nvalues = [2, 4]'
    head = 'combine = "latin-hypercube"\nsamples = 20\nseed = 4'
    made = varied(tmp_path, walk, where, unit, head=head)
    values = np.array(made.values, float)
    parts = np.stack([np.log10(values[:, 0] / 0.001) / 2, (values[:, 1] + 40) / 100])
    for part in parts:
        assert sorted(np.floor(part * 20).astype(int)) == list(range(20))
    assert sorted(values[:, 2]) == [2] * 10 + [4] * 10
    assert varied(tmp_path, walk, where, unit, head=head).values == made.values
    assert count_of(made.entry) == 20


def test_ranges_are_rounded(tmp_path):
    spread = 'key = "site.latitude_deg"\nrange = { low = 10, high = 20, count = 4, digits = 3 }'
    assert varied(tmp_path, spread).values == ((10,), (13.3,), (16.7,), (20,))


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ('key = "imu.gyro.angle_random_walk_rad"\nvalues = [1]',
         r"case 1 \(imu.gyro.angle_random_walk_rad = 1\): hg9900.toml: gyro: unknown key "
         "'angle_random_walk_rad': did you mean angle_random_walk_deg_rt_h"),
        ('key = "step.frist.duration_s"\nvalues = [1]', "unknown step 'frist': did you mean first"),
        ('key = "step.4.duration_s"\nvalues = [1]', "unknown step '4'"),
        ('key = "stpe.first"\nvalues = [1]', "unknown key 'stpe': did you mean step"),
        ('key = "imu.gyr.x"\nvalues = [1]', "unknown key 'gyr': did you mean gyro"),
        ('key = "site.latitude_deg"\nvalues = [10, 95]', "case 2 .*latitude_deg = 95: must"),
        ('key = "step.first.duration_s"\nvalues = ["a"]', "duration_s = 'a': must be"),
        ('key = "imu"\nvalues = [3]', "unknown imu '3'"),
        ('key = "imu"\nvalues = ["stim30"]', "unknown imu 'stim30': did you mean stim300"),
        ('key = "procedure"\nvalues = ["no.toml"]', "no.toml: cannot read this procedure"),
        ('key = "title.x"\nvalues = [1]', "title: is 'Two short rests', and has no keys"),
        ('key = "step.first"\nvalues = [1]', "step 1 = 1: must be a table"),
        ('key = "imu.gyro"\nvalues = [1]', "gyro: is a table or an array"),
        ('key = "site..x"\nvalues = [1]', "'site..x': is no path of keys"),
        ('key = "site.latitude_deg"', "values or range: must have one of them"),
        ('key = "rate_hz"\nvalues = [2.5]', "rate = 2.5 Hz: must be a whole number"),
        ('key = "site.latitude_deg"\nrange = { low = 1, high = 0 }', "must be below high"),
        ('key = "site.latitude_deg"\nrange = { low = 1, high = 2 }', "range, count: required"),
        ('key = "rate_hz"\nvalues = [2]\n[[vary]]\nkey = "rate_hz"\nvalues = [3]', "varied twice"),
        ('key = "rate_hz"\nvalues = []', "values: has none, must have one or more"),
        ('key = []\nvalues = [1]', "key: has none, must have one or more"),
        ('key = "rate_hz"\nvalues = [2, nan]', "vary 1, values: nan must be -1e"),
        ('key = "rate_hz"\nvalues = [2, [3]]', "values: number 2 must be a number, a"),
        ('key = "rate_hz"\nvalues = [2, 3, 2.0]',
         r"case 3 \(rate_hz = 2\): is case 1 once more, values must differ"),
        ('key = "site.latitude_deg"\nrange = { low = 1, high = 1.01, count = 2, digits = 1 }',
         "is case 1 once more"),
        ('key = "seed"\nvalues = [1]', r"unknown key 'seed'.* table, table_errors"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line(tmp_path, table, told):
    with pytest.raises(StandError, match=told) as raised:
        varied(tmp_path, table)
    assert str(raised.value).startswith(str(tmp_path / "sweep.toml"))


def test_a_sweep_without_anything_varied_is_one_case(tmp_path):
    made = varied(tmp_path)
    assert made.values == ((),)
    assert made.case(1).settings.imu.id == "hg9900"
    with pytest.raises(StandError, match="case = 2: must be 1 to 1"):
        made.case(2)


def test_names_are_files_beside_the_sweep(tmp_path, monkeypatch):
    path = written(tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    assert load_sweep("mine/sweep.toml").case(1).settings.procedure.id == "short"
    assert load_sweep(path).inputs.keys() == {
        ("procedure", "short.toml"), ("imu", "hg9900"), ("table", "mid-class")
    }  # fmt: skip


def test_identity_names_what_the_results_depend_on(tmp_path):
    made = load_sweep(written(tmp_path))
    more = sweep_of(tmp_path, SWEEP.replace("runs = 6", "runs = 30").replace("Short", "Long"))
    assert identity(made, {"numpy_version": "1"}) == identity(more, {"numpy_version": "1"})
    other = sweep_of(tmp_path, SWEEP.replace("0.001", "0.002"))
    differs = {k for k, v in identity(other, {}).items() if identity(made, {})[k] != v}
    assert differs == {"sweep, vary 2"}


def test_the_cases_of_a_sweep_can_run(tmp_path):
    """The settings are those of `stand.settings` with what was varied."""
    made = load_sweep(written(tmp_path)).case(4).settings
    dwells, _ = Trials(made).readings(3)
    assert [len(d.readings.t) for d in dwells] == [40, 40]


def test_most_cases(tmp_path):
    wide = 'key = "site.latitude_deg"\nrange = { low = 0, high = 1, count = 100000 }'
    with pytest.raises(StandError, match="at most 100000"):
        varied(tmp_path, wide, 'key = "rate_hz"\nvalues = [2, 3]')


def test_numbers_are_bounded():
    source = Source("a", "a.toml", 'title = "a"\nprocedure = "b"\nruns = 0')
    with pytest.raises(StandError, match=r"^a\.toml: runs = 0: must be greater than or equal to 1"):
        parse(source, SweepEntry)
