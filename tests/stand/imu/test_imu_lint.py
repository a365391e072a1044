"""The lint: every mix-up of units planted into shipped presets is found, shipped presets pass."""

import re
from math import pi

import pytest

from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu import load_imu, without
from stand.imu.bands import ACCEL_BANDS, GYRO_BANDS, SAMPLING_BANDS, SLIPS, slips
from stand.imu.lint import PresetFinding, grade_of, lint
from stand.imu.preset import ACCEL_KEYS, GYRO_KEYS, SamplingEntry
from stand.imu.stated_units import scale_of
from stand.report.lint_table import findings_table

SHIPPED = [name for name in catalogue.ids("imus") if name != "ideal"]

# Warnings that shipped presets keep, and why: the sheets at hand do not say more.
NO_INSTABILITY = {"bmi088", "hg1700", "hg9900", "icm42688p", "ln200s", "mpu9250", "primus200"}
NO_SCALE = {"adis16405", "adis16488", "hg1700", "ln200s"}
NO_ACCEL_SCALE = NO_SCALE | {"bmi088"}
NO_MISALIGNMENT = {"adis16405", "adis16488", "hg1700", "hg9900", "ln200s", "primus200"}
NO_G_SENSITIVITY = NO_MISALIGNMENT | {"icm42688p", "mpu9250", "psins-inertial", "ring-laser"}
ASSUMED = {
    "hg9900": "accel, velocity_random_walk_m_s_rt_h",
    "ring-laser": "gyro, angle_random_walk_deg_rt_h",
}

# What a value is multiplied by when its unit is mistaken, written out by hand.
MIX_UPS = {
    "gyro": {
        "angle_random_walk_deg_rt_h": {"deg/h/rt-Hz": 60, "deg/s/rt-Hz": 1 / 60},
        "turn_on_bias_deg_h": {"3600 once too often": 3600, "deg/s": 1 / 3600},
        "bias_instability_deg_h": {"3600 once too often": 3600, "deg/s": 1 / 3600},
        "g_sensitivity_deg_h_g": {"deg/s/g": 1 / 3600},
        "bias_temperature_deg_h_K": {"deg/s/K": 1 / 3600},
        "resolution_deg_s": {"deg/h": 3600},
        "range_deg_s": {"rad/s": 0.017453293, "deg/h": 3600},
        "bandwidth_hz": {"kHz": 1e-3},
        "scale_factor_ppm": {"%": 1e-4, "parts of one": 1e-6},
        "misalignment_mrad": {"rad": 1e-3},
    },
    "accel": {
        "velocity_random_walk_m_s_rt_h": {
            "60 once too often": 60,
            "m/s^2/rt-Hz": 1 / 60,
            "ug/rt-Hz": 1699.527,  # 1 / (60 x 9.80665e-6)
        },
        "turn_on_bias_mg": {"ug": 1000, "g": 1e-3},
        "bias_instability_ug": {"1000 once too often": 1000, "mg": 1e-3},
        "bias_temperature_ug_K": {"mg/K": 1e-3},
        "second_order_ug_g2": {"mg/g^2": 1e-3},
        "range_g": {"m/s^2": 9.80665, "mg": 1000},
        "resolution_mg": {"ug": 1000},
        "bandwidth_hz": {"kHz": 1e-3},
        "scale_factor_ppm": {"%": 1e-4},
    },
}


def found(text: str) -> list[PresetFinding]:
    return lint(catalogue.Source("own", "own.toml", text))


def changed(name: str, sensor: str, key: str, value: object) -> str:
    """The text of a shipped preset with one value replaced, or a key added."""
    text = catalogue.find("imus", "imu", name).text
    head, section, rest = text.partition(f"[{sensor}]\n")
    own, bracket, tail = rest.partition("\n[")
    line = f'{key} = {{ value = {value}, kind = "typical", source = "Sheet rev. 3, p. 7" }}'
    lines = [row for row in own.splitlines() if not row.startswith(f"{key} =")]
    return head + section + "\n".join([line, *lines]) + "\n" + bracket + tail


def stated(name: str, sensor: str, key: str) -> float | None:
    entry = getattr(getattr(load_imu(name).entry, sensor), key)
    return None if entry is None else entry.value


def planted() -> list:
    return [
        pytest.param(name, sensor, key, unit, factor, id=f"{name}-{key}-in-{unit}")
        for name in SHIPPED
        for sensor, keys in MIX_UPS.items()
        for key, units in keys.items()
        if stated(name, sensor, key)
        for unit, factor in units.items()
    ]


# --- shipped presets


@pytest.mark.parametrize("name", catalogue.ids("imus"))
def test_shipped_presets_have_no_errors_and_only_known_warnings(name):
    left = lint(catalogue.find("imus", "imu", name))
    assert [f for f in left if f.severity == "error"] == []
    missing = {
        "gyro, bias_instability_deg_h": NO_INSTABILITY,
        "accel, bias_instability_ug": NO_INSTABILITY,
        "gyro, scale_factor_ppm": NO_SCALE,
        "accel, scale_factor_ppm": NO_ACCEL_SCALE,
        "gyro, misalignment_mrad": NO_MISALIGNMENT,
        "accel, misalignment_mrad": NO_MISALIGNMENT,
        "gyro, g_sensitivity_deg_h_g": NO_G_SENSITIVITY,
    }
    wanted = {(place, "not stated") for place, names in missing.items() if name in names}
    wanted |= {(ASSUMED[name], "is assumed")} if name in ASSUMED else set()
    assert {f.place for f in left} == {place for place, _ in wanted}
    assert len(left) == len(wanted)
    for place, words in wanted:
        assert any(f.place == place and words in f.message for f in left)


def test_fifteen_presets_from_consumer_to_navigation():
    grades = [grade_of(load_imu(name).entry.grade) for name in catalogue.ids("imus")]
    counts = {g: grades.count(g) for g in grades}
    assert counts == {
        "reference": 1,
        "consumer": 3,
        "industrial": 2,
        "tactical": 5,
        "navigation": 4,
    }


# --- mix-ups of units


@pytest.mark.parametrize(("name", "sensor", "key", "unit", "factor"), planted())
def test_a_planted_mix_up_is_named_with_key_value_and_unit(name, sensor, key, unit, factor):
    right = stated(name, sensor, key)
    wrong = right * factor
    errors = [f for f in found(changed(name, sensor, key, repr(wrong))) if f.severity == "error"]
    told = [f.message for f in errors if f.place == f"{sensor}, {key}"]
    assert any(m.startswith(f"{wrong:g} ") and f"{unit} (then {right:.3g} " in m for m in told)


def graded(text: str, grade: str) -> str:
    return re.sub('grade = ".*"', f'grade = "{grade}"', text)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        # (N / B)^2: 92 s as stated, 3.3e5 s and 0.026 s mixed up
        ("hg4930", 60, "deg/h/rt-Hz"),
        ("hg4930", 1 / 60, "deg/s/rt-Hz"),
        # 6.5 s and 7.7 s as stated, 2 ms mixed up
        ("adis16470", 1 / 60, "deg/s/rt-Hz"),
        ("adis16488", 1 / 60, "deg/s/rt-Hz"),
    ],
)
def test_without_a_grade_the_bias_instability_tells(name, factor, unit):
    """No band of a grade helps: the crossing of white noise and bias instability moves by 3600."""
    key = "angle_random_walk_deg_rt_h"
    right = stated(name, "gyro", key)
    findings = found(graded(changed(name, "gyro", key, right * factor), "my own"))
    (one,) = [f for f in findings if f.severity == "error"]
    assert one.place == f"gyro, {key}"
    assert one.message.startswith(f"{right * factor:g} deg/rt-h with a bias instability of ")
    assert f"{key} in {unit} (then {right:g} deg/rt-h)" in one.message


@pytest.mark.parametrize(
    ("noise", "instability", "severity", "told"),
    [
        # (2 / 0.3)^2 h = 1.6e5 s: a record of ten times that was never made
        (2.0, 0.3, "error", "white noise hides it for 1.6e+05 s"),
        # (0.0012 / 15)^2 h = 0.023 ms: less than a sample of 0.5 ms
        (0.0012, 15.0, "error", "white noise is below it after 2.3e-05 s"),
        # (2 / 0.4)^2 h = 9e4 s: long, and 2 / 60 would do
        (2.0, 0.4, "error", "deg/h/rt-Hz (then 0.0333 deg/rt-h)"),
        # (0.0559 / 15)^2 h = 0.05 s: a hundred samples, so only unusual
        (0.0559, 15.0, "warning", "white noise is below it after 0.05 s"),
        # the same at a thousandth: no known mix-up repairs it, so only unusual
        (0.002, 0.0004, "warning", "white noise hides it for 9e+04 s"),
    ],
)
def test_white_noise_and_bias_instability_that_cannot_both_be_true(
    noise, instability, severity, told
):
    text = graded(changed("stim300", "gyro", "angle_random_walk_deg_rt_h", noise), "my own")
    text = text.replace("value = 0.3,", f"value = {instability},")
    text = text.replace("value = 4.0,", "value = 40.0,")
    (one,) = [f for f in found(text) if "white noise" in f.message]
    assert (one.severity, one.place) == (severity, "gyro, angle_random_walk_deg_rt_h")
    assert told in one.message


# --- impossible and unusual pairs


@pytest.mark.parametrize(
    ("name", "sensor", "key", "value", "severity", "told"),
    [
        ("stim300", "gyro", "turn_on_bias_deg_h", 0.2, "error", "only 0.2 deg/h from run to run"),
        # sqrt(2 N K / sqrt 3) with N = 0.15 and K = 5: 0.93 deg/h
        ("stim300", "gyro", "rate_random_walk_deg_h_rt_h", 5.0, "warning", "alone leave 0.931 deg"),
        # 0.15/60 x sqrt(2 x 1.1107 x 262 Hz) = 0.0603 deg/s
        ("stim300", "gyro", "resolution_deg_s", 0.013, "none", ""),
        ("hg4930", "accel", "resolution_mg", 3.0, "warning", "noise of a sample, 1 mg; readings"),
        ("stim300", "gyro", "resolution_deg_s", 1e-8, "error", "36 bits in 400 deg/s"),
        ("adis16470", "gyro", "bandwidth_hz", 1200, "warning", "above half the output rate"),
        ("adis16470", "gyro", "bandwidth_hz", 2100, "error", "above the output rate, 2000 Hz"),
        ("stim300", "gyro", "increment_lsb_arc_s", 0.1, "warning", "without effect on output = 'r"),
        ("ln200s", "gyro", "resolution_deg_s", 1e-4, "warning", "without effect on output = 'incr"),
        ("stim300", "gyro", "angle_random_walk_deg_rt_h", 0, "warning", "samples have no noise"),
        ("stim300", "accel", "turn_on_bias_mg", 0.0, "warning", "every unit is the same"),
        ("stim300", "accel", "turn_on_bias_mg", 0.01, "error", "then 10 mg"),
        ("primus200", "accel", "turn_on_bias_mg", 4.0, "warning", "has 0.005 to 3 mg"),
        ("stim300", "sampling", "latency_ms", 1e-5, "error", "is it in s (then 0.01 ms)"),
        ("stim300", "sampling", "jitter_us", 0.0, "none", ""),
        # log2(2 x 400/step): 33.05 and 7.97
        ("stim300", "gyro", "resolution_deg_s", 9e-8, "error", "33 bits in 400 deg/s"),
        ("stim300", "gyro", "resolution_deg_s", 3.2, "error", "8 bits in 400 deg/s"),
        # what lies on a limit is within it
        ("stim300", "gyro", "scale_factor_ppm", 30, "none", ""),
        ("stim300", "gyro", "scale_factor_ppm", 3000, "none", ""),
        ("stim300", "gyro", "scale_factor_ppm", 3010, "warning", "has 30 to 3000 ppm"),
        ("adis16470", "gyro", "bandwidth_hz", 1000, "none", ""),
        ("adis16470", "gyro", "bandwidth_hz", 2000, "warning", "above half the output rate"),
    ],
)
def test_pairs(name, sensor, key, value, severity, told):
    findings = found(changed(name, sensor, key, value))
    before = lint(catalogue.find("imus", "imu", name))
    new = [f for f in findings if f not in before]
    if severity == "none":
        assert new == []
        return
    assert any(f.severity == severity and told in f.message for f in new), new


def test_a_drift_as_large_as_the_bias_can_be():
    """0.3 deg/h of instability: nobody could measure less than that from run to run."""
    for bias, told in ((0.3, False), (0.299, True)):
        findings = found(changed("stim300", "gyro", "turn_on_bias_deg_h", bias))
        assert any("from run to run" in f.message for f in findings) == told


# --- sources and kinds


@pytest.mark.parametrize("source", ["TODO", "todo!", "?", "T.B.D.", "n/a", "xxx", "---"])
def test_placeholders_are_no_sources(source):
    text = catalogue.find("imus", "imu", "hg1700").text
    text = re.sub('source = ".*?"', f'source = "{source}"', text, count=1)
    (one,) = [f for f in found(text) if f.severity == "error"]
    assert one.place == "gyro, turn_on_bias_deg_h"
    assert one.message.startswith(f"source = {source!r}: a placeholder")


def test_sources_and_kinds_that_do_not_fit():
    text = catalogue.find("imus", "imu", "hg1700").text
    short = re.sub('source = ".*?"', 'source = "sheet"', text, count=1)
    assert any("too short to find" in f.message for f in found(short))
    nothing = text.replace('evidence = "C"', 'evidence = "none"')
    told = found(nothing)
    assert sum("must be 'assumed'" in f.message for f in told) == 4  # each value of the preset
    assert any(f.place == "evidence" for f in told)
    assumed = text.replace('kind = "1 sigma"', 'kind = "assumed"', 1)
    assert any("1 is assumed in a unit with evidence C" in f.message for f in found(assumed))


def test_a_made_up_unit_is_left_alone():
    text = catalogue.find("imus", "imu", "ideal").text
    assert found(text) == []
    assert found(text.replace("value = 0.0,", "value = 5e6,")) == []
    told = found(text.replace('"reference"', '"special"'))
    assert told[0] == PresetFinding("warning", "evidence", told[0].message)
    assert any("names none of consumer, industrial, tactical" in f.message for f in told)


# --- presets that do not load: one line from load_imu, every fault from the lint


def broken(old: str, new: str) -> str:
    text = catalogue.find("imus", "imu", "stim300").text
    assert old in text
    return text.replace(old, new, 1)


FIRST = '{ value = 4.0, kind = "unspecified", source = "Safran TS1524 rev.31 (2024), p. 9-12" }'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (broken('grade = "tactical MEMS"\n', ""), "grade: required, but missing"),
        (broken("[gyro]", "[gyros]"), "unknown key 'gyros': did you mean gyro?"),
        (
            broken("turn_on_bias_deg_h", "turn_on_bias_deg_s"),
            "gyro: unknown key 'turn_on_bias_deg_s': did you mean turn_on_bias_deg_h",
        ),
        (
            broken("velocity_random_walk_m_s_rt_h", "velocity_random_walk_m_s2_rt_Hz"),
            "accel: unknown key 'velocity_random_walk_m_s2_rt_Hz': did you mean velocity_random",
        ),
        (
            broken("output_rate_hz", "output_rate_khz"),
            "sampling: unknown key 'output_rate_khz': did you mean output_rate_hz",
        ),
        (
            broken("value = 0.15", "value = -0.15"),
            "gyro, angle_random_walk_deg_rt_h, value = -0.15: must be greater than or equal to 0",
        ),
        (
            broken("value = 0.15", "value = nan"),
            "gyro, angle_random_walk_deg_rt_h, value = nan: must be a finite number",
        ),
        (
            broken("value = 0.15", "value = inf"),
            "gyro, angle_random_walk_deg_rt_h, value = inf: must be a finite number",
        ),
        (
            broken("value = 0.15", 'value = "0.15"'),
            "gyro, angle_random_walk_deg_rt_h, value = '0.15': must be a valid number",
        ),
        (
            broken("value = 0.15", "value = true"),
            "gyro, angle_random_walk_deg_rt_h, value = True: must be a valid number",
        ),
        (broken(FIRST, "4.0"), "gyro, turn_on_bias_deg_h = 4.0: must be a table"),
        (
            broken(FIRST, '{ value = 4.0, kind = "typical" }'),
            "gyro, turn_on_bias_deg_h, source: required, but missing",
        ),
        (
            broken(FIRST, '{ kind = "typical", source = "Safran TS1524" }'),
            "gyro, turn_on_bias_deg_h, value: required, but missing",
        ),
        (
            broken(FIRST, '{ value = 4.0, kind = "typ", source = "Safran TS1524" }'),
            "gyro, turn_on_bias_deg_h, kind = 'typ': must be 'typical', '1 sigma', ",
        ),
        (
            broken(FIRST, '{ value = 4.0, kind = "typical", source = "" }'),
            "gyro, turn_on_bias_deg_h, source = '': ",
        ),
        (
            broken("value = 262", "value = 0"),
            "gyro, bandwidth_hz, value = 0: must be greater than 0",
        ),
        (
            broken("range_deg_s = ", "# "),
            "gyro: scale_nonlinearity_ppm: is a part of the range, which is missing",
        ),
        (broken('evidence = "A"', 'evidence = "D"'), "evidence = 'D': must be 'A', 'B', 'C' or "),
        (
            broken('evidence = "A"', 'evidence = "A"\nbias_corners_s = [10, 1]'),
            "bias_corners_s = [10.0, 1.0]: must increase",
        ),
        (
            broken("[sampling]", '[sampling]\noutput = "angle"'),
            "sampling, output = 'angle': must be 'rate' or 'increment'",
        ),
        (
            broken(
                "[accel]",
                "[accel]\nplaces_mm = { value = [[1, 2], [0, 0, 0], [0, 0, 0]], "
                'kind = "typical", source = "Safran TS1524" }',
            ),
            "accel, places_mm, value 1, 2: required, but missing",
        ),
    ],
)
def test_presets_that_do_not_load_say_so_in_one_line(tmp_path, text, told):
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StandError) as caught:
        load_imu(str(path))
    assert str(caught.value).startswith(f"{path}: {told}")
    first = found(text)[0]
    assert first.severity == "error"
    assert told.startswith(first.place) or first.place == "own.toml"


def test_the_lint_tells_every_fault_of_a_preset_that_does_not_load():
    text = broken("value = 0.15", "value = -1").replace("value = 4.0", "value = nan")
    told = found(text.replace('grade = "tactical MEMS"\n', ""))
    assert [f.place for f in told] == [
        "grade",
        "gyro, turn_on_bias_deg_h, value = nan",
        "gyro, angle_random_walk_deg_rt_h, value = -1",
    ]
    assert {f.severity for f in told} == {"error"}
    (syntax,) = found("title = ")
    assert syntax.place == "own.toml"
    assert syntax.message.startswith("not valid TOML: ")


def test_an_unknown_error_term_names_near_matches():
    with pytest.raises(StandError, match="unknown error term 'bandwith': did you mean bandwidth"):
        without(load_imu("stim300"), ["bandwith"])


# --- the tables themselves


def test_every_key_has_a_band_and_every_unit_its_mix_ups():
    assert set(GYRO_BANDS) >= set(GYRO_KEYS)
    assert set(ACCEL_BANDS) >= set(ACCEL_KEYS)
    assert set(SAMPLING_BANDS) == set(SamplingEntry.model_fields) - {"output"}
    for bands in (GYRO_BANDS, ACCEL_BANDS, SAMPLING_BANDS):
        for band in bands.values():
            assert band.unit in SLIPS
            assert band.why
            for low, high in band.spans:
                assert 0 < low < high


NAMES = {"arc seconds": "arcsec", "arc minutes": "arcmin", "parts of one": "1"}


def plain(unit):
    """As data sheets spell it for `scale_of`; nothing of one that is no unit."""
    for name, ours in NAMES.items():
        unit = unit.replace(name, ours)
    unit = unit.replace(" per ", "/")
    return "" if "{" in unit else unit


def test_a_mix_up_is_off_by_what_the_units_say():
    """3600 s/h, 206264.806 arc seconds a radian, g = 9.80665 m/s^2, 60 of deg/rt-h: one deg/s/rt-Hz
    is one deg/rt-s. Of a value that was multiplied once too often the factor is one of the
    others, the other way round. Rounded to seven digits, as the table prints them."""
    assert len(SLIPS) > 20
    for unit, slipped in SLIPS.items():
        size, dimension = scale_of(plain(unit))
        for other, factor in slipped.items():
            if not plain(other):
                assert 1 / factor in {60.0, 1000.0, 3600.0, 1e4}
                assert any(factor * f == pytest.approx(1) for f in slipped.values())
                continue
            theirs, kind = (1e-9, scale_of("s")[1]) if other == "ns" else scale_of(plain(other))
            assert kind == dimension, (unit, other)
            assert theirs / size == pytest.approx(factor, rel=5e-7), (unit, other)


@pytest.mark.parametrize(
    ("bands", "key", "factor"),
    [
        (GYRO_BANDS, "angle_random_walk_deg_rt_h", 60),
        (ACCEL_BANDS, "velocity_random_walk_m_s_rt_h", 60),
        (GYRO_BANDS, "turn_on_bias_deg_h", 3600),
        (GYRO_BANDS, "bias_instability_deg_h", 3600),
        (ACCEL_BANDS, "turn_on_bias_mg", 1000),
        (ACCEL_BANDS, "bias_instability_ug", 1000),
    ],
)
def test_bands_are_narrower_than_the_mix_up_they_must_find(bands, key, factor):
    for low, high in bands[key].spans:
        assert high / low < factor


ROUND = {1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8}


def test_bands_are_round_and_narrow_from_grade_to_grade():
    """Nobody knows their ends to three digits; a better grade has less of every error."""
    for bands in (GYRO_BANDS, ACCEL_BANDS, SAMPLING_BANDS):
        for key, band in bands.items():
            for end in (end for span in band.spans for end in span):
                assert float(f"{end:e}".partition("e")[0]) in ROUND, (key, end)
            for ends in zip(*band.spans, strict=True):
                assert list(ends) == sorted(ends, reverse=True), (key, ends)


def test_factors_between_units_by_hand():
    """What a value of one is, given in the other unit by mistake."""
    degree, g = 180 / pi, 9.80665
    for unit, other, factor in (
        ("deg/h", "deg/s", 3600), ("deg/h", "rad/s", 3600 * degree),
        ("deg/rt-h", "deg/s/rt-Hz", 60), ("deg/rt-h", "rad/s/rt-Hz", 60 * degree),
        ("deg/rt-h", "deg/h/rt-Hz", 1 / 60), ("deg/h/rt-h", "deg/h/rt-s", 60),
        ("deg/h/rt-h", "deg/s/rt-h", 3600), ("deg/h/rt-h", "deg/s/rt-s", 3600 * 60),
        ("deg/h/h", "deg/s/h", 3600), ("deg/h/h", "deg/s/s", 3600**2),
        ("deg/h/g", "deg/s/g", 3600), ("deg/h/g^2", "deg/s/g^2", 3600),
        ("deg/h/K", "deg/s/K", 3600), ("deg/s", "rad/s", degree), ("deg/s", "deg/h", 1 / 3600),
        ("arc seconds", "rad", 3600 * degree), ("arc seconds", "deg", 3600),
        ("mg", "g", 1e3), ("mg", "m/s^2", 1e3 / g), ("mg", "ug", 1e-3), ("ug", "mg", 1e3),
        ("ug", "g", 1e6), ("ug", "m/s^2", 1e6 / g), ("m/s/rt-h", "m/s^2/rt-Hz", 60),
        ("m/s/rt-h", "ug/rt-Hz", 60e-6 * g), ("ug/rt-h", "mg/rt-h", 1e3), ("ug/h", "mg/h", 1e3),
        ("ug/g^2", "mg/g^2", 1e3), ("ug/K", "mg/K", 1e3), ("ppm", "%", 1e4),
        ("ppm", "parts of one", 1e6), ("ppm/K", "%/K", 1e4), ("ppm/K", "parts of one per K", 1e6),
        ("mrad", "rad", 1e3), ("mrad", "deg", 1e3 / degree),
        ("mrad", "arc minutes", 1e3 / 60 / degree),
        ("mrad", "arc seconds", 1e3 / 3600 / degree), ("g", "mg", 1e-3), ("g", "m/s^2", 1 / g),
        ("Hz", "kHz", 1e3), ("us", "ms", 1e3), ("us", "s", 1e6), ("us", "ns", 1e-3),
        ("ms", "s", 1e3), ("ms", "us", 1e-3),
    ):  # fmt: skip
        assert SLIPS[unit][other] == pytest.approx(factor, rel=1e-6), (unit, other)
    again = {u: 1 / f for u, s in SLIPS.items() for name, f in s.items() if "once too" in name}
    assert again == pytest.approx(
        dict.fromkeys(["deg/h", "deg/h/g", "deg/h/g^2", "deg/h/K"], 3600)
        | {"ug": 1e3, "ug/g^2": 1e3, "ug/K": 1e3, "m/s/rt-h": 60, "ppm": 1e4}
    )
    # the ends of a band are in it
    assert slips(2.0, "mg", (2e3, 2e3)) == [("g", 2e3)]
    assert slips(2.0, "mg", (2.1e3, 3e3)) == slips(2.0, "mg", (1.0, 1.9)) == []


def test_findings_as_a_table():
    table = findings_table(
        [PresetFinding("error", "gyro, x", "wrong"), PresetFinding("warning", "accel, y", "odd")]
    )
    assert table.title == "1 error, 1 warning"
    assert table.columns == ("severity", "place", "finding")
    assert table.rows == (("error", "gyro, x", "wrong"), ("warning", "accel, y", "odd"))
    assert findings_table([]).title == "no errors, no warnings"
