"""What is in a recording of tracks, for a terminal of 80 columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from trackbench.report.numbers import fixed
from trackbench.report.traffic.console import values
from trackbench.subjects.recording.commands.inspection import (
    print_command,
    print_contents,
    print_failed,
    print_head,
    table,
)

if TYPE_CHECKING:
    from trackbench.metrics.track_events import TrackEvent
    from trackbench.subjects.recording.tracks.inspection import TrackInspection, TracksMoment


def print_tracks(found: TrackInspection, console: Console) -> None:
    """The contents and scores, or the moments that were asked for."""
    contents = found.contents
    result = contents.recorded.result
    print_head(contents.summary, console)
    if found.at is not None:
        _moment(found.at, console)
    if found.worst is not None and not contents.summary.truth.known:
        console.print(Text("\nThere is no truth, so no event has a cost."), highlight=False)
    elif found.worst:
        _worst(found.worst, console)
        print_command(contents, found.worst[0].tracker, console)
    elif found.worst is not None:
        console.print(Text("\nNo event of the recorded run cost anything."), highlight=False)
    if found.at is None and found.worst is None:
        print_contents(contents, console)
        console.print(Text("\nAll runs"), highlight=False)
        columns = values(result)
        rows = [[t.name, *(cells[i].plain for _, cells in columns)] for i, t in enumerate(result.scored)]
        console.print(table(["tracker", *(heading for heading, _ in columns)], rows))
    print_failed(contents.summary, console)


def _worst(events: list[TrackEvent], console: Console) -> None:
    console.print(Text("\nThe events of the recorded run that cost most"), highlight=False)
    rows = [
        [
            event.tracker,
            fixed(event.time_s, 2),
            event.kind,
            event.object or "-",
            "-" if event.track is None else str(event.track),
            fixed(event.cost_m2, 1),
            event.reason,
        ]
        for event in events
    ]
    console.print(table(["tracker", "time s", "event", "vehicle", "track", "cost m²", "why"], rows, texts=(0, 2, 3, 6)))


def _moment(moment: TracksMoment, console: Console) -> None:
    console.print(Text(f"\nAt {fixed(moment.time_s, 3)} s"), highlight=False)
    rows = [
        [
            vehicle.name,
            fixed(vehicle.px_m, 2),
            fixed(vehicle.py_m, 2),
            fixed(vehicle.speed_mps, 2),
            vehicle.status,
            ", ".join(name for name, state in vehicle.states.items() if state in ("waiting", "lost")),
        ]
        for vehicle in moment.vehicles
    ]
    heads = ["vehicle", "x m", "y m", "speed m/s", "status", "not tracked by"]
    console.print(table(heads, rows, texts=(0, 4, 5)))
    console.print()
    tracks = [
        [item.tracker, str(item.track), fixed(item.px_m, 2), fixed(item.py_m, 2), fixed(item.existence, 2)]
        for item in moment.tracks
    ]
    console.print(table(["tracker", "track", "x m", "y m", "existence"], tracks))
