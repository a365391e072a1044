"""The certificate of a calibration: what it says, and that it is a page like all."""

from dataclasses import replace

import numpy as np
import pytest
from calibrations import DEG_H, a_full_record, a_record
from pages import checked

from stand.calibration.file import load_calibration
from stand.calibration.limits import Limits
from stand.errors import StandError
from stand.report.calibration import number, tables
from stand.report.certificate import page, residual_figure, write_certificate

LIMITS = Limits(2.0, {("gyro", "bias"): (10 * DEG_H, "limits.toml")})


def test_the_page_says_it_all():
    shown = checked(page(a_full_record(), LIMITS))
    for text in (
        "Calibration certificate: a unit <b>",
        "S1",
        "hand-held",
        "1 of 3 values are within their limits",
        "INDETERMINATE: gyro bias Y1 is -10.0 ± 2.0 deg/h noise only, limit 10",
        "12 rests: rank 9 of 9",
        "Not told: what nobody can tell",
        "Left out: rest 3: bumped <i>",
        "Where each sigma comes from",
        "ab" * 32,
        "Temperature",
        "Date, signature",
    ):
        assert text in shown.said, text
    images = [a["aria-label"] for _, a in shown.tags if a.get("role") == "img"]
    assert any("gyro" in (label or "") or "X1" in (label or "") for label in images)
    assert any("Residuals in sigmas: rms" in (label or "") for label in images)


def test_a_page_without_limits_has_no_verdict():
    shown = checked(page(a_record()))
    assert "verdict" not in {a.get("id") for _, a in shown.tags}
    assert residual_figure(a_record()) is None


def test_errors_are_shown_where_the_truth_is_known():
    record = replace(a_record(), errors=[1e-3 * DEG_H] * 9)
    assert "error" in checked(page(record)).said
    assert tables(record)[0].columns[-1] == "error"


def test_written_together_and_never_over_another(tmp_path):
    paths = write_certificate(a_full_record(), tmp_path / "c", LIMITS)
    assert [p.name for p in paths] == ["certificate.html", "calibration.json", "before-after.png"]
    assert paths[2].read_bytes().startswith(b"\x89PNG")
    assert load_calibration(tmp_path / "c").calibration.residuals[0].stretch == "rest 1"
    with pytest.raises(StandError, match=r"--report .*certificate\.html: exists"):
        write_certificate(a_full_record(), tmp_path / "c")
    write_certificate(a_full_record(), tmp_path / "c", force=True)


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [(1.23456, 0.012, "1.235"), (-10234.5, 430.0, "-10234"), (0.0, 0.0, "0"), (5.0, 1e-20, "5")],
)
def test_numbers_to_the_second_digit_of_their_sigma(value, sigma, text):
    assert number(value, sigma).rstrip("0").rstrip(".") == text.rstrip("0").rstrip(".")


def test_a_value_of_zero_has_a_place_on_a_logarithmic_axis():
    record = a_record()
    c = record.calibration
    zero = tuple(replace(p, value=0.0) for p in c.parameters)
    checked(page(replace(record, calibration=replace(c, parameters=zero))))
    exact = replace(
        c,
        parameters=tuple(replace(p, sigma=0.0) for p in c.parameters),
        covariance=np.zeros((9, 9)),
    )
    checked(page(replace(record, calibration=exact)))
