"""An evidence run over time: applied and expected innovations, position errors and NEES."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from trackbench.doctor.evidence import EvidenceRun
from trackbench.doctor.run_errors import run_errors
from trackbench.metrics.consistency import mean_bounds
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.examination_scene import COLOURS
from trackbench.recording.stream import Stream, path, rgba
from trackbench.types import COMMON_STATE, Array

INNOVATION, ERROR, NEES = "innovation", "position_error", "nees"


def send_series(stream: Stream, run: EvidenceRun) -> None:
    """Send all lines of a run."""
    for one in run.innovations:
        for i, component in enumerate(one.components):
            place = (run.drive, INNOVATION, one.sensor, component)
            for name, side in (("2 sigma", 2.0), ("-2 sigma", -2.0)):
                limit = np.full(len(one.time), side * one.sigma[i])
                _line(stream, (*place, name), one.time, limit, BOUND_COLOUR, name)
            _line(stream, (*place, "expected"), one.time, one.expected[i], COLOURS["reference"], "expected", 3.0)
            _line(stream, (*place, "applied"), one.time, one.applied[i], COLOURS["tracker"], "applied")
    for name, of in run_errors(run).items():
        _line(stream, (run.drive, ERROR, name), run.time, of.position, COLOURS[name], name)
        _line(stream, (run.drive, NEES, name), run.time, of.nees, COLOURS[name], name)
        if name == "tracker":
            _line(
                stream, (run.drive, ERROR, "2 sigma"), run.time, of.two_sigma, BOUND_COLOUR, "2 sigma by its covariance"
            )
    for name, bound in zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True):
        line = np.full(len(run.time), float(bound))
        _line(stream, (run.drive, NEES, name), run.time, line, BOUND_COLOUR, "95 % bounds")


def _line(
    stream: Stream, place: tuple[str, ...], time: Array, values: Array, colour: str, name: str, width: float = 1.5
) -> None:
    finite = np.isfinite(values)
    entity = path(*place)
    # An empty row breaks the line where there is no value.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))
