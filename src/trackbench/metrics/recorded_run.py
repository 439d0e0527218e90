"""The recorded run out of its tables: as arrays, at single moments, and when each tracker was worst."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array, Mask
from trackbench.metrics.conditions import FIRST
from trackbench.metrics.intervals import ROUNDING
from trackbench.results import Result
from trackbench.results.columns import Columns, split, table_columns

#: Two moments of one object are told apart if they lie farther apart than this, s.
APART = 1.0
STATE = ("px_m", "py_m", "vx_mps", "vy_mps")


@dataclass(frozen=True)
class RecordedTrack:
    """One tracker's estimates."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    position_error: Array
    """``(instants, objects)`` m."""
    velocity_error: Array
    """``(instants, objects)`` m/s."""
    nees: Array
    """``(instants, objects)``"""
    due: Mask
    """``(instants, objects)`` where an estimate counts."""
    starting: Mask
    """``(instants, objects)`` where the track starts: the first second after the object is known."""


@dataclass(frozen=True)
class RecordedRun:
    """The recorded run at each instant of a measurement."""

    objects: tuple[str, ...]
    time: Array
    """``(instants,)`` s."""
    alive: Mask
    """``(instants, objects)``"""
    tracks: dict[str, RecordedTrack]
    """By tracker, those that did not fail."""


def load_recorded_run(result: Result) -> RecordedRun:
    """The recorded run, from the first to the last instant of a measurement."""
    tables, score = result.tables, result.summary.score
    objects = tuple(result.summary.truth.objects)
    truth = {name: rows for (role, name), rows in split(tables.truth, "role", "object").items() if role == "target"}
    tracks: dict[str, dict[str, Columns]] = {}
    for (tracker, name), rows in split(tables.estimates, "tracker", "object").items():
        tracks.setdefault(tracker, {})[name] = rows
    every = [rows["time_s"] for track in tracks.values() for rows in track.values()]
    time = every[0] if every else np.unique(table_columns(tables.measurements)["time_s"])
    at = np.searchsorted(truth[objects[0]]["time_s"], time)
    alive = np.stack([truth[name]["alive"][at] for name in objects], axis=1).astype(bool)
    start = max(0.0, FIRST - score.settle_s)
    by_tracker = {tracker: _track(rows, objects, time, start) for tracker, rows in tracks.items()}
    return RecordedRun(objects, time, alive, by_tracker)


def _track(rows: dict[str, Columns], objects: tuple[str, ...], time: Array, start: float) -> RecordedTrack:
    """``start``: how long a track starts after its estimates begin to count, s."""

    def column(name: str) -> Array:
        values = np.full((len(time), len(objects)), np.nan)
        for i, key in enumerate(objects):
            if key in rows:
                values[:, i] = rows[key][name]
        return values

    due = column("due") > 0
    begins = due & ~np.vstack([np.zeros_like(due[:1]), due[:-1]])
    since = np.maximum.accumulate(np.where(begins, time[:, None], -np.inf), axis=0)
    return RecordedTrack(
        mean=np.stack([column(name) for name in STATE]),
        position_error=column("position_error_m"),
        velocity_error=column("velocity_error_mps"),
        nees=column("nees"),
        due=due,
        starting=due & (time[:, None] - since < start * (1 - ROUNDING)),
    )


@dataclass(frozen=True)
class VehicleMoment:
    """The true motion of the observer or of a target."""

    name: str
    role: str
    px_m: float
    py_m: float
    vx_mps: float
    vy_mps: float
    speed_mps: float
    course_rad: float
    acceleration_mps2: float
    yaw_rate_radps: float


MOTION = tuple(VehicleMoment.__dataclass_fields__)[2:]


@dataclass(frozen=True)
class MeasurementMoment:
    """Where a sensor has seen an object."""

    sensor: str
    object: str
    time_s: float
    x_m: float
    y_m: float


@dataclass(frozen=True)
class EstimateMoment:
    """A tracker's estimate of an object, and its errors; None where they are not known."""

    tracker: str
    object: str
    time_s: float
    px_m: float
    py_m: float
    vx_mps: float
    vy_mps: float
    position_error_m: float | None
    velocity_error_mps: float | None
    nees: float | None
    starting: bool
    """Whether the track starts: the object is known for less than a second."""


@dataclass(frozen=True)
class SceneMoment:
    """Everything at a time."""

    time_s: float
    vehicles: list[VehicleMoment]
    measurements: list[MeasurementMoment]
    estimates: list[EstimateMoment]


def scene_at(result: Result, recorded: RecordedRun, time: float) -> SceneMoment:
    """Vehicles, measurements and estimates as a viewer shows them at a time: the latest of each up to then.

    Raises:
        InputError: the recording does not have that time.
    """
    truth = split(result.tables.truth, "role", "object")
    clock = next(iter(truth.values()))["time_s"]
    require_time(clock[0], clock[-1], time)
    step = _latest(clock, time)
    present = {(role, name): rows for (role, name), rows in truth.items() if rows["alive"][step]}
    vehicles = [
        VehicleMoment(name, role, **{key: float(rows[key][step]) for key in MOTION})
        for (role, name), rows in present.items()
    ]
    return SceneMoment(
        time_s=float(clock[step]),
        vehicles=vehicles,
        measurements=_measurements(split(result.tables.measurements, "sensor", "object"), time),
        estimates=_estimates(recorded, time, {name for _, name in present}),
    )


def require_time(first: float, last: float, time: float) -> None:
    """Make sure that a time is one of a recording's.

    Raises:
        InputError: it is not.
    """
    # The last instant may not be a round number.
    if not first - 1e-9 <= time <= last + 1e-9:
        raise InputError(f"{time:g} s is not in the recording, which goes from {first:g} s to {last:g} s", key="--at")


def require_name(name: str, known: Iterable[str], what: str) -> str:
    """A name if it is one of those known.

    Args:
        name: of a vehicle or tracker.
        known: those in the recording.
        what: "vehicle" or "tracker"; also the option that gives it.

    Raises:
        InputError: it is not.
    """
    names = list(known)
    if name not in names:
        raise InputError(f"no {what} {name!r} in this recording; {nearest_choices(name, names)}", key=f"--{what}")
    return name


def worst(
    recorded: RecordedRun, trackers: Sequence[str], count: int, vehicle: str | None = None
) -> list[EstimateMoment]:
    """The scored moments of the largest position error, the largest first; of one peak only its top.

    Those at which the track starts come after all others: every track starts with a large error.

    Args:
        recorded: the run.
        trackers: whose errors are looked at; at each moment the largest of them counts.
        count: how many moments at most.
        vehicle: of this one alone.
    """
    time = recorded.time
    errors = np.array([recorded.tracks[name].position_error for name in trackers])
    errors = errors.reshape(len(trackers), *recorded.alive.shape)
    due = np.array([recorded.tracks[name].due for name in trackers]).reshape(errors.shape)
    counted = due & np.array([vehicle in (None, name) for name in recorded.objects])
    errors = np.where(counted, errors, np.nan)
    starting = np.array([recorded.tracks[name].starting for name in trackers]).reshape(errors.shape)
    moments: list[EstimateMoment] = []
    while len(moments) < count and np.isfinite(errors).any():
        settled = np.where(starting, np.nan, errors)
        first = settled if np.isfinite(settled).any() else errors
        tracker, instant, i = (int(index) for index in np.unravel_index(np.nanargmax(first), errors.shape))
        moments.append(_estimate(recorded, trackers[tracker], instant, i))
        errors[:, np.abs(time - time[instant]) <= APART, i] = np.nan
    return moments


def _estimates(recorded: RecordedRun, time: float, present: set[str]) -> list[EstimateMoment]:
    if time < recorded.time[0] - 1e-9:
        return []
    instant = _latest(recorded.time, time)
    return [
        _estimate(recorded, tracker, instant, i)
        for tracker, track in recorded.tracks.items()
        for i, name in enumerate(recorded.objects)
        if name in present and np.isfinite(track.mean[:, instant, i]).all()
    ]


def _estimate(recorded: RecordedRun, tracker: str, instant: int, i: int) -> EstimateMoment:
    track = recorded.tracks[tracker]
    mean = dict(zip(STATE, map(float, track.mean[:, instant, i]), strict=True))
    return EstimateMoment(
        tracker=tracker,
        object=recorded.objects[i],
        time_s=float(recorded.time[instant]),
        **mean,
        position_error_m=_known(track.position_error[instant, i]),
        velocity_error_mps=_known(track.velocity_error[instant, i]),
        nees=_known(track.nees[instant, i]),
        starting=bool(track.starting[instant, i]),
    )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _measurements(measurements: dict[tuple[str, ...], Columns], time: float) -> list[MeasurementMoment]:
    """The latest measurement of each sensor, of the objects that it detected."""
    latest = []
    for (sensor, name), rows in measurements.items():
        at = _latest(rows["time_s"], time)
        if at >= 0 and rows["valid"][at]:
            place = (float(rows[key][at]) for key in ("time_s", "x_m", "y_m"))
            latest.append(MeasurementMoment(sensor, name, *place))
    return latest


def _latest(times: Array, time: float) -> int:
    """Index of the last of ``times`` that is not after ``time``, up to rounding; -1 if all are."""
    return int(np.searchsorted(times, time + 1e-9, side="right")) - 1
