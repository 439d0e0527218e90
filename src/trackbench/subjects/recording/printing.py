"""What is in a recording, for a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.metrics.moments import EstimateMoment, SceneMoment
from trackbench.metrics.track_events import TrackEvent
from trackbench.report.console import track_values
from trackbench.report.numbers import decimals, fixed
from trackbench.results import Summary
from trackbench.subjects.recording.inspection import Inspection, RecordedContents, TracksMoment

#: Scores that differ by less than this share are the same but for rounding.
ROUNDING = 1e-9
#: Scores that are computed afresh, with their headings.
ERRORS = {"position_rmse": "position m", "velocity_rmse": "vel. m/s", "course_rmse": "course deg"}


def print_inspection(inspection: Inspection, console: Console) -> None:
    """The contents and scores, or the moments that were asked for.

    Args:
        inspection: of a recording.
        console: without markup and highlighting.
    """
    contents, summary = inspection.contents, inspection.contents.summary
    hidden = summary.identities == "hidden"
    _head(summary, console)
    if isinstance(inspection.at, TracksMoment):
        _tracks(inspection.at, console)
    elif inspection.at is not None:
        _scene(inspection.at, console)
        _modes(inspection, console)
    if isinstance(inspection.worst, dict):
        _worst(inspection.worst, console)
        _command(contents, list(inspection.worst)[:1], console)
    elif inspection.worst is not None:
        _events(inspection.worst, summary.truth.known, console)
        _command(contents, [event.tracker for event in inspection.worst[:1]], console)
    if inspection.at is None and inspection.worst is None:
        _contents(contents, console)
        (_all_runs if hidden else _scores)(inspection, console)
        _modes(inspection, console)
    if hidden:
        _failed(summary, console)


def _head(summary: Summary, console: Console) -> None:
    what = f"run {summary.recorded_run} of {summary.runs}, {summary.truth.vehicles}, "
    line = f": {what}{fixed(summary.truth.duration_s, 1)} s, seed {summary.seed}"
    console.print(Text.assemble((summary.scenario.name, "bold"), line))


def _command(contents: RecordedContents, trackers: list[str], console: Console) -> None:
    """What shows the worst moment of the first of the trackers."""
    for tracker in trackers:
        command = f"trackbench view {contents.recorded.file} --worst --tracker {tracker}"
        console.print(f"\n{command}", style="dim", soft_wrap=True)


def _contents(contents: RecordedContents, console: Console) -> None:
    """Where it comes from, and how much was measured."""
    summary, recorded = contents.summary, contents.recorded
    if summary.scenario.description:
        console.print(summary.scenario.description)
    written = f"written by Rerun {recorded.rerun}" if recorded.rerun else "tables and summary of the run"
    console.print(f"{recorded.file}: {written}", style="dim", soft_wrap=True)
    console.print(summary.made_with, style="dim", soft_wrap=True)
    console.print(f"measurements: {summary.fingerprint}", style="dim", soft_wrap=True)
    for name, sensor in contents.sensors.items():
        measured = f"{counted(sensor.measurements, 'measurement')} at {sensor.instants} instants"
        console.print(f"{name}: {sensor.kind}, {measured}", style="dim", soft_wrap=True)
    console.print(f"made by: {summary.command}", style="dim", soft_wrap=True)


def _all_runs(inspection: Inspection, console: Console) -> None:
    console.print("\nAll runs")
    columns = track_values(inspection.contents.recorded.result)
    rows = [[t.name, *(cells[i].plain for _, cells in columns)] for i, t in enumerate(inspection.scored)]
    console.print(_table(["tracker", *(heading for heading, _ in columns)], rows))


def _scores(inspection: Inspection, console: Console) -> None:
    summary, sensors = inspection.contents.summary, inspection.contents.sensors
    console.print(f"\nRun {summary.recorded_run} alone, scored afresh from what was recorded")
    places = {name: decimals([tracker.metrics[name].value for tracker in inspection.scored]) for name in ERRORS}
    rows = []
    for tracker in inspection.scored:
        errors = [fixed(tracker.metrics[name].value, places[name]) for name in ERRORS]
        nis = tracker.of_sensors("nis")
        by_sensor = [fixed(nis[sensor].value if sensor in nis else None, 2) for sensor in sensors]
        rows.append([tracker.name, *errors, fixed(tracker.nees.value, 2), *by_sensor])
    console.print(_table(["tracker", *ERRORS.values(), "NEES", *(f"NIS {name}" for name in sensors)], rows))
    _failed(summary, console)
    if inspection.checked is not None:
        difference = inspection.checked.largest_relative_difference
        verdict = "the same" if difference < ROUNDING else f"DIFFERENT by up to {difference:.1e} of the value"
        console.print(f"{inspection.checked.file}: {verdict}", style="dim", soft_wrap=True)


def _modes(inspection: Inspection, console: Console) -> None:
    if not inspection.modes:
        return
    console.print("\nMean probability of each mode" if inspection.at is None else "\nProbability of each mode")
    rows = [
        [tracker, name, ", ".join(f"{mode} {fixed(share, 2)}" for mode, share in modes.items())]
        for tracker, vehicles in inspection.modes.items()
        for name, modes in vehicles.items()
    ]
    console.print(_table(["tracker", "vehicle", "modes"], rows, texts=(0, 1, 2)))


def _failed(summary: Summary, console: Console) -> None:
    """The trackers that failed, each with the cause."""
    for tracker in summary.trackers:
        if tracker.failed is not None:
            console.print(f"{tracker.name} failed: {tracker.failed}")


def _scene(scene: SceneMoment, console: Console) -> None:
    console.print(f"\nAt {fixed(scene.time_s, 3)} s")
    vehicles = [
        [
            vehicle.name,
            fixed(vehicle.px_m, 2),
            fixed(vehicle.py_m, 2),
            fixed(vehicle.speed_mps, 2),
            fixed(math.degrees(vehicle.course_rad), 1),
            ", ".join(item.sensor for item in scene.measurements if item.object == vehicle.name),
        ]
        for vehicle in scene.vehicles
    ]
    console.print(_table(["vehicle", "x m", "y m", "speed m/s", "course deg", "detected by"], vehicles, texts=(0, 5)))
    console.print()
    estimates = [
        [item.object, item.tracker, fixed(item.px_m, 2), fixed(item.py_m, 2), *_errors(item)]
        for item in sorted(scene.estimates, key=lambda item: item.object)
    ]
    console.print(_table(["vehicle", "tracker", "x m", "y m", "error m", "error m/s", "NEES"], estimates, texts=(0, 1)))


def _tracks(moment: TracksMoment, console: Console) -> None:
    console.print(f"\nAt {fixed(moment.time_s, 3)} s")
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
    console.print(_table(["vehicle", "x m", "y m", "speed m/s", "status", "not tracked by"], rows, texts=(0, 4, 5)))
    console.print()
    tracks = [
        [item.tracker, str(item.track), fixed(item.px_m, 2), fixed(item.py_m, 2), fixed(item.existence, 2)]
        for item in moment.tracks
    ]
    console.print(_table(["tracker", "track", "x m", "y m", "existence"], tracks))


def _worst(worst: Mapping[str, list[EstimateMoment]], console: Console) -> None:
    console.print("\nThe largest position errors that count, a second apart at least")
    rows = [
        [tracker if i == 0 else "", fixed(item.time_s, 2), item.object, *_errors(item)]
        for tracker, items in worst.items()
        for i, item in enumerate(items)
    ]
    console.print(_table(["tracker", "time s", "vehicle", "error m", "error m/s", "NEES"], rows, texts=(0, 2)))


def _events(events: list[TrackEvent], known: bool, console: Console) -> None:
    """The events that cost most; ``known``: whether there is a truth."""
    if not known or not events:
        reason = (
            "No event of the recorded run cost anything." if known else "There is no truth, so no event has a cost."
        )
        console.print(f"\n{reason}")
        return
    console.print("\nThe events of the recorded run that cost most")
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
    console.print(
        _table(["tracker", "time s", "event", "vehicle", "track", "cost m²", "why"], rows, texts=(0, 2, 3, 6))
    )


def _errors(item: EstimateMoment) -> list[str]:
    return [fixed(value, 2) for value in (item.position_error_m, item.velocity_error_mps, item.nees)]


def _table(heads: Iterable[str], rows: Iterable[list[str]], texts: tuple[int, ...] = (0,)) -> Table:
    """A table of texts; the columns ``texts`` are flush left."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for i, head in enumerate(heads):
        table.add_column(head, justify="left" if i in texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
