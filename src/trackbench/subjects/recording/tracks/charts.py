"""GOSPA and its parts over all runs, and how many tracks and due objects there are in the recorded one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackbench.base.types import DUE, Array
from trackbench.document.palette import BOUND_COLOUR
from trackbench.document.replay import Chart, ChartLine
from trackbench.metrics.track_events import instants
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.contents import Contents

PARTS = {
    "gospa_m": "GOSPA",
    "gospa_localisation_m": "Localisation part",
    "gospa_missed_m": "Missed part",
    "gospa_false_m": "False part",
}


def charts_of_tracks(contents: Contents) -> list[Chart]:
    """Every chart of a recording."""
    steps = {tracker: rows for (tracker,), rows in split(contents.tables.steps, "tracker").items()}
    parts = [
        Chart(("all_runs", name), title, "m", _lines(steps, name, contents.colours)) for name, title in PARTS.items()
    ]
    return [*parts, _numbers(contents)]


def _numbers(contents: Contents) -> Chart:
    """How many confirmed tracks each tracker has, and how many objects are due."""
    time = instants(contents.tables)
    tracks = {tracker: rows["time_s"] for (tracker,), rows in split(contents.tables.tracks, "tracker").items()}
    lines = tuple(
        ChartLine((tracker,), tracker, colour, time, _count(tracks.get(tracker, np.empty(0)), time))
        for tracker, colour in contents.colours.items()
    )
    due = contents.tables.due
    when = due["time_s"].to_numpy()[due["status"].to_numpy() == DUE] if due.num_rows else np.empty(0)
    bound = ChartLine(("due",), "due objects", BOUND_COLOUR, time, _count(when, time), 2.0)
    return Chart(("recorded_run", "tracks"), "Tracks, and objects due", "", lines, (bound,))


def _count(when: Array, time: Array) -> Array:
    return np.bincount(np.searchsorted(time, when - 1e-9), minlength=len(time)).astype(float)


def _lines(rows: Mapping[str, Columns], name: str, colours: Mapping[str, str]) -> tuple[ChartLine, ...]:
    return tuple(
        ChartLine((tracker,), tracker, colour, rows[tracker]["time_s"], rows[tracker][name])
        for tracker, colour in colours.items()
        if tracker in rows
    )
