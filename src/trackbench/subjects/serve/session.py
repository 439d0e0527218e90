"""The session of a client: its tracker, its answers and the running RMSE."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Observer, Scan
from trackbench.base.units import wrap_angle
from trackbench.driving.drive import empty_scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.driving.start import ending, start_stepper
from trackbench.driving.steppers import ForeignTracker
from trackbench.models.sensors import Lidar, Radar, sensor_type
from trackbench.scenario import Scenario
from trackbench.sensing.view import sensor_motion
from trackbench.subjects.serve.protocol import MANUAL, estimate_marker, parse
from trackbench.trackers.answers import GIVEN_UP, NOT_FINITE, TrackerFault
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.late import LateScans
from trackbench.truth.config.recording import FixedObserver
from trackbench.truth.recorded.udacity import Measurement

log = logging.getLogger(__name__)

#: Number of a frame's characters in a log line.
SHOWN = 60


class TrackerError(Exception):
    """Failure of a tracker; the message has the measurement and the reason."""


@dataclass(frozen=True)
class Served:
    """Tracker of a scenario with its sensors; each session starts a fresh tracker."""

    name: str
    config: FilterConfig | PluginConfig
    folder: Path
    sensors: Mapping[str, tuple[Lidar | Radar, Scan]]
    """Sensors of the scenario by kind, ``lidar`` or ``radar``, each with an empty scan at time 0."""
    isolation: Isolation

    def stepper(self) -> Any:
        """Start a fresh tracker and return it; a plug-in that fails to start raises its error."""
        return start_stepper(self.config, self.folder, 1, _refuse_truth, self.isolation)


def load_served(loaded: Scenario, name: str, isolation: Isolation = ISOLATED) -> Served:
    """Return the tracker with the name ``name``, ready to be served, after a trial start.

    Raises:
        InputError: there is no such tracker, it fails to start, or the scenario has two lidars or two radars.
    """
    config = loaded.config
    if name not in config.trackers:
        hint = nearest_choices(name, config.trackers)
        raise InputError(f"no tracker {name!r} in this scenario; {hint}", file=loaded.path)
    if config.sensing.identities == "hidden":
        message = "hidden, and the simulator's client asks for one object; serve a tracker of known identities"
        raise loaded.locate(InputError(message, key="sensing.identities"))
    sensors: dict[str, tuple[Lidar | Radar, Scan]] = {}
    for sensor_name, sensor in config.sensors.items():
        kind = sensor_type(sensor.type)
        if kind in sensors:
            message = f"a second {kind} beside {sensors[kind][1].sensor}; the simulator has one lidar and one radar"
            raise loaded.locate(InputError(message, key=f"sensors.{sensor_name}"))
        if isinstance(sensor, Lidar | Radar):
            sensors[kind] = sensor, _empty_scan(sensor_name, sensor, getattr(config.truth, "observer", None))
    checked = Served(name, config.driven(name), loaded.folder, sensors, isolation)
    try:
        with ending(checked.stepper()):
            pass
    except (InputError, TrackFault) as error:
        message = error.message if isinstance(error, InputError) else str(error)
        raise loaded.locate(InputError(message, key=f"trackers.{name}")) from error
    return checked


def _empty_scan(name: str, config: Lidar | Radar, observer: object) -> Scan:
    """Return an empty scan of a sensor at rest, at the scenario's fixed observer or else at the origin."""
    at = observer if isinstance(observer, FixedObserver) else FixedObserver()
    x, y, yaw, rest = (np.array([value]) for value in (at.x, at.y, np.deg2rad(at.yaw_deg), 0.0))
    pose = sensor_motion(Observer(x, y, yaw, rest, rest, rest), config.mount).pose[:, 0]
    noise, nothing = config.noise_covariance(), np.full((len(config.components), 1), np.nan)
    return Scan(0.0, name, config.type, nothing, np.zeros(1, dtype=bool), noise, pose, np.zeros(2), 0.0)


def _refuse_truth(tracker: LateScans) -> LateScans:
    if tracker.starts_from_truth:
        raise InputError("starts from the truth, which a live client does not have; use initial: two_measurements")
    return tracker


class Client:
    """Session of one connection, without the network; a restart of the simulator begins a new data set and RMSE."""

    def __init__(self, served: Served, name: str) -> None:
        """Start a fresh tracker.

        Raises:
            TrackerError: the plug-in fails to start.
        """
        self._served = served
        self._name = name
        self._start()

    def _start(self) -> None:
        self._first: int | None = None
        self._last: Measurement | None = None
        self._last_answer = MANUAL
        self._squares = np.zeros(4)
        self._measurements = self._estimates = 0
        try:
            self._stepper, self._state = self._served.stepper(), None
        except (Exception, SystemExit) as error:
            raise TrackerError(f"to start: {fault_of(error)}") from error

    def answer(self, frame: str | bytes) -> str | None:
        """Return the frame (message) to send back, None for no answer; a bad event is logged and answered ``manual``.

        Raises:
            TrackerError: the tracker raised an error, or its answer is no estimate.
        """
        try:
            measurement = parse(frame)
        except InputError as error:
            log.warning("%s: bad frame, %s: %r", self._name, error, frame[:SHOWN])
            return MANUAL
        if not isinstance(measurement, Measurement):
            return measurement
        if measurement.kind not in self._served.sensors:
            return MANUAL
        if measurement == self._last:
            # The simulator may send a line twice, since its clock stops during a pause.
            return self._last_answer
        if self._last is not None and measurement.stamp < self._last.stamp:
            self.close()
            log.info("%s: time goes backwards: starts afresh", self._name)
            self._start()
        self._last = measurement
        self._measurements += 1
        try:
            self._last_answer = self._answer_to(measurement)
        except (Exception, SystemExit) as error:
            raise TrackerError(f"at measurement {self._measurements}: {fault_of(error)}") from error
        return self._last_answer

    def close(self) -> None:
        """End the tracker, and log the totals of the data set."""
        if isinstance(self._stepper, ForeignTracker):
            self._stepper.close()
        if self._measurements:
            px, py, vx, vy = np.sqrt(self._squares / self._estimates) if self._estimates else np.full(4, np.nan)
            text = "%s: %d measurements, %d estimates, RMSE %.4f %.4f m, %.4f %.4f m/s"
            log.info(text, self._name, self._measurements, self._estimates, px, py, vx, vy)

    def _answer_to(self, measurement: Measurement) -> str:
        with np.errstate(all="ignore"):
            self._state, estimate = self._stepper.step(self._state, self._scan(measurement))
        if estimate is None or not np.isfinite(estimate.mean.sum() + estimate.covariance.sum()):
            if self._estimates:
                raise TrackerFault(GIVEN_UP if estimate is None else NOT_FINITE)
            return MANUAL
        mean = np.asarray(estimate.mean[:, 0])
        self._squares += (mean - measurement.truth) ** 2
        self._estimates += 1
        return estimate_marker(mean, np.sqrt(self._squares / self._estimates))

    def _scan(self, measurement: Measurement) -> Scan:
        config, empty = self._served.sensors[measurement.kind]
        values = np.array(measurement.measurement)[:, None]
        if measurement.kind == "radar":
            values[1] = wrap_angle(values[1])
            values = values[[Radar.components.index(name) for name in config.components]]
        if self._first is None:
            self._first = measurement.stamp
        time = (measurement.stamp - self._first) / 1e6  # s, of microseconds
        scan = empty._replace(time=time, arrival_time=time, measurement=values, valid=np.ones(1, dtype=bool))
        used = self._served.config.sensors_used
        return scan if used is None or scan.sensor in used else empty_scan(scan)
