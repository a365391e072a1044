"""What `stand.run` left behind, that prints itself."""

from collections.abc import Sequence

from stand.evaluation.run_result import RunResult
from stand.report.document import ANGLE_NOTE, motion_table, refusal_lines, score_tables
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Recorded(Shown, RunResult):
    """What `stand.run` left behind."""

    __slots__ = ()

    def headline(self) -> str:
        s = self.settings
        return (
            f"{s.procedure.entry.title}: {s.imu.title}, seed {s.seed}, {self.samples} samples at "
            f"{s.rate_hz} Hz ({s.sampling.value}), {s.motion.value} motion of {s.table.title}; "
            f"recorded in {self.out}"
        )

    def tables(self) -> Sequence[TableData]:
        motion = [motion_table(self.records)] if self.records else []
        return [*motion, *score_tables(self.scores, self.settings.imu)]

    def remarks(self) -> Sequence[str]:
        return [*refusal_lines(self.refusals), ANGLE_NOTE]
