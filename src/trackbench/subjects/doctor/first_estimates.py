"""The first estimates of tracks: of all targets at once where the tracker takes a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.subjects.doctor.probes import Probe, probe_rate
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Number of scans in which a track has to start.
SCANS = 16


class FirstEstimate(NamedTuple):
    """The first estimate of a track."""

    probe: Probe
    scan: Scan
    estimate: Estimate
    truth: Array
    """``(4,)`` at that time."""
    given: list[Scan]
    """The scans up to that time."""


class Approach(NamedTuple):
    """A target as one sensor measures it from time 0 on."""

    probe: Probe
    name: str
    """Of the sensor."""
    sensor: Sensor
    noise: Array
    """``(SCANS, m)`` of the measurements, in standard deviations."""

    def time(self, k: int) -> float:
        """Of a scan, s."""
        return k / probe_rate(self.sensor)

    def scan(self, k: int) -> Scan:
        """The scan of this number."""
        scan = self.probe.scan(self.name, self.sensor, self.time(k))
        return scan._replace(measurement=scan.measurement + np.sqrt(np.diag(scan.noise_covariance)) * self.noise[k])


def first_estimates(
    tracker: TrackerUnderTest, probes: Sequence[Probe], name: str, random: np.random.Generator | None = None
) -> list[FirstEstimate | None]:
    """Start a track of each target with one sensor; None where it fails or does not start.

    Args:
        tracker: starts them.
        probes: the targets, all with the same observer.
        name: of the sensor.
        random: draws the noise of the measurements, which is the same for every tracker; without it there is none.
    """
    sensor = tracker.sensors[name]
    size = (len(probes), SCANS, len(SENSOR_MODELS[sensor.type].components))
    noise = np.zeros(size) if random is None else random.standard_normal(size)
    targets = [Approach(probe, name, sensor, own) for probe, own in zip(probes, noise, strict=True)]
    if tracker.batched:
        try:
            return _started(tracker, targets)
        except StepFailed as failure:
            if failure.fault.kind == "died":
                tracker.failures.append((probes[0].name, failure))
                return [None] * len(probes)
            # It tells not in which column it failed.
    found: list[FirstEstimate | None] = []
    for one in targets:
        with tracker.recording_failures(one.probe.name):
            found += _started(tracker, [one])
            continue
        found.append(None)
    return found


def _started(tracker: TrackerUnderTest, targets: Sequence[Approach]) -> list[FirstEstimate | None]:
    session = TrackerSession(tracker.make, len(targets))
    found: list[FirstEstimate | None] = [None] * len(targets)
    for k in range(SCANS):
        scans = [one.scan(k) for one in targets]
        for i, estimate in enumerate(session.step_each(scans)):
            if found[i] is None and estimate is not None:
                probe, time = targets[i].probe, targets[i].time(k)
                found[i] = FirstEstimate(probe, scans[i], estimate, probe.truth(time), session.given_to(i))
        if None not in found:
            break
    return found
