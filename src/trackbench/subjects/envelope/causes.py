"""Why a tracker misses its requirement: under which condition, at which moment, and what an examination finds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor

from trackbench.base.execution import Task
from trackbench.base.subjects import offered, resolve
from trackbench.metrics.function_events import FunctionEvent, events_of, function_events, function_labels
from trackbench.metrics.moments import scene_at
from trackbench.metrics.recorded_run import load_recorded_run
from trackbench.report.moments import moment_text, worst_moments
from trackbench.results import ConditionScores, Result
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.trackers.config import FilterConfig

#: A condition stands out if it has at least this many times the squared error of its share of the estimates.
STANDS_OUT = 1.2
#: And at least this share of all.
LEAST = 0.1


def condition_of(result: Result, tracker: str, metric: str = "") -> str:
    """What carries the error: a manoeuvre or a range band; of tracks, the kind of event. Empty where none stands out,
    and of a function.

    Args:
        result: of all runs.
        tracker: its name.
        metric: that is not met.
    """
    if _function(result, metric):
        return ""
    if result.summary.identities == "hidden":
        return _dearest_kind(result, tracker)
    scores = result[tracker].breakdown
    if scores is None or not scores.all.count:
        return ""
    carriers = (_carrier(group, scores.all) for group in (scores.manoeuvre, scores.range))
    return ", ".join(text for text in carriers if text)


def _carrier(group: Mapping[str, ConditionScores], every: ConditionScores) -> str:
    """Of manoeuvres, or of range bands, the one that carries most beyond its share of the estimates."""
    total = _squares(every)
    shares = [(_squares(item) / total, item.count / every.count, name) for name, item in group.items() if total]
    carried, count, name = max(shares, key=lambda share: share[0] - share[1], default=(0.0, 1.0, ""))
    if carried < max(STANDS_OUT * count, LEAST):
        return ""
    return f"{name}: {100 * carried:.0f} % of the squared position error in {100 * count:.0f} % of the estimates"


def _squares(scores: ConditionScores) -> float:
    value = None if scores.position_rmse is None else scores.position_rmse.value
    return 0.0 if value is None else scores.count * value**2


def _dearest_kind(result: Result, tracker: str) -> str:
    costs: dict[tuple[str, str], float] = {}
    for event in events_of(result, tracker):
        costs[event.kind, event.cause] = costs.get((event.kind, event.cause), 0.0) + event.cost_m2
    total = sum(costs.values())
    if not total:
        return ""
    (kind, why), cost = max(costs.items(), key=lambda item: item[1])
    return f"{kind}, {why}: {100 * cost / total:.0f} % of the cost of all events"


def event_of(result: Result, tracker: str, metric: str = "") -> str:
    """What went wrong most in the recorded run; empty where nothing did, or nothing is known of it."""
    if label := _function(result, metric):
        decided = next(iter(function_events(result, label, tracker, result.summary.recorded_run)), None)
        if decided is None:
            return ""
        where = f" at {decided.object}" if decided.object else ""
        text = f"{label} {decided.word}{where} at {decided.time_s:.2f} s, by {decided.wrong_s:.2f} s"
        return ", ".join([text, *_errors_at(result, tracker, decided)])
    if result.summary.identities == "hidden":
        first = next(iter(events_of(result, tracker, result.summary.recorded_run)), None)
        return "" if first is None else f"{first.kind} at {first.time_s:.2f} s, {first.reason}"
    moment = worst_moments(result).get(tracker)
    return "" if moment is None else f"position error {moment_text(moment)}"


def _errors_at(result: Result, tracker: str, event: FunctionEvent) -> Iterator[str]:
    """The errors of the estimate of the object when the function was due: later ones did not decide it."""
    for estimate in scene_at(result, load_recorded_run(result), event.time_s).estimates:
        if (estimate.tracker, estimate.object) == (tracker, event.object) and estimate.velocity_error_mps is not None:
            position, velocity = estimate.position_error_m or 0.0, estimate.velocity_error_mps
            yield f"with a position error of {position:.2f} m and a velocity error of {velocity:.2f} m/s then"


def _function(result: Result, metric: str) -> str:
    """The function that a metric is of; empty where it is of none."""
    label = metric.partition(".")[2]
    paths = (path for item in result.summary.trackers for path in item.metrics)
    return label if label in function_labels(paths) else ""


def finding_on(loaded: Scenario, tracker: str, executor: Executor) -> str:
    """What the subjects that examine trackers say of a built-in one; empty of any other."""
    if not isinstance(loaded.config.trackers[tracker], FilterConfig):
        return ""
    sentences = []
    for name, target in offered("examiners"):
        remark = executor.submit(Task(resolve(target), loaded, own_folder(loaded)), tracker).result()
        sentences.append(f"the {name} finds no fault in it" if remark is None else f"the {name}: {remark}")
    return "; ".join(sentences)
