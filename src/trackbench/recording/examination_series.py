"""An evidence run over time: applied and expected innovations, position errors and NEES."""

from __future__ import annotations

import numpy as np

from trackbench.doctor.evidence import EvidenceRun
from trackbench.doctor.run_errors import run_errors
from trackbench.metrics.consistency import mean_bounds
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.examination_scene import COLOURS
from trackbench.recording.shapes import send_line
from trackbench.recording.stream import Stream, path
from trackbench.types import COMMON_STATE

INNOVATION, ERROR, NEES = "innovation", "position_error", "nees"


def send_series(stream: Stream, run: EvidenceRun) -> None:
    """Send all lines of a run."""
    for one in run.innovations:
        for i, component in enumerate(one.components):
            place = (run.drive, INNOVATION, one.sensor, component)
            for name, side in (("2 sigma", 2.0), ("-2 sigma", -2.0)):
                limit = np.full(len(one.time), side * one.sigma[i])
                send_line(stream, path(*place, name), one.time, limit, name, BOUND_COLOUR)
            send_line(
                stream, path(*place, "expected"), one.time, one.expected[i], "expected", COLOURS["reference"], 3.0
            )
            send_line(stream, path(*place, "applied"), one.time, one.applied[i], "applied", COLOURS["tracker"])
    for name, of in run_errors(run).items():
        send_line(stream, path(run.drive, ERROR, name), run.time, of.position, name, COLOURS[name])
        send_line(stream, path(run.drive, NEES, name), run.time, of.nees, name, COLOURS[name])
        if name == "tracker":
            entity = path(run.drive, ERROR, "2 sigma")
            send_line(stream, entity, run.time, of.two_sigma, "2 sigma by its covariance", BOUND_COLOUR)
    for name, bound in zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True):
        line = np.full(len(run.time), float(bound))
        send_line(stream, path(run.drive, NEES, name), run.time, line, "95 % bounds", BOUND_COLOUR)
