"""What a run found, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.report.numbers import NOT_AVAILABLE, Metric, decimals, fixed, half_width
from trackbench.report.significance import Differences, letters
from trackbench.report.tables import TONE
from trackbench.report.wording import Tracker, expectations_met, failure, precision_reached, scored, unscored
from trackbench.results import RunResult
from trackbench.words import counted

_STYLE = {"good": "green", "warn": "yellow", "bad": "bold red", "": "dim"}


def print_summary(result: RunResult, console: Console) -> None:
    """The ranked table, what it leaves out, the expectations, and the trackers that failed."""
    summary = result.summary
    trackers = scored(summary)
    console.print(_title(summary), highlight=False)
    if trackers:
        console.print(_ranked(summary, trackers))
        for note in _notes(summary, trackers):
            console.print(Text(note, style="dim"), highlight=False)
    for tracker in unscored(summary):
        label = ("FAILED ", _STYLE["bad"]) if tracker["failed"] else ("NO SCORE ", _STYLE["warn"])
        console.print(Text.assemble(label, f"{tracker['name']}: {failure(tracker)}"), highlight=False)
    if summary["expectations"]:
        console.print(Text(expectations_met(summary["expectations"])), style="bold", highlight=False)
        for missed in (item for item in summary["expectations"] if not item["passed"]):
            console.print(_missed(missed), highlight=False)


def _title(summary: Mapping[str, Any]) -> Text:
    truth = summary["truth"]
    what = f"{counted(summary['runs'], 'run')}, {counted(len(truth['objects']), 'vehicle')}, "
    return Text.assemble(
        (summary["scenario"]["name"], "bold"), f": {what}{fixed(truth['duration_s'], 1)} s, seed {summary['seed']}"
    )


def _ranked(summary: Mapping[str, Any], trackers: Sequence[Tracker]) -> Table:
    alike = letters([tracker["name"] for tracker in trackers], Differences(summary["differences"]))
    positions = _column(trackers, "position_rmse")
    velocities = _column(trackers, "velocity_rmse")
    efficiencies = _column(trackers, "position_efficiency")
    costs = _column(trackers, "step_time", 2)
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("tracker", overflow="fold")
    table.add_column("position m", justify="right", no_wrap=True)
    table.add_column("alike", no_wrap=True)
    table.add_column("vel. m/s", justify="right", no_wrap=True)
    table.add_column("/bound", justify="right", no_wrap=True)
    table.add_column("NEES", no_wrap=True)
    table.add_column("lost", justify="right", no_wrap=True)
    table.add_column("µs/step", justify="right", no_wrap=True)
    for i, tracker in enumerate(trackers):
        table.add_row(
            Text(tracker["name"], style="bold"),
            positions[i],
            alike[tracker["name"]],
            velocities[i],
            efficiencies[i],
            _nees(tracker["metrics"]["nees"]),
            _lost(tracker["health"]["diverged_runs"]),
            costs[i],
        )
    return table


def _column(trackers: Sequence[Tracker], name: str, significant: int = 3) -> list[str]:
    """One metric down the column; only the position has room for its interval."""
    metrics = [tracker["metrics"][name] for tracker in trackers]
    places = decimals([metric["value"] for metric in metrics], significant)
    return [fixed(m["value"], places) + (_half_width(m, places) if name == "position_rmse" else "") for m in metrics]


def _half_width(metric: Metric, places: int) -> str:
    width = half_width(metric)
    return "" if width is None else f" ±{fixed(width, places)}"


def _nees(nees: Mapping[str, Any]) -> Text:
    if nees["mean"] is None:
        return Text(NOT_AVAILABLE, style="dim")
    mean = f"{nees['mean']:.1f}" if nees["mean"] < 1000 else f"{nees['mean']:.0e}"
    return Text.assemble(f"{mean:>5} ", (nees["verdict"], _STYLE[TONE[nees["verdict"]]]))


def _lost(runs: int) -> Text:
    return Text(str(runs), style=_STYLE["bad"] if runs else "")


def _notes(summary: Mapping[str, Any], trackers: Sequence[Tracker]) -> list[str]:
    """What the headings mean, where they say something, and what else a reader must know."""
    notes = [f"±: 95 %; /bound: over the Cramér-Rao bound; lost: diverged runs of {summary['runs']}"]
    if len(trackers) > 1:
        notes.append("alike: no difference in position was shown between those that share a letter")
    if summary["runs"] == 1:
        notes.append("one run gives no interval and shows no difference")
    if "precision" in summary:
        notes.append(precision_reached(summary["precision"], summary["runs"]))
    repaired = [(t["name"], t["health"]["repaired_covariances"]) for t in trackers]
    notes += [f"{name}: {counted(count, 'covariance')} repaired" for name, count in repaired if count]
    for metric in ("velocity_rmse", "position_efficiency", "nees"):
        missing = {(t["metrics"][metric].get("reason") or "not given") for t in trackers if _is_missing(t, metric)}
        notes += [f"{metric.replace('_', ' ')} n/a: {reason}" for reason in sorted(missing)]
    return notes


def _is_missing(tracker: Tracker, metric: str) -> bool:
    found = tracker["metrics"][metric]
    return found.get("value", found.get("mean")) is None


def _missed(item: Mapping[str, Any]) -> Text:
    value = item["value"]
    found = (
        fixed(value, decimals([value])) if isinstance(value, float) else value if value is not None else NOT_AVAILABLE
    )
    return Text.assemble(("  FAILED ", _STYLE["bad"]), f"{item['text']}: {found}")
