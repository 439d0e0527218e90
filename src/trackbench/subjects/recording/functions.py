"""Decisions of assistance functions in the recorded run: a lane (row of the time line) for truth and each tracker."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from trackbench.base.types import Array
from trackbench.document.palette import ERROR_COLOURS, TRUTH_COLOUR
from trackbench.metrics.function_events import FunctionEvent
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.stream import Stream, path, rgba_of

LANES = "functions"
#: Name of the truth's lane: no tracker has it, and it sorts first.
TRUTH = "_truth"
#: Colour of a lane while a decision is wrong, by kind.
WRONG = {"missed": ERROR_COLOURS[2], "late": ERROR_COLOURS[0], "false": ERROR_COLOURS[1]}
#: State of a lane without a decision.
NOTHING = ""


def send_functions(
    stream: Stream,
    decisions: pa.Table,
    events: Iterable[FunctionEvent],
    colours: Mapping[str, str],
) -> None:
    """Send the decisions of all assistance functions to the recording, as lanes (rows of its time line).

    Args:
        stream: the recording.
        decisions: table of decisions in the recorded run.
        events: wrong decisions in the recorded run.
        colours: colour of each tracker, "#RRGGBB" by name.
    """
    by_function: dict[str, dict[str, Columns]] = {}
    for (function, tracker), rows in split(decisions, "function", "tracker").items():
        by_function.setdefault(function, {})[tracker] = rows
    wrong = list(events)
    for function, rows_by_tracker in by_function.items():
        first = next(iter(rows_by_tracker.values()))
        states = np.where(first["true_active"] > 0, _object_names(first["true_object"]), NOTHING)
        _send_lane(stream, (function, TRUTH), first["time_s"], states, TRUTH_COLOUR)
        for tracker, rows in rows_by_tracker.items():
            tracker_events = [event for event in wrong if (event.function, event.tracker) == (function, tracker)]
            _send_lane(stream, (function, tracker), rows["time_s"], lane(rows, tracker_events), colours[tracker])


def lane(rows: Columns, events: Iterable[FunctionEvent]) -> Array:
    """Return what a tracker's row of the time line shows at each instant: a decision's object, an error, or nothing."""
    time, active = rows["time_s"], rows["active"] > 0
    states = np.where(active, _object_names(rows["object"]), NOTHING)
    for event in events:
        until = event.until_s if event.word == "false" else event.time_s + event.wrong_s
        inside = (time >= event.time_s - 1e-9) & (time < until - 1e-9)
        if event.word in WRONG:
            states = np.where(inside & (active if event.word == "false" else ~active), event.word, states)
    return states


def lanes_view() -> rrb.StateTimelineView:
    """Return the view with the lanes (rows of the time line) of all assistance functions, one below the other."""
    return rrb.StateTimelineView(
        origin=path(LANES), name="Functions", time_view=rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
    )


def _object_names(objects: Array) -> Array:
    names = objects.astype(str)
    return np.where(names == "", "no object", names)


def _send_lane(stream: Stream, parts: tuple[str, ...], time: Array, states: Array, colour: str) -> None:
    change = np.append(True, states[1:] != states[:-1])
    entity = path(LANES, *parts)
    stream.columns(entity, time[change], rr.StateChange.columns(state=states[change].tolist()))
    values = np.unique(states).tolist()
    colours = rgba_of(WRONG.get(value, colour) for value in values)
    visible = [value != NOTHING for value in values]
    stream.static(entity, rr.StateConfiguration(values=values, labels=values, colors=colours, visible=visible))
