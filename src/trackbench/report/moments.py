"""Worst moments of the recorded run: largest errors and, with hidden identities, costliest failures."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence

import pyarrow.compute as pc

from trackbench.document import Code, Column, Paragraph, Section, Table
from trackbench.metrics.function_events import TrackEvent, events_of
from trackbench.metrics.recorded_run import EstimateMoment, recorded_estimates, worst
from trackbench.report.numbers import joined_names, percent, rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.results import Result


def worst_moments(result: Result) -> dict[str, EstimateMoment]:
    """Return the moment of each tracker's largest scored position error in the recorded run, best tracker first."""
    if not result.scored:
        return {}
    estimates = recorded_estimates(result)
    return {name: top for name in (tracker.name for tracker in result.scored) for top in worst(estimates, [name], 1)}


def diverged_elsewhere(result: Result) -> str:
    """Return a note on divergence in other runs than the recorded one: "Not shown: div diverged in run 7."."""
    runs: dict[str, list[int]] = {}
    filtering = {tracker.name for tracker in result.filtering}
    table = result.tables.if_there("runs")
    for row in table.filter(pc.greater(table["diverged"], 0)).to_pylist() if "diverged" in table.column_names else ():
        if row["tracker"] in filtering and row["run"] != result.summary.recorded_run:
            runs.setdefault(row["tracker"], []).append(int(row["run"]))
    parts = [
        f"{name} diverged in run {first}{f' and {len(more)} more' * bool(more)}"
        for name, (first, *more) in runs.items()
    ]
    return f"Not shown: {joined_names(parts)}." if parts else ""


def moment_text(moment: EstimateMoment) -> str:
    """Return error, object and time of a moment: "3.18 m, v5 at 7.40 s"."""
    return f"{rounded(moment.position_error_m, 2)} m, {moment.object} at {rounded(moment.time_s, 2)} s"


def moments_section(result: Result, moments: Mapping[str, EstimateMoment], ringed: Sequence[str]) -> Iterator[Section]:
    """Yield a section on the largest errors of the trackers ``ringed`` in the map, with commands to examine them."""
    rows = [(name, moments[name]) for name in ringed if name in moments]
    if not rows:
        return
    columns: dict[Column, Callable[[tuple[str, EstimateMoment]], str]] = {
        TRACKER: lambda row: row[0],
        Column("largest position error", left=True): lambda row: moment_text(row[1]),
    }
    table = text_table("worst-moments", rows, columns)
    elsewhere = [Paragraph(text)] if (text := diverged_elsewhere(result)) else []
    farthest, _ = max(rows, key=lambda row: row[1].position_error_m or 0.0)
    yield Section("Worst moments", (table, *elsewhere, _commands(result, 3, farthest)))


def _commands(result: Result, moments: int, tracker: str) -> Code:
    view = f"\ntrackbench view . --worst --tracker {tracker}" if result.summary.has_recording else ""
    return Code(f"trackbench inspect . --worst {moments}{view}", "sh")


#: Rows of the table of causes, at most.
MOST_CAUSES = 16


def events_section(result: Result) -> Iterator[Section]:
    """Yield a section on each tracker's costliest failure in the recorded run, and on the causes in all runs."""
    run = result.summary.recorded_run
    rows = [(tracker.name, events[0]) for tracker in result.scored if (events := events_of(result, tracker.name, run))]
    if not rows:
        return
    columns: dict[Column, Callable[[tuple[str, TrackEvent]], str]] = {
        TRACKER: lambda row: row[0],
        Column("event", left=True): lambda row: row[1].kind,
        Column("time, s"): lambda row: rounded(row[1].time_s, 2),
        Column("vehicle", left=True): lambda row: row[1].object or "none",
        Column("track"): lambda row: "none" if row[1].track is None else str(row[1].track),
        Column("cost, m²", _COST): lambda row: rounded(row[1].cost_m2, 1),
        Column("why", left=True): lambda row: row[1].reason,
    }
    table = text_table("costliest-events", rows, columns)
    dearest, _ = max(rows, key=lambda row: row[1].cost_m2)
    yield Section(f"Costliest events of run {run}", (table, _commands(result, 10, dearest), *_causes(result)))


_COST = "squared GOSPA of the missed objects and false tracks until it ends, or of the switch in squared T-GOSPA"


def _causes(result: Result) -> Iterator[Table]:
    """Yield a table of each tracker's costliest causes of missed objects, false tracks and switches, if any."""
    rows: list[tuple[str, ...]] = []
    trackers = result.drawn
    for tracker in trackers:
        costs: dict[tuple[str, str], float] = defaultdict(float)
        counts = Counter[tuple[str, str]]()
        for event in events_of(result, tracker.name):
            if event.cost_m2 > 0:
                costs[event.kind, event.cause] += event.cost_m2
                counts[event.kind, event.cause] += 1
        for key in sorted(costs, key=lambda key: -costs[key])[: max(1, MOST_CAUSES // max(1, len(trackers)))]:
            rows.append((tracker.name, *key, str(counts[key]), percent(costs[key] / sum(costs.values()))))
    headings = (
        TRACKER,
        Column("event", left=True),
        Column("why", left=True),
        Column("times", "in all runs"),
        Column("share of the cost", "of all events of the tracker, in all runs"),
    )
    columns = {heading: (lambda row, i=i: row[i]) for i, heading in enumerate(headings)}
    if rows:
        yield text_table("causes", rows, columns, "What costs most, in all runs")
