"""Draws a run while it goes on, a handful of instants at a time, and whole when it is complete."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.palette import sensor_colour, tracker_colour
from trackbench.recording import layout, scene, series, views
from trackbench.recording.live import Scene
from trackbench.recording.stream import Stream
from trackbench.recording.writer import new_recording, send
from trackbench.results import Result
from trackbench.runner.block import Observation, RecordedEstimates
from trackbench.runner.recorded_tables import estimates_table, measurements_table, roads_table, truth_table
from trackbench.types import Scan


class Painter:
    """One viewer, to which one run after another is drawn."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._run: _Run | None = None

    def take(self, batch: Iterable[Scene | list[Scan] | Observation | Result]) -> None:
        """Draw what was observed, in the order in which it was."""
        for _, items in groupby(batch, key=type):
            alike = list(items)
            observations = [item for item in alike if isinstance(item, Observation)]
            if observations and self._run is not None:
                self._run.estimate(observations)
            for item in alike:
                self._change(item)

    def _change(self, item: Scene | list[Scan] | Observation | Result) -> None:
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
        self._trackers, self._sensors = tracker_colour(about.trackers), sensor_colour(about.sensors)
        self._motion = truth_table(about.truth, 0)
        self._measurements = pa.table({})
        self._steps = np.empty(0, dtype=np.intp)
        self._drawn = -np.inf
        self.recording = new_recording(about.name)
        self.recording.connect_grpc(url)
        windows = views.windows(self._motion)
        self.recording.send_blueprint(layout.live_blueprint(windows, about.sensors))
        self.recording.send_recording_name(about.name)
        self._stream = Stream(self.recording)
        scene.send_roads(self._stream, roads_table(about.truth))
        views.send_scales(self._stream, windows)
        views.send_legends(self._stream, windows, self._trackers)

    def sense(self, scans: list[Scan]) -> None:
        """The measurements, which are drawn as far as the first tracker has come."""
        truth = self._about.truth
        self._measurements = measurements_table(scans, truth.ids)
        self._steps = np.searchsorted(truth.time, np.unique([scan.time for scan in scans]))

    def estimate(self, observations: list[Observation]) -> None:
        """Estimates of some instants, tracker by tracker."""
        if not len(self._steps):
            return
        for tracker, items in groupby(observations, key=lambda item: item.tracker):
            these = list(items)
            steps = self._steps[[item.instant for item in these]]
            self._advance(float(self._about.truth.time[steps[-1]]))
            mean = np.stack([item.mean for item in these], axis=1)
            covariance = np.stack([item.covariance for item in these], axis=2)
            estimates = estimates_table({tracker: RecordedEstimates(mean, covariance)}, self._about.truth, steps, 0)
            scene.send_estimates(self._stream, estimates, self._motion, self._trackers, self._about.hold)
            nothing = pa.table({})
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
