"""What is in a recording, for a terminal of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed
from trackbench.words import counted

Json = Mapping[str, Any]

#: Scores that differ by less than this share are the same but for rounding.
ROUNDING = 1e-9


def print_inspection(found: Json, console: Console) -> None:
    """The contents and scores, or the moments that were asked for."""
    _head(found, console)
    if "at" in found:
        _scene(found["at"], console)
    if "worst" in found:
        _worst(found["worst"], console)
    if "at" not in found and "worst" not in found:
        _contents(found, console)
        _scores(found, console)


def _head(found: Json, console: Console) -> None:
    what = f"run {found['recorded_run']} of {found['runs']}, {counted(len(found['objects']), 'vehicle')}, "
    line = f": {what}{fixed(found['duration_s'], 1)} s, seed {found['seed']}"
    console.print(Text.assemble((found["scenario"], "bold"), line), highlight=False)


def _contents(found: Json, console: Console) -> None:
    if found["description"]:
        console.print(Text(found["description"]), highlight=False)
    written = f"written by Rerun {found['rerun']}" if found["rerun"] else "tables and summary of the run"
    lines = [
        f"{found['file']}: {written}",
        ", ".join(f"{name} {version}" for name, version in found["versions"].items()),
        f"measurements: {found['fingerprint']}",
        *(
            f"{name}: {sensor['kind']}, {counted(sensor['measurements'], 'measurement')} at {sensor['instants']} "
            "instants"
            for name, sensor in found["sensors"].items()
        ),
        f"made by: {found['command']}",
    ]
    for line in lines:
        console.print(Text(line, style="dim"), highlight=False, soft_wrap=True)


def _scores(found: Json, console: Console) -> None:
    console.print(Text(f"\nRun {found['recorded_run']} alone, scored afresh from what was recorded"), highlight=False)
    scored = [tracker for tracker in found["trackers"] if "metrics" in tracker]
    sensors = list(found["sensors"])
    names = ("position_rmse", "velocity_rmse", "course_rmse")
    places = {name: decimals([tracker["metrics"][name]["value"] for tracker in scored]) for name in names}
    rows = []
    for tracker in scored:
        metrics = tracker["metrics"]
        errors = [fixed(metrics[name]["value"], places[name]) for name in names]
        nis = [fixed((metrics["nis"].get(sensor) or {}).get("mean"), 2) for sensor in sensors]
        rows.append([tracker["name"], *errors, fixed(metrics["nees"]["mean"], 2), *nis])
    heads = ["tracker", "position m", "vel. m/s", "course deg", "NEES", *(f"NIS {name}" for name in sensors)]
    console.print(_table(heads, rows))
    for tracker in found["trackers"]:
        if tracker["failed"]:
            console.print(Text(f"{tracker['name']} failed: {tracker['failed']['cause']}"), highlight=False)
    checked = found["checked"]
    if checked:
        apart = checked["largest_relative_difference"]
        verdict = "the same" if apart < ROUNDING else f"DIFFERENT by up to {apart:.1e} of the value"
        console.print(Text(f"{checked['file']}: {verdict}", style="dim"), highlight=False, soft_wrap=True)


def _scene(scene: Json, console: Console) -> None:
    console.print(Text(f"\nAt {fixed(scene['time_s'], 3)} s"), highlight=False)
    vehicles = [
        [
            vehicle["name"],
            fixed(vehicle["px_m"], 2),
            fixed(vehicle["py_m"], 2),
            fixed(vehicle["speed_mps"], 2),
            fixed(math.degrees(vehicle["course_rad"]), 1),
            ", ".join(item["sensor"] for item in scene["measurements"] if item["object"] == vehicle["name"]),
        ]
        for vehicle in scene["vehicles"]
    ]
    console.print(_table(["vehicle", "x m", "y m", "speed m/s", "course deg", "detected by"], vehicles, texts=(0, 5)))
    console.print()
    estimates = [
        [item["object"], item["tracker"], fixed(item["px_m"], 2), fixed(item["py_m"], 2), *_errors(item)]
        for item in sorted(scene["estimates"], key=lambda item: str(item["object"]))
    ]
    console.print(_table(["vehicle", "tracker", "x m", "y m", "error m", "error m/s", "NEES"], estimates, texts=(0, 1)))


def _worst(worst: Mapping[str, list[Json]], console: Console) -> None:
    console.print(Text("\nThe largest position errors that count, a second apart at least"), highlight=False)
    rows = [
        [tracker if first else "", fixed(item["time_s"], 2), item["object"], *_errors(item)]
        for tracker, items in worst.items()
        for first, item in zip([True] + [False] * len(items), items, strict=False)
    ]
    console.print(_table(["tracker", "time s", "vehicle", "error m", "error m/s", "NEES"], rows, texts=(0, 2)))


def _errors(item: Json) -> list[str]:
    values = (item["position_error_m"], item["velocity_error_mps"], item["nees"])
    return [fixed(value, 2) if math.isfinite(value) else NOT_AVAILABLE for value in values]


def _table(heads: Iterable[str], rows: Iterable[list[str]], texts: tuple[int, ...] = (0,)) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for i, head in enumerate(heads):
        table.add_column(head, justify="left" if i in texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table
