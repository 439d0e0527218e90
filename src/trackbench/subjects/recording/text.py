"""What a reader of the recording should know, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

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
        *legend(summary.trackers, summary.sensors),
        *("", "### Again", "", f"`{summary.command}`", ""),
        summary.made_with,
    ]
    return "\n".join(lines)


def truth(summary: Summary) -> str:
    """Where the motion came from."""
    found = summary.truth
    source = " ".join(str(part) for part in (found.source, (found.model_extra or {}).get("env")) if part)
    return f"- truth: {source}, {counted(len(found.objects), 'target')}, {found.duration_s:g} s"


def legend(trackers: Iterable[TrackerResult], sensors: Mapping[str, SensorSummary]) -> Iterator[str]:
    """What the picture shows."""
    yield from ("", "### In the scene", "", IN_THE_SCENE, "", "### In the plots", "", IN_THE_PLOTS)
    yield from ("", "### Trackers", "", *(f"- **{tracker.name}**: {tracker.describe}" for tracker in trackers))
    yield from ("", "### Sensors", "", *(sensor_line(name, sensor) for name, sensor in sensors.items()))


def _row(tracker: TrackerResult) -> str:
    if tracker.failed is not None:
        return f"| {tracker.name} | failed | | | |"
    nees = tracker.nees
    over = tracker.metrics.get("position_over_reference")
    cells = (
        f"{tracker.name} ({tracker.aside})" if tracker.aside else tracker.name,
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
