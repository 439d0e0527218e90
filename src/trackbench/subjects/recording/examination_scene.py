"""An evidence run from above: truth, tracker and reference with their ellipses, and measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from trackbench.base.types import Array
from trackbench.document.palette import OBSERVER_COLOUR, TRACKER_COLOURS, TRUTH_COLOUR, sensor_colours
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.recording.shapes import send_ellipses, send_points
from trackbench.subjects.recording.stream import Stream, path, pixels, rgba

#: Colour of the tracker and of the reference, as in the report.
COLOURS = {"reference": TRACKER_COLOURS[5], "tracker": TRACKER_COLOURS[4]}
#: Of their paths, pixels: the tracker is drawn on top of the reference.
WIDTHS = {"reference": 1.5, "tracker": 0.5}


def frame(drive: str) -> tuple[str, ...]:
    """The entity that turns y down, as Rerun's 2D views have it, so that a left turn goes left."""
    return drive, "world", "frame"


def measurements(drive: str, sensor: str) -> tuple[str, ...]:
    """The entity of a sensor's measurements."""
    return drive, "world", "measurements", sensor


def sensors_of(evidence: Sequence[EvidenceRun]) -> dict[str, str]:
    """The colour of each sensor in all drives."""
    return sensor_colours(scan.sensor for run in evidence for scan in run.scans)


def send_scene(stream: Stream, run: EvidenceRun, colours: Mapping[str, str]) -> None:
    """Send all that is drawn in the fixed frame; ``colours`` are those of the sensors."""
    world = (run.drive, "world")
    stream.static(path(*frame(run.drive)), rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))
    _send_path(stream, (*world, "truth"), run.time, run.target[:2], TRUTH_COLOUR, 5.0)
    sensors = np.array([scan.sensor_pose[:2] for scan in run.scans]).T
    _send_path(stream, (*world, "sensors"), run.time, sensors, OBSERVER_COLOUR, 4.0)
    tracks = {
        "reference": (run.reference_mean, run.reference_covariance),
        "tracker": (run.mean, run.covariance),
    }
    for name, (mean, covariance) in tracks.items():
        known = np.isfinite(mean[:2]).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        time, at, p = run.time[known], mean[:2, known], covariance[:, :, known]
        _send_path(stream, (*world, name), time, at, COLOURS[name], 4.0, WIDTHS[name])
        send_ellipses(stream, path(*world, name, "covariance"), time, at, p, COLOURS[name], 15.0)
    for sensor, colour in colours.items():
        scans = [scan for scan in run.scans if scan.sensor == sensor and scan.valid]
        time = np.array([scan.time for scan in scans])
        at = np.array([SENSOR_MODELS[scan.kind].position(scan).mean for scan in scans]).reshape(-1, 2).T
        send_points(stream, path(*measurements(run.drive, sensor)), time, at, colour, 2.0, 10.0)


def _send_path(
    stream: Stream, place: tuple[str, ...], time: Array, position: Array, colour: str, size: float, width: float = 0.75
) -> None:
    """The position over time, and the whole path; narrow paths are on top."""
    send_points(stream, path(*place), time, position, colour, size, 20.0)
    line = rr.LineStrips2D([position.T], colors=rgba(colour), radii=pixels(width), draw_order=5.0 - width)
    stream.static(path(*place, "path"), line)
