"""Are the first estimate of a track and its covariance right?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.subjects.doctor.findings import PROVEN, Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe, probe_rate
from trackbench.subjects.doctor.session import StepFailed, TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Largest NEES of the first estimate, relative to its expectation; 4 with standard deviations of half the right ones.
OVERCONFIDENT = 6.0
#: Median of a chi-square variable with 2 degrees of freedom.
MEDIAN = 1.39
#: Number of tracks for the NEES.
STARTS = 60
#: Least velocity of the sensor along the line of sight that counts, and largest difference of equal velocities, m/s.
OWN, SAME = 2.0, 0.5
#: Other orders of an estimate, and the indices of px, py, vx, vy in them.
ORDERS = {"px, vx, py, vy": [0, 2, 1, 3], "vx, vy, px, py": [2, 3, 0, 1]}
#: Number of scans within which a track has to start.
SCANS = 16


class FirstEstimate(NamedTuple):
    """First estimate of a track, with the true state and the scans until then."""

    probe: Probe
    scan: Scan
    estimate: Estimate
    truth: Array
    """True px, py, vx, vy ``(4,)`` at the time of the scan."""
    scans: list[Scan]
    """Scans up to the time of the first estimate."""


class Approach(NamedTuple):
    """A target with its noisy measurements by one sensor from time 0 on."""

    probe: Probe
    name: str
    """Name of the sensor."""
    sensor: Sensor
    noise: Array
    """Noise ``(scans, m)`` of the measurements, in standard deviations."""

    def time(self, k: int) -> float:
        """Return the time of the scan with index ``k``, from 0, in s."""
        return k / probe_rate(self.sensor)

    def scan(self, k: int) -> Scan:
        scan = self.probe.scan(self.name, self.sensor, self.time(k))
        return scan._replace(measurement=scan.measurement + np.sqrt(np.diag(scan.noise_covariance)) * self.noise[k])


def first_estimates(
    tracker: TrackerUnderTest, probes: Sequence[Probe], name: str, random: np.random.Generator | None = None
) -> list[FirstEstimate | None]:
    """Return the first estimate of a track of each target with one sensor; None where a track fails or never starts.

    Args:
        tracker: tracker whose tracks start.
        probes: targets, all with the same observer.
        name: name of the sensor.
        random: source of the measurement noise, which is the same for every tracker; None for no noise.
    """
    sensor = tracker.sensors[name]
    size = (len(probes), SCANS, len(SENSOR_MODELS[sensor.type].components))
    noise = np.zeros(size) if random is None else random.standard_normal(size)
    targets = [Approach(probe, name, sensor, of_target) for probe, of_target in zip(probes, noise, strict=True)]
    if tracker.batched:
        try:
            return _start_tracks(tracker, targets)
        except StepFailed as failure:
            if failure.fault.kind == "died":
                tracker.failures.append((probes[0].name, failure))
                return [None] * len(probes)
            # A failed step does not say in which column it failed.
    firsts: list[FirstEstimate | None] = []
    for target in targets:
        firsts.append(None)
        with tracker.recording_failures(target.probe.name):
            firsts[-1] = _start_tracks(tracker, [target])[0]
    return firsts


def _start_tracks(tracker: TrackerUnderTest, targets: Sequence[Approach]) -> list[FirstEstimate | None]:
    session = TrackerSession(tracker.make, len(targets))
    firsts: list[FirstEstimate | None] = [None] * len(targets)
    for k in range(SCANS):
        scans = [target.scan(k) for target in targets]
        for i, estimate in enumerate(session.step_each(scans)):
            if firsts[i] is None and estimate is not None:
                probe, time = targets[i].probe, targets[i].time(k)
                firsts[i] = FirstEstimate(probe, scans[i], estimate, probe.truth(time), session.scans_of(i))
        if None not in firsts:
            break
    return firsts


@doctor_check(
    Question(
        "start",
        "Do tracks start at the target?",
        "Do tracks that start with {sensor} start at the target?",
        each_sensor=True,
    ),
    place=30,
    faults={
        "state_order": KnownFault(
            "the components of the estimate are in another order",
            "Where the estimate is returned.",
            "Return px, py, vx, vy, and the covariance in that order: covariance[np.ix_(order, order)].",
            Role("exact", rank=1, drive="tangential_pass"),
        )
    },
)
def first_position(tracker: TrackerUnderTest) -> PartResult:
    """Start tracks without noise at many probes with each sensor alone, and compare first positions with the truth."""
    result = PartResult()
    for name, sensor in tracker.sensors.items():
        firsts = first_estimates(tracker, tracker.probes.general, name)
        for probe in tracker.probes.moving:
            firsts += first_estimates(tracker, (probe,), name)
        started = [first for first in firsts if first is not None and finite(first.estimate)]
        if not started:
            result.add(f"start.{name}", None, "no track started")
            continue
        misplaced = [first for first in started if _error(first) > _allowed(first)]
        worst = max(started, key=_error)
        text = f"{len(misplaced)} of {len(started)} tracks start elsewhere; the largest error is {_error(worst):.3g} m"
        finding = _another_order(misplaced) if 2 * len(misplaced) > len(started) else None
        if finding is None and sensor.type == "radar":
            finding = _own_velocity(name, started)
        result.add(f"start.{name}", not misplaced and finding is None, text, finding)
    return result


def _another_order(firsts: Sequence[FirstEstimate]) -> Finding | None:
    """Report first estimates that are at their targets once px, py, vx, vy are read in a different order."""
    for names, order in ORDERS.items():
        errors = [np.hypot(*(first.estimate.mean[order] - first.truth)[:2]) for first in firsts]
        if all(error < _allowed(first) for error, first in zip(errors, firsts, strict=True)):
            states = (firsts[0].estimate.mean, firsts[0].truth)
            mean, truth = (", ".join(f"{value:.3g}" for value in state[:4]) for state in states)
            text = f"the first estimate {mean} is {names} of a target with px, py, vx, vy = {truth} "
            text += f"({len(firsts)} tracks)"
            return Finding("state_order", PROVEN, text, shown_by="tangential_pass")
    return None


def _error(first: FirstEstimate) -> float:
    return float(np.hypot(*(first.estimate.mean - first.truth)[:2]))


def _allowed(first: FirstEstimate) -> float:
    position = SENSOR_MODELS[first.scan.kind].position(first.scan).covariance
    return 3.0 * float(np.sqrt(np.trace(position)))


def _own_velocity(name: str, started: list[FirstEstimate]) -> Finding | None:
    """Report first velocities off by one or two times the sensor's own velocity along the line of sight."""
    seen = [(first, _along(first, first.scan.sensor_velocity)) for first in started]
    moving = [(first, ego) for first, ego in seen if abs(ego) > OWN]
    for times, words in ((1.0, "left out"), (2.0, "added, and is to be subtracted")):
        errors = [(_along(first, first.estimate.mean[2:] - first.truth[2:]), ego, first) for first, ego in moving]
        if len(errors) < 2 or any(
            abs(error + times * ego) > SAME or not _is_significant(first, error) for error, ego, first in errors
        ):
            continue
        error, ego, first = max(errors, key=lambda entry: abs(entry[0]))
        text = (
            f"the first velocity from {name} is off by {error:+.3g} m/s along the line of sight where the sensor moves "
            f"at {ego:+.3g} m/s along it: its own velocity is {words} ({len(errors)} of {len(moving)} tracks)"
        )
        fault = "ego_motion_ignored" if times == 1.0 else "ego_motion_wrong"
        return Finding(fault, 0.92, text, sensor=name, shown_by=first.probe.name)
    return None


def _along(first: FirstEstimate, vector: Array) -> float:
    """Return the component of a vector along the line of sight from the sensor to the target."""
    sight = first.truth[:2] - first.scan.sensor_pose[:2]
    return float(vector @ sight / np.hypot(*sight))


def _is_significant(first: FirstEstimate, error: float) -> bool:
    """Return whether a velocity error along the line of sight exceeds 2 of the estimate's standard deviations."""
    sight = first.truth[:2] - first.scan.sensor_pose[:2]
    variance = sight @ first.estimate.covariance[2:, 2:] @ sight / (sight @ sight)
    return bool(error**2 > 4.0 * variance)


@doctor_check(
    Question("start_confidence", "Is the first covariance as large as the first errors?"),
    place=50,
    of_own_covariance=True,
    faults={
        "overconfident_start": KnownFault(
            "the first covariance is too small",
            "Where the first covariance of a track is set.",
            "Give what the first measurements do not determine the spread of real targets: 20 m/s for the velocity of "
            "cars.",
            Role(drive="stationary"),
        )
    },
)
def confidence(tracker: TrackerUnderTest) -> PartResult:
    """Start tracks of targets with many velocities, with noise, and compute the NEES of the first estimates."""
    random = np.random.default_rng([tracker.seed, 0])
    nees: dict[str, list[Array]] = {name: [] for name in tracker.sensors}
    probes = [_random_target(random).placed(tracker.probes.site) for _ in range(STARTS)]
    for name in tracker.sensors:
        for first in first_estimates(tracker, probes, name, random):
            if first is None:
                continue
            tracker.output_checks.add(first.estimate, first.scan, first.probe.name, first.scans)
            if finite(first.estimate):
                nees[name].append(_nees_of_parts(first))
    by_sensor = {name: np.array(values) for name, values in nees.items() if len(values) > STARTS // 2}
    if not by_sensor:
        return PartResult().add("start_confidence", None, "no track started")
    means = {name: (np.mean(values, axis=0), np.median(values, axis=0)) for name, values in by_sensor.items()}
    text = "; ".join(
        f"{name}: mean NEES {mean[0]:.3g} of the first position and {mean[1]:.3g} of the first velocity (expected: 2)"
        for name, (mean, _) in means.items()
    )
    ratios = {name: max(mean / 2) for name, (mean, median) in means.items() if max(median / MEDIAN) > OVERCONFIDENT}
    if not ratios:
        return PartResult().add("start_confidence", True, text)
    name = max(ratios, key=lambda item: ratios[item])
    shown_by = tracker.probes.general[0].name
    finding = Finding("overconfident_start", 0.9, text, factor=1 / ratios[name], shown_by=shown_by)
    return PartResult().add("start_confidence", False, text, finding)


def _random_target(random: np.random.Generator) -> Probe:
    bearing, course = random.uniform(-np.pi, np.pi, 2)
    distance, speed = random.uniform(15.0, 150.0), random.uniform(3.0, 30.0)
    target = (distance * np.cos(bearing), distance * np.sin(bearing), speed * np.cos(course), speed * np.sin(course))
    return Probe("start", "a random target at its first measurement", target)


def _nees_of_parts(first: FirstEstimate) -> Array:
    error, covariance = first.estimate.mean - first.truth, first.estimate.covariance
    p = 0.5 * (covariance + covariance.T)
    return np.array([error[part] @ np.linalg.pinv(p[part, part]) @ error[part] for part in (slice(0, 2), slice(2, 4))])
