"""What a reader of a recording of tracks should know, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.subjects.recording.text import NOT_AVAILABLE, all_runs, expectations, number, sensor_line, truth

IN_THE_SCENE = (
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
    """The trackers by GOSPA, and whether the scenario's expectations were met."""
    lines = [f"## {result.name}", f"{all_runs(str(result.summary.runs))}, ranked by GOSPA", ""]
    lines += _table(result.scored, METRICS, lambda metric: number(metric.value))
    if any(metric.ci95 for tracker in result.scored for metric in tracker.metrics.values()):
        lines += ["", "### 95 % intervals", "", *_table(result.scored, INTERVALS, _interval)]
    failed = [f"- **{tracker.name}**: {result.why_unscored(tracker)}" for tracker in result.unscored]
    if failed:
        lines += ["", "### Failed", "", *failed]
    return "\n".join([*lines, *expectations(result.summary)])


def about(result: Result) -> str:
    """What was run, what the picture shows, and how to run it again."""
    return "\n".join(_about(result))


def _about(result: Result) -> Iterator[str]:
    summary = result.summary
    yield from (summary.scenario.description, "", truth(summary))
    yield f"- shown: Monte-Carlo run {summary.recorded_run} of {summary.runs}, seed {summary.seed}"
    yield f"- measurements: fingerprint `{summary.fingerprint}`"
    yield from ("", "### In the scene", "", IN_THE_SCENE, "", "### Trackers", "")
    for tracker in summary.trackers:
        yield f"- **{tracker.name}**: {', '.join(filter(None, (tracker.association, tracker.describe)))}"
    yield from ("", "### Sensors", "", *(sensor_line(name, sensor) for name, sensor in summary.sensors.items()))
    yield from ("", "### Again", "", f"`{summary.command}`", "")
    yield summary.made_with


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
