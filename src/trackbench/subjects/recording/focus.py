"""Where a recording opens: at a time, with a vehicle in the middle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.metrics.function_events import FunctionEvent, TrackEvent, events_of, function_events
from trackbench.metrics.recorded_run import EstimateMoment, recorded_estimates, worst
from trackbench.results import Result
from trackbench.results.columns import Columns, split

Moment = EstimateMoment | TrackEvent | FunctionEvent


@dataclass(frozen=True)
class Opening:
    """Where the viewer is asked to open; unless stated, with the whole scene from the start."""

    at_s: float | None = None
    worst: int | None = None
    """At the moment of the largest position error, the second largest, and so on."""
    vehicle: str | None = None
    tracker: str | None = None
    """Whose error is the worst; unless stated, that of any contender that filters. With hidden identities also whose
    tracks are shown."""
    function: str | None = None
    """At the worst event of this one in the recorded run."""


WHOLE = Opening()


@dataclass(frozen=True)
class Focus:
    """What is looked at first; unless stated, the whole scene from the start."""

    vehicle: str | None = None
    time_s: float | None = None
    error_m: float = 0.0
    """A position error that the plot of the vehicle has to show."""
    tracker: str | None = None
    """Where identities are hidden, the one whose tracks are shown."""
    function: str | None = None
    """Whose lanes are shown."""
    beside: tuple[float, float] = (0.0, 0.0)
    """Where identities are hidden, the place of the event from the vehicle in the middle, m in x and y."""


def focus_of(result: Result, opening: Opening) -> Focus:
    """Return what a run opens with.

    Raises:
        InputError: a vehicle, tracker, time or moment that it does not have.
    """
    moments = worst_moments(result, opening)
    if opening.worst is not None:
        if len(moments) < opening.worst:
            raise _too_few(result, opening, len(moments))
        return _focus_on(result, moments[opening.worst - 1])
    if opening.at_s is not None:
        require_time(0.0, result.summary.truth.duration_s, opening.at_s)
        if opening.vehicle is not None:
            _require_present(result, opening.vehicle, opening.at_s)
    return Focus(opening.vehicle, opening.at_s, tracker=opening.tracker)


def worst_moments(result: Result, opening: Opening, *, each: bool = False) -> Sequence[Moment]:
    """Return as many of the worst moments as an opening asks for, the worst first.

    They are events of its function; else with hidden identities what costs most; else the largest position errors.

    Args:
        result: of the run.
        opening: with the tracker and the vehicle of the moments.
        each: as many of each tracker, contenders first, and the events of a function of all runs.

    Raises:
        InputError: the run has no such tracker, vehicle or function.
    """
    hidden, tracker, vehicle = result.summary.identities == "hidden", opening.tracker, opening.vehicle
    if tracker is not None:
        _require_use_of_tracker(result, opening, tracker)
    if vehicle is not None:
        require_name(vehicle, result.summary.truth.objects, "vehicle")
    if opening.worst is None:
        return []
    if opening.function is not None:
        run = None if each else result.summary.recorded_run
        return function_events(result, opening.function, tracker, run, vehicle)[: opening.worst]
    if hidden:
        return costly_events(result, tracker, vehicle)[: opening.worst]
    estimates = recorded_estimates(result)
    names = list(estimates["tracker"].unique())
    filtering = [item.name for item in result.filtering if item.name in names]
    if tracker is not None:
        groups = [[require_name(tracker, names, "tracker")]]
    elif each:
        groups = [[name] for name in dict.fromkeys([*filtering, *names])]
    else:
        groups = [filtering or names]
    return [moment for group in groups for moment in worst(estimates, group, opening.worst, vehicle)]


def _focus_on(result: Result, moment: Moment) -> Focus:
    if isinstance(moment, EstimateMoment):
        return Focus(moment.object, moment.time_s, moment.position_error_m or 0.0)
    tracker = moment.tracker if result.summary.identities == "hidden" else None
    if isinstance(moment, FunctionEvent):
        return Focus(moment.object or None, moment.time_s, tracker=tracker, function=moment.function)
    vehicle, beside = _vehicle_at(result, moment)
    return Focus(vehicle, moment.time_s, tracker=tracker, beside=beside)


def _too_few(result: Result, opening: Opening, number: int) -> InputError:
    if opening.function is not None:
        run, wrong = result.summary.recorded_run, counted(number, "event")
        message = f"in run {run}, the recorded one, {wrong} of {opening.function} went wrong"
        return InputError(f"{message}; trackbench inspect has all runs", key="--worst")
    if result.summary.identities == "hidden":
        return InputError(f"only {number} such events: no other costs anything", key="--worst")
    return InputError(f"only {number} such moments: no other estimate counts", key="--worst")


def require_time(first: float, last: float, time: float) -> None:
    """Make sure that a time is one of a recording's.

    Raises:
        InputError: it is not.
    """
    # The last instant may not be a round number.
    if not first - 1e-9 <= time <= last + 1e-9:
        raise InputError(f"{time:g} s is not in the recording, which goes from {first:g} s to {last:g} s", key="--at")


def require_name(name: str, known: Iterable[str], what: str) -> str:
    """Return a name if it is one of those known.

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


def _require_present(result: Result, vehicle: str, time_s: float) -> None:
    rows = split(result.tables.truth, "object")[vehicle,]
    present = rows["time_s"][rows["alive"].astype(bool)]
    if not len(present) or not present[0] - 1e-9 <= time_s <= present[-1] + 1e-9:
        when = f"from {present[0]:g} s to {present[-1]:g} s" if len(present) else "at no time"
        raise InputError(f"{vehicle} is not there at {time_s:g} s: it is there {when}", key="--at")


#: Over so long a time the difference of two trackers is averaged, and so far it is from the ends of a track, s.
SMOOTH_S, MARGIN_S = 0.5, 1.0


def moment_of(result: Result) -> Focus:
    """Return a moment of the recorded run that is worth seeing first.

    Where identities are hidden, the costliest event of the best contender that is no start of a track. With functions,
    where the first is due. Else where the errors of two contenders differ most for half a second.
    """
    if result.summary.identities == "hidden":
        best = result.contenders[0].name if result.scored else None
        events = [event for event in costly_events(result, best, None) if event.kind != "confirmed"]
        return Focus(_vehicle_at(result, events[0])[0], events[0].time_s) if events else Focus()
    for rows in split(result.tables.if_there("decisions"), "function").values():
        due = np.flatnonzero(rows["true_active"] > 0)
        if due.size:
            return Focus(str(rows["true_object"][due[0]]), float(rows["time_s"][due[0]]))
    filtering = {tracker.name for tracker in result.filtering}
    of_objects: dict[str, list[Columns]] = {}
    for (name, tracker), rows in split(result.tables.if_there("estimates"), "object", "tracker").items():
        if tracker in filtering:
            of_objects.setdefault(name, []).append(rows)
    moments = [(*_most_apart(tracks), name) for name, tracks in of_objects.items()]
    difference, time, vehicle = max(moments, default=(0.0, 0.0, ""))
    return Focus(vehicle, time) if difference > 0 else Focus()


def _most_apart(tracks: Sequence[Columns]) -> tuple[float, float]:
    """Return by how much the position errors of an object's tracks differ at most, m, and when, s."""
    time = np.unique(np.concatenate([rows["time_s"] for rows in tracks]))
    if not len(time):
        return 0.0, 0.0
    errors = np.full((len(tracks), len(time)), np.nan)
    for own, rows in zip(errors, tracks, strict=True):
        own[np.searchsorted(time, rows["time_s"])] = rows["position_error_m"]
    differ = np.fmax.reduce(errors) - (np.fmin.reduce(errors) if len(errors) > 1 else 0.0)
    inside = (time > time[0] + MARGIN_S) & (time < time[-1] - MARGIN_S)
    width = max(1, round(SMOOTH_S * len(time) / max(float(np.ptp(time)), SMOOTH_S)))
    smooth = np.convolve(np.nan_to_num(differ) * inside, np.full(width, 1 / width), "same")
    return float(smooth.max()), float(time[smooth.argmax()])


def _require_use_of_tracker(result: Result, opening: Opening, tracker: str) -> None:
    """Require that a tracker is named for its worst moments, or, with hidden identities, for its tracks."""
    if result.summary.identities == "hidden":
        failed = result[require_name(tracker, list(result), "tracker")].failed
        if failed is not None:
            raise InputError(f"{tracker} failed, so it has no tracks: {failed}", key="--tracker")
    elif opening.worst is None:
        raise InputError("names whose worst moments are meant: give --worst with it", key="--tracker")


def costly_events(result: Result, tracker: str | None, vehicle: str | None) -> list[TrackEvent]:
    """Return the events of the recorded run that cost something, of a tracker or the contenders, costliest first."""
    events = events_of(result, tracker, result.summary.recorded_run, vehicle)
    names = [item.name for item in result.filtering] if tracker is None else [tracker]
    return [event for event in events if event.cost_m2 > 0 and event.tracker in names]


def _vehicle_at(result: Result, event: TrackEvent) -> tuple[str, tuple[float, float]]:
    """Return the vehicle of an event, or the nearest to it, and the place of the event seen from there, m."""
    away = {}
    for (_, name), rows in split(result.tables.truth, "role", "object").items():
        step = int(np.searchsorted(rows["time_s"], event.time_s - 1e-9))
        if rows["alive"][step]:
            away[name] = (float(event.x_m - rows["px_m"][step]), float(event.y_m - rows["py_m"][step]))
    vehicle = event.object if event.object in away else min(away, key=lambda name: np.hypot(*away[name]))
    return vehicle, away[vehicle]
