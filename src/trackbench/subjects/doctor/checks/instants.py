"""Do all sensors' measurements count, and at the time when they were taken?"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.exhibits import Predictions
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.right_answers import named, update_shown
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: Distance of a measurement from where it is expected, in its standard deviations: within every gate.
ASIDE = 2.0
#: Share of what the measurement alone moves the estimate by, below which it does not count: rounding.
NOTHING = 1e-9
#: Difference between two sensors' times that is found, s; the finite range of a probe's velocity hides less.
APART = 5e-3
#: Speed of a target from which on a time can be told from a position, m/s.
MOVING = 3.0


def instants(tracker: TrackerUnderTest) -> PartResult:
    """Give measurements of two sensors at one instant, and ask for the estimate of one instant by each sensor."""
    result = PartResult()
    if len(tracker.sensors) > 1:
        _same_instant(tracker, result)
        _same_time(tracker, result)
    return result


def _same_instant(tracker: TrackerUnderTest, result: PartResult) -> None:
    kept: dict[tuple[str, str], list[bool]] = {}
    for probe in tracker.probes.general[:3]:
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        for first, second in permutations(tracker.sensors, 2):
            with tracker.recording_failures(probe.name):
                counts = None if session is None else _counts(tracker, probe, session, first, second)
                if counts is not None:
                    kept.setdefault((first, second), []).append(counts)
    dropped = [pair for pair, counts in kept.items() if not any(counts)]
    if not dropped:
        passed, text = (True, f"yes, in {len(kept)} orders of two sensors") if kept else (None, "there was no estimate")
        result.add("same_instant", passed, text)
        return
    first, second = dropped[0]
    text = (
        f"a measurement of {second} that comes after one of {first} with the same time does not move the estimate "
        f"({len(kept[dropped[0]])} of {len(kept[dropped[0]])} trials); it does if it comes alone"
    )
    sensor = second if len({pair[1] for pair in dropped}) == 1 else None
    fault, exhibit = "second_measurement_dropped", _dropped_shown(tracker, first, second)
    finding = Finding(fault, 0.98, text, sensor=sensor, shown_by="uneven_steps", exhibit=exhibit)
    result.add("same_instant", False, text, finding)


def _dropped_shown(tracker: TrackerUnderTest, first: str, second: str) -> Predictions | None:
    """The update by the second measurement, beside the first one, and the right one."""
    probe = tracker.probes.general[0]
    session = tracker.session_at(probe, tracker.sensor_sets()[-1])
    before, scan = (probe.scan(name, tracker.sensors[name], 0.0) for name in (first, second))
    with tracker.recording_failures(probe.name):
        after = None if session is None else session.copy()
        estimate = None if after is None else after.step(before)
        if after is not None and estimate is not None and finite(estimate):
            trial = Trial(probe.name, probe.description, scan, estimate, after)
            return update_shown(trial, _beside(scan).measurement)
    return None


def _counts(tracker: TrackerUnderTest, probe: Probe, session: TrackerSession, first: str, second: str) -> bool | None:
    """Whether the second of two measurements moves the estimate; None where it does not if it comes alone either."""
    before, scan = (probe.scan(name, tracker.sensors[name], 0.0) for name in (first, second))
    alone = _moves(session, scan)
    after = session.copy()
    after.step(before)
    both = _moves(after, scan)
    if alone is None or both is None or alone <= NOTHING:
        return None
    return both > NOTHING * alone


def _moves(session: TrackerSession, scan: Scan) -> float | None:
    """How far the estimates are apart after a measurement and after another one beside it, m and m/s."""
    one, other = session.peek(scan), session.peek(_beside(scan))
    if one is None or other is None or not (finite(one) and finite(other)):
        return None
    return float(np.abs(one.mean - other.mean).max())


def _beside(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement + ASIDE * np.sqrt(np.diag(scan.noise_covariance)))


def _same_time(tracker: TrackerUnderTest, result: PartResult) -> None:
    """Ask for the estimate of one instant by missed scans of each sensor."""
    names = tuple(tracker.sensors)
    lags: dict[str, list[float]] = {name: [] for name in names[1:]}
    shown: dict[str, Predictions] = {}
    for probe in tracker.probes.general:
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        if session is None:
            continue
        with tracker.recording_failures(probe.name):
            # Later than every scan before, also by a clock that is off.
            estimates = [session.peek(empty_scan(probe.scan(name, tracker.sensors[name], 0.5))) for name in names]
            for name, estimate in zip(names[1:], estimates[1:], strict=True):
                if estimate is not None and estimates[0] is not None and finite(estimate) and finite(estimates[0]):
                    lags[name] += _lag(estimates[0].mean, estimate.mean)
                    title = f"Estimate of one instant, asked for by two sensors: {probe.description}"
                    own, other = named(f"by a scan of {name}", estimate), named(f"by one of {names[0]}", estimates[0])
                    shown.setdefault(name, Predictions(title, None, own, other))
    known = {name: np.array(found) for name, found in lags.items() if len(found) >= 3}
    if not known:
        result.add("same_time", None, "there was no moving estimate")
        return
    name = max(known, key=lambda item: abs(float(np.median(known[item]))))
    lag = float(np.median(known[name]))
    text = f"by a scan of {name} the target is {1e3 * lag:+.3g} ms of its motion from where it is by one of {names[0]}"
    apart = abs(lag) > APART and float(np.mean(np.abs(known[name] - lag) < 0.3 * abs(lag))) > 0.7
    words = f"{text} (median of {len(known[name])} trials): the times of one of the two sensors are off by that"
    finding = Finding("time_offset", 0.97, words, shown_by="tangential_pass", exhibit=shown[name])
    result.add("same_time", not apart, text, finding if apart else None)


def _lag(one: Array, other: Array) -> list[float]:
    """The time by which another estimate is ahead along the velocity, s."""
    speed = float(np.hypot(*one[2:]))
    return [float((other - one)[:2] @ one[2:]) / speed**2] if speed > MOVING else []


INSTANTS_CHECK = DoctorCheck(
    instants,
    place=170,
    questions=(
        Question(
            "same_instant",
            "Do two sensors' measurements of one instant both count?",
            finds=("second_measurement_dropped",),
        ),
        Question(
            "same_time",
            "Is the estimate of one instant the same, whichever sensor's scan asks for it?",
            misses=True,
            finds=("time_offset",),
        ),
    ),
    of_filters=True,
    least_sensors=2,
    faults={
        "second_measurement_dropped": KnownFault(
            "of two measurements at one instant only the first is used",
            "Where a scan with the time of the last one (a time step of zero) returns early.",
            "With a time step of zero leave out the prediction alone, and make the update.",
            Role("exact", rank=28, always="measurement_ignored", drive="uneven_steps"),
        ),
        "time_offset": KnownFault(
            "the time of a sensor's measurements is off by a constant",
            "Where the time of a scan is read, and where a latency is taken off or added.",
            "scan.time is when the measurement was taken: predict to it, and add or subtract no latency.",
            Role("offset", rank=27, causes="measured growth angle sensor_bias scale_error", drive="tangential_pass"),
        ),
    },
)
