"""What the agent is told of the other vehicles: the truth, detections as they are, or the tracks of a tracker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import SAME_TIME, Tracks, Truth
from trackbench.driving.drive import empty_scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.isolation import Isolation
from trackbench.driving.remote import fresh_tracks
from trackbench.driving.steppers import Stepper
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.subjects.gym.sensing import SensedScan
from trackbench.trackers.answers import tracks_of_run
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.initial import InitialConfig, start_tracks

NOTHING = Tracks(np.zeros(0, dtype=np.intp), np.zeros((4, 0)), np.zeros((4, 4, 0)))


class Perception(Protocol):
    """What is known of the other vehicles."""

    def begin(self) -> None:
        """An episode begins."""

    def take(self, scans: list[SensedScan], truth: Truth) -> Tracks:
        """What is known at the last step of the truth, after scans that have arrived until then."""

    def close(self) -> None:
        """It is no longer needed."""


class KnownTruth:
    """Every vehicle as it is: the reference."""

    def begin(self) -> None:
        """Nothing is remembered."""

    def take(self, scans: list[SensedScan], truth: Truth) -> Tracks:
        """The vehicles that are there, with no uncertainty."""
        there = np.flatnonzero(truth.alive[-1])
        mean = np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, -1, there, 0]
        return Tracks(there, mean, np.zeros((4, *mean.shape)), np.ones(len(there)))

    def close(self) -> None:
        """Nothing is left."""


class BareDetections:
    """The detections of the latest scan of each sensor, each as a track that starts with it would be.

    Where a sensor measures the range rate, the velocity is that along the line of sight; else it is zero.
    """

    def __init__(self) -> None:
        self._config, self._motion = InitialConfig(), ConstantVelocity(acceleration_sigma_mps2=1.0)

    def begin(self) -> None:
        """No sensor has measured."""
        self._latest: dict[str, Tracks] = {}

    def take(self, scans: list[SensedScan], truth: Truth) -> Tracks:
        """Those of the latest scans."""
        for item in scans:
            scan = item.scan._replace(measurement=item.scan.measurement[..., 0], valid=item.scan.valid[..., 0])
            mean, covariance = start_tracks(self._config, scan, None).state_of(self._motion)
            self._latest[scan.sensor] = Tracks(np.full(mean.shape[1], -1), mean, covariance)
        parts = [NOTHING, *self._latest.values()]
        return Tracks(*(np.concatenate([part[i] for part in parts], axis=-1) for i in range(3)))

    def close(self) -> None:
        """Nothing is left."""


class Tracked:
    """The tracks of a tracker of several objects.

    Args:
        name: of the tracker.
        config: its entry in a scenario.
        folder: where its module is looked for first.
        isolation: whether it gets a process of its own.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackbenchError: its process ended.
    """

    def __init__(
        self, name: str, config: FilterConfig | PluginConfig, folder: Path | None, isolation: Isolation
    ) -> None:
        self._name, self._sensors = name, config.sensors_used
        try:
            self._make: Callable[[], Stepper] | None = fresh_tracks(config, folder, isolation)
        except TrackFault as fault:
            raise self._failed(fault) from fault
        self._tracker: Stepper | None = None
        self._last: SensedScan | None = None

    def begin(self) -> None:
        """A fresh tracker."""
        if self._make is None:
            raise TrackbenchError("the environment is closed")
        self._last = None
        try:
            self._tracker = self._make()
        except TrackFault as fault:
            raise self._failed(fault) from fault

    def take(self, scans: list[SensedScan], truth: Truth) -> Tracks:
        """Its tracks now.

        Raises:
            TrackbenchError: it failed.
        """
        now, answer = float(truth.time[-1]), NOTHING
        for item in scans:
            self._last = item
            read = self._sensors is None or item.scan.sensor in self._sensors
            answer = self._step(item if read else SensedScan(empty_scan(item.scan), item.origins[:, :0]))
        if self._last is not None and abs(self._last.scan.time - now) > SAME_TIME:
            answer = self._step(self._question(self._last, now))
        return answer

    def close(self) -> None:
        """End its process."""
        if self._tracker is not None:
            self._tracker.close()
        self._tracker = self._make = None

    @staticmethod
    def _question(last: SensedScan, now: float) -> SensedScan:
        """A scan without detections that asks for the tracks of now."""
        scan = empty_scan(last.scan)._replace(time=now, arrival_time=now, asked=True)
        return SensedScan(scan, last.origins[:, :0])

    def _step(self, item: SensedScan) -> Tracks:
        assert self._tracker is not None
        try:
            return tracks_of_run(self._tracker.step(item.scan, item.origins), 0)
        except Exception as error:
            raise self._failed(fault_of(error)) from error

    def _failed(self, fault: TrackFault) -> TrackbenchError:
        return TrackbenchError(f"the tracker {self._name} failed: {fault}")
