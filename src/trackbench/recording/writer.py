"""Writes a run's recording, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rerun as rr

from trackbench.errors import InputError
from trackbench.palette import sensor_colours, tracker_colours
from trackbench.recording import layout, scene, series, text, views
from trackbench.recording.data import send_data
from trackbench.recording.stream import Stream
from trackbench.results import Result, write_bytes


def write(result: Result, path: Path) -> None:
    """Write one run as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, in seconds of simulated time; positions are in metres of the fixed frame.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """
    recording = new_recording(result.json()["scenario"]["name"])
    if not rr.is_enabled(recording):
        raise InputError("the environment variable RERUN switches recordings off; unset it", file=path)
    # To memory first: Rerun's own file sink waits for ever on a full disk.
    binary = rr.binary_stream(recording)
    send(recording, result)
    content = binary.read()
    recording.disconnect()
    write_bytes(path, content or b"")


def new_recording(name: str) -> rr.RecordingStream:
    """A recording of a scenario; the viewer keeps one layout for all of the same scenario."""
    return rr.RecordingStream(f"trackbench {name}")


def send(recording: rr.RecordingStream, result: Result) -> None:
    """Everything that is shown and kept of a run, and its layout."""
    summary, tables = result.json(), result.tables
    trackers = tracker_colours(tracker["name"] for tracker in summary["trackers"])
    sensors = sensor_colours(summary["sensors"])
    stream = Stream(recording)
    windows = views.windows(tables["truth"])
    recording.send_blueprint(layout.blueprint(summary, tables, windows))
    recording.send_recording_name(summary["scenario"]["name"])
    recording.send_property("trackbench", rr.AnyValues(**_properties(summary)))
    for name, document in (("ranking", text.ranking(summary)), ("about", text.about(summary))):
        stream.static(name, rr.TextDocument(document, media_type=rr.MediaType.MARKDOWN))
    scene.send_roads(stream, tables["roads"])
    views.send_scales(stream, windows)
    views.send_legends(stream, windows, trackers)
    scene.send_vehicles(stream, tables["truth"])
    scene.send_measurements(stream, tables["measurements"], sensors)
    slowest = max(1.0 / sensor["rate_hz"] for sensor in summary["sensors"].values())
    scene.send_estimates(stream, tables["estimates"], tables["truth"], trackers, slowest)
    series.send_all_runs(stream, tables["steps"], tables["nis"], trackers)
    series.send_recorded_run(stream, tables["estimates"], tables["recorded_nis"], tables["nis"], trackers)
    send_data(stream, result)


def _properties(summary: dict[str, Any]) -> dict[str, Any]:
    return {
        "scenario": summary["scenario"]["name"],
        "seed": summary["seed"],
        "runs": str(summary["runs"]),
        "recorded_run": summary["recorded_run"],
        "fingerprint": summary["fingerprint"],
        "versions": [f"{name} {version}" for name, version in summary["versions"].items()],
    }
