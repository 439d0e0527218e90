"""A result that shows itself."""

from __future__ import annotations

from typing import Self

from trackbench import results
from trackbench.words import counted


class Result(results.Result):
    """The result of a scenario, which a notebook shows as its table.

    ``result["ekf_cv"].position_rmse.value`` is a metric of a tracker, ``result.to_pandas("steps")`` a table.
    """

    @classmethod
    def of(cls, result: results.Result) -> Self:
        """The same result, as one that shows itself."""
        return cls(result.summary, result.tables)

    def __repr__(self) -> str:
        summary = self.summary
        best = f", best {self.scored[0].name}" if self.scored else ""
        return (
            f"<result {self.name}: {counted(summary.runs, 'run')}, {counted(len(summary.trackers), 'tracker')}{best}>"
        )
