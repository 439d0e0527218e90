"""The time and the vehicle at which a recording opens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.metrics.function_events import FunctionEvent, TrackEvent, events_of, function_events
from trackbench.metrics.recorded_run import EstimateMoment, recorded_estimates, worst
from trackbench.results import Result
from trackbench.results.columns import split

Moment = EstimateMoment | TrackEvent | FunctionEvent


@dataclass(frozen=True)
class Opening:
    """Request of the user where the viewer opens; by default with the whole scene, at the start."""

    at_s: float | None = None
    worst: int | None = None
    """Rank of the moment among the worst ones: 1 for the largest position error or costliest event."""
    vehicle: str | None = None
    tracker: str | None = None
    """Tracker whose worst moments count; None for all ranked trackers that filter. With hidden identities the viewer
    displays this tracker's tracks."""
    function: str | None = None
    """Driver assistance function whose wrong decisions count as the worst moments; None for errors or track events."""


@dataclass(frozen=True)
class Focus:
    """Time and vehicle at which a recording opens; by default the whole scene, at the start."""

    vehicle: str | None = None
    time_s: float | None = None
    error_m: float = 0.0
    """Position error, m, up to which the value axis of the vehicle's error plot must reach."""
    tracker: str | None = None
    """Tracker whose tracks are displayed, with hidden identities; None for the best tracker."""
    function: str | None = None
    """Driver assistance function at whose wrong decision the recording opens; None for another moment."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Position of the event relative to the vehicle in the middle, with hidden identities, m in x and y."""


def focus_of(result: Result, opening: Opening) -> Focus:
    """Return the time and the vehicle at which the recording of a run opens.

    Raises:
        InputError: the run lacks the vehicle, tracker, time or moment.
    """
    moments = worst_moments(result, opening)
    if opening.worst is not None:
        if len(moments) < opening.worst:
            run, number = result.summary.recorded_run, counted(len(moments), "such moment")
            raise InputError(f"run {run}, which is recorded, has {number}", key="--worst")
        return _focus_at(result, moments[opening.worst - 1])
    if opening.at_s is not None:
        require_time(result, opening.at_s)
        if opening.vehicle is not None:
            _require_present(result, opening.vehicle, opening.at_s)
    return Focus(opening.vehicle, opening.at_s, tracker=opening.tracker)


def worst_moments(result: Result, opening: Opening) -> Sequence[Moment]:
    """Return the ``opening.worst`` worst moments of a run, the worst first.

    They are wrong decisions of a function if the opening names one. Otherwise they are the costliest track events with
    hidden identities, and the largest position errors with known ones.

    Args:
        result: result of the run.
        opening: number of moments, and optionally their tracker, vehicle and function.

    Raises:
        InputError: the run has no such tracker, vehicle or function.
    """
    hidden, tracker, vehicle = result.summary.identities == "hidden", opening.tracker, opening.vehicle
    if tracker is not None:
        _require_tracker_fits(result, opening, tracker)
    if vehicle is not None:
        require_name(vehicle, result.summary.truth.objects, "vehicle")
    if opening.worst is None:
        return []
    if opening.function is not None:
        run = result.summary.recorded_run
        return function_events(result, opening.function, tracker, run, vehicle)[: opening.worst]
    if hidden:
        return costly_events(result, tracker, vehicle)[: opening.worst]
    estimates = recorded_estimates(result)
    names = list(estimates["tracker"].unique())
    filtering = [item.name for item in result.filtering if item.name in names]
    trackers = filtering or names if tracker is None else [require_name(tracker, names, "tracker")]
    return worst(estimates, trackers, opening.worst, vehicle)


def _focus_at(result: Result, moment: Moment) -> Focus:
    if isinstance(moment, EstimateMoment):
        return Focus(moment.object, moment.time_s, moment.position_error_m or 0.0)
    tracker = moment.tracker if result.summary.identities == "hidden" else None
    if isinstance(moment, FunctionEvent):
        return Focus(moment.object or None, moment.time_s, tracker=tracker, function=moment.function)
    vehicle, offset = _vehicle_at(result, moment)
    return Focus(vehicle, moment.time_s, tracker=tracker, offset=offset)


def require_time(result: Result, time: float) -> None:
    """Refuse a time, s, outside the recording.

    Raises:
        InputError: the time is outside.
    """
    last = result.summary.truth.duration_s
    # The last instant may not be a round number.
    if not -1e-9 <= time <= last + 1e-9:
        raise InputError(f"{time:g} s is not in the recording, which goes from 0 s to {last:g} s", key="--at")


def require_name(name: str, known: Iterable[str], what: str) -> str:
    """Return a name if it is among the known names of ``what``, "vehicle" or "tracker".

    Raises:
        InputError: the name is unknown.
    """
    names = list(known)
    if name not in names:
        raise InputError(f"no {what} {name!r} in this recording; {nearest_choices(name, names)}", key=f"--{what}")
    return name


def _require_present(result: Result, vehicle: str, time_s: float) -> None:
    rows = split(result.tables.truth, "object")[vehicle,]
    present = rows["time_s"][rows["alive"].astype(bool)]
    if not len(present) or not present[0] - 1e-9 <= time_s <= present[-1] + 1e-9:
        when = f"from {present[0]:g} s to {present[-1]:g} s" if len(present) else "at no time"
        raise InputError(f"{vehicle} is not there at {time_s:g} s: it is there {when}", key="--at")


def moment_of(result: Result) -> Focus:
    """Return the time and vehicle of the recorded run that are worth seeing first.

    With functions it is the time at which the first function should act. Otherwise it is the largest error of any
    contender, or with hidden identities the costliest event of the best contender.
    """
    for rows in split(result.tables.if_there("decisions"), "function").values():
        due = np.flatnonzero(rows["true_active"] > 0)
        if due.size:
            return Focus(str(rows["true_object"][due[0]]), float(rows["time_s"][due[0]]))
    hidden = result.summary.identities == "hidden"
    best = result.contenders[0].name if hidden and result.scored else None
    moments = worst_moments(result, Opening(worst=1, tracker=best))
    return _focus_at(result, moments[0]) if moments else Focus()


def _require_tracker_fits(result: Result, opening: Opening, tracker: str) -> None:
    """Refuse a tracker that has no tracks, or that is named without ``--worst`` although identities are known."""
    if result.summary.identities == "hidden":
        failed = result[require_name(tracker, list(result), "tracker")].failed
        if failed is not None:
            raise InputError(f"{tracker} failed, so it has no tracks: {failed}", key="--tracker")
    elif opening.worst is None:
        raise InputError("chooses whose worst moments are shown: give --worst with it", key="--tracker")


def costly_events(result: Result, tracker: str | None, vehicle: str | None) -> list[TrackEvent]:
    """Return the events with a cost in the recorded run, of a tracker or all contenders, the costliest first."""
    events = events_of(result, tracker, result.summary.recorded_run, vehicle)
    names = [item.name for item in result.filtering] if tracker is None else [tracker]
    return [event for event in events if event.cost_m2 > 0 and event.tracker in names]


def _vehicle_at(result: Result, event: TrackEvent) -> tuple[str, tuple[float, float]]:
    """Return the vehicle of an event, or else the nearest vehicle, and the event's position relative to it, m."""
    offsets = {}
    for (_, name), rows in split(result.tables.truth, "role", "object").items():
        step = int(np.searchsorted(rows["time_s"], event.time_s - 1e-9))
        if rows["alive"][step]:
            offsets[name] = (float(event.x_m - rows["px_m"][step]), float(event.y_m - rows["py_m"][step]))
    vehicle = event.object if event.object in offsets else min(offsets, key=lambda name: np.hypot(*offsets[name]))
    return vehicle, offsets[vehicle]
