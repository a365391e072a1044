"""Values as data sheets write them: their own units, bounds that stay bounds, gaps told."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stand.errors import StandError
from stand.imu import imu_from, load_imu
from stand.imu.model import draw
from stand.imu.preset import TriadSpec, unstated
from stand.imu.stated_units import conversion, scale_of
from stand.toml_files import Source, ids

SHEET = 'kind = "typical", source = "Sheet rev. 3, p. 7"'


def unit(gyro="", accel=""):
    head = 'title = "T"\ngrade = "consumer"\nevidence = "A"\n'
    return imu_from(Source("t", "t.toml", f"{head}[gyro]\n{gyro}\n[accel]\n{accel}\n"))


@pytest.mark.parametrize(
    ("told", "value", "wanted", "by_hand"),
    [
        ("mdps/rt-Hz", 3.8, "deg/rt-h", 0.228),  # 3.8e-3 deg/s/rt-Hz x 60 rt-s/rt-h
        ("mdps/√Hz", 3.8, "deg/rt-h", 0.228),
        ("dps/sqrt(Hz)", 0.0038, "deg/rt-h", 0.228),
        ("deg/h/rt-Hz", 9.0, "deg/rt-h", 0.15),  # 9 / 60
        ("°/√hr", 0.15, "deg/rt-h", 0.15),
        ("ug/rt-Hz", 70, "m/s/rt-h", 0.04118793),  # 70e-6 x 9.80665 x 60
        ("µg/√Hz", 70, "m/s/rt-h", 0.04118793),
        ("ft/s/rt-h", 0.065, "m/s/rt-h", 0.019812),
        ("dps", 0.5, "deg/h", 1800),
        ("deg/s", 0.5, "deg/h", 1800),
        ("rad/s", 1e-6, "deg/h", 0.20626480624709636),
        ("%", 0.5, "ppm", 5000),
        ("%", 2, "mrad", 20),  # cross-axis sensitivity
        ("arcsec", 206.26480624709636, "mrad", 1),
        ("m/s^2", 0.0980665, "mg", 10),
        ("dps/g", 0.1, "deg/h/g", 360),
        ("mdps/K", 5, "deg/h/K", 18),
        ("ug/g^2", 50, "ug/g^2", 50),
        ("kHz", 1.5, "Hz", 1500),
    ],
)
def test_units_of_sheets_by_hand(told, value, wanted, by_hand):
    assert value * conversion(told, wanted) == pytest.approx(by_hand, rel=1e-12)


# in SI; powers of angle, length, time and temperature
UNITS = {
    "deg": (0.017453292519943295, (1, 0, 0, 0)),
    "mdeg": (1.7453292519943295e-5, (1, 0, 0, 0)),
    "rad": (1, (1, 0, 0, 0)),
    "mrad": (1e-3, (1, 0, 0, 0)),
    "urad": (1e-6, (1, 0, 0, 0)),
    "arcmin": (2.908882086657216e-4, (1, 0, 0, 0)),
    "arcsec": (4.84813681109536e-6, (1, 0, 0, 0)),
    "m": (1, (0, 1, 0, 0)),
    "mm": (1e-3, (0, 1, 0, 0)),
    "ft": (0.3048, (0, 1, 0, 0)),
    "g": (9.80665, (0, 1, -2, 0)),
    "mg": (9.80665e-3, (0, 1, -2, 0)),
    "ug": (9.80665e-6, (0, 1, -2, 0)),
    "s": (1, (0, 0, 1, 0)),
    "ms": (1e-3, (0, 0, 1, 0)),
    "us": (1e-6, (0, 0, 1, 0)),
    "h": (3600, (0, 0, 1, 0)),
    "Hz": (1, (0, 0, -1, 0)),
    "kHz": (1e3, (0, 0, -1, 0)),
    "rt-h": (60, (0, 0, 0.5, 0)),
    "rt-s": (1, (0, 0, 0.5, 0)),
    "rt-Hz": (1, (0, 0, -0.5, 0)),
    "K": (1, (0, 0, 0, 1)),
    "ppm": (1e-6, (0, 0, 0, 0)),
    "%": (1e-2, (0, 0, 0, 0)),
    "1": (1, (0, 0, 0, 0)),
}
SPELLINGS = {
    "deg / s": "deg/s", "°C": "K", "°/s": "deg/s", "µg": "ug", "μg": "ug", "√h": "rt-h",
    "√hr": "rt-h", "sqrt(h)": "rt-h", "sqrt(hr)": "rt-h", "sqrt s": "rt-s", "rth": "rt-h",
    "√Hz": "rt-Hz", "rt-hz": "rt-Hz", "√hz": "rt-Hz", "hz": "Hz", "hr": "h", "mdps": "mdeg/s",
    "dps": "deg/s", "arcseconds": "arcsec", "arcsecond": "arcsec", "arc-s": "arcsec",
    "arcs": "arcsec", "arcminute": "arcmin", "arcminutes": "arcmin",
}  # fmt: skip


def test_every_unit_by_hand():
    with pytest.raises(StandError) as caught:
        scale_of("furlong")
    assert str(caught.value).endswith("; known: " + ", ".join(UNITS))
    for name, (size, dimension) in UNITS.items():
        assert scale_of(name) == (pytest.approx(size, rel=1e-13), dimension), name
        angle, length, time, warmth = (-3 * d for d in dimension)
        found = scale_of(f"rad^2/{name}^3/s/m/K")
        expected = angle + 2, length - 1, time - 1, warmth - 1
        assert found == (pytest.approx(size**-3, rel=1e-13), expected), name
    for told, ours in SPELLINGS.items():
        assert scale_of(told) == scale_of(ours), told
    with pytest.raises(StandError, match=r"'m\^4' is not known"):
        scale_of("m^4/s")


def test_a_key_takes_the_unit_of_its_sheet():
    gyro = (
        f'angle_random_walk = {{ value = 3.8, unit = "mdps/rt-Hz", {SHEET} }}\n'
        f'turn_on_bias = {{ value = 0.5, unit = "dps", {SHEET} }}\n'
        f'scale_factor = {{ value = 0.5, unit = "%", {SHEET} }}\n'
        f'misalignment = {{ value = 2, unit = "%", {SHEET} }}\n'
        f'range = {{ value = 2000, unit = "dps", {SHEET} }}'
    )
    accel = f'noise_density = {{ value = 70, unit = "ug/rt-Hz", {SHEET} }}'
    spec = unit(gyro, accel)
    assert spec.gyro.noise == pytest.approx(np.radians(0.0038), rel=1e-12)  # rad/s/rt-Hz
    assert spec.gyro.bias == pytest.approx(np.radians(0.5), rel=1e-12)
    assert spec.gyro.scale == pytest.approx(0.005, rel=1e-12)
    assert spec.gyro.misalignment == pytest.approx(0.02, rel=1e-12)
    assert spec.gyro.range == pytest.approx(np.radians(2000), rel=1e-12)
    assert spec.accel.noise == pytest.approx(70e-6 * 9.80665, rel=1e-12)  # m/s^2/rt-Hz


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('range = { value = 4, unit = "furlong", %s }', "unit 'furlong': 'furlong' is not known"),
        (
            'range = { value = 4, unit = "mg", %s }',
            "range, unit 'mg': is of another kind than 'deg/s'",
        ),
        ('turn_on_bias = { value = -1, unit = "dps", %s }', "greater than or equal to 0"),
        ('turn_on_bias = { value = "1", unit = "dps", %s }', "unknown key 'turn_on_bias'"),
        ('turn_on_bais = { value = 1, unit = "dps", %s }', "did you mean turn_on_bias_deg_h"),
        ('bias = { value = 1, unit = "dps", %s }', "unknown key 'bias'"),
        (
            'turn_on_bias = { value = 1, unit = "dps", %s }\n'
            "turn_on_bias_deg_h = { value = 1, %s }",
            "is stated twice, as turn_on_bias_deg_h too",
        ),
    ],
)
def test_a_wrong_unit_is_one_line(line, said):
    with pytest.raises(StandError) as caught:
        unit(line.replace("%s", SHEET))
    assert said in str(caught.value)
    assert str(caught.value).startswith("t.toml: gyro")


@given(st.text(max_size=20))
def test_any_text_is_a_unit_or_one_line(text):
    try:
        factor, _ = scale_of(text)
    except StandError:
        return
    assert factor > 0


# --- a maximum is a bound

CONSTANT = ("bias", "scale", "misalignment", "g_sensitivity")


def test_a_maximum_is_never_exceeded_and_evenly_used():
    gyro = (
        'turn_on_bias_deg_h = { value = 100, kind = "maximum", source = "Sheet p. 7" }\n'
        'scale_factor_ppm = { value = 1000, kind = "1 sigma", source = "Sheet p. 7" }'
    )
    spec = unit(gyro).gyro
    deg_h = np.radians(1 / 3600)
    assert spec.bias == pytest.approx(100 / np.sqrt(3) * deg_h, rel=1e-12)  # GUM 4.3.7
    runs = 1000
    bias = np.array([draw(spec, seed, "gyro").bias for seed in range(runs)]) / deg_h
    scale = np.array([draw(spec, seed, "gyro").matrix for seed in range(runs)])
    n = bias.size
    assert np.abs(bias).max() <= 100
    # the largest of n even draws misses its bound by 1/n of it on average: 10 times is exp(-10)
    assert np.abs(bias).max() > 100 * (1 - 10 / n)
    # variance of a squared even draw is 4/45 of the bound's fourth power
    assert abs((bias**2).mean() - 1e4 / 3) < 4 * 1e4 * np.sqrt(4 / 45 / n)
    # normal beside it: 0.27 % lie beyond three sigma, where a bound would have none
    beyond = np.abs(scale[:, range(3), range(3)] - 1) > 1000e-6 * 1.8
    expected = 0.0719 * n  # two-sided, at 1.8 sigma
    assert abs(beyond.sum() - expected) < 4 * np.sqrt(expected)


def test_a_stated_spread_draws_as_before():
    plain = TriadSpec(bias=1.0, scale=1e-3, misalignment=1e-3, non_orthogonality=1e-3)
    first = draw(plain, 7, "gyro")
    assert np.array_equal(first.bias, draw(replace(plain, scale=0.0), 7, "gyro").bias)
    bounded = draw(replace(plain, bounded=frozenset({"bias"})), 7, "gyro")
    assert np.array_equal(bounded.matrix, first.matrix)
    assert not np.array_equal(bounded.bias, first.bias)


# --- what a sheet leaves out is told


def test_what_a_sheet_does_not_state_is_told():
    told = unstated(load_imu("bmi088"))
    assert told[0] == (
        "the sheet of bmi088 states no drift of the gyros: none is simulated or predicted"
    )
    assert unstated(load_imu("stim300")) == ()
    assert unstated(load_imu("ideal")) == ()
    bare = unstated(unit())
    assert len(bare) == 11  # five of both triads, and the gyros' g-sensitivity
    found = unstated(unit(), {("gyro", "bias"), ("accel", "non_orthogonality")})
    left = "turn-on bias of the gyros", "misalignment of the accelerometers"
    assert set(bare) - set(found) == {
        f"the sheet of t states no {what}: none is simulated or predicted" for what in left
    }


def test_a_constant_known_by_value_is_simulated():
    head = 'title = "T"\ngrade = "consumer"\nevidence = "A"\n'
    one = 'sensor = "gyro", term = "bias", axis = "X1", value = 3.1, unit = "deg/h"'
    text = f"{head}known = [{{ {one} }}]\n[gyro]\n[accel]\n"
    told = unstated(imu_from(Source("t", "t.toml", text)))
    start = "the sheet of t states no turn-on bias of the gyros: "
    assert f"{start}simulated as known by value, not predicted" in told


@pytest.mark.parametrize("name", ids("imus"))
def test_it_is_told_wherever_predictions_appear(name, stand_command):
    told = stand_command("rehearse", "static", "--imu", name, "--rate", 10, "--json").json
    sentences = [f["text"] for f in told["findings"] if f["kind"] == "data sheet"]
    assert sentences == list(unstated(load_imu(name)))
    linted = stand_command("check-imu", name, "--json").json["findings"]
    places = {f["place"] for f in linted if "not stated, so zero" in f["message"]}
    for sentence in sentences:
        sensor = "gyro" if "gyros" in sentence else "accel"
        key = {
            "drift": "bias_instability",
            "turn-on bias": "turn_on_bias",
            "scale factor error": "scale_factor",
            "misalignment": "misalignment",
            "g-sensitivity": "g_sensitivity",
        }
        (wanted,) = (k for text, k in key.items() if f"no {text}" in sentence)
        assert any(p.startswith(f"{sensor}, {wanted}") for p in places)
