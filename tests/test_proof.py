"""Predictions against runs of the stand, in short: `make proof` does the same at length."""

from dataclasses import replace

import pytest

from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import with_verification
from stand.simulation.settings import assembled

# runs of each: a sigma of n runs is known to 1/sqrt(2 n), 60 to 9 %; the more so with many
# quantities, of which none may be off by more than chance and the 10 % that are promised
RUNS = {"six-position": 60, "two-position": 60, "four-position": 60, "carousel": 40}
CASES = [(name, imu) for name in RUNS for imu in ("icm42688p", "stim300", "hg9900")]
SWAYING = [("random-sway", "stim300"), ("random-sway", "hg9900")]
SEED = 90_000  # none of those of the long proof


def compared(name, imu, runs):
    procedure = load_procedure(name)
    site = procedure.entry.site.site()
    asked = assembled(procedure, load_imu(imu), table_of(procedure), site, 20)
    result = rehearse(asked)
    result = with_verification(result, replace(asked, seed=SEED), runs, workers=1)
    assert result.verification is not None
    return result.verification


@pytest.mark.slow
@pytest.mark.parametrize(("name", "imu"), CASES)
def test_runs_come_to_what_is_predicted(name, imu):
    found = compared(name, imu, RUNS[name])
    assert [(a.method, a.label, a.quantity, a.ratio) for a in found.disagreeing] == []
    assert any(a.ratio is not None for a in found.achieved)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "imu"), SWAYING)
def test_so_do_runs_on_a_base_that_sways(name, imu):
    found = compared(name, imu, 24)
    assert [(a.method, a.quantity, a.ratio) for a in found.disagreeing] == []
