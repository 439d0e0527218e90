"""The layout of an examination: a tab for each drive with its scene and series, and the findings beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from trackbench.base.types import Array
from trackbench.document.palette import BOUND_COLOUR, OBSERVER_COLOUR
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.recording.examination_scene import COLOURS, frame, measurements, sensors_of
from trackbench.subjects.recording.examination_series import error_charts, innovation_charts
from trackbench.subjects.recording.layout import beside, played
from trackbench.subjects.recording.legend import NamedColour
from trackbench.subjects.recording.plots import chart_tabs
from trackbench.subjects.recording.stream import path
from trackbench.subjects.recording.views import from_above

#: How long a measurement is shown, s.
RECENT_S = 0.5
MARGIN_M = 6.0


def blueprint(evidence: Sequence[EvidenceRun]) -> rrb.Blueprint:
    """The layout; it plays in a loop."""
    drives = rrb.Tabs(*(_drive(run) for run in evidence), active_tab=0)
    text = rrb.TextDocumentView(origin="findings", name="Findings")
    return played(beside(drives, legend(evidence), text))


def legend(evidence: Sequence[EvidenceRun]) -> list[NamedColour]:
    """What is in the pictures of all drives."""
    return [
        *(NamedColour(name, colour) for name, colour in COLOURS.items()),
        NamedColour("truth, bounds", BOUND_COLOUR),
        NamedColour("sensors", OBSERVER_COLOUR),
        *(NamedColour(name, colour, "dot") for name, colour in sensors_of(evidence).items()),
    ]


def _drive(run: EvidenceRun) -> rrb.Container:
    innovations = [chart_tabs([chart]) for chart in innovation_charts(run)]
    errors = rrb.Vertical(*(chart_tabs([chart]) for chart in error_charts(run)))
    above = rrb.Horizontal(_scene(run), errors, column_shares=[3, 2])
    below = rrb.Grid(*innovations, grid_columns=min(3, max(1, len(innovations))))
    return rrb.Vertical(above, below, row_shares=[1, 1], name=run.drive)


def _scene(run: EvidenceRun) -> rrb.Spatial2DView:
    sensors = dict.fromkeys(scan.sensor for scan in run.scans)
    poses = np.array([scan.sensor_pose[:2] for scan in run.scans]).T
    return from_above(
        path(*frame(run.drive)),
        "From above",
        [f"+ {path(run.drive, 'world')}/**"],
        (_extent(run.target[0], poses[0]), _extent(-run.target[1], -poses[1])),
        {path(*measurements(run.drive, sensor)): RECENT_S for sensor in sensors},
    )


def _extent(target: Array, sensors: Array) -> tuple[float, float]:
    both = np.concatenate([target, sensors])
    return float(both.min()) - MARGIN_M, float(both.max()) + MARGIN_M
