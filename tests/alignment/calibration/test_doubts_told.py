"""What a calibration doubts is told whole: stretches that it left out, and contradictions."""

from types import SimpleNamespace

import pytest

from alignment.methods.calibration import _doubts

BUMPED = SimpleNamespace(stretch="third", reason="it was bumped")
APART = (
    "the readings contradict one another: chi-square 84 for 21: sigmas are 2 times as large for it"
)


@pytest.mark.parametrize(
    ("left_out", "enlarged", "told"),
    [
        ((), 1.0, ()),
        ((BUMPED,), 1.0, ("third left out: it was bumped",)),
        ((), 2.0, (APART,)),
        ((BUMPED,), 2.0, ("third left out: it was bumped", APART)),
    ],
)
def test_all_that_is_doubted_is_told(left_out, enlarged, told):
    found = SimpleNamespace(left_out=left_out, enlarged=enlarged, chi_square=84.0, dof=21)
    assert _doubts(found) == told
