"""Outcome of a comparison of results: scores, differences, ranking and kept limits, which is stored as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy.special import stdtrit

from trackbench.metrics.contrasts import LogRatio
from trackbench.metrics.intervals import ROUNDING
from trackbench.results import MetricValue
from trackbench.results.metric_value import ResultModel, read_model

SCHEMA_VERSION = 5
#: Metrics of computing time: they differ between machines, so no file keeps them.
TIMES = ("step_time",)
#: Significant digits that are kept: machines differ only in digits far behind.
DIGITS = 4

GateOutcome = Literal["passed", "failed", "undecided", "error"]
#: Verdict on a difference with its sign reversed.
_TURNED = {"worse": "better", "better": "worse", "larger": "smaller", "smaller": "larger"}


class Entrant(ResultModel):
    """Tracker that takes part in a comparison, with the index of its set of results (one version of the trackers)."""

    tracker: str
    set: int = 0
    """Index of the set of results, from 0 in the order in which the user names them; 0 is the baseline."""


class ComparedResult(ResultModel):
    """Stored result that takes part in a comparison: runs, seed, expectations and pairing with the baseline."""

    set: int
    label: str
    """Folder of the result, as the user wrote it."""
    runs: int
    seed: int
    expectations: int
    expectations_met: int
    shared_runs: int | None = None
    """Number of runs with the same measurements as a run of the baseline, over which differences are paired; None where
    the runs are not paired."""
    reason: str = ""
    """Reason why the differences are paired, or not; empty for the baseline."""


class ComparedScenario(ResultModel):
    """Name and description of a compared scenario, and its stored results in the order of the sets of results."""

    name: str
    description: str
    results: list[ComparedResult]


class SetOrigin(ResultModel):
    """Time at which a set of results was made, commit of the code, and changes since the previous set."""

    set: int
    made_at: str | None
    """Time at which the most recent result of the set began to be computed: UTC, ISO 8601; None in results of earlier
    versions."""
    commit: str | None
    """Commit of the repository that holds the scenarios; None without a repository."""
    changes: list[str]
    """Changes since the previous set, as the results state: versions, engine, trackers, scenario, code, commit; empty
    for the baseline."""


class EntrantScore(ResultModel):
    """Metric values, diverged runs and rank of one tracker of a set of results, in one scenario."""

    scenario: str
    entrant: Entrant
    metrics: dict[str, MetricValue]
    """Metrics that have a value for this entrant, by dotted path such as ``rmse.px``."""
    diverged_runs: int
    leading: bool
    """Whether the tracker is the best of the scenario, or was compared with the best and not shown to be worse by more
    than the margin."""
    failure: str = ""
    """Reason why the tracker has no score, such as a failure; empty where it has a score."""
    reference: bool = False
    """Whether the tracker knows origins of detections or later measurements; the other trackers are ranked without this
    tracker."""

    def value(self, metric: str) -> float | None:
        """Return the value of the metric with this dotted path; None where the tracker has no value."""
        value = self.metrics.get(metric)
        return None if value is None else value.value


class PairDifference(ResultModel):
    """Difference of a metric between two trackers in one scenario: value of ``entrant`` minus value of ``against``."""

    scenario: str
    metric: str
    unit: str
    entrant: Entrant
    against: Entrant
    value: float
    """Value of the metric for the tracker ``entrant``, over the runs that are compared."""
    reference: float
    """Value of the metric for the tracker ``against``, over the runs that are compared."""
    difference: float
    ci95: tuple[float, float] | None
    """95 % interval of the difference; None with fewer than two runs."""
    margin: float
    """Largest difference that does not matter: the margin that the baseline's scenario states, or a limit on
    regressions if that is smaller."""
    p_value: float
    """P-value of the hypothesis that the difference is within the margin, corrected for the number of tests."""
    paired_runs: int | None
    """Number of runs over which the two trackers are paired; None for two independent samples."""
    stretches: int | None = None
    """Number of stretches of time that are the independent parts, for a single run or few logs; else None."""
    without_charged: float | None = None
    """Difference over the given estimates alone. None unless over a tenth of either squared error is charged for
    missing estimates. If its sign differs from that of ``difference``, neither entrant is called better."""
    scenes: int
    """Number of scenes of the compared runs; several scenes are the independent parts."""
    few_scenes_decide: bool = False
    """Whether vehicles hide others, so that one scene in a hundred can turn which of two trackers is better."""
    scenes_in_words: str = ""
    """Number and kind of the compared scenes, such as "6 sequences"; empty for one scene."""
    repeatable: bool = False
    """Whether both results come from the same recorded data without random numbers, where a limit is tested; else
    False."""
    verdict: str
    """Verdict on ``entrant``: better, worse, larger, smaller, equivalent or undecided."""
    scenes_ahead: tuple[int, int] | None = None
    """Number of scenes in which ``entrant`` has the better value, and number of all scenes; None for one scene."""
    log_ratio: LogRatio | None = None
    """Logarithm of value over reference, from which scenarios are pooled; None where either is not positive."""

    def turned(self) -> PairDifference:
        """Return the difference of ``against`` minus ``entrant``, with the opposite verdict."""
        ratio, ahead = self.log_ratio, self.scenes_ahead
        return self.model_copy(
            update={
                "entrant": self.against,
                "against": self.entrant,
                "value": self.reference,
                "reference": self.value,
                "difference": 0.0 - self.difference,
                "ci95": self.ci95 and (0.0 - self.ci95[1], 0.0 - self.ci95[0]),
                "verdict": _TURNED.get(self.verdict, self.verdict),
                "scenes_ahead": ahead and (ahead[1] - ahead[0], ahead[1]),
                "log_ratio": ratio and ratio._replace(value=-ratio.value),
            }
        )

    @property
    def percent(self) -> float | None:
        """Difference in percent of the value of ``against``; None where that value is zero."""
        return 100.0 * self.difference / abs(self.reference) if self.reference else None

    @property
    def percent_ci95(self) -> tuple[float, float] | None:
        """95 % interval of the difference in percent of ``reference``, taken as exact; None without an interval."""
        if self.ci95 is None or not self.reference:
            return None
        low, high = (100.0 * end / abs(self.reference) for end in self.ci95)
        return low, high

    @property
    def ratio_ci95(self) -> tuple[float, float] | None:
        """95 % interval of the ratio of both values less one, in percent; None without a ``log_ratio``."""
        ratio = self.log_ratio
        if ratio is None or ratio.error is None:
            return None
        reach = stdtrit(ratio.freedom, 0.975) * ratio.error
        return as_percent(ratio.value - reach), as_percent(ratio.value + reach)

    @property
    def identical(self) -> bool:
        """Whether both trackers had the same value in every run, up to rounding."""
        reach = max(abs(self.value), abs(self.reference)) * ROUNDING
        ends = self.ci95 or (self.difference,)
        return self.paired_runs is not None and max(map(abs, ends)) <= reach


class NotCompared(ResultModel):
    """Pair of trackers that could not be compared by a metric in a scenario, with the reason."""

    scenario: str
    metric: str
    entrant: Entrant
    against: Entrant
    reason: str
    of_entrant: bool
    """Whether only ``entrant`` lacks a value, and ``against`` has one."""


class OverallChange(ResultModel):
    """Change of a tracker's metric against the baseline, pooled over the scenarios in which both have a value."""

    metric: str
    entrant: Entrant
    against: Entrant
    verdicts: dict[str, int]
    """Number of scenarios with each verdict on ``entrant``, such as "better", by verdict."""
    mean_percent: float | None
    """Geometric mean over scenarios of the ratio to the baseline, less one, in percent; None where a value is not
    positive."""
    ci95: tuple[float, float] | None = None
    """95 % interval of the mean change. It covers other noise and other scenes of the same scenarios. None where a
    scenario's difference has no interval, or both trackers have the same value in every run."""


class RankedTracker(ResultModel):
    """Tracker in the ranking over scenarios, within a single set of results: its relative error and missing scores."""

    tracker: str
    without_score: int
    """Number of scenarios in which the tracker failed or did not take part."""
    relative_error: float | None
    """Geometric mean over scenarios of a ratio: the tracker's error to the geometric mean of the competing trackers'
    errors in the scenario. None without a score in any scenario."""
    reference: bool = False
    """Whether the tracker knows origins of detections or later measurements, so that it is listed after the competing
    trackers."""


class GateResult(ResultModel):
    """Outcome of a limit on the regression of a metric, for one tracker of a later result in one scenario."""

    scenario: str
    entrant: Entrant
    metric: str
    percent: float
    outcome: GateOutcome
    """passed, failed or undecided, by the test of a limit; ``error`` where the tracker has no value."""
    text: str


class OrderInWorlds(ResultModel):
    """Better of two trackers in each world (variant with other drivers and sensors) of a scenario."""

    scenario: str
    """Name of the scenario without the suffix for its world, such as "highway" for "highway-human"."""
    a: str
    """Name of the tracker with the smaller error in the first world."""
    b: str
    ahead: dict[str, str | None]
    """Tracker that is shown to be better by more than the margin, by name of the world; None where neither is shown to
    be better. The tests are corrected for the pairs in all worlds of the scenario."""

    @property
    def order(self) -> Literal["holds", "turns", "holds in part", "not shown"]:
        """Whether one tracker is better in each world (holds), or each tracker is better in some world (turns).

        holds in part: one tracker is better in some worlds, and neither is shown to be better in the others. not shown:
        neither tracker is statistically better in any world.
        """
        winners = {*self.ahead.values()}
        if {self.a, self.b} <= winners:
            return "turns"
        if winners == {None}:
            return "not shown"
        return "holds in part" if None in winners else "holds"


class Comparison(ResultModel):
    """Comparison of trackers over scenarios: scores, differences, ranking and limits; set of results 0 is the baseline.

    The fields describe the scenarios that one metric ranks; ``groups`` has a comparison for each such metric.
    """

    schema_version: int = SCHEMA_VERSION
    sets: list[str]
    """Labels of the sets of results, the baseline first."""
    ranked_by: str = "position_rmse"
    """Metric that ranks trackers in these scenarios; ``tgospa`` with hidden identities."""
    scenarios: list[ComparedScenario] = Field(min_length=1)
    scores: list[EntrantScore]
    differences: list[PairDifference]
    """Differences of every pair of trackers of a single set, or of each entrant to the baseline of several sets."""
    overall: list[OverallChange]
    """Changes against the baseline, pooled over several scenarios; empty for one scenario."""
    baseline: str | None = None
    """Name of the tracker that all other trackers are compared with on pages: the tracker that the user named, else the
    ``score.baseline`` of all scenarios, else the best over several scenarios. None for several sets, and for one
    scenario without a baseline."""
    sets_of_scenes: list[list[str]]
    """Names of the scenarios, grouped where they share scenes, so that their differences are correlated."""
    ranking: list[RankedTracker]
    """Trackers of a single set: by the number of scenarios with a score, then by relative error, best first."""
    gates: list[GateResult]
    not_compared: list[NotCompared]
    notes: list[str]
    """Remarks for the reader on what limits or qualifies the comparison."""
    worlds: list[OrderInWorlds] = Field(default_factory=list)
    """Order of every pair of trackers of a single set, for scenarios in several worlds (variants with other drivers and
    sensors)."""
    places: dict[str, int] = Field(default_factory=dict)
    """Index of each tracker in the first scenario file that has it, which selects its colour. Filled only in this
    comparison, empty in ``other_groups``."""
    origins: list[SetOrigin] = Field(default_factory=list)
    """When and with which code each of several sets of results was made. Filled only in this comparison, empty in
    ``other_groups``."""
    without_truth: list[str] = Field(default_factory=list)
    """Names of the scenarios that are not compared because they have no truth."""
    commands: list[str] = Field(default_factory=list)
    """Commands that repeat the runs and the comparison; empty where a result does not say how it was made."""
    other_groups: list[Comparison] = Field(default_factory=list)
    """Comparisons of these sets of results in scenarios with another ranking metric, one for each such metric."""

    @property
    def groups(self) -> list[Comparison]:
        """This comparison, then ``other_groups``: one for each ranking metric, over the scenarios that it ranks."""
        others = [group.model_copy(update={"origins": self.origins}) for group in self.other_groups]
        return [self.model_copy(update={"other_groups": []}), *others]

    @property
    def passed(self) -> bool:
        """Whether every limit on regressions is shown to be kept, in all scenarios."""
        return all(outcome == "passed" for outcome in self.outcomes)

    @property
    def outcomes(self) -> list[GateOutcome]:
        """Outcome of each limit for each tracker and scenario."""
        return [item.outcome for group in self.groups for item in group.gates]

    @property
    def trackers(self) -> list[str]:
        """Names of the trackers of all groups, in the order in which they first appear."""
        return list(dict.fromkeys(score.entrant.tracker for group in self.groups for score in group.scores))

    def by_metric(self) -> Iterator[tuple[str, list[PairDifference]]]:
        """Yield the path of each metric with the differences by this metric."""
        for metric in dict.fromkeys(item.metric for item in self.differences):
            yield metric, [item for item in self.differences if item.metric == metric]

    def json(self) -> dict[str, Any]:  # type: ignore[override]
        """Return the comparison as JSON values that machines agree on: four significant digits, no computing times."""
        values = _rounded(self.model_dump(mode="json"))
        for group in (values, *values["other_groups"]):
            for score in group["scores"]:
                score["metrics"] = {name: entry for name, entry in score["metrics"].items() if name not in TIMES}
            for name in ("worlds", "commands", "places", "origins"):
                if not group[name]:
                    del group[name]
        return {**values, "passed": self.passed}


def as_percent(log_ratio: float) -> float:
    """Return by how many percent a ratio exceeds one, from the natural logarithm of the ratio."""
    return float(100.0 * np.expm1(log_ratio))


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return value


def load_comparison(file: Path) -> Comparison:
    """Load a comparison from its JSON file.

    Raises:
        InputError: the file cannot be read, or is no comparison of this version.
    """
    return read_model(Comparison, file, "comparison", SCHEMA_VERSION)
