"""A recording as the estimators take it, that prints itself."""

from collections.abc import Sequence

from alignment.units import DEG
from stand.recording.log import Log
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Recording(Shown, Log):
    """A recording as the estimators take it; see `stand.recording.log.Log`."""

    __slots__ = ()

    def headline(self) -> str:
        latitude = self.site.latitude
        where = "latitude not known" if latitude is None else f"latitude {latitude / DEG:.4f} deg"
        return f"{self.path} {self.topic}: {', '.join(self.methods)}; {where}"

    def tables(self) -> Sequence[TableData]:
        rows = tuple((d.label, f"{d.t_from:.2f}", f"{d.t_to:.2f}") for d in self.dwells)
        return [TableData("stretches to estimate from", ("label", "from s", "to s"), rows)]
