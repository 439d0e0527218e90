"""What a recording shows: one run, or several of the same traffic laid over each other, with the texts beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.errors import counted
from trackbench.document.palette import tracker_colours
from trackbench.metrics.function_events import FunctionEvent, function_events
from trackbench.metrics.verdicts import named_verdicts, only_where, what_is_off
from trackbench.report.numbers import reach_text
from trackbench.results import (
    MOST_DRAWN,
    ExpectationResult,
    MetricValue,
    Result,
    Summary,
    Tables,
    TrackerResult,
    by_value,
)
from trackbench.results.columns import split
from trackbench.results.scenario_summary import SensorSummary
from trackbench.subjects.recording.focus import Focus, moment_of
from trackbench.subjects.recording.views import ErrorMap


@dataclass(frozen=True)
class Contents:
    """What is drawn, and the texts beside it."""

    name: str
    runs: str
    """How many runs the scores are over: "100", or "4 and 6" where those of several results differ."""
    recorded_run: str
    """The number of the recorded run, or the numbers."""
    vehicles: list[str]
    """Those that are tracked."""
    colours: Mapping[str, str]
    """By tracker."""
    sensors: Mapping[str, SensorSummary]
    tables: Tables
    reference: str
    """What the reference is called."""
    ranking: str
    """Markdown."""
    about: str
    """Markdown."""
    best: str | None = None
    """The best tracker."""
    unlabelled: Result | None = None
    """The result of a run with hidden identities."""
    function_events: list[FunctionEvent] = field(default_factory=list)
    """Those of the recorded run in which something was wrong."""
    baselines: frozenset[str] = frozenset()
    """Trackers that filter nothing, beside others."""
    moment: Focus = field(default_factory=Focus)
    """One that is worth seeing first."""

    @property
    def decisions(self) -> pa.Table:
        """What functions decide; without rows where there are none."""
        return self.tables.if_there("decisions")

    @cached_property
    def errors(self) -> ErrorMap | None:
        """The map of errors; None where identities are hidden, or there are no errors."""
        shown = [name for name in self.colours if name not in self.baselines] if self.unlabelled is None else []
        return ErrorMap(self.tables, shown, self.hold) or None

    @property
    def hold(self) -> float:
        """For how long an estimate is shown when none follows: the period of the slowest sensor, s."""
        return max((1.0 / sensor.rate_hz for sensor in self.sensors.values() if sensor.rate_hz), default=1.0)


def contents_of(result: Result) -> Contents:
    """The contents of a recording of one run."""
    summary = result.summary
    drawn = {tracker.name for tracker in [*result.drawn, *result.unscored][:MOST_DRAWN]}
    names = [name for name in result if name in drawn]
    tables = result.tables
    if len(names) < len(summary.trackers):
        tables = Tables(
            {
                name: table.filter(pc.is_in(table["tracker"], pa.array(names)))
                if "tracker" in table.column_names
                else table
                for name, table in tables.items()
            }
        )
    return Contents(
        name=result.name,
        runs=str(summary.runs),
        recorded_run=str(summary.recorded_run),
        vehicles=list(summary.truth.objects),
        colours=tracker_colours({name: result.places[name] for name in names}),
        sensors=summary.sensors,
        tables=tables,
        reference="" if summary.reference is None else summary.reference.label,
        ranking=ranking_text(result.listed),
        about=about(result),
        best=result.contenders[0].name if result.scored else None,
        unlabelled=result if summary.identities == "hidden" else None,
        function_events=[event for event in _recorded_events(result) if event.tracker in names],
        baselines=_baselines(result.summary.trackers),
        moment=moment_of(result),
    )


def _baselines(trackers: Iterable[TrackerResult]) -> frozenset[str]:
    own = {tracker.name: tracker.baseline for tracker in trackers}
    return frozenset(name for name, baseline in own.items() if baseline and not all(own.values()))


def _recorded_events(result: Result) -> Iterator[FunctionEvent]:
    for (function,) in split(result.tables.if_there("decisions"), "function"):
        yield from function_events(result, function, run=result.summary.recorded_run)


def labels(paths: Sequence[Path]) -> list[str]:
    """A short name for each of several runs: the part of their paths that tells them apart."""
    parts = [path.resolve().with_suffix("").parts for path in paths]
    for i in range(1, min(map(len, parts)) + 1):
        names = [part[-i] for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{path} ({number})" for number, path in enumerate(paths, start=1)]


def same_traffic(results: Sequence[Result]) -> bool:
    """Whether all show the same motion of the same objects."""
    first, *others = (split(result.tables.truth, "role", "object") for result in results)
    return all(_same(first, other, ("px_m", "py_m")) for other in others)


def laid_over(named: Mapping[str, Result]) -> Contents:
    """Runs of the same traffic in one scene; a tracker is called "its name (its run's name)"."""
    first, *others = named.values()
    drawn = split(first.tables.measurements, "sensor", "object")
    once = all(
        _same(drawn, split(other.tables.measurements, "sensor", "object"), ("time_s", "x_m", "y_m")) for other in others
    )
    trackers = [
        tracker.model_copy(update={"name": _named(tracker.name, label)})
        for label, result in named.items()
        for tracker in result.summary.trackers
    ]
    sensors = {
        name if once else _named(name, label): sensor
        for label, result in named.items()
        for name, sensor in result.summary.sensors.items()
    }
    tables = ("steps", "nis", "estimates", "recorded_nis", "modes", "recorded_modes", "decisions")
    parts = dict.fromkeys(tables, "tracker")
    if not once:
        parts["measurements"] = "sensor"
    joined = {
        table: _joined({label: result.tables.if_there(table) for label, result in named.items()}, column)
        for table, column in parts.items()
    }
    references = {result.summary.held_against.label for result in named.values()}
    name, runs = " over ".join(named), _each(result.summary.runs for result in named.values())
    lines = [truth_line(first.summary)]
    for label, result in named.items():
        summary = result.summary
        run = f"run {summary.recorded_run} of {summary.runs}, seed {summary.seed}"
        lines.append(f"- **{label}**: {run}, measurements `{summary.fingerprint}`; `{summary.command}`")
    if len({result.summary.fingerprint for result in named.values()}) > 1:
        lines += ["", "The scores are over different measurements: a small difference between two may be chance."]
    return Contents(
        name=name,
        runs=runs,
        recorded_run=_each(result.summary.recorded_run for result in named.values()),
        vehicles=list(first.summary.truth.objects),
        colours=tracker_colours(
            {_named(name, label): place for label, result in named.items() for name, place in result.places.items()}
        ),
        baselines=_baselines(trackers),
        moment=moment_of(first),
        sensors=sensors,
        tables=Tables({**first.tables, **joined}),
        reference=references.pop() if len(references) == 1 else "reference",
        ranking="\n".join(ranked(name, runs, _by_error(trackers))),
        about="\n".join([*lines, *legend(trackers, sensors)]),
        function_events=[
            event._replace(tracker=_named(event.tracker, label))
            for label, result in named.items()
            for event in _recorded_events(result)
        ],
    )


def _each(numbers: Any) -> str:
    """ "4", or "4 and 6" where they differ."""
    return " and ".join(dict.fromkeys(map(str, numbers)))


def _named(name: str, label: str) -> str:
    return f"{name} ({label})"


def _by_error(trackers: Sequence[TrackerResult]) -> list[TrackerResult]:
    values = [None if tracker.failed is not None else tracker.position_rmse.value for tracker in trackers]
    order = by_value({i: float("inf") if value is None else value for i, value in enumerate(values)})
    return [trackers[i] for i in order]


def _joined(tables: Mapping[str, pa.Table], column: str) -> pa.Table:
    """The rows of all tables, with their label after the name in a column."""
    parts = []
    for label, table in tables.items():
        if table.num_rows:
            names = pa.array([_named(str(name), label) for name in table.column(column).to_pylist()])
            plain = table.set_column(table.schema.get_field_index(column), column, names)
            parts.append(
                {
                    name: plain[name].cast(pa.string()) if pa.types.is_dictionary(plain[name].type) else plain[name]
                    for name in sorted(plain.column_names)
                }
            )
    return pa.concat_tables([pa.table(part) for part in parts]) if parts else pa.table({})


def _same(a: Mapping[Any, Any], b: Mapping[Any, Any], names: Sequence[str]) -> bool:
    """Whether the rows of every key have the same values in these columns."""
    return a.keys() == b.keys() and all(
        np.array_equal(a[key][name], b[key][name], equal_nan=True) for key in a for name in names
    )


NOT_AVAILABLE = "n/a"
IN_THE_SCENE = (
    "Boxes are the true vehicles, the arrow points where the body points. Small dots are measurements of the last"
    " 0.3 s. Larger dots are estimates, in the colours of the plots, each in its 95 % ellipse of position. Lines are"
    " the true and the estimated paths of the last 2 s."
)
IN_THE_PLOTS = (
    "Grey lines are the reference and bounds; one of one tracker alone has its colour. Plots of log10 are of the same"
    " values, where they span a large range: 0 is 1, -1 is 0.1. All have one time axis."
)
IN_THE_SCENE_OF_TRACKS = (
    "A tab for each tracker. Boxes are the true vehicles, small dots detections of the last 0.3 s, false alarms among "
    "them. Larger dots are tracks with their numbers and 95 % ellipses, in pale colours by identity; a track "
    "that states a smaller existence probability is fainter. Lines are the paths of the last 2 s, true and tracked. "
    "A red ring is a due vehicle without a track. Switches, losses and false tracks are marked for 1 s. The view on "
    "the right also has the gates of the built-in trackers' tracks, and a line from each track to the detection that "
    "it took, where the tracker says so."
)
METRICS = {"tgospa": "T-GOSPA m", "gospa": "GOSPA m", "gospa_missed": "missed", "gospa_false": "false", "hota": "HOTA"}
INTERVALS = {"tgospa": "T-GOSPA m", "gospa": "GOSPA m", "hota": "HOTA"}


def ranking_text(result: Result) -> str:
    """The trackers by position RMSE or T-GOSPA, and whether the scenario's expectations were met."""
    summary = result.summary
    if summary.identities == "hidden":
        lines = [f"## {result.name}", f"{all_runs(str(summary.runs))}, ranked by T-GOSPA", ""]
        lines += _table(result.scored, METRICS, lambda metric: number(metric.value))
        if any(metric.ci95 for tracker in result.scored for metric in tracker.metrics.values()):
            lines += ["", "### 95 % intervals", "", *_table(result.scored, INTERVALS, _interval)]
        lines += _failed({tracker.name: result.why_unscored(tracker) for tracker in result.unscored})
    else:
        lines = list(ranked(result.name, str(summary.runs), [*result.scored, *result.unscored]))
        for word, heading, of in named_verdicts({tracker.name: tracker.nees for tracker in result.scored}):
            lines += ["", f"*{word}*: {heading}:", ""]
            lines += [f"- **{name}**: {what_is_off(nees, word=word)}" for name, nees in of.items()]
    if summary.expectations:
        verdict = "all met" if summary.passed else "**not all met**"
        lines += ["", f"### Expectations: {verdict}", "", *map(_expectation, summary.expectations)]
    return "\n".join(lines)


def ranked(name: str, runs: str, trackers: Sequence[TrackerResult]) -> list[str]:
    """A table of trackers in the order given, then those that failed."""
    return [
        f"## {name}",
        f"{all_runs(runs)}, ranked by position RMSE, ± 95 %; diverged: runs",
        "",
        "| tracker | RMSE m | covariance | NEES | / ref |",
        "|:--|--:|:--|--:|--:|",
        *map(_row, trackers),
        *_failed({tracker.name: tracker.failed for tracker in trackers if tracker.failed is not None}),
    ]


def _failed(causes: Mapping[str, object]) -> list[str]:
    lines = [f"- **{name}**: {cause}" for name, cause in causes.items()]
    return ["", "### Failed", "", *lines] if lines else []


def all_runs(runs: str) -> str:
    """What the scores are over: "1 run", "All 100 runs", "All 4 and 6 runs"."""
    return "1 run" if runs == "1" else f"All {runs} runs"


def about(result: Result) -> str:
    """What was run, what the picture shows, and how to run it again."""
    summary = result.summary
    lines = [
        summary.scenario.description,
        "",
        truth_line(summary),
        f"- shown: Monte-Carlo run {summary.recorded_run} of {summary.runs}, seed {summary.seed}",
        f"- measurements: fingerprint `{summary.fingerprint}`",
        *legend(summary.trackers, summary.sensors, hidden=summary.identities == "hidden"),
        *("", "### Again", "", f"`{summary.command}`", ""),
        summary.made_with,
    ]
    return "\n".join(lines)


def truth_line(summary: Summary) -> str:
    """Where the motion came from."""
    motion = summary.truth
    source = " ".join(str(part) for part in (motion.source, (motion.model_extra or {}).get("env")) if part)
    return f"- truth: {source}, {counted(len(motion.objects), 'target')}, {motion.duration_s:g} s"


def legend(
    trackers: Iterable[TrackerResult], sensors: Mapping[str, SensorSummary], hidden: bool = False
) -> Iterator[str]:
    """What the picture shows, the trackers and the sensors; ``hidden``: the identities are."""
    yield from ("", "### In the scene", "", IN_THE_SCENE_OF_TRACKS if hidden else IN_THE_SCENE)
    if not hidden:
        yield from ("", "### In the plots", "", IN_THE_PLOTS)
    yield from ("", "### Trackers", "")
    for tracker in trackers:
        yield f"- **{tracker.name}**: {', '.join(filter(None, (tracker.association, tracker.describe)))}"
    yield from ("", "### Sensors", "", *(sensor_line(name, sensor) for name, sensor in sensors.items()))


def _row(tracker: TrackerResult) -> str:
    if tracker.failed is not None:
        return f"| {tracker.name} | failed | | | |"
    nees, where = tracker.nees, only_where(tracker.nees, 1)
    over, lost = tracker.metrics.get("position_over_reference"), tracker.health.diverged_runs
    cells = (
        f"{tracker.name} ({tracker.reference_kind})" if tracker.reference_kind else tracker.name,
        f"{number(tracker.position_rmse.value)}, diverged: {lost}" if lost else with_interval(tracker.position_rmse),
        f"{nees.verdict or NOT_AVAILABLE}{where and f' ({where})'}",
        number(nees.value),
        number(None if over is None else over.value),
    )
    return "| " + " | ".join(cells) + " |"


def with_interval(metric: MetricValue) -> str:
    """The value with half of its 95 % interval, or with its ends, to the same decimals."""
    value = number(metric.value)
    return " ".join(filter(None, [value, reach_text(metric.value, metric.ci95, len(value.partition(".")[2]))]))


def _expectation(item: ExpectationResult) -> str:
    verdict = "met" if item.passed else "**undecided**" if item.undecided else "**not met**"
    value = item.value if isinstance(item.value, str) else number(item.value)
    return f"- {verdict}: {item.text} (is {value})"


def sensor_line(name: str, sensor: SensorSummary) -> str:
    """A sensor in a line."""
    preset = f", {sensor.preset}" if sensor.preset else ""
    share = sensor.detection_rate
    detected = "no target in view" if share is None else f"{100 * share:.0f} % of targets detected"
    rate = "" if sensor.rate_hz is None else f", {sensor.rate_hz:.4g} Hz"
    sees = f"field of view {sensor.fov_deg:g} deg, range {sensor.range_in_words}"
    sigmas = f"noise (1 sigma) {sensor.noise_in_words}"
    mount = f"mount {sensor.mount_in_words}"
    return f"- **{name}**: {sensor.kind}{preset}{rate}, {detected}; {sigmas}; {sees}; {mount}"


def number(value: float | None) -> str:
    """Three significant digits, or the whole part."""
    if value is None:
        return NOT_AVAILABLE
    return f"{value:#.3g}" if abs(value) < 100 else f"{value:.0f}"


def _table(
    trackers: Sequence[TrackerResult], metrics: Mapping[str, str], cell: Callable[[MetricValue], str]
) -> Iterator[str]:
    yield "| tracker | " + " | ".join(metrics.values()) + " |"
    yield "|:--|" + "--:|" * len(metrics)
    for tracker in trackers:
        name = f"{tracker.name} (reference)" if tracker.is_reference else tracker.name
        cells = [cell(tracker.metrics[path]) if path in tracker.metrics else NOT_AVAILABLE for path in metrics]
        yield "| " + " | ".join([name, *cells]) + " |"


def _interval(metric: MetricValue) -> str:
    return NOT_AVAILABLE if metric.ci95 is None else f"{number(metric.ci95[0])} to {number(metric.ci95[1])}"
