"""Largest errors of the recorded run and, with hidden identities, the costliest causes of failures in all runs."""

from __future__ import annotations

from collections import Counter, defaultdict

from trackbench.document import Column, Table
from trackbench.metrics.function_events import events_of
from trackbench.metrics.recorded_run import EstimateMoment, recorded_estimates, worst
from trackbench.report.numbers import percent, rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.results import Result


def worst_moments(result: Result) -> dict[str, EstimateMoment]:
    """Return each tracker's estimate with the largest scored position error in the recorded run, best tracker first."""
    if not result.scored:
        return {}
    estimates = recorded_estimates(result)
    return {name: top for name in (tracker.name for tracker in result.scored) for top in worst(estimates, [name], 1)}


def moment_text(moment: EstimateMoment) -> str:
    """Return error, object and time of a moment: "3.18 m, v5 at 7.40 s"."""
    return f"{rounded(moment.position_error_m, 2)} m, {moment.object} at {rounded(moment.time_s, 2)} s"


#: Rows of the table of causes, at most.
MOST_CAUSES = 16


def causes_table(result: Result) -> Table | None:
    """Return a table of each tracker's costliest causes of missed objects, false tracks and switches; None if none."""
    rows: list[tuple[str, ...]] = []
    trackers = result.drawn
    for tracker in trackers:
        costs: dict[tuple[str, str], float] = defaultdict(float)
        counts = Counter[tuple[str, str]]()
        for event in events_of(result, tracker.name):
            if event.cost_m2 > 0:
                costs[event.kind, event.cause] += event.cost_m2
                counts[event.kind, event.cause] += 1
        for key in sorted(costs, key=lambda key: -costs[key])[: max(1, MOST_CAUSES // len(trackers))]:
            rows.append((tracker.name, *key, str(counts[key]), percent(costs[key] / sum(costs.values()))))
    headings = (
        TRACKER,
        Column("event", left=True),
        Column("why", left=True),
        Column("times", "in all runs"),
        Column("share of the cost", "of all events of the tracker, in all runs"),
    )
    columns = {heading: (lambda row, i=i: row[i]) for i, heading in enumerate(headings)}
    return text_table("causes", rows, columns) if rows else None
