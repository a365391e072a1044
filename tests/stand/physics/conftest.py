"""How much work the truth is."""

import pytest

from stand.physics.hinges import Hinges


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many states each call of the truth's sensors evaluates, as they come."""
    found, sensed = [], Hinges.sensed

    def counted(hinges, joints, rates, accelerations):
        found.append(len(joints))
        return sensed(hinges, joints, rates, accelerations)

    monkeypatch.setattr(Hinges, "sensed", counted)
    return found
