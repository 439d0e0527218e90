"""The writing of a run's or a replay's recording, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from trackbench.base.errors import InputError
from trackbench.document import Document, Paragraph
from trackbench.document.markdown import to_markdown
from trackbench.document.palette import sensor_colours
from trackbench.document.replay import Replay, ReplayScene
from trackbench.metrics.function_events import drawn_instants, events_of
from trackbench.results import Result, write_bytes
from trackbench.results.columns import split
from trackbench.subjects.recording import functions, layout, scene, tracks, views
from trackbench.subjects.recording.contents import (
    Contents,
    contents_of,
    description_text,
    ranking_text,
    rows_of_trackers,
)
from trackbench.subjects.recording.data import send_data
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.layout import plot, send_chart, send_legend, with_legend, with_time_panel
from trackbench.subjects.recording.moments import moments_table
from trackbench.subjects.recording.series import charts_of, charts_of_tracks
from trackbench.subjects.recording.stream import Stream, outlines, path, pixels, rgba, send_points
from trackbench.subjects.recording.views import RECENT_S, from_above


def write(result: Result, path: Path, focus: Focus = layout.WHOLE) -> None:
    """Write a run as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, in seconds of simulated time; positions are in metres of the fixed frame.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """
    write_recording(path, application(result.name), lambda recording: send(recording, result, focus))


def write_recording(path: Path, name: str, send_all: Callable[[rr.RecordingStream], None]) -> None:
    """Write the recording that ``send_all`` sends, with the errors of :func:`write`.

    The viewer keeps one layout for all recordings of a ``name``.
    """
    recording = rr.RecordingStream(name)
    if not rr.is_enabled(recording):
        raise InputError("the environment variable RERUN switches recordings off; unset it", file=path)
    # Rerun's own file sink waits for ever on a full disk, so that the recording goes to memory first.
    binary = rr.binary_stream(recording)
    send_all(recording)
    content = binary.read()
    recording.disconnect()
    write_bytes(path, content or b"")


def application(scenario: str) -> str:
    """Return the name under which the viewer keeps the layout of a scenario's recordings."""
    return f"trackbench {scenario}"


def send(recording: rr.RecordingStream, result: Result, focus: Focus = layout.WHOLE) -> None:
    """Send all drawings and data of a run, and its layout."""
    contents = contents_of(result)
    stream, tables, colours = Stream(recording), contents.scene, contents.colours
    wide = views.wide_window(contents.tables.truth)
    if contents.hidden:
        charts = charts_of_tracks(contents)
        blueprint = layout.track_blueprint(contents, charts, wide, focus)
    else:
        parts = charts_of(contents)
        charts = [chart for group in (parts.all_runs, parts.recorded, *parts.vehicles.values()) for chart in group.all]
        blueprint = layout.blueprint(contents, parts, wide, focus)
    recording.send_blueprint(blueprint)
    recording.send_recording_name(result.name)
    properties = {name: getattr(result.summary, name) for name in ("seed", "recorded_run", "fingerprint", "engine")}
    recording.send_property("trackbench", rr.AnyValues(scenario=result.summary.scenario.name, **properties))
    stream.markdown("ranking", ranking_text(result))
    stream.markdown("about", description_text(contents))
    scene.send_roads(stream, tables.roads)
    views.send_scales(stream, wide, contents.vehicles)
    layout.send_legend(stream, layout.entries_of(contents))
    scene.send_vehicles(stream, tables.truth, wide.metres_per_pixel)
    scene.send_measurements(stream, tables.measurements, sensor_colours(contents.sensors))
    scene.send_true_trail(stream, tables.truth)
    if contents.hidden:
        _send_hidden(stream, contents)
        stream.markdown(layout.COSTS, costs(result, colours))
    else:
        estimates = split(tables.if_there("estimates"), "tracker")
        time = np.unique(np.concatenate([rows["time_s"] for rows in estimates.values()] or [np.empty(0)]))
        for (tracker,), rows in estimates.items():
            tracks.send_tracks(stream, tracker, rows, time, colours[tracker])
    if contents.mapped:
        views.send_maps(stream, tables, contents.mapped)
    for chart in charts:
        send_chart(stream, chart)
    functions.send_functions(stream, contents.decisions, contents.function_events, colours)
    send_data(stream, result, contents.stored)


def _send_hidden(stream: Stream, contents: Contents) -> None:
    result, tables, time = contents.result, contents.scene, drawn_instants(contents.scene)
    for (tracker,), rows in split(tables.tracks, "tracker").items():
        tracks.send_tracks(stream, tracker, rows, time)
    for (tracker,), rows in split(tables.if_there("gates"), "tracker").items():
        tracks.send_gates(stream, tracker, rows, time)
    for tracker in contents.colours:
        names = ("taken", "tracks", "objects")
        taken, own_tracks, objects = (rows_of_trackers(tables.if_there(name), [tracker]) for name in names)
        if objects.num_rows:
            tracks.send_misses(stream, tracker, objects, tables.truth, time)
        if taken.num_rows and own_tracks.num_rows:
            tracks.send_associations(stream, tracker, taken, own_tracks, tables.measurements, time)
        events = sorted(events_of(result, tracker, result.summary.recorded_run), key=lambda event: event.time_s)
        tracks.send_marks(stream, tracker, events)


#: Largest number of rows in the table of events.
MOST_EVENTS = 40


def costs(result: Result, trackers: Collection[str]) -> str:
    """Return the events with a cost in the recorded run as Markdown, the costliest first, track starts last."""
    events = [event for event in events_of(result, run=result.summary.recorded_run) if event.tracker in trackers]
    costly = [event for event in events if event.cost_m2][:MOST_EVENTS]
    parts = [moments_table(costly)] if costly else [Paragraph("None.")]
    return to_markdown(Document("recording", "Events by cost", tuple(parts)))


#: Entity whose y axis points down, as in Rerun's 2D views, so that a left turn goes left.
FRAME = "frame"


def write_replay(replay: Replay, file: Path) -> None:
    """Write a replay as a Rerun recording (.rrd) with its layout, which plays in a loop.

    The timeline is ``sim_time``, in s; positions are in m in the fixed frame. The entities of a scene are below its
    name. Raises the errors of :func:`write`.
    """

    def send(recording: rr.RecordingStream) -> None:
        scenes = rrb.Tabs(*(_scene_tab(part) for part in replay.scenes), active_tab=0)
        text = rrb.TextDocumentView(origin=replay.title.lower(), name=replay.title)
        recording.send_blueprint(with_time_panel(with_legend(scenes, list(replay.legend), text), "playing"))
        recording.send_recording_name(replay.name)
        stream = Stream(recording)
        stream.markdown(replay.title.lower(), replay.text)
        send_legend(stream, list(replay.legend))
        for part in replay.scenes:
            _send_scene(stream, part)
            for chart in (*part.beside, *part.below):
                send_chart(stream, chart)

    write_recording(file, replay.kind, send)


def _scene_tab(scene: ReplayScene) -> rrb.Container:
    (left, right), (low, high) = scene.x_range, scene.y_range
    view = from_above(
        path(scene.name, "world", FRAME),
        "From above",
        [f"+ {path(scene.name, 'world')}/**"],
        ((left, right), (-high, -low)),
        {path(scene.name, "world", "measurements", m.sensor): RECENT_S for m in scene.measurements if len(m.time)},
    )
    charts = rrb.Vertical(*map(plot, scene.beside))
    above = rrb.Horizontal(view, charts, column_shares=[3, 2])
    below = rrb.Grid(*map(plot, scene.below), grid_columns=min(3, max(1, len(scene.below))))
    return rrb.Vertical(above, below, row_shares=[1, 1], name=scene.name)


def _send_scene(stream: Stream, scene: ReplayScene) -> None:
    world = (scene.name, "world")
    stream.turn_y_down(path(*world, FRAME))
    for track in scene.paths:
        place = (*world, track.name)
        send_points(stream, path(*place), track.time, track.position, track.colour, track.dot, 20.0)
        line = rr.LineStrips2D(
            [track.position.T], colors=rgba(track.colour), radii=pixels(track.width), draw_order=5.0 - track.width
        )
        stream.static(path(*place, "path"), line)
        if track.covariance is not None:
            (p_00, p_01), (_, p_11) = track.covariance
            ellipses = rr.LineStrips2D.columns(strips=outlines(track.position.T, p_00, p_01, p_11))
            thin = rr.LineStrips2D.from_fields(colors=rgba(track.colour), radii=pixels(0.75), draw_order=15.0)
            stream.draw(path(*place, "covariance"), track.time, thin, ellipses)
    for item in scene.measurements:
        entity = path(*world, "measurements", item.sensor)
        send_points(stream, entity, item.time, item.position, item.colour, 2.0, 10.0)
