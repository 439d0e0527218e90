"""What a reader of the recording should know, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from trackbench.results import ExpectationResult, Result, Summary, TrackerResult
from trackbench.results.summary import SensorSummary
from trackbench.words import counted

NOT_AVAILABLE = "n/a"
IN_THE_SCENE = (
    "Boxes are the true vehicles, the arrow points where the body points. Small dots are measurements of the last"
    " 0.3 s. Larger dots are estimates, in the colours of the plots, each in its 95 % ellipse of position."
)


def ranking(result: Result) -> str:
    """The trackers by position RMSE, and whether the scenario's expectations were met."""
    summary = result.summary
    lines = list(ranked(result.name, str(summary.runs), [*result.scored, *result.unscored]))
    if summary.expectations:
        verdict = "all met" if summary.passed else "**not all met**"
        lines += ["", f"### Expectations: {verdict}", "", *map(_expectation, summary.expectations)]
    return "\n".join(lines)


def ranked(name: str, runs: str, trackers: Iterable[TrackerResult]) -> Iterator[str]:
    """A table of trackers in the order given, then those that failed."""
    yield f"## {name}"
    yield f"All {runs} runs, ranked by position RMSE"
    yield ""
    yield "| # | tracker | RMSE m | 95 % interval | RMSE / reference | NEES | covariance |"
    yield "|--:|:--|--:|:-:|--:|--:|:--|"
    failures = []
    for place, tracker in enumerate(trackers, start=1):
        yield _row(place, tracker)
        if tracker.failed is not None:
            failed = tracker.failed
            run = "" if failed.run is None else f", run {failed.run}"
            at = f"{_number(failed.time_s)} s (step {failed.step}{run})"
            failures.append(f"- **{tracker.name}** at {at}: {failed.cause}")
    if failures:
        yield from ("", "### Failed", "", *failures)


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
        ", ".join(f"{name} {version}" for name, version in summary.versions.items()),
    ]
    return "\n".join(lines)


def truth(summary: Summary) -> str:
    """Where the motion came from."""
    found = summary.truth
    source = " ".join(str(part) for part in (found.source, (found.model_extra or {}).get("env")) if part)
    return f"- truth: {source}, {counted(len(found.objects), 'target')}, {found.duration_s:g} s"


def legend(trackers: Iterable[TrackerResult], sensors: Mapping[str, SensorSummary]) -> Iterator[str]:
    """What the picture shows."""
    yield from ("", "### In the scene", "", IN_THE_SCENE)
    yield from ("", "### Trackers", "", *(f"- **{tracker.name}**: {tracker.describe}" for tracker in trackers))
    yield from ("", "### Sensors", "", *(_sensor(name, sensor) for name, sensor in sensors.items()))


def _row(place: int, tracker: TrackerResult) -> str:
    if tracker.failed is not None:
        return f"| {place} | {tracker.name} | failed | | | | |"
    error, nees = tracker.position_rmse, tracker.nees
    over = tracker.metrics.get("position_over_reference")
    cells = (
        str(place),
        tracker.name,
        _number(error.value),
        " to ".join(map(_number, error.ci95)) if error.ci95 else NOT_AVAILABLE,
        _number(None if over is None else over.value),
        _number(nees.value),
        nees.verdict or NOT_AVAILABLE,
    )
    return "| " + " | ".join(cells) + " |"


def _expectation(item: ExpectationResult) -> str:
    verdict = "met" if item.passed else "**not met**"
    value = item.value if isinstance(item.value, str) else _number(item.value)
    return f"- {verdict}: {item.text} (is {value})"


def _sensor(name: str, sensor: SensorSummary) -> str:
    preset = f", {sensor.preset}" if sensor.preset else ""
    share = sensor.detection_rate
    found = "no target in view" if share is None else f"{100 * share:.0f} % of targets detected"
    rate = "" if sensor.rate_hz is None else f", {sensor.rate_hz:.4g} Hz"
    return f"- **{name}**: {sensor.kind}{preset}{rate}, {found}"


def _number(value: float | None) -> str:
    if value is None:
        return NOT_AVAILABLE
    return f"{value:#.3g}" if abs(value) < 100 else f"{value:.0f}"
