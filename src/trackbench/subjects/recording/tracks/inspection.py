"""What is in a recording of tracks: contents, scores of the run, its costliest events, and single moments."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.metrics.moments import require_name, require_time
from trackbench.metrics.track_events import TrackEvent, events_of
from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.subjects.recording.inspection import RecordedContents
from trackbench.subjects.recording.reader import Recorded


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
class TrackInspection:
    """Everything about a recording of tracks that can be read without a viewer."""

    contents: RecordedContents
    at: TracksMoment | None
    worst: list[TrackEvent] | None
    """The costliest first."""

    def json(self) -> dict[str, Any]:
        """Everything as JSON values; moments that were not asked for are left out."""
        found = {
            **self.contents.json(),
            "trackers": [tracker.model_dump(mode="json") for tracker in self.contents.summary.trackers],
        }
        if self.at is not None:
            found["at"] = asdict(self.at)
        if self.worst is not None:
            found["worst"] = [event._asdict() for event in self.worst]
        return found


def inspect_tracks(
    recorded: Recorded,
    at: float | None = None,
    count: int | None = None,
    tracker: str | None = None,
    vehicle: str | None = None,
) -> TrackInspection:
    """Read the recording of a run whose identities are hidden.

    Args:
        recorded: what was read.
        at: also what there is at this time, s.
        count: also so many of the costliest events of the recorded run.
        tracker: of this one alone.
        vehicle: those in which this one has a part.

    Raises:
        InputError: it has no such time or vehicle.
    """
    result = recorded.result
    if vehicle is not None:
        require_name(vehicle, result.summary.truth.objects, "vehicle")
    worst = None
    if count is not None:
        events = events_of(result, tracker, result.summary.recorded_run, vehicle)
        worst = [event for event in events if event.cost_m2 > 0][:count]
    return TrackInspection(
        contents=RecordedContents.of(recorded),
        at=None if at is None else _moment(result, at, tracker),
        worst=worst,
    )


def _moment(result: Result, time: float, only: str | None) -> TracksMoment:
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
    tracks = _tracks(result.tables.tracks, now)
    return TracksMoment(now, vehicles, [item for item in tracks if only in (None, item.tracker)])


def _tracks(table: pa.Table, now: float) -> list[TrackMoment]:
    if not table.num_rows:
        return []
    rows = table.filter(pc.less(pc.abs(pc.subtract(table["time_s"], now)), 1e-9)).to_pylist()
    return [TrackMoment(r["tracker"], int(r["track"]), r["px_m"], r["py_m"], r["existence"]) for r in rows]
