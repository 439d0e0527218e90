"""A replay as a Rerun recording: a tab for each scene with its charts, and the text beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from trackbench.document.replay import Replay, ReplayPath, ReplayScene
from trackbench.subjects.recording.layout import beside, played
from trackbench.subjects.recording.legend import send_legend
from trackbench.subjects.recording.plots import chart_tabs, send_chart
from trackbench.subjects.recording.stream import Stream, path, pixels, rgba, send_ellipses, send_points
from trackbench.subjects.recording.views import from_above
from trackbench.subjects.recording.writer import write_recording

#: How long a measurement is shown, s.
RECENT_S = 0.5


def write_replay(replay: Replay, file: Path) -> None:
    """Write a replay as a Rerun recording (.rrd) with its layout, which plays in a loop.

    The timeline is ``sim_time``, in s; positions are in m in the fixed frame. The entities of a scene are below its
    name.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """

    def send(recording: rr.RecordingStream) -> None:
        scenes = rrb.Tabs(*(_scene_tab(scene) for scene in replay.scenes), active_tab=0)
        text = rrb.TextDocumentView(origin=replay.title.lower(), name=replay.title)
        recording.send_blueprint(played(beside(scenes, list(replay.legend), text)))
        recording.send_recording_name(replay.name)
        stream = Stream(recording)
        stream.markdown(replay.title.lower(), replay.text)
        send_legend(stream, list(replay.legend))
        for scene in replay.scenes:
            _send_scene(stream, scene)
            for chart in (*scene.beside, *scene.below):
                send_chart(stream, chart)

    write_recording(file, replay.kind, send)


def _scene_tab(scene: ReplayScene) -> rrb.Container:
    (left, right), (low, high) = scene.x_range, scene.y_range
    view = from_above(
        path(*_frame(scene)),
        "From above",
        [f"+ {path(scene.name, 'world')}/**"],
        ((left, right), (-high, -low)),
        {path(*_measurements(scene, of.sensor)): RECENT_S for of in scene.measurements if len(of.time)},
    )
    charts = rrb.Vertical(*(chart_tabs([chart]) for chart in scene.beside))
    above = rrb.Horizontal(view, charts, column_shares=[3, 2])
    below = rrb.Grid(*(chart_tabs([chart]) for chart in scene.below), grid_columns=min(3, max(1, len(scene.below))))
    return rrb.Vertical(above, below, row_shares=[1, 1], name=scene.name)


def _send_scene(stream: Stream, scene: ReplayScene) -> None:
    stream.static(path(*_frame(scene)), rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))
    for track in scene.paths:
        _send_path(stream, (scene.name, "world", track.name), track)
    for of in scene.measurements:
        send_points(stream, path(*_measurements(scene, of.sensor)), of.time, of.position, of.colour, 2.0, 10.0)


def _send_path(stream: Stream, place: tuple[str, ...], track: ReplayPath) -> None:
    send_points(stream, path(*place), track.time, track.position, track.colour, track.dot, 20.0)
    line = rr.LineStrips2D(
        [track.position.T], colors=rgba(track.colour), radii=pixels(track.width), draw_order=5.0 - track.width
    )
    stream.static(path(*place, "path"), line)
    if track.covariance is not None:
        entity = path(*place, "covariance")
        send_ellipses(stream, entity, track.time, track.position, track.covariance, track.colour, 15.0)


def _frame(scene: ReplayScene) -> tuple[str, ...]:
    """The entity that turns y down, as Rerun's 2D views have it, so that a left turn goes left."""
    return scene.name, "world", "frame"


def _measurements(scene: ReplayScene, sensor: str) -> tuple[str, ...]:
    return scene.name, "world", "measurements", sensor
