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

SCHEMA_VERSION = 4
#: Metrics of computing time: they differ between machines, so no file keeps them.
TIMES = ("step_time",)
#: Significant digits that are kept: machines differ only in digits far behind.
DIGITS = 4

GateOutcome = Literal["passed", "failed", "undecided", "error"]
#: Verdict on a difference with its sign reversed.
_TURNED = {"worse": "better", "better": "worse", "larger": "smaller", "smaller": "larger"}


class Entrant(ResultModel):
    """One tracker in one set of results."""

    tracker: str
    set: int = 0
    """Number of the set, in the order given; 0 for the baseline."""


class ComparedResult(ResultModel):
    """One result of a comparison."""

    set: int
    label: str
    """Folder of the result, as the user named it."""
    runs: int
    seed: int
    expectations: int
    expectations_met: int
    shared_runs: int | None = None
    """Number of runs with the measurements of a run of the baseline, over which the differences are paired; None where
    they are not paired."""
    reason: str = ""
    """Reason why the differences are paired, or not; empty for the baseline."""


class ComparedScenario(ResultModel):
    """One scenario, with its results in the order of the sets."""

    name: str
    description: str
    results: list[ComparedResult]


class SetOrigin(ResultModel):
    """Origin of a set of results: time and code."""

    set: int
    made_at: str | None
    """Time at which the last of its runs began: UTC, ISO 8601; None in results of earlier versions."""
    commit: str | None
    """Commit of the repository that holds the scenarios; None without one."""
    changes: list[str]
    """Changes since the previous set, as the results state: versions, engine, trackers, scenario, code, commit; empty
    for the baseline."""


class EntrantScore(ResultModel):
    """Score of an entrant in a scenario."""

    scenario: str
    entrant: Entrant
    metrics: dict[str, MetricValue]
    """Metrics with a value, by path."""
    diverged_runs: int
    rank: float | None
    """Rank in a single set: one, plus one for each tracker that is shown to be better by more than the margin, plus a
    half for each where neither is better. None without a score, and with several sets."""
    leading: bool
    """Whether it is the best of the scenario, or was compared with the best and not shown to be worse by more than the
    margin."""
    failure: str = ""
    """Reason for a missing score."""
    reference: bool = False
    """Whether it knows the origin of detections, or later measurements, so that the others are ranked without it."""

    def value(self, metric: str) -> float | None:
        """Return the value of a metric, None if it has none."""
        value = self.metrics.get(metric)
        return None if value is None else value.value


class PairDifference(ResultModel):
    """Value of a metric for an entrant minus the value for another entrant, in one scenario."""

    scenario: str
    metric: str
    unit: str
    entrant: Entrant
    against: Entrant
    value: float
    """Value of ``entrant`` over the runs that are compared."""
    reference: float
    """Value of ``against`` over the runs that are compared."""
    difference: float
    ci95: tuple[float, float] | None
    """Interval of the difference; None with fewer than two runs."""
    margin: float
    """Largest difference that does not matter: the margin of the baseline, or a smaller limit."""
    p_value: float
    """P-value of the hypothesis that the difference is within the margin, corrected for the number of differences."""
    paired_runs: int | None
    """Number of runs over which it is paired; None for two independent samples."""
    stretches: int | None = None
    """Number of stretches of time of a single run or of few logs, where these are the independent parts."""
    without_charged: float | None = None
    """Difference over the given estimates alone, where over a tenth of either squared error is charged for missing
    estimates. Neither entrant is called better where its sign differs."""
    scenes: int
    """Number of scenes of the runs; several scenes are the independent parts."""
    few_scenes_decide: bool = False
    """Whether one scene of a hundred may decide."""
    scenes_in_words: str = ""
    """Number and kind of the scenes, such as "6 sequences"; empty for one scene."""
    repeatable: bool = False
    """With a limit: whether both results are of the same recorded data, in which nothing is drawn."""
    verdict: str
    """One of :data:`trackbench.metrics.differences.VERDICTS`."""
    scenes_ahead: tuple[int, int] | None = None
    """Number of scenes in which the entrant is better, and number of all scenes; None for one scene."""
    log_ratio: LogRatio | None = None
    """Logarithm of the ratio of the value to the reference, from which scenarios are pooled; None where one of them is
    not positive."""

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
        """Difference in percent of the reference; None for a reference of zero."""
        return 100.0 * self.difference / abs(self.reference) if self.reference else None

    @property
    def percent_ci95(self) -> tuple[float, float] | None:
        """Interval of the difference in percent of the reference, which is taken as known."""
        if self.ci95 is None or not self.reference:
            return None
        low, high = (100.0 * end / abs(self.reference) for end in self.ci95)
        return low, high

    @property
    def ratio_ci95(self) -> tuple[float, float] | None:
        """Interval of the ratio less one, in percent; it allows for the uncertainty of the reference too."""
        ratio = self.log_ratio
        if ratio is None or ratio.error is None:
            return None
        reach = stdtrit(ratio.freedom, 0.975) * ratio.error
        return as_percent(ratio.value - reach), as_percent(ratio.value + reach)

    @property
    def identical(self) -> bool:
        """Whether both entrants had the same value in every run, but for rounding."""
        reach = max(abs(self.value), abs(self.reference)) * ROUNDING
        ends = self.ci95 or (self.difference,)
        return self.paired_runs is not None and max(map(abs, ends)) <= reach


class NotCompared(ResultModel):
    """Pair of entrants that could not be compared by a metric."""

    scenario: str
    metric: str
    entrant: Entrant
    against: Entrant
    reason: str
    of_entrant: bool
    """Whether only ``entrant`` has no value."""


class OverallChange(ResultModel):
    """Change of a metric of an entrant against the baseline, over the scenarios in which both have a value."""

    metric: str
    entrant: Entrant
    against: Entrant
    verdicts: dict[str, int]
    """Number of scenarios by verdict."""
    mean_percent: float | None
    """Geometric mean of the ratios less one, in percent; None where a value is not positive."""
    ci95: tuple[float, float] | None = None
    """95 % interval of ``mean_percent``, over other noise and scenes of these scenarios. None where a scenario's
    difference has no interval, and where both trackers have the same value in every run."""


class RankedTracker(ResultModel):
    """Mean rank and record of one tracker over all its scenarios."""

    tracker: str
    scenarios: int
    mean_rank: float
    ci95: tuple[float, float] | None
    """95 % interval of the mean rank. None where there are too few trackers or sets of scenes for it, and where it has
    no width or covers all ranks."""
    won: int
    """Number of pairings in a scenario in which its error is shown to be smaller by more than the margin."""
    lost: int
    tied: int
    """Number of pairings in which neither error is shown to be smaller."""
    consistent_scenarios: int
    """Number of scenarios in which the covariance is as large as the errors."""
    judged_scenarios: int
    """Number of scenarios with a verdict on the covariance."""
    diverged_runs: int
    failed_scenarios: int
    reference: bool = False
    """Whether it is no competitor: it stands after the others, with the rank that it would have."""


class RankDifference(ResultModel):
    """Test of the mean ranks of two trackers."""

    a: str
    b: str
    p_value: float
    """P-value of the hypothesis of equal expected ranks in a scenario, corrected for the number of pairs."""
    shown: bool
    """Whether the mean ranks are shown to differ."""


class GateResult(ResultModel):
    """Outcome of a limit on how much worse a metric may be, for one tracker of a later set in one scenario."""

    scenario: str
    entrant: Entrant
    metric: str
    percent: float
    outcome: GateOutcome
    """Outcome by the rule of :func:`trackbench.compare.limits.gate_results`; ``error``: the entrant has no value."""
    text: str


class OrderInWorlds(ResultModel):
    """Order of two trackers in each world of a scenario."""

    scenario: str
    """Name of the scenario without its world."""
    a: str
    """Tracker with the smaller error in the first world."""
    b: str
    ahead: dict[str, str | None]
    """Tracker that is shown to be better by more than the margin, by world; None where neither is. Corrected for the
    pairs of all worlds of the scenario."""

    @property
    def order(self) -> Literal["holds", "turns", "holds in part", "not shown"]:
        """Order over all worlds. turns: each tracker is ahead in some world; holds: one is ahead in every world."""
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
    """Labels of the sets."""
    ranked_by: str = "position_rmse"
    """Metric that ranks trackers; ``tgospa`` with hidden identities."""
    scenarios: list[ComparedScenario] = Field(min_length=1)
    scores: list[EntrantScore]
    differences: list[PairDifference]
    """Differences of every pair of trackers in a single set, or of each entrant to the baseline with several sets."""
    overall: list[OverallChange]
    """Changes over several scenarios; else empty."""
    baseline: str | None = None
    """Tracker that the others are compared with in ``overall``: ``score.baseline`` of all scenarios, else the best.
    None unless a single set has several scenarios."""
    sets_of_scenes: list[list[str]]
    """Sets of scenarios that share scenes; the ranking counts each set once."""
    ranking: list[RankedTracker]
    """Trackers of a single set, best first."""
    rank_differences: list[RankDifference]
    """Tests of every pair of trackers of a single set over several scenarios, in the order of the ranking."""
    gates: list[GateResult]
    not_compared: list[NotCompared]
    notes: list[str]
    """Remarks that a reader needs beside the numbers."""
    worlds: list[OrderInWorlds] = Field(default_factory=list)
    """Order of every pair of trackers of a single set, for scenarios in several worlds."""
    places: dict[str, int] = Field(default_factory=dict)
    """Place of each tracker in the first scenario that has it, which gives its colour; the first group has all."""
    origins: list[SetOrigin] = Field(default_factory=list)
    """Origin of each of several sets; the first group has all."""
    without_truth: list[str] = Field(default_factory=list)
    """Scenarios that are not compared, as they have no truth."""
    commands: list[str] = Field(default_factory=list)
    """Commands that repeat the runs and the comparison; empty where a result does not say how it was made."""
    other_groups: list[Comparison] = Field(default_factory=list)
    """Comparisons of the same sets, one for each other metric that ranks; these have no other groups."""

    @property
    def groups(self) -> list[Comparison]:
        """Comparisons of the scenarios that each metric ranks."""
        others = [group.model_copy(update={"origins": self.origins}) for group in self.other_groups]
        return [self.model_copy(update={"other_groups": []}), *others]

    @property
    def passed(self) -> bool:
        """Whether every limit is shown to be kept in every group."""
        return all(outcome == "passed" for outcome in self.outcomes)

    @property
    def outcomes(self) -> list[GateOutcome]:
        """Outcomes of all limits, group by group."""
        return [item.outcome for group in self.groups for item in group.gates]

    @property
    def trackers(self) -> list[str]:
        """Every tracker of every group, in the order in which they first appear."""
        return list(dict.fromkeys(score.entrant.tracker for group in self.groups for score in group.scores))

    def by_metric(self) -> Iterator[tuple[str, list[PairDifference]]]:
        """Yield each metric with its differences."""
        for metric in dict.fromkeys(item.metric for item in self.differences):
            yield metric, [item for item in self.differences if item.metric == metric]

    def json(self) -> dict[str, Any]:  # type: ignore[override]
        """Return the comparison as JSON values: four significant digits and no times, so it can be a reference."""
        values = _rounded(self.model_dump(mode="json"))
        for group in (values, *values["other_groups"]):
            for score in group["scores"]:
                score["metrics"] = {name: entry for name, entry in score["metrics"].items() if name not in TIMES}
            for name in ("worlds", "commands", "places", "origins"):
                if not group[name]:
                    del group[name]
        return {**values, "passed": self.passed}


def as_percent(log_ratio: float) -> float:
    """Return a ratio less one in percent, from its logarithm."""
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
    """Load a comparison that was kept as JSON.

    Raises:
        InputError: the file cannot be read, or is no comparison of this version.
    """
    return read_model(Comparison, file, "comparison", SCHEMA_VERSION)
