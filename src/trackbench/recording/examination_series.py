"""A drive of an examination over time: innovations as taken and as sound, position errors, NEES."""

from __future__ import annotations

import numpy as np

from trackbench.doctor.exhibits import Exhibit
from trackbench.doctor.measures import measures
from trackbench.metrics.consistency import mean_bounds
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.examination_scene import COLOURS
from trackbench.recording.shapes import send_line
from trackbench.recording.stream import Stream, path
from trackbench.types import COMMON_STATE

INNOVATION, ERROR, NEES = "innovation", "position_error", "nees"


def send_series(stream: Stream, exhibit: Exhibit) -> None:
    """All lines of a drive."""
    for one in exhibit.innovations:
        for i, component in enumerate(one.components):
            place = (exhibit.course, INNOVATION, one.sensor, component)
            for name, side in (("2 sigma", 2.0), ("-2 sigma", -2.0)):
                limit = np.full(len(one.time), side * one.sigma[i])
                send_line(stream, path(*place, name), one.time, limit, name, BOUND_COLOUR)
            send_line(stream, path(*place, "sound"), one.time, one.sound[i], "sound", COLOURS["reference"], 3.0)
            send_line(stream, path(*place, "taken"), one.time, one.taken[i], "as taken", COLOURS["tracker"])
    for name, of in measures(exhibit).items():
        send_line(stream, path(exhibit.course, ERROR, name), exhibit.time, of.error, name, COLOURS[name])
        send_line(stream, path(exhibit.course, NEES, name), exhibit.time, of.nees, name, COLOURS[name])
        if name == "tracker":
            claimed = path(exhibit.course, ERROR, "claimed")
            send_line(stream, claimed, exhibit.time, of.claimed, "its own 2 sigma", BOUND_COLOUR)
    for name, bound in zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True):
        line = np.full(len(exhibit.time), float(bound))
        send_line(stream, path(exhibit.course, NEES, name), exhibit.time, line, "95 % bounds", BOUND_COLOUR)
