"""A command opens a recording once, however much it reads of it."""

import pytest

from stand.recording.mcap import reader


@pytest.mark.parametrize(
    "arguments",
    [
        ("align", "{}"),
        ("align", "{}", "--method", "carousel", "--turn-joint", "outer", "--from", 12, "--to", 14),
        ("allan", "{}", "--json"),
        ("report", "{}", "--out", "{}/../page.html"),
    ],
)
def test_a_recording_is_opened_once(recorded, stand_command, monkeypatch, arguments):
    opened = []

    def counted(path, open_file=reader.opened):
        opened.append(path)
        return open_file(path)

    monkeypatch.setattr(reader, "opened", counted)
    outcome = stand_command(*(str(a).format(recorded.folder) for a in arguments))
    assert outcome.code in (0, 2), outcome.err  # two seconds of a slew are no whole turn
    assert [str(path) for path in opened] == [str(recorded.folder / "run.mcap")]


def test_a_file_that_is_refused_is_closed(tmp_path):
    """Warnings are errors here: a file left open would be one."""
    path = tmp_path / "short.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(reader.StandError, match=r"short\.mcap: cut off before its end"):
        reader.read_imu(path)
