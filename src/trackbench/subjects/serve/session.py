"""One client's tracker, its truth and the running RMSE."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array, Observer, Scan
from trackbench.base.units import wrap_angle
from trackbench.driving.drive import empty_scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.driving.start import ending, start_stepper
from trackbench.driving.steppers import ForeignTracker
from trackbench.metrics.consistency import normalised_square
from trackbench.metrics.sums import OVERFLOW
from trackbench.models.sensors import Lidar, Radar, sensor_type
from trackbench.scenario import Scenario
from trackbench.sensing.view import sensor_motion, silent
from trackbench.subjects.serve.protocol import Marker
from trackbench.trackers.answers import GIVEN_UP, NOT_DEFINITE, NOT_FINITE, TOO_LARGE, TrackerFault
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.late import LateScans
from trackbench.truth.config import FixedObserver
from trackbench.truth.recorded.udacity import Measurement

#: In a second.
MICROSECONDS = 1e6


class TrackerFailed(Exception):
    """The tracker cannot go on; when and why."""


class ServedSensor(NamedTuple):
    """A sensor of the scenario."""

    config: Lidar | Radar
    scan: Scan
    """At time 0, without a measurement; its pose is in the simulator's frame."""


@dataclass(frozen=True)
class Served:
    """A scenario's tracker, which every session makes afresh, and the sensors that it reads."""

    name: str
    config: FilterConfig | PluginConfig
    folder: Path
    sensors: Mapping[str, ServedSensor]
    """The scenario's lidar and radar by kind."""
    isolation: Isolation

    def stepper(self) -> Any:
        """Start a fresh tracker.

        Raises:
            InputError: it starts from the truth, or is a plug-in that does not start.
        """
        return start_stepper(self.config, self.folder, 1, _refuse_truth, self.isolation)


def served(loaded: Scenario, name: str, isolation: Isolation = ISOLATED) -> Served:
    """Return the tracker of that name, started once to see that it can be.

    Raises:
        InputError: no such tracker, it cannot start, or not one lidar and one radar at most.
    """
    config = loaded.config
    if name not in config.trackers:
        hint = nearest_choices(name, config.trackers)
        raise InputError(f"no tracker {name!r} in this scenario; {hint}", file=loaded.path)
    if config.sensing.identities == "hidden":
        message = "hidden, and the simulator's client asks for one object; serve a tracker of known identities"
        raise loaded.locate(InputError(message, key="sensing.identities"))
    sensors: dict[str, ServedSensor] = {}
    for sensor_name, sensor in config.sensors.items():
        kind = sensor_type(sensor.type)
        if kind in sensors:
            message = f"a second {kind} beside {sensors[kind].scan.sensor}; the simulator has one lidar and one radar"
            raise loaded.locate(InputError(message, key=f"sensors.{sensor_name}"))
        if isinstance(sensor, Lidar | Radar):
            sensors[kind] = _served_sensor(sensor_name, sensor, getattr(config.truth, "observer", None))
    if not sensors:
        raise loaded.locate(InputError("no lidar and no radar, which is what the simulator has", key="sensors"))
    checked = Served(name, config.driven(name), loaded.folder, sensors, isolation)
    try:
        with ending(checked.stepper()):
            pass
    except (InputError, TrackFault) as error:
        message = error.message if isinstance(error, InputError) else str(error)
        raise loaded.locate(InputError(message, key=f"trackers.{name}")) from error
    return checked


def _served_sensor(name: str, config: Lidar | Radar, observer: object) -> ServedSensor:
    """Return a sensor at rest in the simulator's origin, unless the scenario puts it elsewhere."""
    at = observer if isinstance(observer, FixedObserver) else FixedObserver()
    x, y, yaw, rest = (np.array([value]) for value in (at.x, at.y, np.deg2rad(at.yaw_deg), 0.0))
    pose = sensor_motion(Observer(x, y, yaw, rest, rest, rest), config.mount).pose[:, 0]
    noise, nothing = config.noise_covariance(), np.full((len(config.components), 1), np.nan)
    scan = Scan(0.0, name, config.type, nothing, np.zeros(1, dtype=bool), noise, pose, np.zeros(2), 0.0)
    for shared in (noise, pose, scan.sensor_velocity):
        # One client's tracker must not change what another's reads.
        shared.setflags(write=False)
    return ServedSensor(config, scan)


def _refuse_truth(tracker: LateScans) -> LateScans:
    if tracker.starts_from_truth:
        raise InputError("starts from the truth, which a live client does not have; use initial: two_measurements")
    return tracker


class Session:
    """One data set of one client. Every estimate counts in the RMSE, from the first on.

    Attributes:
        measurements: number of measurements so far.
        estimates: number of estimates so far.
    """

    def __init__(self, served: Served) -> None:
        """Start a fresh tracker.

        Raises:
            TrackerFailed: a plug-in does not start again.
        """
        self._served = served
        try:
            self._stepper, self._state = served.stepper(), None
        except (Exception, SystemExit) as error:
            raise TrackerFailed(f"to start: {fault_of(error)}") from error
        self._first: int | None = None
        self._squares = np.zeros(4)
        self.measurements = 0
        self.estimates = 0

    @property
    def rmse(self) -> Array:
        """``(4,)`` px, py m, vx, vy m/s; NaN before the first estimate."""
        return np.sqrt(self._squares / self.estimates) if self.estimates else np.full(4, np.nan)

    def take(self, measurement: Measurement) -> Marker | None:
        """Return the estimate after a measurement, or None while there is none.

        Args:
            measurement: not older than the one before; its kind is one that the scenario has.

        Raises:
            TrackerFailed: the tracker raised, or what it gave is not an estimate.
        """
        self.measurements += 1
        try:
            mean = self._estimate(self._scan(measurement))
            if mean is None:
                return None
            self._squares += (mean - measurement.truth) ** 2
            if not self._squares.max() < OVERFLOW:
                raise TrackerFault(TOO_LARGE)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise TrackerFailed(f"at measurement {self.measurements}: {fault_of(error)}") from error
        self.estimates += 1
        return Marker(float(mean[0]), float(mean[1]), *map(float, self.rmse))

    def close(self) -> None:
        """End the tracker."""
        if isinstance(self._stepper, ForeignTracker):
            self._stepper.close()

    def _estimate(self, scan: Scan) -> Array | None:
        """Return the mean of the tracker's estimate, checked as the runner checks estimates."""
        with np.errstate(all="ignore"):
            self._state, estimate = self._stepper.step(self._state, scan)
        if estimate is None or not np.isfinite(estimate.mean.sum() + estimate.covariance.sum()):
            if self.estimates:
                raise TrackerFault(GIVEN_UP if estimate is None else NOT_FINITE)
            return None
        if not normalised_square(estimate.mean, estimate.covariance)[2].all():
            raise TrackerFault(NOT_DEFINITE)
        return np.asarray(estimate.mean[:, 0])

    def _scan(self, measurement: Measurement) -> Scan:
        sensor = self._served.sensors[measurement.kind]
        values = np.array(measurement.measurement)[:, None]
        if measurement.kind == "radar":
            values[1] = wrap_angle(values[1])
            values = values[[Radar.components.index(name) for name in sensor.config.components]]
        if self._first is None:
            self._first = measurement.stamp
        time = (measurement.stamp - self._first) / MICROSECONDS
        valid = ~silent(sensor.config, np.array([time]))
        values = np.where(valid, values, np.nan)
        scan = sensor.scan._replace(time=time, arrival_time=time, measurement=values, valid=valid)
        named = self._served.config.sensors_used
        return scan if named is None or scan.sensor in named else empty_scan(scan)
