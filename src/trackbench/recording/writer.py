"""Writes a run's recording, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import rerun as rr

from trackbench.errors import InputError
from trackbench.palette import sensor_colours
from trackbench.recording import layout, scene, series, views
from trackbench.recording.contents import Contents, contents_of
from trackbench.recording.data import send_data
from trackbench.recording.stream import Stream
from trackbench.results import Result, Summary, write_bytes


def write(result: Result, path: Path, colours: Mapping[str, str] | None = None) -> None:
    """Write one run as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, in seconds of simulated time; positions are in metres of the fixed frame.

    Args:
        result: of the run.
        path: the file.
        colours: of its trackers, by name, where they are those of several runs; "#RRGGBB".

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """
    write_recording(path, application(result.name), lambda recording: send(recording, result, colours))


def write_overlay(contents: Contents, path: Path) -> None:
    """Write several runs that are laid over each other, to be looked at: their numbers are not in the file.

    Raises:
        As :func:`write`.
    """
    write_recording(path, application(contents.name), lambda recording: draw(recording, contents))


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


def send(recording: rr.RecordingStream, result: Result, colours: Mapping[str, str] | None = None) -> None:
    """Everything that is shown and kept of a run, and its layout."""
    draw(recording, contents_of(result, colours))
    recording.send_property("trackbench", _properties(result.summary))
    send_data(Stream(recording), result)


def draw(recording: rr.RecordingStream, contents: Contents) -> None:
    """Everything that is shown, and its layout."""
    stream, tables, colours = Stream(recording), contents.tables, contents.colours
    windows = views.windows(tables.truth)
    recording.send_blueprint(layout.blueprint(contents, windows))
    recording.send_recording_name(contents.name)
    stream.markdown("ranking", contents.ranking)
    stream.markdown("about", contents.about)
    scene.send_roads(stream, tables.roads)
    views.send_scales(stream, windows)
    views.send_legends(stream, windows, colours)
    scene.send_vehicles(stream, tables.truth)
    scene.send_measurements(stream, tables.measurements, sensor_colours(contents.sensors))
    scene.send_estimates(stream, tables.estimates, tables.truth, colours, contents.hold)
    series.send_all_runs(stream, tables.steps, tables.nis, colours, contents.reference)
    series.send_recorded_run(stream, tables.estimates, tables.recorded_nis, tables.nis, colours)


def _properties(summary: Summary) -> rr.AnyValues:
    return rr.AnyValues(
        scenario=summary.scenario.name,
        seed=summary.seed,
        runs=str(summary.runs),
        recorded_run=summary.recorded_run,
        fingerprint=summary.fingerprint,
        versions=[f"{name} {version}" for name, version in summary.versions.items()],
    )
