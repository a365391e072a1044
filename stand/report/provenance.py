"""Where a report's numbers come from: a record to sign, hashes, versions, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stand.errors import StandError
from stand.report.tables import TableData
from stand.table.table import CertificateEntry, TableEntry
from stand.toml_files import Source, parse


@dataclass(frozen=True, slots=True)
class Provenance:
    """The last part of every report.

    `record`: names and values of the test record, '' where a hand fills it in; `hashes`,
    `versions`: tables; `files`: (title, text).
    """

    record: tuple[tuple[str, str], ...]
    hashes: TableData
    versions: TableData
    files: tuple[tuple[str, str], ...]


def provenance(
    files: Mapping[str, tuple[str, str]],
    sha256: Mapping[str, str],
    versions: Mapping[str, str],
) -> Provenance:
    """What was used and how to tell it again.

    Parameters
    ----------
    files : mapping
        'procedure', 'imu' and 'table' to (id, TOML text); those that are not known left out.
    sha256 : mapping
        By what it is the hash of.
    versions : mapping
        By package.
    """
    titles = {"procedure": "Procedure", "imu": "IMU", "table": "Table"}
    return Provenance(
        _record(*files.get("table", ("", ""))),
        TableData("SHA-256", ("of", "hash"), tuple(sha256.items())),
        TableData("Versions", ("package", "version"), tuple(_named(versions).items())),
        tuple(
            (f"{titles[key]}: {files[key][0]}", files[key][1].rstrip())
            for key in titles
            if key in files
        ),
    )


def _named(versions: Mapping[str, str]) -> dict[str, str]:
    return {name.removesuffix("_version"): version for name, version in versions.items()}


def _record(table_id: str, table_text: str) -> tuple[tuple[str, str], ...]:
    """What a person signs for; what the table's file does not say is left blank."""
    stated = _certificate(table_id, table_text)
    of_table = (
        ("Table, serial number", stated.serial_number),
        ("Table, calibration certificate", stated.number),
        ("Issued by", stated.laboratory),
        ("Calibrated on", stated.calibrated_on),
        ("Valid until", stated.valid_until),
    )
    return (
        ("IMU, serial number", ""),
        *(of_table if table_text else ()),
        ("Tested by", ""),
        ("Date, signature", ""),
    )


def _certificate(table_id: str, text: str) -> CertificateEntry:
    try:
        return parse(Source(table_id, f"{table_id}.toml", text), TableEntry).certificate
    except StandError:  # of a recording made by another version: a hand can fill it in
        return CertificateEntry()
