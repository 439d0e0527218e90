"""A drive of an examination seen from above: truth, tracker and reference with their ellipses, measurements."""

from __future__ import annotations

import numpy as np
import rerun as rr

from trackbench.doctor.exhibits import Exhibit
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.palette import OBSERVER_COLOUR, TRACKER_COLOURS, TRUTH_COLOUR, sensor_colours
from trackbench.recording.shapes import send_ellipses, send_points
from trackbench.recording.stream import Stream, path, pixels, rgba
from trackbench.types import Array

#: Colour of the tracker and of the reference, as in the report.
COLOURS = {"tracker": TRACKER_COLOURS[4], "reference": TRACKER_COLOURS[5]}


def frame(course: str) -> tuple[str, ...]:
    """The frame of the scene in which y is down, as Rerun's 2D views have it, so that a left turn goes left."""
    return course, "world", "frame"


def measurements(course: str, sensor: str) -> tuple[str, ...]:
    """Where a sensor's measurements lie."""
    return course, "world", "measurements", sensor


def send_scene(stream: Stream, exhibit: Exhibit) -> None:
    """Everything that lies in the fixed frame."""
    world = (exhibit.course, "world")
    stream.static(path(*frame(exhibit.course)), rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))
    _send_path(stream, (*world, "truth"), exhibit.time, exhibit.target[:2], TRUTH_COLOUR, 5.0)
    sensors = np.array([scan.sensor_pose[:2] for scan in exhibit.scans]).T
    _send_path(stream, (*world, "sensors"), exhibit.time, sensors, OBSERVER_COLOUR, 4.0)
    tracks = {
        "reference": (exhibit.reference_mean, exhibit.reference_covariance),
        "tracker": (exhibit.mean, exhibit.covariance),
    }
    for name, (mean, covariance) in tracks.items():
        known = np.isfinite(mean[:2]).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        time, at, p = exhibit.time[known], mean[:2, known], covariance[:, :, known]
        _send_path(stream, (*world, name), time, at, COLOURS[name], 4.0)
        entity, once = path(*world, name, "covariance"), np.ones(len(time), dtype=int)
        send_ellipses(stream, entity, time, once, at[0], at[1], (p[0, 0], p[0, 1], p[1, 1]), COLOURS[name], 15.0)
    _send_measurements(stream, exhibit)


def _send_path(stream: Stream, place: tuple[str, ...], time: Array, position: Array, colour: str, size: float) -> None:
    """Where something is, and the whole of its way."""
    send_points(stream, path(*place), time, np.ones(len(time), dtype=int), position[0], position[1], colour, size, 20.0)
    way = rr.LineStrips2D([position.T], colors=rgba(colour), radii=pixels(0.75), draw_order=5.0)
    stream.static(path(*place, "way"), way)


def _send_measurements(stream: Stream, exhibit: Exhibit) -> None:
    for sensor, colour in sensor_colours(dict.fromkeys(scan.sensor for scan in exhibit.scans)).items():
        scans = [scan for scan in exhibit.scans if scan.sensor == sensor and scan.valid]
        x, y = np.array([SENSOR_MODELS[scan.kind].position(scan).mean for scan in scans]).reshape(-1, 2).T
        time, entity = np.array([scan.time for scan in scans]), path(*measurements(exhibit.course, sensor))
        send_points(stream, entity, time, np.ones(len(time), dtype=int), x, y, colour, 2.0, 10.0)
