"""What the servo did, written for machines and read back as a file that is not believed."""

import json

import numpy as np
import pytest

from alignment.units import ARC_SECOND
from stand.errors import StandError
from stand.simulation.step_record import StepRecord, record_to_json, records_from_json

SIX = np.arange(6.0)


def records():
    def record(label, rests, settled):
        return StepRecord(
            label=label,
            kind="dwell",
            t_from=0.0,
            t_to=60.0,
            following_max=4 * SIX * ARC_SECOND,
            following_rms=SIX * ARC_SECOND,
            saturated=SIX / 8,
            torque_ratio=SIX / 16,
            rests=rests,
            settled=settled,
        )

    return record("X1 up", True, 0.25), record("to Y1 up", False, None)


def told(change=None):
    steps = [record_to_json(record) for record in records()]
    return json.dumps({"steps": steps if change is None else change(steps), "seed": 1})


def test_what_was_written_is_read():
    for found, written in zip(records_from_json("result.json", told()), records(), strict=True):
        for name in ("label", "kind", "t_from", "t_to", "saturated", "rests", "settled"):
            assert np.all(getattr(found, name) == getattr(written, name))
        # to arc seconds and percent and back: two roundings
        for name in ("following_max", "following_rms", "torque_ratio"):
            np.testing.assert_allclose(getattr(found, name), getattr(written, name), rtol=1e-15)


def test_a_drive_has_none():
    assert records_from_json("result.json", '{"drive": "weaving"}') == ()


def one(key, value):
    return lambda steps: [steps[0], steps[1] | {key: value}]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "result = '': Invalid JSON"),
        ("[" * 9999, "result = "),
        ("[]", "must be a table"),
        (told(lambda steps: 3), "steps = 3: must be an array"),
        (told(lambda steps: [{}]), "steps, 0, label: required, but missing"),
        (told(one("t_to_s", "x")), "steps, 1, t_to_s = 'x': must be a valid number"),
        (told(one("t_to_s", float("nan"))), "steps, 1, t_to_s = nan: must be a finite number"),
        (told(one("saturated_s", {})), "saturated_s: must name the axes base_roll, "),
        (told(one("saturated_s", {"tail": 1.0})), "saturated_s: must name the axes base_roll, "),
        (told(one("torque_percent", {"outer": -1})), "torque_percent, outer = -1: must be greater"),
    ],
)
def test_a_damaged_result_is_one_line(text, said):
    with pytest.raises(StandError) as caught:
        records_from_json("a/result.json", text)
    assert str(caught.value).startswith("a/result.json: result")
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300
