"""Single moments of the recorded run: what the scene is at a time, and when each tracker was worst."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.errors import InputError
from trackbench.recording.shown import STATE, ShownRun, Track
from trackbench.recording.tables import Columns, split
from trackbench.results import Result

Json = dict[str, Any]

#: Two moments of one object are told apart if they lie farther apart than this, s.
APART = 1.0
MOTION = (*STATE, "speed_mps", "course_rad", "acceleration_mps2", "yaw_rate_radps")


def scene_at(result: Result, shown: ShownRun, time: float) -> Json:
    """Vehicles, measurements and estimates as a viewer shows them at a time: the latest of each up to then.

    Raises:
        InputError: the recording does not have that time.
    """
    truth = split(result.tables["truth"], "role", "object")
    clock = next(iter(truth.values()))["time_s"]
    require_time(clock[0], clock[-1], time)
    step = _latest(clock, time)
    vehicles = []
    for (role, name), rows in truth.items():
        if rows["alive"][step]:
            motion = {key: float(rows[key][step]) for key in MOTION}
            vehicles.append({"name": name, "role": role, **motion})
    present = {name for (_, name), rows in truth.items() if rows["alive"][step]}
    return {
        "time_s": float(clock[step]),
        "vehicles": vehicles,
        "measurements": _measurements(split(result.tables["measurements"], "sensor", "object"), time),
        "estimates": _estimates(shown, time, present),
    }


def require_time(first: float, last: float, time: float) -> None:
    """Make sure that a time is one of a recording's.

    Raises:
        InputError: it is not.
    """
    # The last instant may not be a round number.
    if not first - 1e-9 <= time <= last + 1e-9:
        raise InputError(f"{time:g} s is not in the recording, which goes from {first:g} s to {last:g} s", key="--at")


def worst(shown: ShownRun, count: int) -> dict[str, list[Json]]:
    """By tracker, the scored moments of the largest position error; of one peak only its top."""
    return {tracker: _worst(shown, track, count) for tracker, track in shown.tracks.items()}


def _worst(shown: ShownRun, track: Track, count: int) -> list[Json]:
    time = shown.target.time
    error = np.where(shown.scored, track.position_error, np.nan)
    found: list[Json] = []
    while len(found) < count and np.isfinite(error).any():
        instant, i = (int(index) for index in np.unravel_index(np.nanargmax(error), error.shape))
        found.append({"time_s": float(time[instant]), "object": shown.objects[i], **_errors(track, instant, i)})
        error[np.abs(time - time[instant]) <= APART, i] = np.nan
    return found


def _errors(track: Track, instant: int, i: int) -> Json:
    return {
        "position_error_m": float(track.position_error[instant, i]),
        "velocity_error_mps": float(track.velocity_error[instant, i]),
        "nees": float(track.nees[instant, i]),
    }


def _estimates(shown: ShownRun, time: float, present: set[str]) -> list[Json]:
    if time < shown.target.time[0] - 1e-9:
        return []
    instant = _latest(shown.target.time, time)
    found = []
    for tracker, track in shown.tracks.items():
        for i, name in enumerate(shown.objects):
            if name in present and np.isfinite(track.mean[:, instant, i]).all():
                mean = dict(zip(STATE, map(float, track.mean[:, instant, i]), strict=True))
                entry = {"tracker": tracker, "object": name, "time_s": float(shown.target.time[instant]), **mean}
                found.append({**entry, **_errors(track, instant, i)})
    return found


def _measurements(measurements: dict[tuple[str, ...], Columns], time: float) -> list[Json]:
    """The latest measurement of each sensor, of the objects that it detected."""
    found = []
    for (sensor, name), rows in measurements.items():
        if rows["time_s"][0] <= time + 1e-9:
            at = _latest(rows["time_s"], time)
            if rows["valid"][at]:
                place = {key: float(rows[key][at]) for key in ("x_m", "y_m")}
                found.append({"sensor": sensor, "object": name, "time_s": float(rows["time_s"][at]), **place})
    return found


def _latest(times: Any, time: float) -> int:
    """Index of the last of ``times`` that is not after ``time``, up to rounding."""
    return int(np.searchsorted(times, time + 1e-9, side="right")) - 1
