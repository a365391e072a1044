"""Findings about a preset as a table."""

from collections.abc import Sequence

from stand.imu.lint import PresetFinding, count
from stand.report.tables import TableData


def findings_table(findings: Sequence[PresetFinding]) -> TableData:
    """Findings as a table, with their count in the title."""
    errors = sum(f.severity == "error" for f in findings)
    title = f"{count(errors, 'error')}, {count(len(findings) - errors, 'warning')}"
    rows = tuple((f.severity, f.place, f.message) for f in findings)
    return TableData(title, ("severity", "place", "finding"), rows)
