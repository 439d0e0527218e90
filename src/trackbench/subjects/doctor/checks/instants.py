"""Do all sensors' measurements count, at the time when they were taken, late ones too?"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.subjects.doctor.exhibits import Predictions, stated_belief, update_shown
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import StepFailed, TrackerSession, finite
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
#: A late scan is older than the latest one by its sensor's latency, within these, s.
LEAST, MOST = 0.1, 0.5
#: How near the estimate is to the one after a scan that counts as new, in shares of what that moves it by.
NEAR = 0.2
#: What a scan that counts as new has to move the estimate by to be told from one that is left out, m.
CLEAR = 0.05


@doctor_check(
    Question(
        "same_instant", "Do two sensors' measurements of one instant both count?", finds=("second_measurement_dropped",)
    ),
    Question(
        "same_time",
        "Is the estimate of one instant the same, whichever sensor's scan asks for it?",
        misses=True,
        finds=("time_offset",),
    ),
    place=170,
    of_filters=True,
    least_sensors=2,
    faults={
        "second_measurement_dropped": KnownFault(
            "of two measurements at one instant only the first is used",
            "Where a scan with the time of the last one (a time step of zero) returns early.",
            "With a time step of zero leave out the prediction alone, and make the update.",
            Role("exact", rank=27, always="measurement_ignored", drive="uneven_steps"),
        ),
        "time_offset": KnownFault(
            "the time of a sensor's measurements is off by a constant",
            "Where the time of a scan is read, and where a latency is taken off or added.",
            "scan.time is when the measurement was taken: predict to it, and add or subtract no latency.",
            Role("offset", rank=27, causes="measured growth angle sensor_bias scale_error", drive="tangential_pass"),
        ),
    },
)
def measurements_of_one_instant(tracker: TrackerUnderTest) -> PartResult:
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
    before, scan = (tracker.scan(probe, name, 0.0) for name in (first, second))
    with tracker.recording_failures(probe.name):
        after = None if session is None else session.copy()
        estimate = None if after is None else after.step(before)
        if after is not None and estimate is not None and finite(estimate):
            trial = Trial(probe.name, probe.description, scan, estimate, after)
            return update_shown(trial, _beside(scan).measurement)
    return None


def _counts(tracker: TrackerUnderTest, probe: Probe, session: TrackerSession, first: str, second: str) -> bool | None:
    """Whether the second of two measurements moves the estimate; None where it does not if it comes alone either."""
    before, scan = (tracker.scan(probe, name, 0.0) for name in (first, second))
    alone = _moved_by(session, scan)
    after = session.copy()
    after.step(before)
    both = _moved_by(after, scan)
    if alone is None or both is None or alone <= NOTHING:
        return None
    return both > NOTHING * alone


def _moved_by(session: TrackerSession, scan: Scan) -> float | None:
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
            estimates = [session.peek(tracker.missed(probe, name, 0.5)) for name in names]
            for name, estimate in zip(names[1:], estimates[1:], strict=True):
                if estimate is not None and estimates[0] is not None and finite(estimate) and finite(estimates[0]):
                    lags[name] += _lag(estimates[0].mean, estimate.mean)
                    title = f"Estimate of one instant, asked for by two sensors: {probe.description}"
                    own, other = (
                        stated_belief(f"by a scan of {name}", estimate),
                        stated_belief(f"by one of {names[0]}", estimates[0]),
                    )
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


@doctor_check(
    Question(
        "late",
        "Are late measurements held against where the target was?",
        "Are late measurements of {sensor} held against where the target was?",
        each_sensor=True,
        misses=True,
    ),
    place=220,
    late_sensors=True,
    faults={
        "late_processed_as_new": KnownFault(
            "a late measurement is processed as if it were new",
            "Where the time since the last scan is computed, and where the time of a scan is read.",
            "Compare scan.time with the state's time: drop an older scan, or go back to its time; arrival_time is not "
            "its time.",
            Role(drive="uneven_steps"),
        )
    },
)
def late_measurements(tracker: TrackerUnderTest) -> PartResult:
    """Give old scans without noise, of sensors that the scenario says are late: they add nothing that is not known."""
    result = PartResult()
    for name, latency in tracker.late.items():
        age = float(np.clip(latency, LEAST, MOST))
        try:
            moves = [_moves(tracker, probe, name, age) for probe in tracker.probes.regular]
        except StepFailed as failure:
            text = f"it raises at a scan that is older by {age:g} s than the one before: {failure}"
            result.add(f"late.{name}", None, text)
            continue
        clear = [move for move in moves if move is not None and np.hypot(*move.new) > CLEAR]
        as_new = [move for move in clear if np.hypot(*(move.late - move.new)) < NEAR * np.hypot(*move.new)]
        if not clear:
            result.add(f"late.{name}", None, "no scan of it moves the estimate")
            continue
        faulty = 2 * len(as_new) > len(clear)
        shown = max(as_new if faulty else clear, key=lambda move: float(np.hypot(*move.new)))
        text = (
            f"after a scan that is older by {age:g} s than the one before, {shown.probe.description} is estimated "
            f"{np.hypot(*shown.late):.2f} m from where it was without; if the scan were new that would be "
            f"{np.hypot(*shown.new):.2f} m ({len(as_new)} of {len(clear)} probes as if new)"
        )
        where, exhibit = shown.probe.name, shown.exhibit(age)
        finding = Finding("late_processed_as_new", 0.95, text, sensor=name, shown_by=where, exhibit=exhibit)
        result.add(f"late.{name}", not faulty, text, finding if faulty else None)
    return result


class _Moves(NamedTuple):
    """How far the position goes by an old scan, ``(2,)`` m."""

    probe: Probe
    late: Array
    """Given late."""
    new: Array
    """Given as if it were new."""
    estimates: tuple[Estimate, Estimate]
    """Without the scan, and with it given late."""

    def exhibit(self, age: float) -> Predictions:
        """The estimate with the late scan beside that without it, from which it should hardly differ."""
        without, after = self.estimates
        title = f"After a scan that is older by {age:g} s: {self.probe.description}"
        return Predictions(title, None, stated_belief("tracker", after), stated_belief("without the scan", without))


def _moves(tracker: TrackerUnderTest, probe: Probe, name: str, age: float) -> _Moves | None:
    """None where there is no estimate.

    Raises:
        StepFailed: the tracker raises at the late scan.
    """
    session = tracker.session_at(probe, tracker.sensor_sets()[-1])
    if session is None:
        return None
    latest = tracker.approach(probe, tracker.sensor_sets()[-1])[-1].time
    old = tracker.scan(probe, name, latest - age)._replace(arrival_time=latest)
    before, after, new = session.copy(), session.copy(), session.copy()
    after.step(old)
    new.step(old._replace(time=latest))
    asking = tracker.missed(probe, name, 0.0)._replace(asked=True)
    plain, late, as_new = (of.step(asking) for of in (before, after, new))
    if plain is None or late is None or as_new is None:
        return None
    return _Moves(probe, late.mean[:2] - plain.mean[:2], as_new.mean[:2] - plain.mean[:2], (plain, late))
