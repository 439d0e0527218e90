"""How an examination opens: a tab for each drive, the scene above its series, the findings beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from trackbench.doctor.exhibits import Exhibit
from trackbench.recording.examination_scene import frame, measurements
from trackbench.recording.examination_series import ERROR, INNOVATION, NEES
from trackbench.recording.layout import played
from trackbench.recording.stream import path
from trackbench.recording.views import from_above
from trackbench.types import Array

#: How long a measurement stays in the picture, s.
TRAIL = 0.5
MARGIN_M = 6.0


def blueprint(exhibits: Sequence[Exhibit]) -> rrb.Blueprint:
    """The layout; it plays from the start, again and again."""
    drives = rrb.Tabs(*(_drive(exhibit) for exhibit in exhibits), active_tab=0)
    text = rrb.TextDocumentView(origin="findings", name="Findings")
    return played(rrb.Horizontal(drives, text, column_shares=[5, 2]))


def _drive(exhibit: Exhibit) -> rrb.Container:
    named = [finding.sensor for finding in exhibit.findings]
    ordered = sorted(exhibit.innovations, key=lambda one: one.sensor not in named)
    innovations = [
        _plot(exhibit, f"Innovation of {one.sensor}, {component}", INNOVATION, one.sensor, component)
        for one in ordered
        for component in one.components
    ]
    errors = rrb.Vertical(_plot(exhibit, "Position error, m", ERROR), _plot(exhibit, "NEES", NEES))
    above = rrb.Horizontal(_scene(exhibit), errors, column_shares=[3, 2])
    below = rrb.Grid(*innovations, grid_columns=min(3, max(1, len(innovations))))
    return rrb.Vertical(above, below, row_shares=[1, 1], name=exhibit.course)


def _scene(exhibit: Exhibit) -> rrb.Spatial2DView:
    sensors = dict.fromkeys(scan.sensor for scan in exhibit.scans)
    poses = np.array([scan.sensor_pose[:2] for scan in exhibit.scans]).T
    return from_above(
        path(*frame(exhibit.course)),
        "From above",
        [f"+ {path(exhibit.course, 'world')}/**"],
        (_extent(exhibit.target[0], poses[0]), _extent(-exhibit.target[1], -poses[1])),
        [path(*measurements(exhibit.course, sensor)) for sensor in sensors],
        TRAIL,
    )


def _extent(target: Array, sensors: Array) -> tuple[float, float]:
    both = np.concatenate([target, sensors])
    return float(both.min()) - MARGIN_M, float(both.max()) + MARGIN_M


def _plot(exhibit: Exhibit, name: str, *place: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=path(exhibit.course, *place), name=name, plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    )
