"""What a command or a function asks for, made ready: the requirement and the settings."""

from os import PathLike
from typing import Any

from alignment.methods.calibration import CALIBRATION
from alignment.units import DEG
from stand.arguments import site_with
from stand.errors import StandError
from stand.imu import ImuSpec
from stand.procedure.procedure import SiteEntry, procedure_from
from stand.proposal.candidates import Candidate
from stand.proposal.text import procedure_of
from stand.proposal.wanted import Wanted, WantedEntry, load_wanted, wanted_of
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
    wanted = _placed(_wanted(requirement, heading_deg, max_time_s), latitude_deg, height_m)
    entry = wanted.entry
    looked_at = procedure_of(wanted, ((Candidate((0.0, 0.0, 0.0)), 2.0),), (CALIBRATION,))
    procedure = procedure_from(Source("proposal", "proposal", looked_at))
    made = settings(
        procedure,
        imu or entry.imu or IMU,
        table or entry.table or TABLE,
        rate_hz=rate_hz,
    )
    return wanted, made


def _placed(wanted: Wanted, latitude_deg: float | None, height_m: float | None) -> Wanted:
    """At another place, whose gravity nobody has measured."""
    site_with(wanted.entry.site.site(), latitude_deg, height_m)  # its bounds
    changed: dict[str, Any] = {}
    if latitude_deg is not None:
        changed["latitude_deg"] = float(latitude_deg)
    if height_m is not None:
        changed["height_m"] = float(height_m)
    if not changed:
        return wanted
    # by what is given anew alone: a default that was not set is not written either
    given = wanted.entry.site.model_dump(exclude_unset=True, exclude={"gravity_m_s2"})
    site = SiteEntry(**(given | changed))
    return Wanted(wanted.name, wanted.entry.model_copy(update={"site": site}))


def request_of(made: Settings) -> Wanted | None:
    """What a procedure requires, as a requirement of its own; None: nothing."""
    entry, site = made.procedure.entry, made.site
    if entry.require is None:
        return None
    require = entry.require.model_copy(update={"method": None})
    title = f"{entry.title}, proposed"
    wanted = Wanted("", WantedEntry(title=title, site=entry.site, require=require))
    if site == entry.site.site() or site.latitude is None:
        return wanted
    return _placed(wanted, float(site.latitude / DEG), site.height)


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
