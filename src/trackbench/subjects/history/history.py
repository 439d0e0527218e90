"""A history as data: what pages, the terminal and gates show, and what is kept as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.execution import one_blas_thread
from trackbench.compare.comparison import GateOutcome
from trackbench.compare.limits import Limit
from trackbench.metrics import Metric
from trackbench.results import MetricValue, merged_places
from trackbench.results.metric_value import ResultModel
from trackbench.subjects.history.changes import (
    OPTION,
    HistoryGate,
    MarkedStretches,
    causes,
    history_gates,
    scenario_sha256,
    stretches_of,
)
from trackbench.subjects.history.past_results import PastResult, results_of_scenario

SCHEMA_VERSION = 1
#: Results before the last one that it is held against, unless told otherwise.
WINDOW = 5


class HistoryEntry(ResultModel):
    """One result."""

    number: int
    """From 1, the earliest."""
    folder: str
    made_at: str | None
    """UTC, ISO 8601; None where it does not say."""
    commit: str | None
    changed: bool | None
    trackbench: str | None
    """The version."""
    scenario_sha256: str
    """Of the text of the scenario and what was set over it."""
    code: dict[str, str | None]
    """By tracker with code of its own, the sha256 of it."""
    seed: int
    runs: int
    values: dict[str, dict[str, MetricValue]]
    """By tracker, the metrics that are looked at by path."""
    failures: dict[str, str]
    """By tracker that has no score, why."""


class HistoryChange(ResultModel):
    """Where a metric of a tracker is shown to have changed by more than the margin."""

    result: int
    """The first result that is shown to differ."""
    since: int
    """The result that it differs from: the first one after the change before."""
    tracker: str
    metric: str
    unit: str
    reference: float
    """Of the result ``since``."""
    value: float
    difference: float
    ci95: tuple[float, float] | None
    percent: float | None
    p_value: float
    """Corrected for the number of looks."""
    paired_runs: int | None
    """None for two independent samples."""
    verdict: str
    """better, worse, larger or smaller."""
    causes: list[str]
    """What else changed after ``since``, the latest first."""


class HistoryBreak(ResultModel):
    """A result that cannot be compared with those before."""

    result: int
    since: int
    trackers: list[str]
    reason: str


class History(ResultModel):
    """Results of one scenario, the earliest first."""

    schema_version: int = SCHEMA_VERSION
    scenario: str
    metrics: list[str]
    trackers: list[str]
    places: dict[str, int] = Field(default_factory=dict)
    """By tracker, its place in the latest scenario that has it, from which it has its colour."""
    results: list[HistoryEntry]
    changes: list[HistoryChange]
    breaks: list[HistoryBreak]
    looks: int
    """Number of differences that were looked at, for which the p-values are corrected."""
    gates: list[HistoryGate]
    notes: list[str]

    @property
    def passed(self) -> bool:
        """Whether every limit is shown to be kept."""
        return all(outcome == "passed" for outcome in self.outcomes)

    @property
    def outcomes(self) -> list[GateOutcome]:
        """Outcomes of all limits."""
        return [gate.outcome for gate in self.gates]

    def json(self) -> dict[str, Any]:  # type: ignore[override]
        """As JSON values."""
        return {**self.model_dump(mode="json"), "passed": self.passed}


@one_blas_thread()
def history_of(
    folders: Sequence[Path],
    *,
    metrics: Sequence[str] = (),
    trackers: Sequence[str] | None = None,
    scenario: str | None = None,
    limits: Sequence[Limit] = (),
    window: int = WINDOW,
) -> History:
    """The history of the results in some folders.

    Args:
        folders: of runs, or of folders of runs, however deep.
        metrics: what to look at, beside what limits name; the metric that ranks unless given.
        trackers: names of those to look at; all unless given.
        scenario: whose results; the one that most are of unless given.
        limits: how much worse the last result may be than those of the window.
        window: number of results before the last one.

    Raises:
        InputError: no results, one that cannot be read, a name that is not there, or a limit that no result can show.
    """
    past = results_of_scenario(folders, scenario)
    entries = past.entries
    named = [*dict.fromkeys([*metrics, *(limit.metric for limit in limits)])]
    chosen = _metrics(entries[-1], named, {limit.metric: OPTION for limit in limits})
    places = merged_places(entry.result for entry in reversed(entries))
    names = list(places)
    for name in trackers or ():
        if name not in names:
            raise InputError(f"no tracker {name!r} in these results; {nearest_choices(name, names)}", key="--trackers")
    names = [name for name in names if trackers is None or name in trackers]
    stretches = stretches_of(entries, names, chosen)
    return History(
        scenario=past.scenario,
        metrics=[metric.path for metric in chosen],
        trackers=names,
        places={name: places[name] for name in names},
        results=[_entry(number, entry, names, chosen) for number, entry in enumerate(entries, 1)],
        changes=_changes(entries, stretches),
        breaks=_breaks(stretches),
        looks=stretches.looks,
        gates=history_gates(entries, names, limits, window),
        notes=past.notes,
    )


def _metrics(last: PastResult, wanted: Sequence[str], options: Mapping[str, str]) -> list[Metric]:
    """Those that are named, by ``--metric`` or another option, or the one that ranks."""
    if not last.result.summary.truth.known:
        raise InputError("a recording without a truth: there are no errors to look at", file=last.label)
    for path in wanted:
        if path not in last.metrics:
            problem = f"{path!r} has no value in each run; {nearest_choices(path, last.metrics)}"
            raise InputError(problem, key=options.get(path, "--metric"))
    return [last.metrics[path] for path in wanted or [last.result.summary.headline]]


def _entry(number: int, entry: PastResult, trackers: Sequence[str], metrics: Sequence[Metric]) -> HistoryEntry:
    summary = entry.result.summary
    made, there = summary.provenance, [name for name in trackers if name in entry.result]
    failures = {name: reason for name in there if (reason := entry.failure(name))}
    values = {
        name: {
            metric.path: value
            for metric in metrics
            if (value := entry.result[name].metrics.get(metric.path.removesuffix(".mean"))) is not None
        }
        for name in there
        if name not in failures
    }
    return HistoryEntry(
        number=number,
        folder=entry.label,
        made_at=made and made.made_at,
        commit=made and made.commit,
        changed=made and made.changed,
        trackbench=summary.versions.get("trackbench"),
        scenario_sha256=scenario_sha256(entry),
        code={} if made is None else made.code,
        seed=summary.seed,
        runs=summary.runs,
        values=values,
        failures=failures,
    )


def _changes(entries: Sequence[PastResult], stretches: MarkedStretches) -> list[HistoryChange]:
    changes = []
    for change in stretches.changes:
        item = change.difference
        tracker, place = item.entrant.tracker, item.entrant.set
        changes.append(
            HistoryChange(
                result=place + 1,
                since=change.since + 1,
                tracker=tracker,
                percent=item.percent,
                causes=causes(entries, tracker, change.since, place),
                **item.model_dump(include={*HistoryChange.model_fields} & {*type(item).model_fields}),
            )
        )
    return changes


def _breaks(stretches: MarkedStretches) -> list[HistoryBreak]:
    """One for all trackers that it is of."""
    names_by_break: dict[tuple[int, int, str], list[str]] = {}
    for (tracker, place), (since, reason) in stretches.breaks.items():
        names_by_break.setdefault((place + 1, since + 1, reason), []).append(tracker)
    return [
        HistoryBreak(result=a, since=b, reason=why, trackers=names)
        for (a, b, why), names in sorted(names_by_break.items())
    ]
