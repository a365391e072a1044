"""The stand of one's own that a recording brings: its files, written out again."""

from pathlib import Path

from stand.errors import StandError
from stand.folder import write_file
from stand.recording.mcap.reader import read_attachments
from stand.recording.metadata import MODEL_FOLDER


def attached_model(file: Path, main: str, folder: Path) -> Path:
    """The MJCF `main` that is attached to a recording, written into a folder with its files."""
    attached = read_attachments(file)
    if main not in attached:
        raise StandError(f"run: model: {main!r} is not attached")
    for name, data in attached.items():
        if not name.startswith(MODEL_FOLDER):
            continue
        if ".." in Path(name).parts or "\0" in name:
            raise StandError(f"attached file {name!r} would leave its folder")
        write_file(folder / name, data)
    return folder / main
