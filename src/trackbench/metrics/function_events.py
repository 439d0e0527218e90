"""Events of a result: faults of driver assistance functions, worst first, and of tracks, costliest first."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array
from trackbench.results import Result, Tables

#: Path prefix of the metric that every function has.
_STEM = "warn_delay."


class FunctionEvent(NamedTuple):
    """Period in which a driver assistance function should have been active, or was active without a reason."""

    tracker: str
    function: str
    object: str
    """Name of the object that the function acts on; empty if it acts on a track on no object."""
    outcome: str
    """``answered``: active when it should be; ``missed``: never active; ``false``: active without a reason."""
    run: int
    time_s: float
    until_s: float
    delay_s: float | None
    """Delay of the activation against the truth, below 0 where it was early; None for a false activation."""

    @property
    def word(self) -> str:
        """Fault of the function: missed, late, false or early; else ``on time``."""
        if self.outcome != "answered" or not self.delay_s:
            return self.outcome if self.outcome != "answered" else "on time"
        return "late" if self.delay_s > 0 else "early"

    @property
    def wrong_s(self) -> float:
        """Time, s, for which the function was active on tracks but not on the ground truth, or the reverse."""
        return self.until_s - self.time_s if self.delay_s is None else abs(self.delay_s)


#: Faults of a function, the worst first.
WORST = ("missed", "late", "false", "early")


def function_labels(paths: Iterable[str]) -> list[str]:
    """Return the names of the driver assistance functions that have metrics among these dotted paths."""
    return list(dict.fromkeys(path.removeprefix(_STEM) for path in paths if path.startswith(_STEM)))


def function_events(
    result: Result,
    function: str,
    tracker: str | None = None,
    run: int | None = None,
    vehicle: str | None = None,
) -> list[FunctionEvent]:
    """Return a driver assistance function's faults: missed, then late, false and early; the longest of each first.

    Args:
        result: result of a run.
        function: name of the driver assistance function in the scenario.
        tracker: name of the only tracker to look at; None for all.
        run: number of the only run to look at; None for all.
        vehicle: name of the only object to look at; None for all.

    Raises:
        InputError: the scenario has no such function.
    """
    labels = function_labels(path for item in result.summary.trackers for path in item.metrics)
    if function not in labels:
        hint = nearest_choices(function, labels) if labels else "it has none"
        raise InputError(f"no function {function!r} in this run; {hint}", key="--function")
    rows = _rows(result.tables.if_there("function_events"), function=function, tracker=tracker, run=run, object=vehicle)
    events = [FunctionEvent(**row) for row in rows]
    wrong = [event for event in events if event.word in WORST]
    return sorted(wrong, key=lambda event: (WORST.index(event.word), -round(event.wrong_s, 6), event.run, event.time_s))


def _rows(table: pa.Table, **values: str | int | None) -> list[dict[str, Any]]:
    """Return the rows that have the given values in the named columns, None for any value; NaN becomes None."""
    for name, value in values.items():
        if value is not None and table.num_rows:
            table = table.filter(pc.equal(table[name], float(value) if name == "run" else value))
    numbers = {"run", "track", "other_track"}
    return [
        {
            name: None if value is None or value != value else int(value) if name in numbers else value
            for name, value in row.items()
        }
        for row in table.to_pylist()
    ]


#: Time at the start of a reason, which differs between events of one cause.
_TIME = re.compile(r"^[\d.]+ s ")


class TrackEvent(NamedTuple):
    """Row of the table of events: a confirmation, loss, switch or another event of a track or an object."""

    tracker: str
    run: int
    kind: str
    time_s: float
    object: str
    """Name of the object; empty for a track on no object."""
    track: int | None
    other_object: str
    other_track: int | None
    x_m: float
    y_m: float
    cost_m2: float
    why: str

    @property
    def cause(self) -> str:
        """Reason of the event without the time in its text, so that events of one cause have equal texts."""
        return _TIME.sub("", self.why)

    @property
    def reason(self) -> str:
        """Reason of the event with the second object and track that take part in it."""
        others = [f"vehicle {self.other_object}"] if self.other_object else []
        others += [f"track {self.other_track}"] if self.other_track is not None else []
        return f"{self.why} ({', '.join(others)})" if others else self.why


def events_of(
    result: Result, tracker: str | None = None, run: int | None = None, vehicle: str | None = None
) -> list[TrackEvent]:
    """Return the track events of a result, the costliest first; a first confirmation comes after other costly events.

    Args:
        result: result with hidden identities.
        tracker: name of the only tracker to look at; None for all.
        run: number of the only run to look at; None for all.
        vehicle: name of an object that takes part in each returned event; None for events of all objects.
    """
    rows = _rows(result.tables.events, tracker=tracker, run=run)
    events = [TrackEvent(**{name: row[name] for name in TrackEvent._fields}) for row in rows]
    if vehicle is not None:
        events = [event for event in events if vehicle in (event.object, event.other_object)]

    def order(event: TrackEvent) -> tuple[bool, bool, float, float]:
        return not event.cost_m2, event.kind == "confirmed", -event.cost_m2, event.time_s

    return sorted(events, key=order)


def drawn_instants(tables: Tables) -> Array:
    """Return the times of the recorded run, ``(instants,)`` s; without a truth, of its tracks and measurements."""
    sources = [tables.due] if tables.due.num_rows else [tables.tracks, tables.measurements]
    return np.unique(
        np.concatenate([table["time_s"].to_numpy() for table in sources if table.num_rows] or [np.empty(0)])
    )
