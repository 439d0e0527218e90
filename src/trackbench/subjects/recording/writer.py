"""Writes a run's recording, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from trackbench.base.errors import InputError
from trackbench.document.palette import sensor_colours
from trackbench.results import Result, Summary, write_bytes
from trackbench.subjects.recording import layout, legend, scene, views
from trackbench.subjects.recording.charts import send_chart
from trackbench.subjects.recording.contents import Contents, contents_of
from trackbench.subjects.recording.data import send_data
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.series import charts_of
from trackbench.subjects.recording.stream import Stream
from trackbench.subjects.recording.tracks.charts import charts_of_tracks
from trackbench.subjects.recording.tracks.layout import blueprint as track_blueprint
from trackbench.subjects.recording.tracks.writer import draw_tracks
from trackbench.subjects.recording.trails import send_trails


def write(result: Result, path: Path, colours: Mapping[str, str] | None = None, focus: Focus = layout.WHOLE) -> None:
    """Write one run as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, in seconds of simulated time; positions are in metres of the fixed frame.

    Args:
        result: of the run.
        path: the file.
        colours: of its trackers, by name, where they are those of several runs; "#RRGGBB".
        focus: where it opens.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """
    write_recording(path, application(result.name), lambda recording: send(recording, result, colours, focus))


def reopened(file: Path, result: Result, path: Path, focus: Focus) -> None:
    """Write a copy of a run's recording that opens elsewhere.

    Args:
        file: the recording.
        result: what was read from it.
        path: the copy.
        focus: where it opens.

    Raises:
        As :func:`write`.
    """

    def send_all(recording: rr.RecordingStream) -> None:
        recording.send_blueprint(_blueprint(contents_of(result), result, focus))
        recording.send_chunks(RrdReader(file).stream())

    write_recording(path, application(result.name), send_all)


def write_overlay(contents: Contents, path: Path, focus: Focus) -> None:
    """Write several runs that are laid over each other, to be looked at: their numbers are not in the file.

    Raises:
        As :func:`write`.
    """
    write_recording(path, application(contents.name), lambda recording: draw(recording, contents, focus))


def write_recording(path: Path, name: str, send_all: Callable[[rr.RecordingStream], None]) -> None:
    """Write what a function sends.

    Args:
        path: the file.
        name: the viewer keeps one layout for all recordings of the same name.
        send_all: gets the recording.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """
    recording = rr.RecordingStream(name)
    if not rr.is_enabled(recording):
        raise InputError("the environment variable RERUN switches recordings off; unset it", file=path)
    # To memory first: Rerun's own file sink waits for ever on a full disk.
    binary = rr.binary_stream(recording)
    send_all(recording)
    content = binary.read()
    recording.disconnect()
    write_bytes(path, content or b"")


def application(scenario: str) -> str:
    """The name under which the viewer keeps the layout of a scenario's recordings."""
    return f"trackbench {scenario}"


def send(
    recording: rr.RecordingStream,
    result: Result,
    colours: Mapping[str, str] | None = None,
    focus: Focus = layout.WHOLE,
) -> None:
    """Everything that is shown and kept of a run, and its layout."""
    contents = contents_of(result, colours)
    if result.summary.identities == "known":
        draw(recording, contents, focus)
    else:
        draw_tracks(recording, contents, result, focus)
    recording.send_property("trackbench", _properties(result.summary))
    send_data(Stream(recording), result)


def draw(recording: rr.RecordingStream, contents: Contents, focus: Focus = layout.WHOLE) -> None:
    """Everything that is shown, and its layout."""
    stream, tables, colours = Stream(recording), contents.tables, contents.colours
    wide, charts = views.wide_window(tables.truth), charts_of(contents)
    recording.send_blueprint(layout.blueprint(contents, charts, wide, focus))
    recording.send_recording_name(contents.name)
    stream.markdown("ranking", contents.ranking)
    stream.markdown("about", contents.about)
    scene.send_roads(stream, tables.roads)
    views.send_scales(stream, wide, contents.vehicles)
    legend.send_legend(stream, legend.entries(colours, list(contents.sensors)))
    scene.send_vehicles(stream, tables.truth, wide.metres_per_pixel)
    scene.send_measurements(stream, tables.measurements, sensor_colours(contents.sensors))
    scene.send_estimates(stream, tables.estimates, tables.truth, colours, contents.hold)
    send_trails(stream, tables.truth, tables.estimates, colours, contents.hold)
    for each in (charts.all_runs, charts.recorded, *charts.vehicles.values()):
        for chart in each.all:
            send_chart(stream, chart)


def _blueprint(contents: Contents, result: Result, focus: Focus) -> rrb.Blueprint:
    wide = views.wide_window(contents.tables.truth)
    if result.summary.identities == "known":
        return layout.blueprint(contents, charts_of(contents), wide, focus)
    return track_blueprint(contents, charts_of_tracks(contents), wide, focus)


def _properties(summary: Summary) -> rr.AnyValues:
    return rr.AnyValues(
        scenario=summary.scenario.name,
        seed=summary.seed,
        runs=str(summary.runs),
        recorded_run=summary.recorded_run,
        fingerprint=summary.fingerprint,
        versions=[f"{name} {version}" for name, version in summary.versions.items()],
        engine=summary.engine,
    )
