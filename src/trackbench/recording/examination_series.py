"""A drive of an examination over time: innovations as taken and as sound, position errors, NEES."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from trackbench.doctor.exhibits import Exhibit
from trackbench.doctor.measures import measures
from trackbench.metrics.consistency import mean_bounds
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.examination_scene import COLOURS
from trackbench.recording.stream import Stream, path, rgba
from trackbench.types import COMMON_STATE, Array

INNOVATION, ERROR, NEES = "innovation", "position_error", "nees"


def send_series(stream: Stream, exhibit: Exhibit) -> None:
    """All lines of a drive."""
    for one in exhibit.innovations:
        for i, component in enumerate(one.components):
            place = (exhibit.course, INNOVATION, one.sensor, component)
            for name, side in (("2 sigma", 2.0), ("-2 sigma", -2.0)):
                limit = np.full(len(one.time), side * one.sigma[i])
                _line(stream, (*place, name), one.time, limit, BOUND_COLOUR, name)
            _line(stream, (*place, "sound"), one.time, one.sound[i], COLOURS["reference"], "sound", 3.0)
            _line(stream, (*place, "taken"), one.time, one.taken[i], COLOURS["tracker"], "as taken")
    for name, of in measures(exhibit).items():
        _line(stream, (exhibit.course, ERROR, name), exhibit.time, of.error, COLOURS[name], name)
        _line(stream, (exhibit.course, NEES, name), exhibit.time, of.nees, COLOURS[name], name)
        if name == "tracker":
            _line(stream, (exhibit.course, ERROR, "claimed"), exhibit.time, of.claimed, BOUND_COLOUR, "its own 2 sigma")
    for name, bound in zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True):
        line = np.full(len(exhibit.time), float(bound))
        _line(stream, (exhibit.course, NEES, name), exhibit.time, line, BOUND_COLOUR, "95 % bounds")


def _line(
    stream: Stream, place: tuple[str, ...], time: Array, values: Array, colour: str, name: str, width: float = 1.5
) -> None:
    finite = np.isfinite(values)
    entity = path(*place)
    # An empty row breaks the line where there is no value.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))
