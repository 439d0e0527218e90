"""The events of a result whose identities are hidden, by what they cost."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import pyarrow.compute as pc

from trackbench.base.types import Array
from trackbench.results import Result, Tables

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
    table = result.tables.events
    if not table.num_rows:
        return []
    if tracker is not None:
        table = table.filter(pc.equal(table["tracker"], tracker))
    if run is not None:
        table = table.filter(pc.equal(table["run"], float(run)))
    columns = {name: table[name].to_pylist() for name in TrackEvent._fields}
    events = [
        TrackEvent(
            **{**row, "run": int(row["run"]), "track": _whole(row["track"]), "other_track": _whole(row["other_track"])}
        )
        for row in (dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True))
    ]
    if vehicle is not None:
        events = [event for event in events if vehicle in (event.object, event.other_object)]

    def order(event: TrackEvent) -> tuple[bool, bool, float, float]:
        return not event.cost_m2, event.kind == "confirmed", -event.cost_m2, event.time_s

    return sorted(events, key=order)


def instants(tables: Tables) -> Array:
    """``(instants,)`` s at which a sensor looks in the recorded run; without objects those with something to draw."""
    sources = [tables.due] if tables.due.num_rows else [tables.tracks, tables.measurements]
    return np.unique(
        np.concatenate([table["time_s"].to_numpy() for table in sources if table.num_rows] or [np.empty(0)])
    )


def _whole(number: float | None) -> int | None:
    return None if number is None or np.isnan(number) else int(number)
