"""The folder of a campaign: its sweep, the texts of all inputs, what it depends on, its results."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stand.campaigns.results import FILE, PARTS, Results
from stand.campaigns.sweep import Sweep, SweepEntry, check, identity, sha256
from stand.errors import StandError
from stand.folder import RECORDINGS, held, write_files
from stand.toml_files import Source, parse
from stand.versions import versions

MANIFEST, SWEEP, INPUTS = "campaign.json", "sweep.toml", "inputs"
_FORMAT = 1


def default_folder(sweep: Sweep) -> Path:
    """Where a campaign goes if nobody says."""
    return RECORDINGS / f"campaign_{sweep.source.id}"


def opened(folder: Path, sweep: Sweep, resume: bool) -> Results:
    """The results of a campaign: of a new one, or with `resume` of the one that is there.

    Raises
    ------
    StandError
        Something is there, and not `resume`; or it is of another campaign: what differs is named.
    """
    manifest = folder / MANIFEST
    if manifest.exists():
        if not resume:
            raise StandError(f"--out {folder}: a campaign is there; --resume goes on with it")
        _refuse_other(folder, read_manifest(folder)["identity"], identity(sweep, versions()))
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StandError(f"--out {folder}: exists and is no campaign; choose another folder")
    results = Results(folder)
    write_files(dict(_written(folder, sweep)))
    (folder / PARTS).mkdir(exist_ok=True)
    return results


def _refuse_other(folder: Path, there: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    for key in dict.fromkeys([*wanted, *there]):
        before, now = there.get(key), wanted.get(key)
        if before != now:
            raise StandError(
                f"--out {folder}: is of another campaign: {_difference(key, before, now)}; "
                "choose another folder"
            )


def _difference(key: str, before: str | None, now: str | None) -> str:
    if key.startswith("sweep") or key.endswith("_version"):
        return (
            f"{key.removesuffix('_version')} was {before or 'not there'}, is {now or 'not there'}"
        )
    if before is None or now is None:
        return f"{key} is {'new' if before is None else 'not there any more'}"
    return f"{key} has changed"


def _written(folder: Path, sweep: Sweep) -> Iterator[tuple[Path, str]]:
    """The texts, and last what tells that it is a campaign."""
    inputs: list[dict[str, str]] = []
    for (kind, name), source in sweep.inputs.items():
        file = f"{INPUTS}/{kind}-{len(inputs) + 1}_{source.id}.toml"
        inputs.append(
            {
                "kind": kind,
                "name": name,
                "id": source.id,
                "file": file,
                "from": _lasting(source.name),
                "sha256": sha256(source.text.encode()),
            }
        )
        yield folder / file, source.text
    yield folder / SWEEP, sweep.source.text
    told = {
        "format": _FORMAT,
        "title": sweep.entry.title,
        "sweep": sweep.source.name,
        "sha256": sha256(sweep.source.text.encode()),
        "runs": sweep.entry.runs,
        "cases": len(sweep.values),
        "inputs": inputs,
        "identity": identity(sweep, versions()),
    }
    yield folder / MANIFEST, json.dumps(told, indent=1) + "\n"


def _lasting(name: str) -> str:
    """A file's name wherever it is read from: what lies beside it is found by that."""
    path = Path(name)
    return str(path.resolve()) if path.is_file() else name


def is_campaign(folder: Path) -> bool:
    """Whether a campaign is there."""
    return (folder / MANIFEST).is_file()


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a folder says of its campaign.

    Raises
    ------
    StandError
        There is none.
    """
    path = folder / MANIFEST
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["format"] != _FORMAT:
            raise StandError(f"{path}: of another version of the stand")
        return told
    except OSError as error:
        raise StandError(f"{folder}: no campaign is there: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise StandError(f"{path}: is damaged: {error}") from error


def read_sweep(folder: Path) -> Sweep:
    """The sweep of a folder with the texts that lie there, whatever became of the files since.

    Raises
    ------
    StandError
        There is none, or a text is not what it was.
    """
    told = read_manifest(folder)
    inputs = {}
    for one in told["inputs"]:
        text = _text(folder / one["file"], one["sha256"])
        inputs[one["kind"], one["name"]] = Source(one["id"], one["from"], text)
    source = Source("sweep", str(folder / SWEEP), _text(folder / SWEEP, told["sha256"]))
    found = Sweep(source, parse(source, SweepEntry), inputs)
    check(found)
    return found


def _text(path: Path, digest: str) -> str:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StandError(f"{path}: cannot be read: {error}") from error
    if sha256(text.encode()) != digest:
        raise StandError(f"{path}: has changed since the campaign began")
    return text


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """While a campaign works in a folder, no other does.

    Raises
    ------
    StandError
        One is at work there.
    """
    with held(folder) as ours:
        if not ours:
            raise StandError(f"--out {folder}: a campaign is at work there")
        yield


def results_of(folder: Path) -> Results:
    """The results of a folder.

    Raises
    ------
    StandError
        There is no campaign.
    """
    read_manifest(folder)
    return Results(folder)


__all__ = ["FILE", "Results", "alone", "default_folder", "is_campaign", "opened", "read_sweep"]
