"""What a reader of the recording should know, as Markdown."""

from __future__ import annotations

from typing import Any

from trackbench.words import counted

NOT_AVAILABLE = "n/a"


def ranking(summary: dict[str, Any]) -> str:
    """The trackers by position RMSE, and whether the scenario's expectations were met."""
    by_name = {tracker["name"]: tracker for tracker in summary["trackers"]}
    lines = [
        f"## {summary['scenario']['name']}",
        f"All {summary['runs']} runs, ranked by position RMSE",
        "",
        "| # | tracker | RMSE m | 95 % interval | RMSE / bound | NEES | covariance |",
        "|--:|:--|--:|:-:|--:|--:|:--|",
    ]
    lines += [_row(place, by_name[name]) for place, name in enumerate(summary["ranking"], start=1)]
    failed = [tracker for tracker in summary["trackers"] if tracker["failed"]]
    if failed:
        lines += ["", "### Failed", "", *(_failure(tracker["name"], tracker["failed"]) for tracker in failed)]
    if summary["expectations"]:
        verdict = "all met" if summary["passed"] else "**not all met**"
        lines += ["", f"### Expectations: {verdict}", ""]
        lines += [_expectation(item) for item in summary["expectations"]]
    return "\n".join(lines)


def about(summary: dict[str, Any]) -> str:
    """What was run, what the picture shows, and how to run it again."""
    scenario, truth = summary["scenario"], summary["truth"]
    source = " ".join(str(truth[key]) for key in ("source", "env") if truth.get(key))
    lines = [
        scenario["description"],
        "",
        f"- truth: {source}, {counted(len(truth['objects']), 'target')}, {truth['duration_s']:g} s",
        f"- shown: Monte-Carlo run {summary['recorded_run']} of {summary['runs']}, seed {summary['seed']}",
        f"- measurements: fingerprint `{summary['fingerprint'].removeprefix('sha256:')[:16]}`",
        "",
        "### In the scene",
        "",
        "Boxes are the true vehicles, the arrow points where the body points. Small dots are measurements of the last"
        " 0.3 s. Larger dots are estimates, in the colours of the plots, each in its 95 % ellipse of position.",
        "",
        "### Trackers",
        "",
        *(f"- **{tracker['name']}**: {tracker['describe']}" for tracker in summary["trackers"]),
        "",
        "### Sensors",
        "",
        *(_sensor(name, sensor) for name, sensor in summary["sensors"].items()),
        "",
        "### Again",
        "",
        f"`{summary['command']}`",
        "",
        ", ".join(f"{name} {version}" for name, version in summary["versions"].items()),
    ]
    return "\n".join(lines)


def _row(place: int, tracker: dict[str, Any]) -> str:
    if tracker["failed"]:
        return f"| {place} | {tracker['name']} | failed | | | | |"
    metrics = tracker["metrics"]
    error, nees = metrics["position_rmse"], metrics["nees"] or {}
    cells = (
        str(place),
        tracker["name"],
        _number(error.get("value")),
        _interval(error.get("ci95")),
        _number((metrics.get("position_efficiency") or {}).get("value")),
        _number(nees.get("mean")),
        nees.get("verdict") or NOT_AVAILABLE,
    )
    return "| " + " | ".join(cells) + " |"


def _failure(name: str, failed: dict[str, Any]) -> str:
    run = "" if failed["run"] is None else f", run {failed['run']}"
    return f"- **{name}** at {_number(failed['time_s'])} s (step {failed['step']}{run}): {failed['cause']}"


def _expectation(item: dict[str, Any]) -> str:
    verdict = "met" if item["passed"] else "**not met**"
    value = item["value"] if isinstance(item["value"], str) else _number(item["value"])
    return f"- {verdict}: {item['text']} (is {value})"


def _sensor(name: str, sensor: dict[str, Any]) -> str:
    preset = f", {sensor['preset']}" if sensor.get("preset") else ""
    share = sensor["detection_rate"]
    found = "no target in view" if share is None else f"{100 * share:.0f} % of targets detected"
    return f"- **{name}**: {sensor['kind']}{preset}, {sensor['rate_hz']:g} Hz, {found}"


def _interval(limits: list[float] | None) -> str:
    return " to ".join(_number(limit) for limit in limits) if limits else NOT_AVAILABLE


def _number(value: float | None) -> str:
    if value is None:
        return NOT_AVAILABLE
    return f"{value:#.3g}" if abs(value) < 100 else f"{value:.0f}"
