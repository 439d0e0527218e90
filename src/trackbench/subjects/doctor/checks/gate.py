"""Does a tracker that rejects a measurement take the target up again?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.exhibits import Course, OverTime
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Time without a measurement, and time of measurements after it, s: with a white acceleration of 1.5 m/s^2 the standard
#: deviation of the position is 4 m after 7 s of these, so that a gate of four opens.
GAP, AFTER = 3.0, 10.0
#: Least distance of the target from its prediction after the gap, m, and the same in the standard deviations of the
#: prediction: a target that braked or turned is as far.
LEAST, FAR = 15.0, 8.0
#: Share of that distance by which the estimate has to come nearer.
TAKEN_UP = 0.3


class Return(NamedTuple):
    """A target that is elsewhere after a gap."""

    probe: Probe
    away: float
    """m from the prediction."""
    sigma: float
    """Standard deviation of the predicted position, m."""
    distances: list[float]
    """Of the estimate from the target in the time after the gap, m, from the prediction on."""

    @property
    def left(self) -> float:
        """The least of them."""
        return min(self.distances)


def gate(tracker: TrackerUnderTest) -> PartResult:
    """Let targets be elsewhere after a gap, and measure them there."""
    returns = [one for probe in tracker.probes.general[:2] if (one := _return(tracker, probe)) is not None]
    if not returns:
        return PartResult().add("gate", None, "there was no estimate")
    worst = max(returns, key=lambda one: one.left / one.away)
    text = (
        f"of {worst.probe.description}, {worst.away:.3g} m from its prediction after {GAP:g} s without a measurement, "
        f"the estimate is {worst.left:.3g} m away at the nearest in {AFTER:g} s of measurements"
    )
    lost = worst.left > (1.0 - TAKEN_UP) * worst.away
    if not lost:
        return PartResult().add("gate", True, text)
    distance = np.array(worst.distances)
    taken_up = np.full(len(distance), (1.0 - TAKEN_UP) * worst.away)
    bounds = np.zeros(len(distance)), taken_up
    course = Course("distance from the target, m", distance, None, bounds, "taken up again")
    time = np.asarray(0.1 * np.arange(len(distance)))
    title = f"After a gap of {GAP:g} s: {worst.probe.description}"
    exhibit = OverTime(title, "time of measurements, s", time, (course,))
    evidence = f"{text}; its prediction stated a standard deviation of {worst.sigma:.3g} m"
    finding = Finding("gate_never_reopens", 0.95, evidence, shown_by="gap_in_a_turn", exhibit=exhibit)
    return PartResult().add("gate", False, text, finding)


def _return(tracker: TrackerUnderTest, probe: Probe) -> Return | None:
    sensor_set = tracker.sensor_sets()[-1]
    session = tracker.session_at(probe, sensor_set)
    if session is None:
        return None
    with tracker.recording_failures(probe.name):
        session = session.copy()
        asked = sensor_set[0]
        predicted = None
        if tracker.assumptions.no_misses:
            predicted = session.predict(probe.scan(asked, tracker.sensors[asked], GAP))
        else:
            for k in range(int(GAP * 10) + 1):
                predicted = session.step(empty_scan(probe.scan(asked, tracker.sensors[asked], 0.1 * k)))
        if predicted is None or not finite(predicted):
            return None
        sigma = float(np.sqrt(max(0.0, np.trace(predicted.covariance[:2, :2]))))
        away = max(LEAST, FAR * sigma)
        elsewhere = _moved(probe, predicted.mean[:2] - probe.truth(GAP)[:2], away)
        distances = [away]
        for k in range(1, int(AFTER * 10) + 1):
            time = GAP + 0.1 * k
            for name in sensor_set:
                estimate = session.step(elsewhere.scan(name, tracker.sensors[name], time))
            if estimate is not None and finite(estimate):
                distances.append(float(np.hypot(*(estimate.mean - elsewhere.truth(time))[:2])))
            if distances[-1] < (1.0 - TAKEN_UP) * away:
                break
        return Return(probe, away, sigma, distances)
    return None


def _moved(probe: Probe, error: np.ndarray, away: float) -> Probe:
    """The target with the same velocity, at a distance from its prediction, outward from the sensor."""
    px, py, vx, vy = probe.target
    outward = np.array([px + GAP * vx - probe.observer.x, py + GAP * vy - probe.observer.y])
    outward = outward / max(float(np.hypot(*outward)), 1e-9)
    shift = error + away * outward
    return probe._replace(target=(px + shift[0], py + shift[1], vx, vy))


GATE_CHECK = DoctorCheck(
    gate,
    place=200,
    questions=(Question("gate", "Is a target that is elsewhere after a gap taken up again?"),),
    asks_at_misses=True,
    faults={
        "gate_never_reopens": KnownFault(
            "a gate that has rejected the target rejects it for ever",
            "Where a measurement is held against a gate.",
            "Gate on y^T S^-1 y with S = H P H^T + R, let P grow at rejected measurements too, or start the track "
            "again.",
            Role("step", drive="gap_in_a_turn"),
        )
    },
)
