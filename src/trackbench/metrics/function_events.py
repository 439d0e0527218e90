"""The events of a result: of its functions, the worst first, and of its tracks, by what they cost."""

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

#: Of the metric that every function has, before its name.
_STEM = "warn_delay."


class FunctionEvent(NamedTuple):
    """A time in which a function should have been active, or was without a reason."""

    tracker: str
    function: str
    object: str
    """Empty where a track on no object was meant."""
    outcome: str
    """answered, missed or false."""
    run: int
    time_s: float
    until_s: float
    delay_s: float | None
    """Below 0 where it was early; None of what is false."""

    @property
    def word(self) -> str:
        """What was wrong: missed, late, false or early; on time where nothing was."""
        if self.outcome != "answered" or not self.delay_s:
            return self.outcome if self.outcome != "answered" else "on time"
        return "late" if self.delay_s > 0 else "early"

    @property
    def wrong_s(self) -> float:
        """For how long it was not as on the truth, s."""
        return self.until_s - self.time_s if self.delay_s is None else abs(self.delay_s)


#: What was wrong, the worst first.
WORST = ("missed", "late", "false", "early")


def function_labels(paths: Iterable[str]) -> list[str]:
    """The functions that have metrics among these paths."""
    return list(dict.fromkeys(path.removeprefix(_STEM) for path in paths if path.startswith(_STEM)))


def function_events(
    result: Result,
    function: str,
    tracker: str | None = None,
    run: int | None = None,
    vehicle: str | None = None,
) -> list[FunctionEvent]:
    """The events of a function in which something was wrong: those that were missed first, then those that were late,
    what was false, and what was early; of each the longest first.

    Args:
        result: of a run.
        function: by its name in the scenario.
        tracker: of this one alone.
        run: of this one alone.
        vehicle: about this one alone.

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
    """Return the rows with these values in their columns, None for any; what is not known is None."""
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


#: A time in a reason, which tells events of one cause apart.
_TIME = re.compile(r"^[\d.]+ s ")


class TrackEvent(NamedTuple):
    """Something that happened to a track or an object."""

    tracker: str
    run: int
    kind: str
    time_s: float
    object: str
    """Empty where it is about a track on none."""
    track: int | None
    other_object: str
    other_track: int | None
    x_m: float
    y_m: float
    cost_m2: float
    why: str

    @property
    def cause(self) -> str:
        """Why, without what is of this event alone."""
        return _TIME.sub("", self.why)

    @property
    def reason(self) -> str:
        """Why, with the other object and track."""
        others = [f"vehicle {self.other_object}"] if self.other_object else []
        others += [f"track {self.other_track}"] if self.other_track is not None else []
        return f"{self.why} ({', '.join(others)})" if others else self.why


def events_of(
    result: Result, tracker: str | None = None, run: int | None = None, vehicle: str | None = None
) -> list[TrackEvent]:
    """The events of a result, the costliest first; those in which a track starts come after the others
    that cost anything.

    Args:
        result: one whose identities are hidden.
        tracker: of this one alone.
        run: of this one alone.
        vehicle: those in which this one has a part.
    """
    rows = _rows(result.tables.events, tracker=tracker, run=run)
    events = [TrackEvent(**{name: row[name] for name in TrackEvent._fields}) for row in rows]
    if vehicle is not None:
        events = [event for event in events if vehicle in (event.object, event.other_object)]

    def order(event: TrackEvent) -> tuple[bool, bool, float, float]:
        return not event.cost_m2, event.kind == "confirmed", -event.cost_m2, event.time_s

    return sorted(events, key=order)


def drawn_instants(tables: Tables) -> Array:
    """``(instants,)`` s at which a sensor looks in the recorded run; without objects those with something to draw."""
    sources = [tables.due] if tables.due.num_rows else [tables.tracks, tables.measurements]
    return np.unique(
        np.concatenate([table["time_s"].to_numpy() for table in sources if table.num_rows] or [np.empty(0)])
    )
