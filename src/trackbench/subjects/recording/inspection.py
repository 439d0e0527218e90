"""What is in a recording: contents, versions, scores computed afresh, single moments."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.metrics import BUILT_IN
from trackbench.metrics.builtin import RootMeanSquare
from trackbench.metrics.moments import EstimateMoment, SceneMoment, require_name, scene_at, worst
from trackbench.metrics.recorded_run import recorded_run
from trackbench.results import Result, Summary, TrackerResult
from trackbench.results.columns import Columns, columns, split
from trackbench.subjects.recording.reader import Recorded, read
from trackbench.subjects.recording.rescore import rescored

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
class RecordedContents:
    """What every recording has: which run it is of, and how much."""

    recorded: Recorded
    rows: dict[str, int]
    """Of each table."""
    sensors: dict[str, SensorContents]

    @classmethod
    def of(cls, recorded: Recorded) -> RecordedContents:
        """What is in it."""
        tables = recorded.result.tables
        measured = split(tables.measurements, "sensor").items()
        return cls(
            recorded=recorded,
            rows={name: table.num_rows for name, table in sorted(tables.items())},
            sensors={name: _sensor(rows) for (name,), rows in measured},
        )

    @property
    def summary(self) -> Summary:
        """That of the run."""
        return self.recorded.result.summary

    def json(self) -> dict[str, Any]:
        """All of it as JSON values."""
        summary = self.summary
        return {
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
            "rows": self.rows,
            "sensors": {name: asdict(sensor) for name, sensor in self.sensors.items()},
        }


@dataclass(frozen=True)
class ScoreCheck:
    """How the scores computed afresh compare with those that the run itself wrote beside the recording."""

    file: str
    largest_relative_difference: float


@dataclass(frozen=True)
class Inspection:
    """Everything about a recording or the folder of a run that can be read without a viewer."""

    contents: RecordedContents
    scored: list[TrackerResult]
    """The trackers that did not fail, with the scores of the recorded run alone."""
    checked: ScoreCheck | None
    """None where there is nothing to compare with."""
    at: SceneMoment | None
    worst: dict[str, list[EstimateMoment]] | None
    """By tracker, the largest error first."""
    modes: Modes
    """The probability of each mode at the time that was asked for, or its mean over the run."""

    def json(self) -> dict[str, Any]:
        """Everything as JSON values; moments that were not asked for are left out."""
        scored = {tracker.name: tracker for tracker in self.scored}
        trackers = [scored.get(tracker.name, tracker) for tracker in self.contents.summary.trackers]
        found = {
            **self.contents.json(),
            "trackers": [_tracker_json(tracker) for tracker in trackers],
            "checked": self.checked and asdict(self.checked),
            "modes": self.modes,
        }
        if self.at is not None:
            found["at"] = asdict(self.at)
        if self.worst is not None:
            found["worst"] = {tracker: [asdict(moment) for moment in items] for tracker, items in self.worst.items()}
        return found


def inspect(
    path: Path | Recorded,
    at: float | None = None,
    count: int | None = None,
    tracker: str | None = None,
    vehicle: str | None = None,
) -> Inspection:
    """Read a recording or the folder of a run whose identities are known.

    Args:
        path: the recording or folder, or what was read of it.
        at: also the scene at this time, s.
        count: also so many worst moments of each tracker.
        tracker: of this one alone.
        vehicle: those of this one alone.

    Raises:
        InputError: it cannot be read, or has no such time, tracker or vehicle.
    """
    found = path if isinstance(path, Recorded) else read(path)
    run = recorded_run(found.result)
    scored = rescored(found.result, run)
    trackers = list(run.tracks) if tracker is None else [require_name(tracker, run.tracks, "tracker")]
    if vehicle is not None:
        require_name(vehicle, run.objects, "vehicle")
    return Inspection(
        contents=RecordedContents.of(found),
        scored=scored,
        checked=_checked(found, scored),
        at=None if at is None else scene_at(found.result, run, at),
        worst=None if count is None else {name: worst(run, [name], count, vehicle) for name in trackers},
        modes=_modes(found.result, trackers, vehicle, at),
    )


def _modes(result: Result, trackers: list[str], vehicle: str | None, at: float | None) -> Modes:
    """The probability of each mode at the latest instant up to a time, or its mean over all."""
    found: Modes = {}
    for (tracker, mode, name), rows in split(
        result.tables.if_there("recorded_modes"), "tracker", "mode", "object"
    ).items():
        probability = rows["probability"]
        if at is not None:
            step = np.searchsorted(rows["time_s"], at + 1e-9, side="right")
            probability = probability[max(step - 1, 0) : step]
        probability = probability[np.isfinite(probability)]
        if len(probability) and tracker in trackers and vehicle in (None, name):
            found.setdefault(tracker, {}).setdefault(name, {})[mode] = float(probability.mean())
    return found


def _tracker_json(tracker: TrackerResult) -> dict[str, Any]:
    included: Any = {"name", "describe", "failed"}
    if tracker.failed is None:
        included = {**dict.fromkeys(included, True), "metrics": True, "health": {"diverged_runs"}}
    return tracker.model_dump(mode="json", include=included)


def _sensor(rows: Columns) -> SensorContents:
    """Of the rows of a sensor."""
    return SensorContents(str(rows["kind"][0]), len(np.unique(rows["time_s"])), int(rows["valid"].sum()))


def _checked(found: Recorded, scored: list[TrackerResult]) -> ScoreCheck | None:
    folder = found.file if found.file.is_dir() else found.file.parent
    try:
        beside = Result.load(folder)
    except InputError:
        return None
    summary = found.result.summary
    if "runs" not in beside.tables or beside.summary.fingerprints != summary.fingerprints:
        return None
    runs = columns(beside.tables.runs)
    differences = [0.0]
    for tracker in scored:
        (row,) = np.flatnonzero((runs["tracker"].astype(str) == tracker.name) & (runs["run"] == summary.recorded_run))
        pairs = [(tracker.nees.value, runs["nees_mean"][row])]
        errors = [metric for metric in BUILT_IN if isinstance(metric, RootMeanSquare)]
        pairs += [(tracker.metrics[metric.name].value, runs[metric.column][row]) for metric in errors]
        differences += [abs(new - old) / old for new, old in pairs if new is not None and old > 0]
    return ScoreCheck(str(folder / "runs.parquet"), float(max(differences)))
