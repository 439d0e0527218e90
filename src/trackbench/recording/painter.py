"""Draws a run while it goes on, a handful of instants at a time, and whole when it is complete."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from trackbench.palette import sensor_colours, tracker_colours
from trackbench.recording import layout, scene, series, views
from trackbench.recording.live import Scene
from trackbench.recording.stream import Stream
from trackbench.recording.writer import application, send
from trackbench.results import Result
from trackbench.runner.block import RecordedEstimates, RecordedInstant
from trackbench.runner.tables import estimates_table, measurements_table, roads_table, truth_table
from trackbench.types import Scan


class Painter:
    """One viewer, to which one run after another is drawn."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._run: _Run | None = None

    def take(self, batch: Iterable[Scene | list[Scan] | RecordedInstant | Result]) -> None:
        """Draw what was observed, in the order in which it was."""
        for _, items in groupby(batch, key=type):
            alike = list(items)
            instants = [item for item in alike if isinstance(item, RecordedInstant)]
            if instants and self._run is not None:
                self._run.estimate(instants)
            for item in alike:
                self._change(item)

    def _change(self, item: Scene | list[Scan] | RecordedInstant | Result) -> None:
        if isinstance(item, Scene):
            self.finish()
            self._run = _Run(self._url, item)
        elif isinstance(item, Result) and self._run is not None:
            send(self._run.recording, item)
        elif isinstance(item, list) and self._run is not None:
            self._run.sense(item)

    def finish(self) -> None:
        """Wait until the viewer has everything."""
        if self._run is not None:
            self._run.recording.disconnect()
            self._run = None


class _Run:
    """One run on the viewer."""

    def __init__(self, url: str, about: Scene) -> None:
        self._about = about
        self._trackers, self._sensors = tracker_colours(about.trackers), sensor_colours(about.sensors)
        self._motion = truth_table(about.truth, 0)
        self._measurements = pa.table({})
        self._steps = np.empty(0, dtype=np.intp)
        self._drawn = -np.inf
        self.recording = rr.RecordingStream(application(about.name))
        self.recording.connect_grpc(url)
        windows = views.windows(self._motion)
        self.recording.send_blueprint(layout.live_blueprint(windows, about.sensors))
        self.recording.send_recording_name(about.name)
        self._stream = Stream(self.recording)
        scene.send_roads(self._stream, roads_table(about.truth))
        views.send_scales(self._stream, windows)
        views.send_legends(self._stream, windows, self._trackers)

    def sense(self, scans: list[Scan]) -> None:
        """The measurements, which are drawn as far as the trackers have come."""
        truth = self._about.truth
        self._measurements = measurements_table(scans, truth.ids)
        self._steps = np.searchsorted(truth.time, np.unique([scan.time for scan in scans]))

    def estimate(self, instants: list[RecordedInstant]) -> None:
        """The estimates of all trackers at some instants."""
        if not len(self._steps):
            return
        truth, nothing = self._about.truth, pa.table({})
        self._advance(float(truth.time[self._steps[instants[-1].number]]))
        for tracker in self._trackers:
            known = [(item.number, item.estimates[tracker]) for item in instants if tracker in item.estimates]
            if not known:
                continue
            numbers, gaussians = zip(*known, strict=True)
            mean, covariance = (np.moveaxis(np.array(part), 0, -2) for part in zip(*gaussians, strict=True))
            steps = self._steps[list(numbers)]
            estimates = estimates_table({tracker: RecordedEstimates(mean, covariance)}, truth, steps, 0)
            scene.send_estimates(self._stream, estimates, self._motion, self._trackers, self._about.hold)
            series.send_recorded_run(self._stream, estimates, nothing, nothing, self._trackers)

    def _advance(self, time: float) -> None:
        """Vehicles and measurements up to a time."""
        if time <= self._drawn:
            return
        for table, draw in ((self._motion, self._vehicles), (self._measurements, self._points)):
            new = table.filter(pc.and_(pc.greater(table["time_s"], self._drawn), pc.less_equal(table["time_s"], time)))
            if new.num_rows:
                draw(new)
        self._drawn = time

    def _vehicles(self, rows: pa.Table) -> None:
        scene.send_vehicles(self._stream, rows)

    def _points(self, rows: pa.Table) -> None:
        scene.send_measurements(self._stream, rows, self._sensors)
