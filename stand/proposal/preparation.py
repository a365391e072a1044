"""What a command or a function asks for, made ready: the requirement and the settings."""

from dataclasses import replace
from os import PathLike
from typing import Any

from stand.arguments import site_with
from stand.errors import StandError
from stand.imu import ImuSpec
from stand.procedure.procedure import procedure_from
from stand.proposal.candidates import Candidate
from stand.proposal.information import METHOD
from stand.proposal.text import procedure_of
from stand.proposal.wanted import Wanted, load_wanted, wanted_of
from stand.simulation.settings import Settings, settings
from stand.table.table import Table
from stand.toml_files import Source

IMU, TABLE = "stim300", "precision"
Named = str | PathLike[str]


def request(
    requirement: str | None,
    *,
    imu: Named | ImuSpec | None = None,
    table: Named | Table | None = None,
    heading_deg: float | None = None,
    max_time_s: float | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    rate_hz: int = 200,
) -> tuple[Wanted, Settings]:
    """A requirement from a file or from options, and unit, table, site and rate.

    Raises
    ------
    StandError
        Neither or both are given; one of them is not right.
    """
    wanted = _wanted(requirement, heading_deg, max_time_s)
    entry = wanted.entry
    looked_at = procedure_of(wanted, ((Candidate((0.0, 0.0, 0.0)), 2.0),), (METHOD,))
    procedure = procedure_from(Source("proposal", "proposal", looked_at))
    made = settings(
        procedure,
        imu or entry.imu or IMU,
        table or entry.table or TABLE,
        latitude_deg=latitude_deg,
        height_m=height_m,
        rate_hz=rate_hz,
    )
    return wanted, replace(made, site=site_with(entry.site.site(), latitude_deg, height_m))


def _wanted(requirement: str | None, heading_deg: float | None, max_time_s: float | None) -> Wanted:
    if (requirement is None) == (heading_deg is None):
        given = "neither" if requirement is None else "both"
        raise StandError(
            f"propose: has {given} of a requirement's file and --heading, must have one of them"
        )
    allowed: dict[str, Any] = {} if max_time_s is None else {"max_time_s": float(max_time_s)}
    if requirement is None:
        assert heading_deg is not None
        return wanted_of({"heading_deg": float(heading_deg)}, allowed)
    wanted = load_wanted(requirement)
    if not allowed:
        return wanted
    checked = wanted_of({"heading_deg": 1.0}, allowed).entry.allowed  # its own bounds
    limits = wanted.entry.allowed.model_copy(update={"max_time_s": checked.max_time_s})
    return Wanted(wanted.name, wanted.entry.model_copy(update={"allowed": limits}))
