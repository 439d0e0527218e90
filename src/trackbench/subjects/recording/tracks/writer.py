"""Draws a run whose identities are hidden."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow.compute as pc
import rerun as rr

from trackbench.document.palette import sensor_colours
from trackbench.metrics.track_events import TrackEvent, events_of, instants
from trackbench.results import Result
from trackbench.subjects.recording import legend, scene, views
from trackbench.subjects.recording.charts import send_chart
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.stream import Stream, path
from trackbench.subjects.recording.tracks.charts import charts_of_tracks
from trackbench.subjects.recording.tracks.layout import EVENTS, blueprint
from trackbench.subjects.recording.tracks.legend import track_entries
from trackbench.subjects.recording.tracks.scene import (
    MARKED,
    send_associations,
    send_gates,
    send_marks,
    send_misses,
    send_tracks,
)
from trackbench.subjects.recording.trails import send_true_trails


def draw_tracks(recording: rr.RecordingStream, contents: Contents, result: Result, focus: Focus) -> None:
    """Everything that is shown, and its layout."""
    stream, tables = Stream(recording), contents.tables
    wide, charts = views.wide_window(tables.truth), charts_of_tracks(contents)
    recording.send_blueprint(blueprint(contents, charts, wide, focus))
    recording.send_recording_name(contents.name)
    stream.markdown("ranking", contents.ranking)
    stream.markdown("about", contents.about)
    scene.send_roads(stream, tables.roads)
    views.send_scales(stream, wide, contents.vehicles)
    legend.send_legend(stream, track_entries(contents.colours, list(contents.sensors)))
    scene.send_vehicles(stream, tables.truth, wide.metres_per_pixel, names_above=True)
    scene.send_measurements(stream, tables.measurements, sensor_colours(contents.sensors))
    send_true_trails(stream, tables.truth, contents.hold)
    time = instants(tables)
    for tracker in contents.colours:
        own = {
            name: table.filter(pc.equal(table["tracker"], tracker))
            for name in ("tracks", "taken", "gates", "objects")
            if name in tables and (table := tables[name]).num_rows
        }
        if "tracks" in own:
            send_tracks(stream, tracker, own["tracks"], time)
        if "objects" in own:
            send_misses(stream, tracker, own["objects"], tables.truth, time)
        if "taken" in own and "tracks" in own:
            send_associations(stream, tracker, own["taken"], own["tracks"], tables.measurements, time)
        if "gates" in own:
            send_gates(stream, tracker, own["gates"], time)
        _events(stream, result, tracker, wide.metres_per_pixel)
    for chart in charts:
        send_chart(stream, chart)


def _events(stream: Stream, result: Result, tracker: str, metres_per_pixel: float) -> None:
    """On the map, and as a log."""
    found = sorted(events_of(result, tracker, result.summary.recorded_run), key=lambda event: event.time_s)
    send_marks(stream, tracker, found, metres_per_pixel)
    if found:
        levels = ["WARN" if event.kind in MARKED else "INFO" for event in found]
        time = np.array([event.time_s for event in found])
        stream.columns(
            path(EVENTS, tracker),
            time,
            rr.TextLog.columns(text=[f"{tracker}: {', '.join(_parts(event))}" for event in found], level=levels),
        )


def _parts(event: TrackEvent) -> Iterator[str]:
    yield event.kind
    if event.object:
        yield f"vehicle {event.object}"
    if event.track is not None:
        yield f"track {event.track}"
    yield event.reason
    if event.cost_m2:
        yield f"{event.cost_m2:.3g} m²"
