"""Any unit on any procedure, in short: docs/proof-units.md has all of them (`make proof`)."""

import pytest
from generated_units import unit_case
from normalised import promises

from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import with_verification

CASES, RUNS = range(10), 4
AMONG = 4000  # numbers of all cases: a case is judged as on their page


@pytest.mark.slow
@pytest.mark.parametrize("number", CASES)
def test_predictions_and_sigmas_of_any_unit_hold(number):
    settings = unit_case(number)
    made = with_verification(rehearse(settings), settings, RUNS, workers=1).verification
    assert made is not None
    assert any(a.ratio is not None for a in made.achieved)
    assert made.disagreeing == ()
    assert made.silent == ()
    stated = [p for p in promises(settings, RUNS) if p.values]
    assert stated
    assert [(p.method, p.label, p.mean) for p in stated if p.mean > p.bounds(AMONG)[1]] == []


def test_cases_are_what_they_say():
    """Rests, spins and rocking; means and instants; from navigation to consumer grade."""
    cases = [unit_case(number) for number in CASES]
    kinds = {step.kind for s in cases for step in s.procedure.entry.step}
    assert kinds == {"move", "dwell", "rate"}
    assert {bool(s.procedure.entry.background) for s in cases} == {True, False}
    assert len({s.sampling for s in cases}) == 2
    grades = sorted(float(s.imu.entry.grade) for s in cases)
    assert grades[0] < 10
    assert grades[-1] > 1000
    assert unit_case(3).imu.text == unit_case(3).imu.text
