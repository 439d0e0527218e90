"""Metrics of every tracker from the blocks of a run, and whether the expectations of the scenario hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trackbench.metrics import BlockScores, Evaluation, evaluate, merge_sums, no_metrics
from trackbench.metrics.differences import UNDECIDED, size
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.registry import HEALTH
from trackbench.metrics.traffic import ASSOCIATION_METRICS, OF_FALSE_TRACKS, TRACK_METRICS, TRACKS, run_sums
from trackbench.results import Difference, ExpectationResult, Failure, TrackerResult, by_value
from trackbench.runner.block import Block, failures_and_outcomes
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import Work
from trackbench.scenario.keys import Expectation

#: Reason for a missing value where nothing had to be tracked: every number would look perfect.
NOTHING_DUE = "no object was ever due: none came into a sensor's view (fov_deg, max_range_m, mount)"
#: Reason for a missing value where a recording does not label its detections with objects.
UNLABELLED = "the recording does not say of which object a detection is"

#: Reason for a missing value of a metric that counts false tracks.
OTHERS_IGNORED = "tracks on no object are ignored (truth.reference.others)"


@dataclass(frozen=True)
class Evaluated:
    """Metrics, ranking and failures of the trackers of a run."""

    failures: Mapping[str, Failure]
    """Failure of each tracker that failed, by name."""
    evaluations: Mapping[str, Evaluation]
    """Metric values and intervals of each tracker that did not fail, by name."""
    ranked: Sequence[str]
    """Names of the trackers with enough estimates, best first."""
    outcomes: Mapping[str, Sequence[Outcome]]
    """Outcome (sums of scores) in each block of runs, by name of each tracker that did not fail."""
    scores: Mapping[str, BlockScores]
    """Sums behind the built-in metrics of estimates, by name of each tracker that did not fail; empty with hidden
    identities."""


def evaluate_trackers(work: Work, blocks: Sequence[Block]) -> Evaluated:
    """Merge the blocks, evaluate every metric of every tracker, and rank the trackers."""
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    summed = [metric for metric in work.metrics if work.has_truth or "truth" not in metric.needs]
    sums = {name: merge_sums([item.sums for item in items], summed) for name, items in outcomes.items()}
    evaluations = {name: _evaluation(work, item) for name, item in sums.items()}
    scores = {name: item[ESTIMATES.name] for name, item in sums.items() if ESTIMATES.name in item}
    incomplete = {name for name, item in scores.items() if not item.given or item.coverage < work.min_coverage}
    complete = [name for name in evaluations if name not in incomplete]
    errors = {name: evaluations[name].intervals.get(work.headline) for name in complete}
    values = {name: error.value for name, error in errors.items() if error is not None}
    ranked = by_value(values) if len(values) == len(complete) else complete
    return Evaluated(failures, evaluations, ranked, outcomes, scores)


def _evaluation(work: Work, sums: MetricSums) -> Evaluation:
    reason = "" if work.has_truth else "there is no truth"
    of_tracks = TRACKS.name in sums
    if of_tracks and work.has_truth and not run_sums(sums[TRACKS.name], "matched_share")[1].any():
        reason = NOTHING_DUE
    metrics = [metric for metric in work.metrics if not reason or "truth" not in metric.needs]
    options = {"in_time": work.stretches > 0, "few_scenes_decide": work.few_scenes_decide}
    evaluation = evaluate(sums, work.scene_of_run, metrics, work.recorded_noise, **options)
    if reason:
        evaluation.values |= no_metrics(reason, work.reported_metrics)
    elif of_tracks:
        if work.scenes[0].unlabelled:
            evaluation.values |= no_metrics(UNLABELLED, ASSOCIATION_METRICS)
        if work.scenes[0].truth.unscored is not None and work.scenes[0].truth.unscored.others:
            evaluation.values |= no_metrics(OTHERS_IGNORED, [TRACK_METRICS[path] for path in OF_FALSE_TRACKS])
    return evaluation


def judge(
    expectations: Sequence[Expectation],
    trackers: Sequence[TrackerResult],
    differences: Sequence[Difference],
    min_coverage: float,
) -> list[ExpectationResult]:
    """Return each expectation's outcome; a tracker that gave too few estimates (``min_coverage``) fails it."""
    by_name = {tracker.name: tracker for tracker in trackers}
    return [_judge(item, by_name[item.tracker], differences, min_coverage) for item in expectations]


def _judge(
    item: Expectation, tracker: TrackerResult, differences: Sequence[Difference], min_coverage: float
) -> ExpectationResult:
    value = _value_at_path(tracker, item.metric)
    number = value if isinstance(value, float | int) else None
    note = missing = _missing_share(tracker, item.metric, min_coverage)
    operator: str
    limit: str | float
    undecided = False
    if item.better_than is not None:
        # The tables show this difference too, with its correction for all comparisons.
        pair = {item.tracker, item.better_than}
        difference = next(
            (each for each in differences if each.metric == item.metric and {each.a, each.b} == pair), None
        )
        operator, limit = "better_than", item.better_than
        passed = difference is not None and difference.better == item.tracker
        undecided = difference is not None and difference.verdict == UNDECIDED
        if not passed and not note:
            note = _why_not_better(item.tracker, difference)
    elif item.equals is not None:
        operator, limit, passed, undecided = "is", item.equals, value == item.equals, value == UNDECIDED
    elif item.below is not None:
        operator, limit, passed = "below", item.below, number is not None and number < item.below
    else:
        assert item.above is not None
        operator, limit, passed = "above", item.above, number is not None and number > item.above
    shown = f"{limit:g}" if isinstance(limit, float) else limit
    return ExpectationResult(
        tracker=item.tracker,
        metric=item.metric,
        operator=operator,
        limit=limit,
        value=value,
        passed=passed and not note,
        undecided=undecided and not passed and not missing,
        text=f"{item.tracker} {item.metric} {operator.replace('_', ' ')} {shown}{note}",
    )


def _why_not_better(tracker: str, difference: Difference | None) -> str:
    if difference is None:
        return " (not compared)"
    assert difference.p_value is not None
    value = difference.value if difference.a == tracker else -difference.value
    word = difference.verdict
    if difference.turned:
        word = f"{size(value)}, but not without the charge for missing estimates"
    untested = difference.ci95 is None and difference.p_value == 1
    tested = (
        "too few runs or scenes to test"
        if untested
        else f"{word}, p = {difference.p_value:.2g} in the test for more than the margin"
    )
    return f" (difference {value:+.3g} {difference.unit}, {tested})"


def _missing_share(tracker: TrackerResult, path: str, min_coverage: float) -> str:
    """Say how many estimates or innovations a metric lacks, if these are too many to judge it; else empty."""
    for name, what in (("coverage", "estimates"), (path, "innovations"), (path.rpartition(".")[0], "innovations")):
        metric = tracker.metrics.get(name)
        share = None if metric is None else metric.value if name == "coverage" else metric.coverage
        if share is not None and share < min_coverage and path != "coverage":
            return f" ({100 * (1 - share):.0f} % of the {what} are missing)"
    return ""


def _value_at_path(tracker: TrackerResult, path: str) -> float | str | None:
    if path.startswith(HEALTH):
        count: float | None = getattr(tracker.health, path.removeprefix(HEALTH))
        return count
    if path in tracker.metrics:
        return tracker.metrics[path].value
    name, _, field = path.rpartition(".")
    value: float | str | None = getattr(tracker.metrics.get(name), field, None)
    return value
