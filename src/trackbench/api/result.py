"""A result that shows itself."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from trackbench import results
from trackbench.base.errors import InputError, counted, nearest

if TYPE_CHECKING:
    from trackbench.api.display import Report, ReportFigure


class ReportableResult(results.Result):
    """The result of a scenario, which a notebook shows as its ranking.

    ``result["ekf_cv"].position_rmse.value`` is a metric of a tracker, ``result.to_pandas("steps")`` a table.
    """

    @classmethod
    def of(cls, result: results.Result) -> Self:
        """The same result, as one that shows itself."""
        return cls(result.summary, result.tables)

    def __getstate__(self) -> dict[str, Any]:
        # The report is made again when it is asked for.
        return {name: value for name, value in vars(self).items() if name != "_report"}

    def report(self) -> Report:
        """The report of the run, as ``trackbench run`` writes it."""
        return self._report

    @property
    def figures(self) -> tuple[str, ...]:
        """The names of the report's figures."""
        return tuple(figure.name for figure in self._report.document.figures)

    def figure(self, name: str) -> ReportFigure:
        """A figure of the report.

        Raises:
            InputError: there is none of this name.
        """
        from trackbench.api.display import ReportFigure

        for figure in self._report.document.figures:
            if figure.name == name:
                return ReportFigure(figure)
        raise InputError(f"no figure {name!r} in this report; {nearest(name, self.figures)}")

    @cached_property
    def _report(self) -> Report:
        from trackbench.api.display import Report
        from trackbench.report.result import result_document

        return Report(result_document(self))

    def __repr__(self) -> str:
        summary = self.summary
        best = f", best {self.contenders[0].name}" if self.scored else ""
        return (
            f"<result {self.name}: {counted(summary.runs, 'run')}, {counted(len(summary.trackers), 'tracker')}{best}>"
        )

    def _repr_html_(self) -> str:
        from trackbench.api.display import table_html
        from trackbench.report.result import ranking_table

        return table_html(ranking_table(self))
