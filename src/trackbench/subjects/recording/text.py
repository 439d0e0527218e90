"""What a reader of a recording should know, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.metrics.verdict_words import MEANING, conditions_off
from trackbench.results import ExpectationResult, MetricValue, Result, Summary, TrackerResult, sensor_words
from trackbench.results.scenario_summary import SensorSummary

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
METRICS = {"gospa": "GOSPA m", "gospa_missed": "missed", "gospa_false": "false", "hota": "HOTA"}
INTERVALS = {"gospa": "GOSPA m", "hota": "HOTA"}


def ranking(result: Result) -> str:
    """The trackers by position RMSE, and whether the scenario's expectations were met."""
    summary = result.summary
    lines = list(ranked(result.name, str(summary.runs), [*result.scored, *result.unscored]))
    return "\n".join([*lines, *_mixed(result.scored), *expectations(summary)])


def expectations(summary: Summary) -> Iterator[str]:
    """Whether those of the scenario were met."""
    if summary.expectations:
        verdict = "all met" if summary.passed else "**not all met**"
        yield from ("", f"### Expectations: {verdict}", "", *map(_expectation, summary.expectations))


def ranked(name: str, runs: str, trackers: Iterable[TrackerResult]) -> Iterator[str]:
    """A table of trackers in the order given, then those that failed."""
    yield f"## {name}"
    yield f"{all_runs(runs)}, ranked by position RMSE, ± 95 %"
    yield ""
    yield "| tracker | RMSE m | / ref | NEES | covariance |"
    yield "|:--|--:|--:|--:|:--|"
    failures = []
    for tracker in trackers:
        yield _row(tracker)
        if tracker.failed is not None:
            failures.append(f"- **{tracker.name}**: {tracker.failed}")
    if failures:
        yield from ("", "### Failed", "", *failures)


def _mixed(trackers: Iterable[TrackerResult]) -> Iterator[str]:
    """Under which conditions each mixed covariance is off."""
    found = [tracker for tracker in trackers if tracker.nees.verdict == "mixed"]
    if found:
        yield from ("", f"*mixed*: {MEANING['mixed']}. NEES where {found[0].nees.dof} is right:", "")
        yield from (f"- **{tracker.name}**: {conditions_off(tracker.nees)}" for tracker in found)


def all_runs(runs: str) -> str:
    """What the scores are over: "1 run", "All 100 runs", "All 4 and 6 runs"."""
    return "1 run" if runs == "1" else f"All {runs} runs"


def about(result: Result) -> str:
    """What was run, what the picture shows, and how to run it again."""
    summary = result.summary
    lines = [
        summary.scenario.description,
        "",
        truth(summary),
        f"- shown: Monte-Carlo run {summary.recorded_run} of {summary.runs}, seed {summary.seed}",
        f"- measurements: fingerprint `{summary.fingerprint}`",
        *legend(summary.trackers, summary.sensors, hidden=summary.identities == "hidden"),
        *("", "### Again", "", f"`{summary.command}`", ""),
        summary.made_with,
    ]
    return "\n".join(lines)


def truth(summary: Summary) -> str:
    """Where the motion came from."""
    found = summary.truth
    source = " ".join(str(part) for part in (found.source, (found.model_extra or {}).get("env")) if part)
    return f"- truth: {source}, {counted(len(found.objects), 'target')}, {found.duration_s:g} s"


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
    nees = tracker.nees
    over = tracker.metrics.get("position_over_reference")
    cells = (
        f"{tracker.name} ({tracker.reference_kind})" if tracker.reference_kind else tracker.name,
        with_interval(tracker.position_rmse),
        number(None if over is None else over.value),
        number(nees.value),
        nees.verdict or NOT_AVAILABLE,
    )
    return "| " + " | ".join(cells) + " |"


def with_interval(metric: MetricValue) -> str:
    """The value with half the width of its 95 % interval, to the same decimals."""
    value = number(metric.value)
    if metric.ci95 is None:
        return value
    places = len(value.partition(".")[2])
    return f"{value} ±{(metric.ci95[1] - metric.ci95[0]) / 2:.{places}f}"


def _expectation(item: ExpectationResult) -> str:
    verdict = "met" if item.passed else "**not met**"
    value = item.value if isinstance(item.value, str) else number(item.value)
    return f"- {verdict}: {item.text} (is {value})"


def sensor_line(name: str, sensor: SensorSummary) -> str:
    """A sensor in a line."""
    preset = f", {sensor.preset}" if sensor.preset else ""
    share = sensor.detection_rate
    found = "no target in view" if share is None else f"{100 * share:.0f} % of targets detected"
    rate = "" if sensor.rate_hz is None else f", {sensor.rate_hz:.4g} Hz"
    sees = f"field of view {sensor.fov_deg:g} deg, range {sensor_words.reach(sensor)}"
    sigmas = f"noise (1 sigma) {sensor_words.noise(sensor)}"
    mount = f"mount {sensor_words.mount(sensor)}"
    return f"- **{name}**: {sensor.kind}{preset}{rate}, {found}; {sigmas}; {sees}; {mount}"


def number(value: float | None) -> str:
    """Three significant digits, or the whole part."""
    if value is None:
        return NOT_AVAILABLE
    return f"{value:#.3g}" if abs(value) < 100 else f"{value:.0f}"


def track_ranking(result: Result) -> str:
    """The trackers by GOSPA, and whether the scenario's expectations were met."""
    lines = [f"## {result.name}", f"{all_runs(str(result.summary.runs))}, ranked by GOSPA", ""]
    lines += _table(result.scored, METRICS, lambda metric: number(metric.value))
    if any(metric.ci95 for tracker in result.scored for metric in tracker.metrics.values()):
        lines += ["", "### 95 % intervals", "", *_table(result.scored, INTERVALS, _interval)]
    failed = [f"- **{tracker.name}**: {result.why_unscored(tracker)}" for tracker in result.unscored]
    if failed:
        lines += ["", "### Failed", "", *failed]
    return "\n".join([*lines, *expectations(result.summary)])


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
