"""The live view of a run: its recorded run is sent to another process, which draws it in the viewer.

Rerun's connection may wait for ever for a viewer that is gone or slow, and cannot be interrupted. Therefore it lives in
a process that reads from a queue, and the run never waits.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from trackbench.api.plan import Listener, Prepared
from trackbench.base.types import Scan, Truth
from trackbench.document.palette import sensor_colours, tracker_colours
from trackbench.results import Result
from trackbench.results.columns import split, table_of
from trackbench.runner.estimate_records import estimate_records, measurement_records
from trackbench.runner.recorded import RecordedEstimates, RecordedInstant
from trackbench.runner.shared_records import road_records, truth_records
from trackbench.subjects.recording import layout, scene, series, views
from trackbench.subjects.recording.stream import Stream
from trackbench.subjects.recording.tracks import send_tracks
from trackbench.subjects.recording.writer import application, send

if TYPE_CHECKING:
    from multiprocessing.queues import Queue

    from trackbench.runner.recorded import OnRecordedRun

#: Longest wait, s: of :meth:`Live.close` for the drawing process, and of the drawing process for the viewer.
PATIENCE = 20


@dataclass(frozen=True)
class LiveRun:
    """Data of a run that are known before its first step."""

    name: str
    colours: Mapping[str, str]
    """Colour of each tracker by name."""
    sensors: list[str]
    truth: Truth
    """Ground truth of the recorded run alone."""


#: Message to the drawing process: start of a run, its measurements, its estimates at an instant, or its result.
Part = LiveRun | list[Scan] | RecordedInstant | Result


class Live(Listener):
    """Connection to a viewer, which shows one run after another.

    Attributes:
        lost: whether the drawing process ended or did not end in time.
    """

    def __init__(self, url: str) -> None:
        self.lost = False
        context = multiprocessing.get_context("spawn")
        self._parts: Queue[bytes | None] = context.Queue()
        self._process = context.Process(target=draw_runs, args=(url, self._parts), daemon=True)
        self._process.start()

    @property
    def observes(self) -> bool:
        return True

    def begin(self, item: Prepared) -> OnRecordedRun:
        """Send the data known before a run; return the callback for its further parts."""
        scenario = item.scenario.config
        colours = tracker_colours({name: item.scenario.places[name] for name in scenario.trackers})
        truth = truth_of_run(item.truths[scenario.recording.scene].truth, scenario.recording.run)
        self._send(LiveRun(scenario.name, colours, list(scenario.sensors), truth))
        return self.observe

    def observe(self, observed: list[Scan] | RecordedInstant) -> None:
        """Send the viewer the scans that have arrived, or an instant of the recorded run."""
        self._send(observed)

    def end(self, result: Result, folder: Path | None = None) -> None:
        """Send the viewer the whole recording of a run."""
        self._send(result)

    def _send(self, part: Part) -> None:
        # Pickled now: the queue's thread would pickle later, when the part may have changed.
        self._parts.put(pickle.dumps(part))

    def close(self) -> None:
        """Wait until everything is drawn; after ``PATIENCE`` give up the viewer."""
        self._parts.put(None)
        self._process.join(PATIENCE)
        self.lost = self._process.exitcode != 0
        self._process.kill()
        self._process.join()
        # Unread parts must not keep this process from ending.
        self._parts.cancel_join_thread()


def truth_of_run(truth: Truth, run: int) -> Truth:
    """Return the truth with only the motion of one run."""
    motion = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate")
    paths = {name: getattr(truth, name) for name in motion}
    return replace(truth, **{name: values[..., min(run, values.shape[-1] - 1), None] for name, values in paths.items()})


class LiveScene:
    """Drawing of one run in the viewer while the run goes on, up to the latest instant."""

    def __init__(self, url: str, live: LiveRun) -> None:
        self._live = live
        self._motion = table_of(truth_records(live.truth, 0))
        self._measurements = pa.table({})
        self._steps = np.empty(0, dtype=np.intp)
        self._drawn = -np.inf
        self._recording = rr.RecordingStream(application(live.name))
        self._recording.connect_grpc(url)
        self._wide, vehicles = views.wide_window(self._motion), list(live.truth.ids)
        self._recording.send_blueprint(layout.live_blueprint(self._wide, vehicles, live.sensors, dict(live.colours)))
        self._recording.send_recording_name(live.name)
        self._stream = Stream(self._recording)
        scene.send_roads(self._stream, table_of(road_records(live.truth)))
        views.send_scales(self._stream, self._wide, vehicles)
        layout.send_legend(self._stream, layout.entries(live.colours, live.sensors))

    def finish(self) -> None:
        """Wait until the viewer has everything."""
        self._recording.disconnect()

    def draw_whole(self, result: Result) -> None:
        send(self._recording, result)

    def take_measurements(self, scans: list[Scan]) -> None:
        """Store the measurements; each is sent to the viewer when the trackers reach its time."""
        truth = self._live.truth
        self._measurements = table_of(measurement_records(scans, truth.ids))
        self._steps = np.searchsorted(truth.time, np.unique([scan.time for scan in scans]))

    def draw_estimates(self, instants: list[RecordedInstant]) -> None:
        """Draw the estimates of trackers at some instants; a failed tracker has no further estimates."""
        if not len(self._steps):
            return
        truth, nothing, records = self._live.truth, pa.table({}), []
        self._draw_truth(float(truth.time[self._steps[max(item.number for item in instants)]]))
        for tracker in self._live.colours:
            numbers = [item.number for item in instants if tracker in item.estimates]
            beliefs = [item.estimates[tracker] for item in instants if tracker in item.estimates]
            if beliefs:
                mean = np.stack([belief.mean for belief in beliefs], axis=1)
                covariance = np.stack([belief.covariance for belief in beliefs], axis=2)
                recorded = {tracker: RecordedEstimates(mean, covariance, np.isfinite(mean[0]))}
                records += estimate_records(recorded, truth, self._steps[numbers], 0)
        estimates = table_of(records)
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
    """Viewer in which one run after another is drawn."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._scene: LiveScene | None = None

    def draw(self, parts: Iterable[Part]) -> None:
        """Draw the parts of runs in the order of arrival; a part that comes before any start of a run is ignored."""
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


def draw_runs(url: str, source: Queue[bytes | None]) -> None:
    """Draw parts from a queue until None arrives; a viewer that accepts nothing for ``PATIENCE`` s ends the process."""
    # Ctrl-C ends the run, and the end of the run ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    runs = LiveRuns(url)
    parts: list[bytes | None] = []
    while None not in parts:
        parts = [source.get()]
        try:
            while True:
                parts.append(source.get_nowait())
        except queue.Empty:
            pass
        # Only a signal interrupts Rerun's calls.
        signal.alarm(PATIENCE)
        runs.draw(pickle.loads(part) for part in parts if part is not None)
        signal.alarm(0)
    signal.alarm(PATIENCE)
    runs.finish()
