"""Outcome of a comparison: the data that pages, terminals and gates show, and that is kept as JSON."""

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
    """Tracker of one set of results, as it takes part in a comparison."""

    tracker: str
    set: int = 0
    """Index of the set of results, in the order given; 0 for the baseline."""


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
    they are not paired."""
    reason: str = ""
    """Reason why the differences are paired, or not; empty for the baseline."""


class ComparedScenario(ResultModel):
    """Scenario of a comparison, with its results in the order of the sets."""

    name: str
    description: str
    results: list[ComparedResult]


class SetOrigin(ResultModel):
    """When and with which code a set of results was made, and what changed since the previous set."""

    set: int
    made_at: str | None
    """Time at which the last of the set's runs began: UTC, ISO 8601; None in results of earlier versions."""
    commit: str | None
    """Commit of the repository that holds the scenarios; None without a repository."""
    changes: list[str]
    """Changes since the previous set, as the results state: versions, engine, trackers, scenario, code, commit; empty
    for the baseline."""


class EntrantScore(ResultModel):
    """Metrics of one entrant in one scenario."""

    scenario: str
    entrant: Entrant
    metrics: dict[str, MetricValue]
    """Metrics that have a value for this entrant, by dotted path such as ``rmse.px``."""
    diverged_runs: int
    leading: bool
    """Whether the entrant is the best of the scenario, or was compared with the best and not shown to be worse by more
    than the margin."""
    failure: str = ""
    """Reason why the entrant has no score; empty where it has one."""
    reference: bool = False
    """Whether the tracker knows origins of detections or later measurements; the others are ranked without it."""

    def value(self, metric: str) -> float | None:
        """Return the value of the metric at a path; None where the entrant has none."""
        value = self.metrics.get(metric)
        return None if value is None else value.value


class PairDifference(ResultModel):
    """Metric value of one entrant minus that of another entrant, in one scenario."""

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
    """Largest difference that does not matter: the margin of the baseline's scenario, or a smaller limit."""
    p_value: float
    """P-value of the hypothesis that the difference is within the margin, corrected for the number of tests."""
    paired_runs: int | None
    """Number of runs over which the two entrants are paired; None for two independent samples."""
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
    """With a limit: whether both results come from the same recorded data, without random numbers."""
    verdict: str
    """Verdict on ``entrant``: better, worse, larger, smaller, equivalent or undecided."""
    scenes_ahead: tuple[int, int] | None = None
    """Number of scenes in which ``entrant`` has the better value, and number of all scenes; None for one scene."""
    log_ratio: LogRatio | None = None
    """Logarithm of value over reference, from which scenarios are pooled; None where either is not positive."""

    def turned(self) -> PairDifference:
        """Return the difference with both entrants exchanged."""
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
        """Interval in percent of the value of ``against``, taken as exact; None if that is 0 or without one."""
        if self.ci95 is None or not self.reference:
            return None
        low, high = (100.0 * end / abs(self.reference) for end in self.ci95)
        return low, high

    @property
    def ratio_ci95(self) -> tuple[float, float] | None:
        """Interval of the ratio less one, in percent, with the uncertainty of both values; None if unknown."""
        ratio = self.log_ratio
        if ratio is None or ratio.error is None:
            return None
        reach = stdtrit(ratio.freedom, 0.975) * ratio.error
        return as_percent(ratio.value - reach), as_percent(ratio.value + reach)

    @property
    def identical(self) -> bool:
        """Whether both entrants had the same value in every run, up to rounding."""
        reach = max(abs(self.value), abs(self.reference)) * ROUNDING
        ends = self.ci95 or (self.difference,)
        return self.paired_runs is not None and max(map(abs, ends)) <= reach


class NotCompared(ResultModel):
    """Pair of entrants that could not be compared by a metric, with the reason."""

    scenario: str
    metric: str
    entrant: Entrant
    against: Entrant
    reason: str
    of_entrant: bool
    """Whether only ``entrant`` lacks a value, and ``against`` has one."""


class OverallChange(ResultModel):
    """Change of one metric of an entrant against the baseline, pooled over the scenarios in which both have a value."""

    metric: str
    entrant: Entrant
    against: Entrant
    verdicts: dict[str, int]
    """Number of scenarios with each verdict on ``entrant``."""
    mean_percent: float | None
    """Geometric mean over scenarios of the ratio to the baseline, less one, in percent; None where a value is not
    positive."""
    ci95: tuple[float, float] | None = None
    """95 % interval of the mean change. It covers other noise and other scenes of the same scenarios. None where a
    scenario's difference has no interval, or both trackers have the same value in every run."""


class RankedTracker(ResultModel):
    """Place of one tracker of a single set in the order over scenarios."""

    tracker: str
    without_score: int
    """Number of scenarios in which the tracker failed or did not take part."""
    relative_error: float | None
    """Geometric mean over scenarios of the error, divided by the geometric mean error of the competing trackers in the
    scenario. None without a score in any scenario."""
    reference: bool = False
    """Whether the tracker is no competitor, so that it is listed after the others."""


class GateResult(ResultModel):
    """Outcome of a limit on how much worse a metric may be, for one tracker of a later set in one scenario."""

    scenario: str
    entrant: Entrant
    metric: str
    percent: float
    outcome: GateOutcome
    """passed, failed or undecided, by the test of a limit; ``error`` where the entrant has no value."""
    text: str


class OrderInWorlds(ResultModel):
    """Which of two trackers is better in each world of a scenario."""

    scenario: str
    """Name of the scenario without its world."""
    a: str
    """Tracker with the smaller error in the first world."""
    b: str
    ahead: dict[str, str | None]
    """Tracker that is shown to be better by more than the margin, by name of the world; None where neither is. The
    tests are corrected for the pairs in all worlds of the scenario."""

    @property
    def order(self) -> Literal["holds", "turns", "holds in part", "not shown"]:
        """Order over all worlds. holds: the same tracker is ahead in each; turns: each is ahead in some world."""
        winners = {*self.ahead.values()}
        if {self.a, self.b} <= winners:
            return "turns"
        if winners == {None}:
            return "not shown"
        return "holds in part" if None in winners else "holds"


class Comparison(ResultModel):
    """Comparison of entrants over scenarios. An entrant is a tracker in a set of results; set 0 is the baseline.

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
    """Tracker that the others are shown against: the one the user named, else the ``score.baseline`` of all scenarios,
    else the best over several scenarios. None for several sets, and for one scenario without a baseline."""
    sets_of_scenes: list[list[str]]
    """Names of the scenarios, grouped where they share scenes, so that their differences are correlated."""
    ranking: list[RankedTracker]
    """Trackers of a single set: by the number of scenarios with a score, then by relative error, best first."""
    gates: list[GateResult]
    not_compared: list[NotCompared]
    notes: list[str]
    """Remarks for the reader on what limits or qualifies the comparison."""
    worlds: list[OrderInWorlds] = Field(default_factory=list)
    """Order of every pair of trackers of a single set, for scenarios in several worlds."""
    places: dict[str, int] = Field(default_factory=dict)
    """Index of each tracker in the first scenario file that has it, which selects its colour; only the first group has
    this."""
    origins: list[SetOrigin] = Field(default_factory=list)
    """When and with which code each of several sets was made; only the first group has this."""
    without_truth: list[str] = Field(default_factory=list)
    """Names of the scenarios that are not compared because they have no truth."""
    commands: list[str] = Field(default_factory=list)
    """Commands that repeat the runs and the comparison; empty where a result does not say how it was made."""
    other_groups: list[Comparison] = Field(default_factory=list)
    """Comparisons of these sets of results in scenarios with another ranking metric, one for each such metric."""

    @property
    def groups(self) -> list[Comparison]:
        """One comparison for each metric that ranks trackers, over the scenarios in which it ranks them."""
        others = [group.model_copy(update={"origins": self.origins}) for group in self.other_groups]
        return [self.model_copy(update={"other_groups": []}), *others]

    @property
    def passed(self) -> bool:
        """Whether every limit is shown to be kept in every group."""
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
