"""What functions decide in the recorded run: a lane for the truth and each tracker, a log, and rings in the scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

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
from trackbench.subjects.recording.tracks import WARNED, send_rings

LANES = "functions"
LOG = "function_events"
#: No tracker is called so, and it comes before all.
TRUTH = "_truth"
#: Of a lane in which something is wrong.
WRONG = {"missed": ERROR_COLOURS[4], "late": ERROR_COLOURS[2], "false": ERROR_COLOURS[3]}
#: In a lane, nothing is decided.
NOTHING = ""
#: Radius of the ring of the first tracker, and by how much that of each other one is larger, m.
RING, WIDER = 2.8, 0.35


def send_functions(
    stream: Stream,
    decisions: pa.Table,
    events: Iterable[FunctionEvent],
    truth: pa.Table,
    colours: Mapping[str, str],
) -> None:
    """Send the lanes, the log and the rings of functions.

    Args:
        stream: the recording.
        decisions: the table.
        events: those of the recorded run in which something was wrong.
        truth: the table.
        colours: by tracker.
    """
    by_function: dict[str, dict[str, Columns]] = {}
    for (function, tracker), rows in split(decisions, "function", "tracker").items():
        by_function.setdefault(function, {})[tracker] = rows
    wrong = list(events)
    for function, of_trackers in by_function.items():
        first = next(iter(of_trackers.values()))
        states = np.where(first["true_active"] > 0, _named(first["true_object"]), NOTHING)
        _send_lane(stream, (function, TRUTH), first["time_s"], states, TRUTH_COLOUR)
        for tracker, rows in of_trackers.items():
            own = [event for event in wrong if (event.function, event.tracker) == (function, tracker)]
            _send_lane(stream, (function, tracker), rows["time_s"], lane(rows, own), colours[tracker])
    for tracker in colours:
        _send_log(stream, tracker, [event for event in wrong if event.tracker == tracker])
    warned = {tracker: [own[tracker] for own in by_function.values() if tracker in own] for tracker in colours}
    for number, (tracker, rows_of) in enumerate(warned.items()):
        if rows_of:
            entity, radius = path(*WARNED, tracker), RING + WIDER * number
            send_rings(stream, entity, rows_of[0]["time_s"], _warned(rows_of), truth, colours[tracker], radius)


def lane(rows: Columns, events: Iterable[FunctionEvent]) -> Array:
    """Return what a tracker's lane says at each instant: the object that is warned of, what is wrong, or nothing."""
    time, active = rows["time_s"], rows["active"] > 0
    states = np.where(active, _named(rows["object"]), NOTHING)
    for event in events:
        until = event.until_s if event.word == "false" else event.time_s + event.wrong_s
        inside = (time >= event.time_s - 1e-9) & (time < until - 1e-9)
        if event.word in WRONG:
            states = np.where(inside & (active if event.word == "false" else ~active), event.word, states)
    return states


def lanes_view() -> rrb.StateTimelineView:
    """Return a view of the lanes of every function, one below the other."""
    return rrb.StateTimelineView(
        origin=path(LANES), name="Functions", time_view=rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
    )


def log_view() -> rrb.TextLogView:
    """Return a view of the events of all functions."""
    return rrb.TextLogView(origin=path(LOG), name="Missed, late, false, early")


def _named(objects: Array) -> Array:
    """Return the names of objects, with a text for tracks on no object."""
    names = objects.astype(str)
    return np.where(names == "", "no object", names)


def _send_lane(stream: Stream, place: tuple[str, ...], time: Array, states: Array, colour: str) -> None:
    change = np.append(True, states[1:] != states[:-1])
    entity = path(LANES, *place)
    stream.columns(entity, time[change], rr.StateChange.columns(state=states[change].tolist()))
    values = np.unique(states).tolist()
    colours = rgba_of(WRONG.get(value, colour) for value in values)
    visible = [value != NOTHING for value in values]
    stream.static(entity, rr.StateConfiguration(values=values, labels=values, colors=colours, visible=visible))


def _send_log(stream: Stream, tracker: str, events: Sequence[FunctionEvent]) -> None:
    ordered = sorted(events, key=lambda event: event.time_s)
    texts = [f"{tracker}: {e.function} {e.word} by {e.wrong_s:.2f} s, {e.object or 'no object'}" for e in ordered]
    warnings = [event.word in WRONG for event in ordered]
    stream.log(path(LOG, tracker), [event.time_s for event in ordered], texts, warnings)


def _warned(rows: Sequence[Columns]) -> Iterator[tuple[str, Array]]:
    """Yield the objects that functions are active about, with the times of it, s."""
    times = np.concatenate([of["time_s"][of["active"] > 0] for of in rows])
    objects = np.concatenate([of["object"][of["active"] > 0] for of in rows])
    for name in np.unique(objects.astype(str)):
        if name:
            yield str(name), np.unique(times[objects == name])
