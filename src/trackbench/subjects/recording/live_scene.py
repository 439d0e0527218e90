"""The process between a run and the viewer: draws a run while it goes on, and its whole recording at the end."""

from __future__ import annotations

import pickle
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress
from itertools import groupby
from typing import IO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from trackbench.base.types import Scan
from trackbench.document.palette import sensor_colours
from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.results.declared import LABELLED
from trackbench.runner.estimate_records import estimate_records, measurement_records
from trackbench.runner.recorded import RecordedEstimates, RecordedInstant
from trackbench.runner.shared_records import road_records, truth_records
from trackbench.subjects.recording import layout, scene, series, views
from trackbench.subjects.recording.live import PATIENCE, LiveRun, Part
from trackbench.subjects.recording.stream import Stream
from trackbench.subjects.recording.tracks import send_tracks
from trackbench.subjects.recording.writer import application, send


class LiveScene:
    """One run on the viewer, as far as it has gone."""

    def __init__(self, url: str, live: LiveRun) -> None:
        self._live = live
        self._motion = LABELLED["truth"].written(truth_records(live.truth, 0))
        self._measurements = pa.table({})
        self._steps = np.empty(0, dtype=np.intp)
        self._drawn = -np.inf
        self._recording = rr.RecordingStream(application(live.name))
        self._recording.connect_grpc(url)
        self._wide, vehicles = views.wide_window(self._motion), list(live.truth.ids)
        self._recording.send_blueprint(layout.live_blueprint(self._wide, vehicles, live.sensors, dict(live.colours)))
        self._recording.send_recording_name(live.name)
        self._stream = Stream(self._recording)
        scene.send_roads(self._stream, LABELLED["roads"].written(road_records(live.truth)))
        views.send_scales(self._stream, self._wide, vehicles)
        layout.send_legend(self._stream, layout.entries(live.colours, live.sensors))

    def finish(self) -> None:
        """Wait until the viewer has everything."""
        self._recording.disconnect()

    def draw_whole(self, result: Result) -> None:
        """Draw the whole recording."""
        send(self._recording, result)

    def take_measurements(self, scans: list[Scan]) -> None:
        """Keep the measurements, which are drawn as far as the trackers have come."""
        truth = self._live.truth
        self._measurements = LABELLED["measurements"].written(measurement_records(scans, truth.ids))
        self._steps = np.searchsorted(truth.time, np.unique([scan.time for scan in scans]))

    def draw_estimates(self, instants: list[RecordedInstant]) -> None:
        """Draw the estimates of trackers at some instants; one that has failed has none from then on."""
        if not len(self._steps):
            return
        truth, nothing, records = self._live.truth, pa.table({}), []
        self._draw_truth(float(truth.time[self._steps[max(item.number for item in instants)]]))
        for tracker in self._live.colours:
            numbers = [item.number for item in instants if tracker in item.estimates]
            own = [item.estimates[tracker] for item in instants if tracker in item.estimates]
            if own:
                mean = np.stack([belief.mean for belief in own], axis=1)
                covariance = np.stack([belief.covariance for belief in own], axis=2)
                recorded = {tracker: RecordedEstimates(mean, covariance, np.isfinite(mean[0]))}
                records += estimate_records(recorded, truth, self._steps[numbers], 0)
        estimates = LABELLED["estimates"].written(records)
        for (tracker,), rows in split(estimates, "tracker").items():
            send_tracks(self._stream, tracker, rows, np.unique(rows["time_s"]), self._live.colours[tracker])
        for chart in series.recorded_run(estimates, nothing, nothing, nothing, self._live.colours).all:
            layout.send_chart(self._stream, chart)

    def _draw_truth(self, time: float) -> None:
        """Draw vehicles and measurements up to a time, s."""
        if time <= self._drawn:
            return
        vehicles, measurements = (
            table.filter(pc.and_(pc.greater(table["time_s"], self._drawn), pc.less_equal(table["time_s"], time)))
            for table in (self._motion, self._measurements)
        )
        scene.send_vehicles(self._stream, vehicles, self._wide.metres_per_pixel)
        scene.send_measurements(self._stream, measurements, sensor_colours(self._live.sensors))
        self._drawn = time


class LiveRuns:
    """One viewer, to which one run after another is drawn."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._scene: LiveScene | None = None

    def draw(self, parts: Iterable[Part]) -> None:
        """Draw parts of runs in their order; what comes before the start of a run is left out."""
        for _, group in groupby(parts, key=type):
            instants = []
            for part in group:
                if isinstance(part, LiveRun):
                    self.finish()
                    self._scene = LiveScene(self._url, part)
                elif self._scene is None:
                    continue
                elif isinstance(part, RecordedInstant):
                    instants.append(part)
                elif isinstance(part, Result):
                    self._scene.draw_whole(part)
                else:
                    self._scene.take_measurements(part)
            if instants and self._scene is not None:
                self._scene.draw_estimates(instants)

    def finish(self) -> None:
        """Wait until the viewer has everything."""
        if self._scene is not None:
            self._scene.finish()
            self._scene = None


def draw_runs(url: str, source: IO[bytes]) -> None:
    """Draw what comes from a pipe until it ends; a viewer that takes nothing for long ends this process."""
    runs = LiveRuns(url)
    with suppress(EOFError):
        while True:
            parts: list[Part] = pickle.load(source)
            # Rerun's calls cannot be interrupted otherwise.
            signal.alarm(PATIENCE)
            runs.draw(parts)
            signal.alarm(0)
    signal.alarm(PATIENCE)
    runs.finish()


if __name__ == "__main__":
    # Ctrl-C is for the run, whose end ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    draw_runs(sys.argv[1], sys.stdin.buffer)
