"""What a run found, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.text import Text

from trackbench.report.numbers import NOT_AVAILABLE, Metric, decimals, fixed, half_width
from trackbench.report.significance import Differences, letters
from trackbench.report.tables import TONE
from trackbench.report.wording import Tracker, expectations_met, failure, precision_reached, scored, unscored
from trackbench.results import Result
from trackbench.words import counted

_STYLE = {"good": "green", "warn": "yellow", "bad": "bold red", "": "dim"}
#: From here on a number is written with its power of ten.
_HUGE = 1e4
_MOST_LETTERS = 12


def print_summary(result: Result, console: Console) -> None:
    """The ranked table, what it leaves out, the expectations, and the trackers that failed."""
    summary = result.json()
    trackers = scored(summary)
    console.print(_title(summary), highlight=False)
    if trackers:
        for row in _ranked(summary, trackers, console.width):
            console.print(row, highlight=False, soft_wrap=True)
        for note in _notes(summary, trackers):
            console.print(Text(note, style="dim"), highlight=False)
    _print_failed_trackers(summary, console)
    if summary["expectations"]:
        console.print(Text(expectations_met(summary["expectations"])), style="bold", highlight=False)
        _print_missed(summary, console)


def print_outcome(result: Result, console: Console) -> None:
    """One line, and what failed."""
    summary = result.json()
    outcome = f"{summary['scenario']['name']}: {expectations_met(summary['expectations'])}"
    console.print(Text(outcome), highlight=False)
    _print_failed_trackers(summary, console)
    _print_missed(summary, console)


def _print_failed_trackers(summary: Mapping[str, Any], console: Console) -> None:
    for tracker in unscored(summary):
        label = ("FAILED ", _STYLE["bad"]) if tracker["failed"] else ("NO SCORE ", _STYLE["warn"])
        console.print(Text.assemble(label, f"{tracker['name']}: {failure(tracker)}"), highlight=False)


def _print_missed(summary: Mapping[str, Any], console: Console) -> None:
    for missed in (item for item in summary["expectations"] if not item["passed"]):
        console.print(_missed(missed), highlight=False)


def _title(summary: Mapping[str, Any]) -> Text:
    truth = summary["truth"]
    what = f"{counted(summary['runs'], 'run')}, {counted(len(truth['objects']), 'vehicle')}, "
    return Text.assemble(
        (summary["scenario"]["name"], "bold"), f": {what}{fixed(truth['duration_s'], 1)} s, seed {summary['seed']}"
    )


@dataclass(frozen=True)
class _Column:
    heading: str
    cells: list[Text]
    right: bool = True

    @property
    def width(self) -> int:
        return max(len(self.heading), *(cell.cell_len for cell in self.cells))

    def shown(self, text: Text) -> Text:
        filled = text.copy()
        filled.align("right" if self.right else "left", self.width)
        return filled


def _ranked(summary: Mapping[str, Any], trackers: Sequence[Tracker], width: int) -> list[Text]:
    """The table, line by line; a name that its column has no room for stands on a line of its own."""
    health = [tracker["health"]["diverged_runs"] for tracker in trackers]
    alike = _alike(summary, trackers)
    columns = [
        _Column("position m", _values(trackers, "position_rmse")),
        *([_Column("alike", [Text(group) for group in alike], right=False)] if alike else []),
        _Column("vel. m/s", _values(trackers, "velocity_rmse")),
        _Column("/bound", _values(trackers, "position_efficiency")),
        _Column("NEES", [_nees(tracker["metrics"]["nees"]) for tracker in trackers], right=False),
        _Column("lost", [Text(str(runs), style=_STYLE["bad"] if runs else "") for runs in health]),
        _Column("µs/step", _values(trackers, "step_time", 2)),
    ]
    room = width - sum(1 + column.width for column in columns)
    names = [Text(tracker["name"], style="bold") for tracker in trackers]
    first = _Column("tracker", [name for name in names if len(name) <= room] or [Text()], right=False)
    rows = [_row([first, *columns], [Text(column.heading, style="dim") for column in (first, *columns)])]
    for i, name in enumerate(names):
        fits = len(name) <= room
        rows += [] if fits else [name]
        rows.append(_row([first, *columns], [name if fits else Text(), *(column.cells[i] for column in columns)]))
    return rows


def _row(columns: Sequence[_Column], cells: Sequence[Text]) -> Text:
    row = Text(" ").join(column.shown(cell) for column, cell in zip(columns, cells, strict=True))
    row.rstrip()
    return row


def _alike(summary: Mapping[str, Any], trackers: Sequence[Tracker]) -> list[str]:
    """The letters of each tracker; nothing where there are so many that they say nothing at a glance."""
    found = letters([tracker["name"] for tracker in trackers], Differences(summary["differences"]))
    return list(found.values()) if max(map(len, found.values())) <= _MOST_LETTERS else []


def _values(trackers: Sequence[Tracker], name: str, significant: int = 3) -> list[Text]:
    """One metric down the column; only the position has room for its interval."""
    metrics = [tracker["metrics"][name] for tracker in trackers]
    places = decimals([metric["value"] for metric in metrics], significant)
    return [Text(_short(m["value"], places) + (_spread(m, places) if name == "position_rmse" else "")) for m in metrics]


def _short(value: float | None, places: int) -> str:
    return fixed(value, places) if value is None or value < _HUGE else f"{value:.1e}"


def _spread(metric: Metric, places: int) -> str:
    width = half_width(metric)
    return "" if width is None else f" ±{_short(width, places)}"


def _nees(nees: Mapping[str, Any]) -> Text:
    if nees["mean"] is None:
        return Text(NOT_AVAILABLE, style="dim")
    mean = f"{nees['mean']:.1f}" if nees["mean"] < 1000 else f"{nees['mean']:.0e}"
    return Text.assemble(f"{mean:>5} ", (nees["verdict"], _STYLE[TONE[nees["verdict"]]]))


def _notes(summary: Mapping[str, Any], trackers: Sequence[Tracker]) -> list[str]:
    """What the headings mean, where they say something, and what else a reader must know."""
    notes = [f"±: 95 %; /bound: over the Cramér-Rao bound; lost: diverged runs of {summary['runs']}"]
    if not _alike(summary, trackers):
        notes.append("alike: too many groups for this table; report.html has them")
    elif len(trackers) > 1:
        notes.append("alike: no difference in position was shown between those that share a letter")
    if summary["runs"] == 1:
        notes.append("one run gives no interval and shows no difference")
    if summary["precision"]:
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
