"""Replay of an examination: the evidence runs with their innovations and errors, and the findings as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.base.types import COMMON_STATE, Array
from trackbench.document import LegendEntry, TrackerStyle
from trackbench.document.palette import BOUND_COLOUR, OBSERVER_COLOUR, TRACKER_COLOURS, TRUTH_COLOUR, sensor_colours
from trackbench.document.replay import (
    Chart,
    ChartLine,
    Replay,
    ReplayEvent,
    ReplayMeasurements,
    ReplayPath,
    ReplayScene,
    ReplayStart,
    extent_of,
)
from trackbench.metrics.consistency import mean_bounds
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.evidence import EvidenceRun, run_errors

#: Colours of the tracker and of the reference, as in the report.
COLOURS = {"reference": TRACKER_COLOURS[5], "tracker": TRACKER_COLOURS[4]}
#: Widths of paths and of lines in charts, pixels: the tracker is drawn on top of the reference.
PATH_WIDTHS = {"reference": 1.5, "tracker": 0.5}
LINE_WIDTHS = {"reference": 3.0, "tracker": 1.5}
IN_THE_PICTURES = (
    "## In the pictures\n\n"
    "Grey: the truth. Orange: the tracker. Blue: the reference. Dots: measurements of the last 0.3 s. Ellipses: 95 % of"
    " the position by the estimate's covariance. Innovations: orange, applied by the tracker; blue, expected from the"
    " same prediction by the right measurement model; grey, two standard deviations of the noise."
)


def examination_replay(tracker: str, report: str, evidence: Sequence[EvidenceRun]) -> Replay:
    """Return the replay of an examination, with its report in Markdown and a scene for each run."""
    sensors = sensor_colours(scan.sensor for run in evidence for scan in run.scans)
    legend = (
        *(LegendEntry(name, colour) for name, colour in COLOURS.items()),
        LegendEntry("truth, bounds", BOUND_COLOUR),
        LegendEntry("sensors", OBSERVER_COLOUR),
        *(LegendEntry(name, colour, "dot") for name, colour in sensors.items()),
    )
    scenes = tuple(map(drive_scene, evidence))
    return Replay(tracker, "trackbench doctor", "Findings", f"{report}\n{IN_THE_PICTURES}", legend, scenes)


def drive_scene(run: EvidenceRun) -> ReplayScene:
    """Return the scene of a run, which opens at the largest error of the tracker."""
    poses = np.array([scan.sensor_pose[:2] for scan in run.scans]).T
    sensors = sensor_colours(scan.sensor for scan in run.scans)
    # Only the last of several scans at one instant is drawn.
    last = np.append(np.diff(run.time) > 0, True)
    error = np.where(last, np.nan_to_num(run_errors(run)["tracker"].position), 0.0)
    k = int(np.argmax(error))
    x, y = run.target[:2, k].tolist()
    worst = ReplayEvent("tracker", "worst", float(run.time[k]), x, y, f"largest error {error[k]:.2f} m")
    target = ReplayPath("truth", TRUTH_COLOUR, run.time, run.target[:2], dot=5.0)
    sensor_path = ReplayPath("sensors", OBSERVER_COLOUR, run.time, poses, is_observer=True)
    return ReplayScene(
        run.drive,
        (
            target,
            sensor_path,
            _estimates("reference", run.time, run.reference_mean, run.reference_covariance),
            _estimates("tracker", run.time, run.mean, run.covariance),
        ),
        tuple(_measurements(run, sensor, colour) for sensor, colour in sensors.items()),
        *extent_of((target, sensor_path)),
        tuple(_error_charts(run)),
        tuple(_innovation_charts(run)),
        trackers=tuple(TrackerStyle("", name, COLOURS[name]) for name in ("tracker", "reference")),
        shown=("tracker", "reference"),
        events=(worst,),
        start=ReplayStart(worst.time_s, "truth"),
    )


def _estimates(name: str, time: Array, mean: Array, covariance: Array) -> ReplayPath:
    finite = np.isfinite(mean[:2]).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
    p = covariance[:2, :2, finite]
    return ReplayPath(name, COLOURS[name], time[finite], mean[:2, finite], p, width=PATH_WIDTHS[name], tracker=name)


def _measurements(run: EvidenceRun, sensor: str, colour: str) -> ReplayMeasurements:
    scans = [scan for scan in run.scans if scan.sensor == sensor and scan.valid]
    positions = [SENSOR_MODELS[scan.kind].position(scan) for scan in scans]
    means = np.array([position.mean for position in positions]).reshape(-1, 2).T
    covariance = np.array([position.covariance for position in positions]).reshape(-1, 2, 2).transpose(1, 2, 0)
    return ReplayMeasurements(sensor, colour, np.array([scan.time for scan in scans]), means, covariance)


def _innovation_charts(run: EvidenceRun) -> Iterator[Chart]:
    finding_sensors = [finding.sensor for finding in run.findings]
    for series in sorted(run.innovations, key=lambda series: series.sensor not in finding_sensors):
        units = SENSOR_MODELS[series.kind].units
        for i, component in enumerate(series.components):
            lines = (
                _line("reference", series.time, series.expected[i], "expected"),
                _line("tracker", series.time, series.applied[i], "applied"),
            )
            limits = (("high", 2.0 * series.sigma[i]), ("low", -2.0 * series.sigma[i]))
            bounds = tuple(_bound(side, series.time, limit, "2 sigma") for side, limit in limits)
            place = (run.drive, "innovation", series.sensor, component)
            name = f"Innovation of {series.sensor}, {component.replace('_', ' ')}"
            yield Chart(place, name, units[i], lines, bounds, signed=True)


def _error_charts(run: EvidenceRun) -> Iterator[Chart]:
    errors = run_errors(run)
    position = tuple(_line(name, run.time, errors[name].position, name) for name in COLOURS)
    sigma = errors["tracker"].two_sigma
    by_covariance = ChartLine(("bounds", "two_sigma"), "2 sigma by its covariance", BOUND_COLOUR, run.time, sigma)
    yield Chart((run.drive, "position_error"), "Position error", "m", position, (by_covariance,))
    nees = tuple(_line(name, run.time, errors[name].nees, name) for name in COLOURS)
    limits = zip(("low", "high"), mean_bounds(len(COMMON_STATE), 1), strict=True)
    bounds = tuple(_bound(side, run.time, float(limit), "95 % bounds") for side, limit in limits)
    yield Chart((run.drive, "nees"), "NEES", "", nees, bounds)


def _line(tracker: str, time: Array, values: Array, name: str) -> ChartLine:
    return ChartLine((tracker,), name, COLOURS[tracker], time, values, LINE_WIDTHS[tracker])


def _bound(side: str, time: Array, value: float, name: str) -> ChartLine:
    return ChartLine(("bounds", side), name, BOUND_COLOUR, time, np.full(len(time), value))
