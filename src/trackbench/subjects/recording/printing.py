"""What is in a recording, for a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.metrics.recorded_run import SceneMoment
from trackbench.report.console import track_values
from trackbench.report.numbers import decimals, rounded
from trackbench.results import Summary
from trackbench.subjects.recording.inspection import Inspection, TracksMoment

#: Scores that differ by less than this share are the same but for rounding.
ROUNDING = 1e-9
#: Scores that are computed afresh, with their headings.
ERRORS = {"position_rmse": "position m", "velocity_rmse": "vel. m/s", "course_rmse": "course deg"}
#: A column: its heading, an attribute or a function of an item, and decimals; None for a text, which is flush left.
Column = tuple[str, str | Callable[[Any], str], int | None]
MOTION: tuple[Column, ...] = (
    ("vehicle", "name", None),
    ("x m", "px_m", 2),
    ("y m", "py_m", 2),
    ("speed m/s", "speed_mps", 2),
)
ESTIMATE_ERRORS: tuple[Column, ...] = (
    ("error m", "position_error_m", 2),
    ("error m/s", "velocity_error_mps", 2),
    ("NEES", "nees", 2),
)
TRACK_EVENTS: tuple[Column, ...] = (
    ("tracker", "tracker", None),
    ("time s", "time_s", 2),
    ("event", "kind", None),
    ("vehicle", lambda event: event.object or "-", None),
    ("track", lambda event: "-" if event.track is None else str(event.track), 0),
    ("cost m²", "cost_m2", 1),
    ("why", "reason", None),
)
FUNCTION_EVENTS: tuple[Column, ...] = (
    ("tracker", "tracker", None),
    ("run", "run", 0),
    ("time s", "time_s", 2),
    ("object", lambda event: event.object or "-", None),
    ("what", "word", None),
    ("by s", "wrong_s", 2),
)


def print_inspection(inspection: Inspection, console: Console) -> None:
    """The contents and scores, or the moments that were asked for, on a console without markup and highlighting."""
    summary = inspection.summary
    hidden = summary.identities == "hidden"
    run = f"run {summary.recorded_run} of {summary.runs}, {summary.truth.vehicles}"
    line = f": {run}, {rounded(summary.truth.duration_s, 1)} s, seed {summary.seed}"
    console.print(Text.assemble((summary.scenario.name, "bold"), line))
    if isinstance(inspection.at, TracksMoment):
        _tracks(inspection.at, console)
    elif inspection.at is not None:
        _scene(inspection.at, console)
        _modes(inspection, console)
    if isinstance(inspection.worst, dict):
        console.print("\nThe largest position errors that count, a second apart at least")
        moments = [
            replace(m, tracker="") if i else m for items in inspection.worst.values() for i, m in enumerate(items)
        ]
        names: tuple[Column, ...] = (("tracker", "tracker", None), ("time s", "time_s", 2), ("vehicle", "object", None))
        console.print(_table(moments, *names, *ESTIMATE_ERRORS))
        _command(inspection, list(inspection.worst)[:1], console)
    elif inspection.worst is not None:
        if summary.truth.known:
            heading = "The events of the recorded run that cost most"
            _events(inspection.worst, TRACK_EVENTS, heading, "No event of the recorded run cost anything.", console)
        else:
            console.print("\nThere is no truth, so no event has a cost.")
        _command(inspection, [event.tracker for event in inspection.worst[:1]], console)
    if inspection.of_function is not None:
        events = inspection.of_function
        heading = f"The worst events of {events[0].function} in all runs" if events else ""
        _events(events, FUNCTION_EVENTS, heading, "No warning in any run is missed, late, false or early.", console)
    elif inspection.at is None and inspection.worst is None:
        _contents(inspection, console)
        (_all_runs if hidden else _scores)(inspection, console)
        _modes(inspection, console)
    if hidden:
        _failed(summary, console)


def _command(inspection: Inspection, trackers: list[str], console: Console) -> None:
    """What shows the worst moment of the first of the trackers."""
    for tracker in trackers:
        command = f"trackbench view {inspection.recorded.file} --worst --tracker {tracker}"
        console.print(f"\n{command}", style="dim", soft_wrap=True)


def _contents(inspection: Inspection, console: Console) -> None:
    """Where it comes from, and how much was measured."""
    summary, recorded = inspection.summary, inspection.recorded
    if summary.scenario.description:
        console.print(summary.scenario.description)
    written = f"written by Rerun {recorded.rerun}" if recorded.rerun else "tables and summary of the run"
    sensors = [
        f"{name}: {sensor.kind}, {counted(sensor.measurements, 'measurement')} at {sensor.instants} instants"
        for name, sensor in inspection.sensors.items()
    ]
    measurements = f"measurements: {summary.fingerprint}"
    made_by = f"made by: {summary.command}"
    for line in (f"{recorded.file}: {written}", summary.made_with, measurements, *sensors, made_by):
        console.print(line, style="dim", soft_wrap=True)


def _all_runs(inspection: Inspection, console: Console) -> None:
    console.print("\nAll runs")
    columns = track_values(inspection.recorded.result)
    rows = [[t.name, *(cells[i].plain for _, cells in columns)] for i, t in enumerate(inspection.scored)]
    console.print(_rows(["tracker", *(heading for heading, _ in columns)], rows))


def _scores(inspection: Inspection, console: Console) -> None:
    summary, sensors = inspection.summary, inspection.sensors
    console.print(f"\nRun {summary.recorded_run} alone, scored afresh from what was recorded")
    places = {name: decimals([tracker.metrics[name].value for tracker in inspection.scored]) for name in ERRORS}
    rows = []
    for tracker in inspection.scored:
        errors = [rounded(tracker.metrics[name].value, places[name]) for name in ERRORS]
        nis = tracker.of_sensors("nis")
        by_sensor = [rounded(nis[sensor].value if sensor in nis else None, 2) for sensor in sensors]
        rows.append([tracker.name, *errors, rounded(tracker.nees.value, 2), *by_sensor])
    console.print(_rows(["tracker", *ERRORS.values(), "NEES", *(f"NIS {name}" for name in sensors)], rows))
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
        [tracker, name, ", ".join(f"{mode} {rounded(share, 2)}" for mode, share in modes.items())]
        for tracker, vehicles in inspection.modes.items()
        for name, modes in vehicles.items()
    ]
    console.print(_rows(["tracker", "vehicle", "modes"], rows, texts=(0, 1, 2)))


def _failed(summary: Summary, console: Console) -> None:
    """The trackers that failed, each with the cause."""
    for tracker in summary.trackers:
        if tracker.failed is not None:
            console.print(f"{tracker.name} failed: {tracker.failed}")


def _scene(scene: SceneMoment, console: Console) -> None:
    course: Column = ("course deg", lambda vehicle: rounded(math.degrees(vehicle.course_rad), 1), 1)
    sensors: Column = (
        "detected by",
        lambda vehicle: ", ".join(item.sensor for item in scene.measurements if item.object == vehicle.name),
        None,
    )
    console.print(f"\nAt {rounded(scene.time_s, 3)} s")
    console.print(_table(scene.vehicles, *MOTION, course, sensors))
    console.print()
    place: tuple[Column, ...] = (("x m", "px_m", 2), ("y m", "py_m", 2))
    names: tuple[Column, ...] = (("vehicle", "object", None), ("tracker", "tracker", None))
    estimates = sorted(scene.estimates, key=lambda item: item.object)
    console.print(_table(estimates, *names, *place, *ESTIMATE_ERRORS))


def _tracks(moment: TracksMoment, console: Console) -> None:
    console.print(f"\nAt {rounded(moment.time_s, 3)} s")
    missing: Column = (
        "not tracked by",
        lambda vehicle: ", ".join(name for name, state in vehicle.states.items() if state in ("waiting", "lost")),
        None,
    )
    console.print(_table(moment.vehicles, *MOTION, ("status", "status", None), missing))
    console.print()
    track: tuple[Column, ...] = (("tracker", "tracker", None), ("track", lambda item: str(item.track), 0))
    place: tuple[Column, ...] = (("x m", "px_m", 2), ("y m", "py_m", 2), ("existence", "existence", 2))
    console.print(_table(moment.tracks, *track, *place))


def _events(events: Sequence[Any], columns: Sequence[Column], heading: str, nothing: str, console: Console) -> None:
    console.print(f"\n{heading if events else nothing}")
    if events:
        console.print(_table(events, *columns))


def _table(items: Iterable[Any], *columns: Column) -> Table:
    def cell(item: Any, value: str | Callable[[Any], str], places: int | None) -> str:
        if callable(value):
            return value(item)
        content = getattr(item, value)
        return str(content) if places is None else rounded(content, places)

    rows = [[cell(item, value, places) for _, value, places in columns] for item in items]
    texts = [i for i, (*_, places) in enumerate(columns) if places is None]
    return _rows([heading for heading, *_ in columns], rows, texts)


def _rows(heads: Iterable[str], rows: Iterable[list[str]], texts: Iterable[int] = (0,)) -> Table:
    """A table of texts; the columns ``texts`` are flush left."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for i, head in enumerate(heads):
        table.add_column(head, justify="left" if i in texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
