"""What a comparison found: the data that pages, terminals and gates show, and that is kept as JSON."""

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
#: Metrics that are times of computing: the same results on another machine have others, so no file keeps them.
TIMES = ("step_time",)
#: Significant digits that are kept: what differs from machine to machine is far behind them.
DIGITS = 4

GateOutcome = Literal["passed", "failed", "undecided", "error"]
#: What is said of a difference, turned round.
_TURNED = {"worse": "better", "better": "worse", "larger": "smaller", "smaller": "larger"}


class Entrant(ResultModel):
    """One tracker in one set of results."""

    tracker: str
    set: int = 0
    """Number of the set, in the order given; 0 is the baseline."""


class ComparedResult(ResultModel):
    """One result that takes part."""

    set: int
    label: str
    """Its folder, as the user named it."""
    runs: int
    seed: int
    expectations: int
    expectations_met: int
    shared_runs: int | None = None
    """Number of runs with the measurements that the baseline's had too, over which the differences are paired; None
    where they are not paired."""
    reason: str = ""
    """Why they are paired, or not; empty for the baseline."""


class ComparedScenario(ResultModel):
    """One scenario, with its results in the order of the sets."""

    name: str
    description: str
    results: list[ComparedResult]


class SetOrigin(ResultModel):
    """When a set of results was made, and of what."""

    set: int
    made_at: str | None
    """When the last of its runs began: UTC, ISO 8601; None in results of earlier versions."""
    commit: str | None
    """Commit of the repository that holds the scenarios; None without one."""
    changes: list[str]
    """What else changed since the set before, as the results state: versions, engine, trackers, scenario, code, commit;
    empty for the baseline."""


class EntrantScore(ResultModel):
    """What an entrant reached in a scenario."""

    scenario: str
    entrant: Entrant
    metrics: dict[str, MetricValue]
    """Those that have a value, by path."""
    diverged_runs: int
    rank: float | None
    """By the metric that ranks, in a set that is compared alone: one, and one for each tracker that is shown to be
    better by more than the margin, a half for each where neither is. None without a score, and with several sets."""
    leading: bool
    """Whether it is the best of the scenario, or was compared with the best and not shown to be worse by more than the
    margin."""
    failure: str = ""
    """Why there is no score."""
    reference: bool = False
    """Whether it knows which detection is whose, or later measurements, so that the others are ranked without it."""

    def value(self, metric: str) -> float | None:
        """The value of a metric, None where there is none."""
        value = self.metrics.get(metric)
        return None if value is None else value.value


class PairDifference(ResultModel):
    """A metric of one entrant minus that of another, in one scenario."""

    scenario: str
    metric: str
    unit: str
    entrant: Entrant
    against: Entrant
    value: float
    """Of the entrant, over the runs that are compared."""
    reference: float
    """Of the one that it is held against."""
    difference: float
    ci95: tuple[float, float] | None
    """Of the difference; None with fewer than two runs."""
    margin: float
    """Up to this a difference does not matter: that of the baseline, and not more than a limit."""
    p_value: float
    """Of the hypothesis that the difference is within the margin, corrected for the number of differences."""
    paired_runs: int | None
    """Number of runs over which it is paired; None for two independent samples."""
    stretches: int | None = None
    """Number of stretches of time of a single run or of few logs, where these are what is independent."""
    without_charged: float | None = None
    """The same over the estimates that were given alone, where over a tenth of the squared error of either is charged
    for missing ones. Neither is called better where this has the other sign."""
    scenes: int
    """Number of scenes that the runs are of; with several, the scenes are what is independent."""
    few_scenes_decide: bool = False
    """Whether one scene of a hundred may decide."""
    scenes_in_words: str = ""
    """Number and kind of the scenes, such as "6 sequences"; empty where there is one scene."""
    repeatable: bool = False
    """With a limit: whether both are of the same recorded data, in which nothing is drawn."""
    verdict: str
    """One of :data:`trackbench.metrics.differences.VERDICTS`."""
    scenes_ahead: tuple[int, int] | None = None
    """Number of scenes in which the entrant is the better one of the two, and of all; None where there is one scene."""
    log_ratio: LogRatio | None = None
    """Logarithm of the ratio of the value to the reference, its standard error and degrees of freedom, from which
    scenarios are pooled; None where one is not positive."""

    def turned(self) -> PairDifference:
        """Return the difference of the other one to this one."""
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
        """The difference in percent of the reference; None where that is zero."""
        return 100.0 * self.difference / abs(self.reference) if self.reference else None

    @property
    def percent_ci95(self) -> tuple[float, float] | None:
        """The interval of the difference in percent of the reference."""
        if self.ci95 is None or not self.reference:
            return None
        low, high = (100.0 * end / abs(self.reference) for end in self.ci95)
        return low, high

    @property
    def ratio_ci95(self) -> tuple[float, float] | None:
        """The interval of the ratio less one, in percent: also where the reference is less sure than the difference."""
        ratio = self.log_ratio
        if ratio is None or ratio.error is None:
            return None
        reach = stdtrit(ratio.freedom, 0.975) * ratio.error
        low, high = (float(100.0 * np.expm1(ratio.value + side)) for side in (-reach, reach))
        return low, high

    @property
    def identical(self) -> bool:
        """Whether the two had the same value in every run, but for rounding."""
        reach = max(abs(self.value), abs(self.reference)) * ROUNDING
        ends = self.ci95 or (self.difference,)
        return self.paired_runs is not None and max(map(abs, ends)) <= reach


class NotCompared(ResultModel):
    """What could not be compared."""

    scenario: str
    metric: str
    entrant: Entrant
    against: Entrant
    reason: str
    of_entrant: bool
    """Whether it is the entrant that has no value, and the other one has."""


class OverallChange(ResultModel):
    """A metric of an entrant against the baseline, over all scenarios in which both have it; it speaks of these."""

    metric: str
    entrant: Entrant
    against: Entrant
    verdicts: dict[str, int]
    """Number of scenarios by verdict."""
    mean_percent: float | None
    """The geometric mean of the ratios less one, in percent; None where a value is not positive."""
    ci95: tuple[float, float] | None = None
    """95 % interval of ``mean_percent``, over other noise and scenes of these scenarios. None where a scenario's
    difference has no interval, and where both trackers have the same value in every run."""


class RankedTracker(ResultModel):
    """One tracker over all its scenarios."""

    tracker: str
    scenarios: int
    mean_rank: float
    ci95: tuple[float, float] | None
    """95 % interval of the mean rank. None where there are too few trackers or sets of scenes for it, and where it has
    no width or covers all ranks."""
    won: int
    """Pairings with another tracker in a scenario in which its error is shown to be smaller by more than the margin."""
    lost: int
    tied: int
    """Those in which neither is."""
    consistent_scenarios: int
    """Scenarios in which its covariance is as large as its errors."""
    judged_scenarios: int
    """Scenarios in which that could be judged."""
    diverged_runs: int
    failed_scenarios: int
    """Scenarios without a score."""
    reference: bool = False
    """Whether it is no competitor: its rank is that which it would have, and it stands after the others."""


class RankDifference(ResultModel):
    """The mean rank of one tracker against that of another."""

    a: str
    b: str
    p_value: float
    """Of the hypothesis that both have the same expected rank in a scenario, corrected for the number of pairs."""
    shown: bool
    """Whether they are shown to differ."""


class GateResult(ResultModel):
    """A limit on how much worse a metric may be, held against one tracker of a later set in one scenario."""

    scenario: str
    entrant: Entrant
    metric: str
    percent: float
    outcome: GateOutcome
    """Outcome by the rule of :func:`trackbench.compare.limits.gate_results`; ``error``: the entrant has no value."""
    text: str
    """What was found, in one line."""


class OrderInWorlds(ResultModel):
    """Which of two trackers is ahead in each world of a scenario."""

    scenario: str
    """Without the world."""
    a: str
    """The better one of the two in the first world."""
    b: str
    ahead: dict[str, str | None]
    """By world, the tracker that is shown to be better by more than the margin; None where neither is. Corrected for
    the pairs of all worlds of the scenario."""

    @property
    def order(self) -> Literal["holds", "turns", "holds in part", "not shown"]:
        """turns: each is ahead in some world; holds: one is ahead in all of them."""
        winners = {*self.ahead.values()}
        if {self.a, self.b} <= winners:
            return "turns"
        if winners == {None}:
            return "not shown"
        return "holds in part" if None in winners else "holds"


class Comparison(ResultModel):
    """Entrants over scenarios. An entrant is a tracker in a set of results; the first set is the baseline.

    The fields are of the scenarios that the same metric ranks; ``groups`` has those of every such metric.
    """

    schema_version: int = SCHEMA_VERSION
    sets: list[str]
    """Their labels."""
    ranked_by: str = "position_rmse"
    """The metric that trackers are ranked by; ``tgospa`` where identities are hidden."""
    scenarios: list[ComparedScenario] = Field(min_length=1)
    scores: list[EntrantScore]
    differences: list[PairDifference]
    """Of one set: every pair of trackers. Of several: each entrant against the baseline."""
    overall: list[OverallChange]
    """Over several scenarios."""
    baseline: str | None = None
    """Tracker that the others are held against in ``overall``: ``score.baseline`` of all scenarios, else the best.
    Only of one set of results over several scenarios."""
    sets_of_scenes: list[list[str]]
    """The scenarios in sets: those that share scenes are one, which the ranking counts once."""
    ranking: list[RankedTracker]
    """Of one set, best first."""
    rank_differences: list[RankDifference]
    """Of one set over several scenarios: every pair of trackers, in the order of the ranking."""
    gates: list[GateResult]
    not_compared: list[NotCompared]
    notes: list[str]
    """What a reader must know beside the numbers."""
    worlds: list[OrderInWorlds] = Field(default_factory=list)
    """Of one set, scenarios in several worlds: every pair of trackers."""
    places: dict[str, int] = Field(default_factory=dict)
    """By tracker, its place in the first scenario that has it, from which it has its colour; those of all groups stand
    in the first."""
    origins: list[SetOrigin] = Field(default_factory=list)
    """Origin of each of several sets; those of all groups stand in the first."""
    without_truth: list[str] = Field(default_factory=list)
    """Scenarios that are not compared, for they have no truth."""
    commands: list[str] = Field(default_factory=list)
    """What makes it again: the runs, and the comparison; empty where a result does not say how it was made."""
    other_groups: list[Comparison] = Field(default_factory=list)
    """Of the same sets, the scenarios that another metric ranks, each metric's apart; these have no other groups."""

    @property
    def groups(self) -> list[Comparison]:
        """The scenarios of each metric that ranks, apart."""
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
        """The differences of each metric."""
        for metric in dict.fromkeys(item.metric for item in self.differences):
            yield metric, [item for item in self.differences if item.metric == metric]

    def json(self) -> dict[str, Any]:  # type: ignore[override]
        """The comparison as JSON values: four significant digits and no times, so it can be kept as a reference."""
        values = _rounded(self.model_dump(mode="json"))
        for group in (values, *values["other_groups"]):
            for score in group["scores"]:
                score["metrics"] = {name: entry for name, entry in score["metrics"].items() if name not in TIMES}
            for name in ("worlds", "commands", "places", "origins"):
                if not group[name]:
                    del group[name]
        return {**values, "passed": self.passed}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return value


def load_comparison(file: Path) -> Comparison:
    """A comparison that was kept as JSON.

    Raises:
        InputError: it cannot be read, or is none of this version.
    """
    return read_model(Comparison, file, "comparison", SCHEMA_VERSION)
