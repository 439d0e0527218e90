"""An evidence run over time: applied and expected innovations, position errors and NEES."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import COMMON_STATE, Array
from trackbench.document.palette import BOUND_COLOUR
from trackbench.metrics.consistency import mean_bounds
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.run_errors import run_errors
from trackbench.subjects.recording.charts import Chart, ChartLine
from trackbench.subjects.recording.examination_scene import COLOURS

#: The tracker is drawn on top of the reference, which is wider.
REFERENCE_WIDTH = 3.0


def innovation_charts(run: EvidenceRun) -> list[Chart]:
    """A chart for each component of each sensor's innovation, those of the findings first."""
    named = [finding.sensor for finding in run.findings]
    charts = []
    for one in sorted(run.innovations, key=lambda one: one.sensor not in named):
        units = SENSOR_MODELS[one.kind].units
        for i, component in enumerate(one.components):
            lines = (
                _line("reference", one.time, one.expected[i], "expected"),
                _line("tracker", one.time, one.applied[i], "applied"),
            )
            limits = {"high": 2.0 * one.sigma[i], "low": -2.0 * one.sigma[i]}
            bounds = tuple(_bound(side, one.time, limit, "2 sigma") for side, limit in limits.items())
            place = (run.drive, "innovation", one.sensor, component)
            name = f"Innovation of {one.sensor}, {component.replace('_', ' ')}"
            charts.append(Chart(place, name, units[i], lines, bounds, signed=True))
    return charts


def error_charts(run: EvidenceRun) -> list[Chart]:
    """The position error and the NEES of the tracker and of the reference."""
    found = run_errors(run)
    errors = tuple(_line(name, run.time, found[name].position, name) for name in COLOURS)
    two_sigma = ChartLine(
        ("bounds", "two_sigma"), "2 sigma by its covariance", BOUND_COLOUR, run.time, found["tracker"].two_sigma
    )
    nees = tuple(_line(name, run.time, found[name].nees, name) for name in COLOURS)
    limits = zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True)
    bounds = tuple(_bound(side, run.time, float(limit), "95 % bounds") for side, limit in limits)
    return [
        Chart((run.drive, "position_error"), "Position error", "m", errors, (two_sigma,)),
        Chart((run.drive, "nees"), "NEES", "", nees, bounds),
    ]


def _line(of: str, time: Array, values: Array, name: str) -> ChartLine:
    return ChartLine((of,), name, COLOURS[of], time, values, REFERENCE_WIDTH if of == "reference" else 1.5)


def _bound(side: str, time: Array, value: float, name: str) -> ChartLine:
    return ChartLine(("bounds", side), name, BOUND_COLOUR, time, np.full(len(time), value))
