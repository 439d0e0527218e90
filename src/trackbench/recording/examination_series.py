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
from trackbench.types import COMMON_STATE, Array

INNOVATION, ERROR, NEES = "innovation", "position_error", "nees"


def send_series(stream: Stream, run: EvidenceRun) -> None:
    """Send all lines of a run."""

    def line(place: tuple[str, ...], time: Array, values: Array, name: str, colour: str, width: float = 1.5) -> None:
        send_line(stream, path(run.drive, *place), time, values, name, colour, width)

    for one in run.innovations:
        for i, component in enumerate(one.components):
            place = (INNOVATION, one.sensor, component)
            for name, side in (("2 sigma", 2.0), ("-2 sigma", -2.0)):
                line((*place, name), one.time, np.full(len(one.time), side * one.sigma[i]), name, BOUND_COLOUR)
            line((*place, "expected"), one.time, one.expected[i], "expected", COLOURS["reference"], 3.0)
            line((*place, "applied"), one.time, one.applied[i], "applied", COLOURS["tracker"])
    for name, of in run_errors(run).items():
        line((ERROR, name), run.time, of.position, name, COLOURS[name])
        line((NEES, name), run.time, of.nees, name, COLOURS[name])
        if name == "tracker":
            line((ERROR, "2 sigma"), run.time, of.two_sigma, "2 sigma by its covariance", BOUND_COLOUR)
    for name, bound in zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True):
        line((NEES, name), run.time, np.full(len(run.time), float(bound)), "95 % bounds", BOUND_COLOUR)
