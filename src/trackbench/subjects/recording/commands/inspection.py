"""What is in a recording, for a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.report.numbers import decimals, fixed
from trackbench.results import Summary

if TYPE_CHECKING:
    from trackbench.metrics.moments import EstimateMoment, SceneMoment
    from trackbench.subjects.recording.inspection import Inspection, RecordedContents

#: Scores that differ by less than this share are the same but for rounding.
ROUNDING = 1e-9


def print_inspection(found: Inspection, console: Console) -> None:
    """The contents and scores, or the moments that were asked for."""
    contents = found.contents
    print_head(contents.summary, console)
    if found.at is not None:
        _scene(found.at, console)
        _modes(found, console)
    if found.worst is not None:
        _worst(found.worst, console)
        for tracker in list(found.worst)[:1]:
            print_command(contents, tracker, console)
    if found.at is None and found.worst is None:
        print_contents(contents, console)
        _scores(found, console)
        _modes(found, console)


def print_head(summary: Summary, console: Console) -> None:
    """Which run it is."""
    what = f"run {summary.recorded_run} of {summary.runs}, {summary.truth.vehicles}, "
    line = f": {what}{fixed(summary.truth.duration_s, 1)} s, seed {summary.seed}"
    console.print(Text.assemble((summary.scenario.name, "bold"), line), highlight=False)


def print_command(contents: RecordedContents, tracker: str, console: Console) -> None:
    """What shows the worst moment of a tracker."""
    command = f"trackbench view {contents.recorded.file} --worst --tracker {tracker}"
    console.print(Text(f"\n{command}", style="dim"), highlight=False, soft_wrap=True)


def print_contents(contents: RecordedContents, console: Console) -> None:
    """Where it comes from, and how much was measured."""
    summary, recorded = contents.summary, contents.recorded
    if summary.scenario.description:
        console.print(Text(summary.scenario.description), highlight=False)
    written = f"written by Rerun {recorded.rerun}" if recorded.rerun else "tables and summary of the run"
    lines = [
        f"{recorded.file}: {written}",
        summary.made_with,
        f"measurements: {summary.fingerprint}",
        *(
            f"{name}: {sensor.kind}, {counted(sensor.measurements, 'measurement')} at {sensor.instants} instants"
            for name, sensor in contents.sensors.items()
        ),
        f"made by: {summary.command}",
    ]
    for line in lines:
        console.print(Text(line, style="dim"), highlight=False, soft_wrap=True)


def _scores(found: Inspection, console: Console) -> None:
    summary, sensors = found.contents.summary, found.contents.sensors
    line = f"\nRun {summary.recorded_run} alone, scored afresh from what was recorded"
    console.print(Text(line), highlight=False)
    names = ("position_rmse", "velocity_rmse", "course_rmse")
    places = {name: decimals([tracker.metrics[name].value for tracker in found.scored]) for name in names}
    rows = []
    for tracker in found.scored:
        errors = [fixed(tracker.metrics[name].value, places[name]) for name in names]
        nis = tracker.of_sensors("nis")
        by_sensor = [fixed(nis[sensor].value if sensor in nis else None, 2) for sensor in sensors]
        rows.append([tracker.name, *errors, fixed(tracker.nees.value, 2), *by_sensor])
    heads = [
        "tracker",
        "position m",
        "vel. m/s",
        "course deg",
        "NEES",
        *(f"NIS {name}" for name in sensors),
    ]
    console.print(table(heads, rows))
    print_failed(summary, console)
    if found.checked is not None:
        difference = found.checked.largest_relative_difference
        verdict = "the same" if difference < ROUNDING else f"DIFFERENT by up to {difference:.1e} of the value"
        console.print(Text(f"{found.checked.file}: {verdict}", style="dim"), highlight=False, soft_wrap=True)


def _modes(found: Inspection, console: Console) -> None:
    if not found.modes:
        return
    when = "Mean probability of each mode" if found.at is None else "Probability of each mode"
    console.print(Text(f"\n{when}"), highlight=False)
    rows = [
        [tracker, name, ", ".join(f"{mode} {fixed(share, 2)}" for mode, share in modes.items())]
        for tracker, vehicles in found.modes.items()
        for name, modes in vehicles.items()
    ]
    console.print(table(["tracker", "vehicle", "modes"], rows, texts=(0, 1, 2)))


def print_failed(summary: Summary, console: Console) -> None:
    """The trackers that failed, each with the cause."""
    for tracker in summary.trackers:
        if tracker.failed is not None:
            console.print(Text(f"{tracker.name} failed: {tracker.failed}"), highlight=False)


def _scene(scene: SceneMoment, console: Console) -> None:
    console.print(Text(f"\nAt {fixed(scene.time_s, 3)} s"), highlight=False)
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
    console.print(table(["vehicle", "x m", "y m", "speed m/s", "course deg", "detected by"], vehicles, texts=(0, 5)))
    console.print()
    estimates = [
        [item.object, item.tracker, fixed(item.px_m, 2), fixed(item.py_m, 2), *_errors(item)]
        for item in sorted(scene.estimates, key=lambda item: item.object)
    ]
    console.print(table(["vehicle", "tracker", "x m", "y m", "error m", "error m/s", "NEES"], estimates, texts=(0, 1)))


def _worst(worst: Mapping[str, list[EstimateMoment]], console: Console) -> None:
    console.print(Text("\nThe largest position errors that count, a second apart at least"), highlight=False)
    rows = [
        [tracker if i == 0 else "", fixed(item.time_s, 2), item.object, *_errors(item)]
        for tracker, items in worst.items()
        for i, item in enumerate(items)
    ]
    console.print(table(["tracker", "time s", "vehicle", "error m", "error m/s", "NEES"], rows, texts=(0, 2)))


def _errors(item: EstimateMoment) -> list[str]:
    return [fixed(value, 2) for value in (item.position_error_m, item.velocity_error_mps, item.nees)]


def table(heads: Iterable[str], rows: Iterable[list[str]], texts: tuple[int, ...] = (0,)) -> Table:
    """A table of texts; the columns ``texts`` are flush left."""
    found = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for i, head in enumerate(heads):
        found.add_column(head, justify="left" if i in texts else "right", overflow="fold")
    for row in rows:
        found.add_row(*(Text(cell) for cell in row))
    return found
