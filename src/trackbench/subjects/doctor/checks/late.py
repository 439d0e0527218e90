"""Is a late measurement held against where the target was when it was taken?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.exhibits import Predictions
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.right_answers import named
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: A late scan is older than the latest one by its sensor's latency, within these, s.
LEAST, MOST = 0.1, 0.5
#: How near the estimate is to the one after a scan that counts as new, in shares of what that moves it by.
NEAR = 0.2
#: What a scan that counts as new has to move the estimate by to be told from one that is left out, m.
CLEAR = 0.05


def late(tracker: TrackerUnderTest) -> PartResult:
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
        return Predictions(title, None, named("tracker", after), named("without the scan", without))


def _moves(tracker: TrackerUnderTest, probe: Probe, name: str, age: float) -> _Moves | None:
    """None where there is no estimate.

    Raises:
        StepFailed: the tracker raises at the late scan.
    """
    session = tracker.session_at(probe, tracker.sensor_sets()[-1])
    if session is None:
        return None
    latest = tracker.approach(probe, tracker.sensor_sets()[-1])[-1].time
    old = probe.scan(name, tracker.sensors[name], latest - age)._replace(arrival_time=latest)
    before, after, new = session.copy(), session.copy(), session.copy()
    after.step(old)
    new.step(old._replace(time=latest))
    plain, late, as_new = (_at_zero(one, probe, name, tracker) for one in (before, after, new))
    if plain is None or late is None or as_new is None:
        return None
    return _Moves(probe, late.mean[:2] - plain.mean[:2], as_new.mean[:2] - plain.mean[:2], (plain, late))


def _at_zero(session: TrackerSession, probe: Probe, name: str, tracker: TrackerUnderTest) -> Estimate | None:
    return session.step(empty_scan(probe.scan(name, tracker.sensors[name], 0.0))._replace(asked=True))


LATE_CHECK = DoctorCheck(
    late,
    place=220,
    questions=(
        Question(
            "late",
            "Are late measurements held against where the target was?",
            "Are late measurements of {sensor} held against where the target was?",
            each_sensor=True,
            misses=True,
        ),
    ),
    late_sensors=True,
    faults={
        "late_processed_as_new": KnownFault(
            "a late measurement is processed as if it were new",
            "Where the time since the last scan is computed, and where the time of a scan is read.",
            "Compare scan.time with the state's time: drop an older scan, or go back to its time; arrival_time is not "
            "its time.",
            Role(drive="uneven_steps"),
        ),
    },
)
