"""Any run of a campaign as a full recording, with the same estimates."""

from dataclasses import replace
from pathlib import Path

from stand.campaigns.folder import read_sweep
from stand.errors import StandError, whole
from stand.simulation.settings import Settings


def settings_of_run(folder: Path, case: int, seed: int) -> Settings:
    """The settings of one run, from the texts that lie in the folder.

    Parameters
    ----------
    folder : Path
        Of a campaign.
    case : int
        From 1.
    seed : int
        One of the campaign's.

    Raises
    ------
    StandError
        There is no such campaign, case or run.
    """
    sweep = read_sweep(folder)
    made = sweep.case(case).settings
    if whole("seed", seed) not in sweep.seeds:
        first, last = sweep.seeds[0], sweep.seeds[-1]
        raise StandError(f"--seed {seed}: must be {first} to {last}, as in the campaign")
    return replace(made, seed=seed)


def default_recording(folder: Path, case: int, seed: int) -> Path:
    """Where a recording of a run goes if nobody says: into the campaign's folder."""
    return folder / "recordings" / f"case{case}_seed{seed}"
