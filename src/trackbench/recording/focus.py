"""Where a recording opens: at a time, with a vehicle in the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trackbench.errors import InputError
from trackbench.metrics.moments import EstimateMoment, distinct, require_name, require_time, worst
from trackbench.metrics.recorded_run import RecordedRun, recorded_run
from trackbench.results import Result
from trackbench.results.columns import split


@dataclass(frozen=True)
class Opening:
    """Where the viewer is asked to open; unless stated, with the whole scene from the start."""

    at_s: float | None = None
    worst: int | None = None
    """At the moment of the largest position error, the second largest, and so on."""
    vehicle: str | None = None
    tracker: str | None = None
    """Whose error is the worst; unless stated, any tracker's."""


@dataclass(frozen=True)
class Focus:
    """What is looked at first; unless stated, the whole scene from the start."""

    vehicle: str | None = None
    time_s: float | None = None
    error_m: float = 0.0
    """A position error that the plot of the vehicle has to show."""


def focus_of(results: Sequence[Result], opening: Opening) -> Focus:
    """What runs of the same traffic open with.

    Raises:
        InputError: a vehicle, tracker, time or moment that they do not have.
    """
    summary = results[0].summary
    if opening.vehicle is not None:
        require_name(opening.vehicle, summary.truth.objects, "vehicle")
    if opening.worst is not None:
        moment = _worst([recorded_run(result) for result in results], opening.worst, opening)
        return Focus(moment.object, moment.time_s, moment.position_error_m or 0.0)
    if opening.at_s is not None:
        for result in results:
            require_time(0.0, result.summary.truth.duration_s, opening.at_s)
        if opening.vehicle is not None:
            _require_presence(results[0], opening.vehicle, opening.at_s)
    return Focus(opening.vehicle, opening.at_s)


def _worst(runs: Sequence[RecordedRun], number: int, opening: Opening) -> EstimateMoment:
    known = list(dict.fromkeys(name for run in runs for name in run.tracks))
    trackers = known if opening.tracker is None else [require_name(opening.tracker, known, "tracker")]
    found = distinct(
        moment
        for run in runs
        for moment in worst(run, [name for name in trackers if name in run.tracks], number, opening.vehicle)
    )
    if len(found) < number:
        raise InputError(f"only {len(found)} such moments: no other estimate counts", key="--worst")
    return found[number - 1]


def _require_presence(result: Result, vehicle: str, time: float) -> None:
    rows = split(result.tables.truth, "object")[vehicle,]
    present = rows["time_s"][rows["alive"].astype(bool)]
    if not len(present) or not present[0] - 1e-9 <= time <= present[-1] + 1e-9:
        when = f"from {present[0]:g} s to {present[-1]:g} s" if len(present) else "at no time"
        raise InputError(f"{vehicle} is not there at {time:g} s: it is there {when}", key="--at")
