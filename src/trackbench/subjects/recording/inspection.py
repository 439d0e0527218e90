"""What a recorded run shows at a time, and when each tracker was worst: as values, and for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
from rich.console import Console

from trackbench.document import Column
from trackbench.document.terminal import print_table
from trackbench.metrics.function_events import FunctionEvent, TrackEvent, function_events
from trackbench.metrics.recorded_run import (
    EstimateMoment,
    estimates_at,
    latest_rows,
    recorded_estimates,
    require_name,
    require_time,
    table_frame,
    worst,
)
from trackbench.report.console import print_summary
from trackbench.report.numbers import rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.subjects.recording.data import Recorded, read
from trackbench.subjects.recording.focus import WHOLE, Opening, costly_events, require_worst

#: By tracker that has several motion models, by vehicle and by mode.
Modes = dict[str, dict[str, dict[str, float]]]
Moment = EstimateMoment | TrackEvent | FunctionEvent


@dataclass(frozen=True)
class ObjectMoment:
    """A vehicle that is there."""

    name: str
    px_m: float
    py_m: float
    speed_mps: float
    status: str
    """due, optional or absent."""
    states: dict[str, str]
    """What each tracker has of the vehicle: waiting, tracked, switched, lost, or not due."""

    @property
    def missed_by(self) -> str:
        """Names of the trackers that should have a track of the vehicle and have none."""
        return ", ".join(name for name, state in self.states.items() if state in ("waiting", "lost"))


@dataclass(frozen=True)
class TrackMoment:
    """A track at a time."""

    tracker: str
    track: int
    px_m: float
    py_m: float
    existence: float | None


@dataclass(frozen=True)
class TracksMoment:
    """The vehicles and tracks at the latest instant up to a time."""

    time_s: float
    vehicles: list[ObjectMoment]
    tracks: list[TrackMoment]


@dataclass(frozen=True)
class SceneMoment:
    """Everything at a time as a viewer shows it: the latest of each up to then."""

    time_s: float
    vehicles: list[dict[str, Any]]
    """Values of the columns ``VEHICLE`` of the truth, of those that are there."""
    measurements: list[dict[str, Any]]
    """Where each sensor has seen each object."""
    estimates: list[EstimateMoment]
    """Estimates of the vehicles that are there."""


@dataclass(frozen=True)
class Inspection:
    """A recorded run with the moments that were asked for."""

    recorded: Recorded
    at: SceneMoment | TracksMoment | None = None
    worst: Sequence[Moment] | None = None
    """Moments by tracker, contenders first; with hidden identities or of a function events, the worst first."""
    modes: Modes = field(default_factory=dict)
    """Probability of each mode at the time that was asked for."""
    function: str | None = None
    """Function whose events the moments are."""

    def json(self) -> dict[str, Any]:
        """Return everything as JSON values; moments that were not asked for are left out."""
        summary = self.recorded.result.summary
        values: dict[str, Any] = {
            "file": str(self.recorded.path),
            "scenario": summary.scenario.name,
            "description": summary.scenario.description,
            "command": summary.command,
            "seed": summary.seed,
            "runs": summary.runs,
            "recorded_run": summary.recorded_run,
            "objects": summary.truth.objects,
            "duration_s": summary.truth.duration_s,
            "fingerprint": summary.fingerprint,
            "versions": summary.versions,
            "trackers": [tracker.model_dump(mode="json") for tracker in summary.trackers],
        }
        if self.at is not None:
            values |= {"at": asdict(self.at), "modes": self.modes}
        if self.worst is None:
            return values
        if summary.identities == "hidden" or self.function is not None:
            return values | {"worst": [_values(event) for event in self.worst]}
        groups = groupby(self.worst, key=lambda moment: moment.tracker)
        return values | {"worst": {tracker: [_values(moment) for moment in group] for tracker, group in groups}}


def _values(moment: Moment) -> dict[str, Any]:
    if isinstance(moment, EstimateMoment):
        return asdict(moment)
    return {**moment._asdict(), "word": moment.word} if isinstance(moment, FunctionEvent) else moment._asdict()


def inspect(path: Path | Recorded, opening: Opening = WHOLE) -> Inspection:
    """Read the folder of a run or a recording.

    Args:
        path: the folder or recording, or what was read of it.
        opening: also the scene at its time; also as many worst moments of each tracker as it says, with hidden
            identities or of a function as many events.

    Raises:
        InputError: it cannot be read, or has no such time, tracker, vehicle or function.
    """
    recorded = path if isinstance(path, Recorded) else read(path)
    result, tracker, vehicle = recorded.result, opening.tracker, opening.vehicle
    require_worst(result, opening.worst, tracker)
    if tracker is not None:
        require_name(tracker, list(result), "tracker")
    if vehicle is not None:
        require_name(vehicle, result.summary.truth.objects, "vehicle")
    return Inspection(
        recorded, _at(result, opening), _worst(result, opening), _modes(result, opening), opening.function
    )


def _at(result: Result, opening: Opening) -> SceneMoment | TracksMoment | None:
    if opening.at_s is None:
        return None
    if result.summary.identities == "hidden":
        return _tracks_at(result, opening.at_s, opening.tracker)
    return _scene_at(result, opening.at_s)


def _scene_at(result: Result, time: float) -> SceneMoment:
    truth, measured = table_frame(result.tables.truth), ["sensor", "object", "time_s", "x_m", "y_m"]
    require_time(truth["time_s"].min(), truth["time_s"].max(), time)
    present = latest_rows(truth, time, "role", "object").query("alive > 0").rename(columns={"object": "name"})
    measurements = latest_rows(table_frame(result.tables.measurements, "valid", *measured), time, "sensor", "object")
    return SceneMoment(
        time_s=float(truth["time_s"][truth["time_s"] <= time + 1e-9].max()),
        vehicles=present[VEHICLE].to_dict("records"),
        measurements=measurements.query("valid > 0")[measured].to_dict("records"),
        estimates=[item for item in estimates_at(result, time) if item.object in set(present["name"])],
    )


def _worst(result: Result, opening: Opening) -> Sequence[Moment] | None:
    if opening.worst is None:
        return None
    if opening.function is not None:
        return function_events(result, opening.function, opening.tracker, vehicle=opening.vehicle)[: opening.worst]
    if result.summary.identities == "hidden":
        return costly_events(result, opening.tracker, opening.vehicle)[: opening.worst]
    estimates = recorded_estimates(result)
    names = dict.fromkeys([*(tracker.name for tracker in result.filtering), *estimates["tracker"].unique()])
    shown = [name for name in names if opening.tracker in (None, name)]
    return [moment for name in shown for moment in worst(estimates, [name], opening.worst, opening.vehicle)]


def _modes(result: Result, opening: Opening) -> Modes:
    """Return the probabilities at the latest instant up to the time."""
    modes: Modes = {}
    if opening.at_s is None:
        return modes
    rows_of = split(result.tables.if_there("recorded_modes"), "tracker", "mode", "object")
    for (tracker, mode, name), rows in rows_of.items():
        step = int(np.searchsorted(rows["time_s"], opening.at_s + 1e-9, side="right")) - 1
        if step >= 0 and np.isfinite(rows["probability"][step]):
            modes.setdefault(tracker, {}).setdefault(name, {})[mode] = float(rows["probability"][step])
    return modes


def _tracks_at(result: Result, time: float, only: str | None) -> TracksMoment:
    """Return the latest instant up to a time, with the tracks of all trackers or of one."""
    require_time(0.0, result.summary.truth.duration_s, time)
    due = {name: rows for (name,), rows in split(result.tables.due, "object").items()}
    clock = next(iter(due.values()))["time_s"] if due else np.zeros(1)
    step = max(0, int(np.searchsorted(clock, time + 1e-9)) - 1)
    now = float(clock[step])
    states: dict[str, dict[str, str]] = {}
    for (tracker, name), rows in split(result.tables.objects, "tracker", "object").items():
        inside = (rows["time_s"] <= now + 1e-9) & (now + 1e-9 < rows["until_s"])
        states.setdefault(name, {})[tracker] = str(rows["state"][inside][0]) if inside.any() else "not due"
    vehicles = []
    for (_, name), rows in split(result.tables.truth, "role", "object").items():
        row = int(np.searchsorted(rows["time_s"], now - 1e-9))
        if name in due and rows["alive"][row]:
            status = ("absent", "optional", "due")[int(due[name]["status"][step])]
            x, y, speed = (float(rows[key][row]) for key in ("px_m", "py_m", "speed_mps"))
            vehicles.append(ObjectMoment(name, x, y, speed, status, states.get(name, {})))
    table = result.tables.tracks
    near = table.filter(pc.less(pc.abs(pc.subtract(table["time_s"], now)), 1e-9)) if table.num_rows else table
    tracks = [
        TrackMoment(row["tracker"], int(row["track"]), row["px_m"], row["py_m"], row["existence"])
        for row in near.to_pylist()
    ]
    return TracksMoment(now, vehicles, [item for item in tracks if only in (None, item.tracker)])


#: What is printed of a vehicle, an estimate, a track, and each kind of moment.
MOTION = ("name", "px_m", "py_m", "speed_mps")
VEHICLE = [
    *("name", "role", "px_m", "py_m", "vx_mps", "vy_mps"),
    *("speed_mps", "course_rad", "acceleration_mps2", "yaw_rate_radps"),
]
ERRORS = ("position_error_m", "velocity_error_mps", "nees")
ESTIMATE = ("object", "tracker", "px_m", "py_m", *ERRORS)
TRACK = ("tracker", "track", "px_m", "py_m", "existence")
MOMENTS: dict[type, tuple[str, ...]] = {
    EstimateMoment: ("tracker", "time_s", "object", *ERRORS),
    TrackEvent: ("tracker", "time_s", "kind", "object", "track", "cost_m2", "reason"),
    FunctionEvent: ("tracker", "run", "time_s", "object", "word", "wrong_s"),
}
HEADINGS = {
    "name": "vehicle", "object": "vehicle", "px_m": "x, m", "py_m": "y, m", "speed_mps": "speed, m/s",
    "position_error_m": "error, m", "velocity_error_mps": "error, m/s", "nees": "NEES", "time_s": "time, s",
    "kind": "event", "cost_m2": "cost, m²", "reason": "why", "word": "what", "wrong_s": "by, s",
    "missed_by": "not tracked by",
}  # fmt: skip


def print_inspection(inspection: Inspection, console: Console) -> None:
    """Print the moments that were asked for, or the scores of all runs."""
    result, at, moments = inspection.recorded.result, inspection.at, inspection.worst
    summary = result.summary
    if at is None and moments is None:
        print_summary(result, console)
        return
    console.print(f"{result.name}: run {summary.recorded_run} of {summary.runs}, seed {summary.seed}")
    if isinstance(at, SceneMoment):
        _print(console, MOTION, at.vehicles, f"At {rounded(at.time_s, 3)} s")
        _print(console, ESTIMATE, sorted(at.estimates, key=lambda estimate: estimate.object))
        for tracker, vehicles in inspection.modes.items():
            for name, modes in vehicles.items():
                shares = ", ".join(f"{mode} {rounded(share, 2)}" for mode, share in modes.items())
                console.print(f"modes of {tracker}, {name}: {shares}")
    elif at is not None:
        _print(console, (*MOTION, "status", "missed_by"), at.vehicles, f"At {rounded(at.time_s, 3)} s")
        _print(console, TRACK, at.tracks)
    if moments:
        caption = "The worst first; of the peak of an error its top alone"
        _print(console, MOMENTS[type(moments[0])], moments, caption)
    elif moments is not None:
        nothing = (
            "Nothing that counts went wrong" if summary.truth.known else "There is no truth, so no event has a cost"
        )
        console.print(f"{nothing}.")
    for failed in (tracker for tracker in summary.trackers if tracker.failed is not None):
        console.print(f"{failed.name} failed: {failed.failed}")
    if moments and inspection.function is None:
        command = f"trackbench view {inspection.recorded.path} --worst --tracker {moments[0].tracker}"
        console.print(f"\n{command}", style="dim", soft_wrap=True)


def _print(console: Console, names: Sequence[str], items: Sequence[Any], caption: str = "") -> None:
    """Print a table with a row for each item, whose columns are the attributes of these names."""
    texts = {name for name in names for item in items[:1] if isinstance(_value(item, name), str)}
    columns = {
        TRACKER if name == "tracker" else Column(HEADINGS.get(name, name), left=name in texts): partial(
            _cell, name=name
        )
        for name in names
    }
    console.print()
    print_table(text_table("moments", items, columns, caption), console)


def _cell(item: Any, name: str) -> str:
    value = _value(item, name)
    return rounded(value, 2) if isinstance(value, float | None) else str(value)


def _value(item: Any, name: str) -> Any:
    return item[name] if isinstance(item, dict) else getattr(item, name)
