"""The process between a run and the viewer: draws a run while it goes on, and its whole recording at the end."""

from __future__ import annotations

import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import groupby
from queue import Queue
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from trackbench.base.types import Gaussian, Scan
from trackbench.document.palette import sensor_colours
from trackbench.results import Result
from trackbench.results.declared import LABELLED
from trackbench.runner.recorded import RecordedEstimates, RecordedInstant
from trackbench.runner.tables import estimate_records, measurement_records, road_records, truth_records
from trackbench.subjects.recording import layout, scene, series, views
from trackbench.subjects.recording.layout import send_chart
from trackbench.subjects.recording.live import LiveRun
from trackbench.subjects.recording.stream import Stream
from trackbench.subjects.recording.viewer import PATIENCE, listens
from trackbench.subjects.recording.writer import application, send


class Painter:
    """One viewer, to which one run after another is drawn."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._run: _Run | None = None

    def take(self, batch: Iterable[LiveRun | list[Scan] | RecordedInstant | Result]) -> None:
        """Draw parts of runs, in their order."""
        for _, items in groupby(batch, key=type):
            instants = []
            for item in items:
                if isinstance(item, LiveRun):
                    self.finish()
                    self._run = _Run(self._url, item)
                elif isinstance(item, RecordedInstant):
                    instants.append(item)
                elif isinstance(item, Result) and self._run is not None:
                    send(self._run.recording, item)
                elif isinstance(item, list) and self._run is not None:
                    self._run.sense(item)
            if instants and self._run is not None:
                self._run.estimate(instants)

    def finish(self) -> None:
        """Wait until the viewer has everything."""
        if self._run is not None:
            self._run.recording.disconnect()
            self._run = None


class _Run:
    """One run on the viewer."""

    def __init__(self, url: str, live: LiveRun) -> None:
        self.live = live
        self._motion = LABELLED["truth"].written(truth_records(live.truth, 0))
        self._measurements = pa.table({})
        self._steps = np.empty(0, dtype=np.intp)
        self._drawn = -np.inf
        self.recording = rr.RecordingStream(application(live.name))
        self.recording.connect_grpc(url)
        self._wide, vehicles = views.wide_window(self._motion), list(live.truth.ids)
        self.recording.send_blueprint(layout.live_blueprint(self._wide, vehicles, live.sensors, dict(live.colours)))
        self.recording.send_recording_name(live.name)
        self._stream = Stream(self.recording)
        scene.send_roads(self._stream, LABELLED["roads"].written(road_records(live.truth)))
        views.send_scales(self._stream, self._wide, vehicles)
        layout.send_legend(self._stream, layout.entries(live.colours, live.sensors))

    def sense(self, scans: list[Scan]) -> None:
        """The measurements, which are drawn as far as the trackers have come."""
        truth = self.live.truth
        self._measurements = LABELLED["measurements"].written(measurement_records(scans, truth.ids))
        self._steps = np.searchsorted(truth.time, np.unique([scan.time for scan in scans]))

    def estimate(self, instants: list[RecordedInstant]) -> None:
        """The estimates of all trackers at some instants; one that has failed has none."""
        if not len(self._steps):
            return
        truth, nothing = self.live.truth, pa.table({})
        none = Gaussian(np.full((4, len(truth.ids)), np.nan), np.full((4, 4, len(truth.ids)), np.nan))
        steps = self._steps[[item.number for item in instants]]
        self._advance(float(truth.time[steps[-1]]))
        recorded = {}
        for tracker in self.live.colours:
            beliefs = [item.estimates.get(tracker, none) for item in instants]
            mean = np.stack([belief.mean for belief in beliefs], axis=1)
            covariance = np.stack([belief.covariance for belief in beliefs], axis=2)
            recorded[tracker] = RecordedEstimates(mean, covariance, np.isfinite(mean[0]))
        estimates = LABELLED["estimates"].written(estimate_records(recorded, truth, steps, 0))
        scene.send_estimates(self._stream, estimates, self._motion, self.live.colours)
        for chart in series.recorded_run(estimates, nothing, nothing, nothing, self.live.colours).all:
            send_chart(self._stream, chart)

    def _advance(self, time: float) -> None:
        """Vehicles and measurements up to a time."""
        if time <= self._drawn:
            return
        vehicles, measurements = (
            table.filter(pc.and_(pc.greater(table["time_s"], self._drawn), pc.less_equal(table["time_s"], time)))
            for table in (self._motion, self._measurements)
        )
        scene.send_vehicles(self._stream, vehicles, self._wide.metres_per_pixel)
        scene.send_measurements(self._stream, measurements, sensor_colours(self.live.sensors))
        self._drawn = time


#: A viewer that accepts no data for this long is given up, s.
STALLED = 20
#: Deliveries that are kept while the viewer accepts none; then no more are read, and the queue of the run fills.
KEPT = 500


def paint(url: str) -> None:
    """Pass on what comes at standard input until it ends."""
    # Ctrl-C is for the run, whose end ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    batches: Queue[list[Any] | None] = Queue(KEPT)
    threading.Thread(target=_read, args=(batches,), daemon=True).start()
    address = urlsplit(url)
    limit = time.monotonic() + PATIENCE
    while not listens(address.hostname or "", address.port or 0):
        if time.monotonic() > limit:
            return
        time.sleep(0.1)
    painter = Painter(url)
    while (batch := batches.get()) is not None:
        with _limit():
            painter.take(batch)
    with _limit():
        painter.finish()


@contextmanager
def _limit() -> Iterator[None]:
    """The system ends this process if what is within takes too long: Rerun's calls cannot be interrupted otherwise."""
    signal.alarm(STALLED)
    try:
        yield
    finally:
        signal.alarm(0)


def _read(batches: Queue[list[Any] | None]) -> None:
    try:
        while True:
            batches.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):
        batches.put(None)


if __name__ == "__main__":
    paint(sys.argv[1])
