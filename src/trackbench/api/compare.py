"""Python function that compares the scores of trackers, or of versions of a tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from trackbench import results
from trackbench.api.result import HasFigures, Report
from trackbench.api.scenario import listed
from trackbench.base.errors import InputError, counted
from trackbench.compare import Limit, ResultSet, comparison, find_results
from trackbench.compare import compare_results as compare_sets
from trackbench.report.comparison.document import comparison_document
from trackbench.results.metric_value import data_frame

#: Result, or folder of one or several results.
Compared = results.Result | Path | str


class ReportableComparison(HasFigures, comparison.Comparison):
    """Comparison of trackers' results, which a notebook shows as a page and ``print`` as text."""

    def report(self) -> Report:
        """Return the page that ``trackbench compare`` shows: differences of trackers, as text, tables and figures."""
        return Report(comparison_document(self))

    def to_pandas(self) -> Any:
        """Return a data frame with a row for each difference in each group of scenarios.

        ``p_value`` tests the hypothesis that the difference is within the margin, with Holm's correction.
        """
        return data_frame(
            {
                **item.model_dump(include={"scenario", "metric", "unit", "value", "reference", "difference"}),
                "low": item.ci95 and item.ci95[0],
                "high": item.ci95 and item.ci95[1],
                "percent": item.percent,
                "p_value": item.p_value,
                "verdict": item.verdict,
                "paired_runs": item.paired_runs,
                "tracker": item.entrant.tracker,
                "set": self.sets[item.entrant.set],
                "against": item.against.tracker,
                "against_set": self.sets[item.against.set],
            }
            for group in self.groups
            for item in group.differences
        )

    def __repr__(self) -> str:
        scenarios = sum(len(group.scenarios) for group in self.groups)
        return f"<comparison of {' and '.join(self.sets)}: {counted(scenarios, 'scenario')}>"

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def compare(
    first: Compared | Sequence[results.Result],
    *others: Compared | Sequence[results.Result],
    metrics: Sequence[str] = (),
    trackers: Sequence[str] | None = None,
    baseline: str | None = None,
    limits: Mapping[str, float] | None = None,
) -> ReportableComparison:
    """Compare the trackers of one result, or each tracker of later results with its namesake in the first.

    Results on the same measurements are compared run by run, others as independent samples.

    Args:
        first: a result; a list of results of several scenarios; or the folder of either.
        others: further results, lists or folders, which are each compared with the first.
        metrics: metrics to compare by; unless given ``position_rmse``, or ``tgospa`` with hidden identities.
        trackers: names of the trackers to compare; all unless given.
        baseline: tracker of a single result or list that others are compared with; unless given the baseline of the
            scenarios, else the best.
        limits: percentage, by metric, by which trackers of later results may be worse; ``passed`` says if all are kept.

    Raises:
        InputError: there is no such result, or the results cannot be compared.
    """
    if limits is not None and not isinstance(limits, Mapping):
        raise InputError(f"limits are a mapping, such as {{'position_rmse': 5}}, not {limits!r}")
    allowed = [Limit.parse(f"{metric}:{percent}") for metric, percent in (limits or {}).items()]
    arguments = (first, *others)
    names = {name for item in arguments if isinstance(item, results.Result) for name in item}
    for item in arguments:
        if isinstance(item, str) and item in names and not Path(item).exists():
            raise InputError(
                f"{item!r} is a tracker of the results; choose trackers by compare(..., trackers=[{item!r}])"
            )
    sets = [_read_set(item) for item in arguments]
    selected = None if trackers is None else listed(trackers)
    compared = compare_sets(sets, metrics=listed(metrics), trackers=selected, baseline=baseline, limits=allowed)
    return ReportableComparison.model_validate(dict(compared))


def _read_set(results_of: Compared | Sequence[results.Result]) -> ResultSet | results.Result | Sequence[results.Result]:
    if isinstance(results_of, Path | str):
        return find_results(Path(results_of))
    if isinstance(results_of, results.Result):
        return results_of
    if isinstance(results_of, list | tuple) and results_of and all(isinstance(x, results.Result) for x in results_of):
        return results_of
    if isinstance(results_of, list | tuple) and results_of and all(isinstance(x, Path | str) for x in results_of):
        folders = ", ".join(repr(str(folder)) for folder in results_of)
        raise InputError(f"give each folder as an argument of its own: compare({folders})")
    raise InputError(f"{results_of!r} cannot be compared; give a result, a list of results, or a folder")
