"""What is in a recording: contents, versions, scores computed afresh, single moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.metrics import BUILT_IN, Fault, Scorer, evaluate, health
from trackbench.metrics.built_in.basic import RootMeanSquare
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.function_events import FunctionEvent, TrackEvent, function_events
from trackbench.metrics.recorded_run import (
    EstimateMoment,
    RecordedRun,
    RecordedTrack,
    SceneMoment,
    load_recorded_run,
    require_name,
    require_time,
    scene_at,
    worst,
)
from trackbench.metrics.silence import measured_positions
from trackbench.results import Health, Result, Summary, TrackerResult
from trackbench.results.columns import Columns, split, table_columns
from trackbench.subjects.recording.data import Recorded, read
from trackbench.subjects.recording.focus import costly_events

#: By tracker that has several motion models, by vehicle and by mode.
Modes = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True)
class SensorContents:
    """What is recorded of a sensor."""

    kind: str
    instants: int
    measurements: int
    """Detections of all objects at these instants."""


@dataclass(frozen=True)
class ScoreCheck:
    """How the scores computed afresh compare with those that the run itself wrote beside the recording."""

    file: str
    largest_relative_difference: float


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
    """By tracker, what it has of the vehicle: waiting, tracked, switched, lost, or not due."""


@dataclass(frozen=True)
class TrackMoment:
    """A track."""

    tracker: str
    track: int
    px_m: float
    py_m: float
    existence: float | None


@dataclass(frozen=True)
class TracksMoment:
    """Everything at an instant at which a sensor looks."""

    time_s: float
    vehicles: list[ObjectMoment]
    tracks: list[TrackMoment]


@dataclass(frozen=True)
class Inspection:
    """Everything about a recording or the folder of a run that can be read without a viewer."""

    recorded: Recorded
    scored: list[TrackerResult]
    """The trackers that did not fail: with the scores of the recorded run alone, or, of hidden identities, of all."""
    checked: ScoreCheck | None = None
    """None where there is nothing to compare with."""
    at: SceneMoment | TracksMoment | None = None
    worst: dict[str, list[EstimateMoment]] | list[TrackEvent] | None = None
    """By tracker, those that filter first, the largest error first; of hidden identities the costliest event first."""
    of_function: list[FunctionEvent] | None = None
    """The events of a function in all runs, the worst first."""
    modes: Modes = field(default_factory=dict)
    """The probability of each mode at the time that was asked for, or its mean over the run."""

    @property
    def summary(self) -> Summary:
        """That of the run."""
        return self.recorded.result.summary

    @cached_property
    def sensors(self) -> dict[str, SensorContents]:
        """What is recorded of each sensor, by its name."""
        return {
            name: SensorContents(str(rows["kind"][0]), len(np.unique(rows["time_s"])), int(rows["valid"].sum()))
            for (name,), rows in split(self.recorded.result.tables.measurements, "sensor").items()
        }

    def json(self) -> dict[str, Any]:
        """Everything as JSON values; moments that were not asked for are left out."""
        summary, tables = self.summary, self.recorded.result.tables
        values: dict[str, Any] = {
            "file": str(self.recorded.file),
            "rerun": self.recorded.rerun,
            "note": self.recorded.note,
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
            "engine": summary.engine,
            "rows": {name: table.num_rows for name, table in sorted(tables.items())},
            "sensors": {name: asdict(sensor) for name, sensor in self.sensors.items()},
        }
        if summary.identities == "known":
            scored = {tracker.name: tracker for tracker in self.scored}
            plain: Any = {"name", "describe", "failed"}
            full: Any = {**dict.fromkeys(plain, True), "metrics": True, "health": {"diverged_runs"}}
            values["trackers"] = [
                scored.get(tracker.name, tracker).model_dump(
                    mode="json", include=full if tracker.failed is None else plain
                )
                for tracker in summary.trackers
            ]
            values |= {"checked": self.checked and asdict(self.checked), "modes": self.modes}
        else:
            values["trackers"] = [tracker.model_dump(mode="json") for tracker in summary.trackers]
        if self.at is not None:
            values["at"] = asdict(self.at)
        if isinstance(self.worst, dict):
            values["worst"] = {tracker: [asdict(moment) for moment in items] for tracker, items in self.worst.items()}
        elif self.worst is not None:
            values["worst"] = [event._asdict() for event in self.worst]
        if self.of_function is not None:
            values["worst"] = [{**event._asdict(), "word": event.word} for event in self.of_function]
        return values


def inspect(
    path: Path | Recorded,
    at: float | None = None,
    count: int | None = None,
    tracker: str | None = None,
    vehicle: str | None = None,
    function: str | None = None,
) -> Inspection:
    """Read a recording or the folder of a run.

    Args:
        path: the recording or folder, or what was read of it.
        at: also the scene at this time, s.
        count: also so many worst moments of each tracker; of hidden identities, the costliest events of the recorded
            run.
        tracker: of this one alone.
        vehicle: those of this one alone.
        function: the events of this one in all runs, in place of other moments.

    Raises:
        InputError: it cannot be read, or has no such time, tracker, vehicle or function.
    """
    recorded = path if isinstance(path, Recorded) else read(path)
    result = recorded.result
    of_function = None
    if function is not None:
        if tracker is not None:
            require_name(tracker, list(result), "tracker")
        of_function, count = function_events(result, function, tracker, vehicle=vehicle)[:count], None
    if vehicle is not None:
        require_name(vehicle, result.summary.truth.objects, "vehicle")
    if result.summary.identities == "hidden":
        events = None if count is None else costly_events(result, tracker, vehicle)[:count]
        moment = None if at is None else _tracks_at(result, at, tracker)
        return Inspection(recorded, list(result.scored), at=moment, worst=events, of_function=of_function)
    run = load_recorded_run(result)
    scored = rescored(result, run)
    first = [item.name for item in result.filtering if item.name in run.tracks]
    trackers = [*dict.fromkeys([*first, *run.tracks])]
    if tracker is not None:
        trackers = [require_name(tracker, run.tracks, "tracker")]
    return Inspection(
        recorded,
        scored,
        _checked(recorded, scored),
        None if at is None else scene_at(result, run, at),
        None if count is None else {name: worst(run, [name], count, vehicle) for name in trackers},
        of_function,
        _modes(result, trackers, vehicle, at),
    )


def _modes(result: Result, trackers: list[str], vehicle: str | None, at: float | None) -> Modes:
    """The probability of each mode at the latest instant up to a time, or its mean over all."""
    modes: Modes = {}
    for (tracker, mode, name), rows in split(
        result.tables.if_there("recorded_modes"), "tracker", "mode", "object"
    ).items():
        probability = rows["probability"]
        if at is not None:
            step = np.searchsorted(rows["time_s"], at + 1e-9, side="right")
            probability = probability[max(step - 1, 0) : step]
        probability = probability[np.isfinite(probability)]
        if len(probability) and tracker in trackers and vehicle in (None, name):
            modes.setdefault(tracker, {}).setdefault(name, {})[mode] = float(probability.mean())
    return modes


def _checked(recorded: Recorded, scored: list[TrackerResult]) -> ScoreCheck | None:
    folder = recorded.file if recorded.file.is_dir() else recorded.file.parent
    try:
        beside = Result.load(folder)
    except InputError:
        return None
    summary = recorded.result.summary
    if "runs" not in beside.tables or beside.summary.fingerprints != summary.fingerprints:
        return None
    runs = table_columns(beside.tables.runs)
    differences = [0.0]
    for tracker in scored:
        rows = np.flatnonzero((runs["tracker"].astype(str) == tracker.name) & (runs["run"] == summary.recorded_run))
        if len(rows) != 1:
            message = f"{tracker.name} has no run {summary.recorded_run}: not the table runs of this run"
            raise InputError(message, file=folder / "runs.parquet")
        row = rows[0]
        pairs = [(tracker.nees.value, runs["nees_mean"][row])]
        errors = [metric for metric in BUILT_IN if isinstance(metric, RootMeanSquare)]
        pairs += [(tracker.metrics[metric.name].value, runs[metric.column][row]) for metric in errors]
        differences += [abs(new - old) / old for new, old in pairs if new is not None and old > 0]
    return ScoreCheck(str(folder / "runs.parquet"), float(max(differences)))


def _tracks_at(result: Result, time: float, only: str | None) -> TracksMoment:
    """The latest instant up to a time, with the tracks of all trackers or of one."""
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


#: Metrics that a recording cannot give: the reference needs the sensors' models, whiteness the innovations themselves,
#: the time that a step took is not seen in an estimate, and first seconds after a detection are not recorded.
NOT_RECORDED = (
    "whiteness",
    "position_reference",
    "velocity_reference",
    "position_over_reference",
    "velocity_over_reference",
    "step_time",
    "start_delay",
    "start_position_rmse",
)


def rescored(result: Result, recorded: RecordedRun) -> list[TrackerResult]:
    """What each tracker that did not fail reached in the one recorded run.

    Raises:
        InputError: what was recorded cannot be scored.
    """
    nis: dict[str, dict[str, dict[str, Columns]]] = {}
    for (tracker, sensor, name), rows in split(result.tables.recorded_nis, "tracker", "sensor", "object").items():
        nis.setdefault(tracker, {}).setdefault(sensor, {})[name] = rows
    dof = {key: int(rows["dof"][0]) for key, rows in split(result.tables.nis, "tracker", "sensor").items()}
    innovations = {
        name: {
            sensor: _innovations(rows, recorded, dof.get((name, sensor), 1))
            for sensor, rows in nis.get(name, {}).items()
        }
        for name in recorded.tracks
    }
    # What the sensors could see is not recorded, so that nothing is broken down by it.
    alike = np.zeros((len(recorded.time), len(recorded.objects), 1), dtype=np.int16)
    scorers = {
        name: Scorer(
            recorded.target(name),
            alike,
            {sensor: len(items) for sensor, items in own.items()},
            tracker=name,
            measured=partial(_measured, result, recorded, result[name].sensors),
        )
        for name, own in innovations.items()
    }
    for instant in range(len(recorded.time)):
        for name, scorer in scorers.items():
            try:
                _take(scorer, recorded, recorded.tracks[name], innovations[name], instant)
            except Fault as fault:
                raise InputError(f"the recorded estimates of {name} cannot be scored: {fault.cause}") from fault
    return [_reached(result[name], scorer) for name, scorer in scorers.items()]


def _measured(result: Result, recorded: RecordedRun, sensors: Sequence[str] | None, here: slice) -> Array:
    """``(2, instants, objects)`` m, the latest measured position of each object at some instants, as the run has it.

    Raises:
        InputError: the measurements are of other instants.
    """
    rows = table_columns(result.tables.measurements)
    # A scan has a row of each object.
    of_each = [np.flatnonzero(rows["object"] == name) for name in recorded.objects] if rows else []
    measured = np.empty((2, 0))
    if len({len(own) for own in of_each}) == 1 and len(of_each[0]):
        positions, objects = np.stack([rows["x_m"], rows["y_m"]]), np.stack(of_each, axis=-1)
        time, sensor, valid, arrival = (rows[name] for name in ("time_s", "sensor", "valid", "arrival_time_s"))
        scans = [_scan(time[own[0]], sensor[own[0]], valid[own] > 0, arrival[own[0]]) for own in objects]
        each = result.summary.score.each == "measurement"
        held = measured_positions(scans, lambda number: positions[:, objects[number]], sensors, each)
        measured = np.stack(list(held), axis=1)
    if measured.shape[1] != len(recorded.time):
        raise InputError("the measurements are not at the times of the estimates: not the tables of one run")
    return measured[:, here]


def _scan(time: float, sensor: str, valid: Mask, arrival_time: float) -> Scan:
    """As much of a scan as scoring looks at."""
    nothing = np.empty(0)
    return Scan(time, sensor, "", nothing, valid, nothing, nothing, nothing, arrival_time)


def _take(
    scorer: Scorer, recorded: RecordedRun, track: RecordedTrack, innovations: dict[str, dict[int, Array]], instant: int
) -> None:
    estimate = Estimate(track.mean[:, instant], track.covariance[:, :, instant])
    for sensor, items in innovations.items():
        if instant in items:
            white, time = items[instant], float(recorded.time[instant])
            scan = _scan(time, sensor, np.isfinite(white[0]), time)
            scorer.scan(instant, scan, estimate._replace(whitened_innovation=white))
    scorer.estimate(estimate)


def _reached(tracker: TrackerResult, scorer: Scorer) -> TrackerResult:
    sums = scorer.close()
    values = evaluate(sums, np.zeros(1, dtype=np.intp)).values
    return TrackerResult(
        name=tracker.name,
        describe=tracker.describe,
        failed=tracker.failed,
        metrics={path: value for path, value in values.items() if path.partition(".")[0] not in NOT_RECORDED},
        health=Health(diverged_runs=health(sums[ESTIMATES.name]).diverged_runs),
    )


def _innovations(rows: dict[str, Columns], recorded: RecordedRun, dof: int) -> dict[int, Array]:
    """By instant, ``(dof, objects)`` innovations of the recorded squared length, which is all that scoring needs."""
    innovations: dict[int, Array] = {}
    for name, of_object in rows.items():
        instants = np.searchsorted(recorded.time, of_object["time_s"])
        for instant, value in zip(instants, of_object["nis"], strict=True):
            white = innovations.setdefault(int(instant), np.zeros((dof, len(recorded.objects))))
            white[0, recorded.objects.index(name)] = np.sqrt(value)
    return innovations
