"""Do measurements count at the time at which they were taken, if two are of one instant and if they come late?"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from trackbench.base.types import Estimate, Scan
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Distance of a measurement from the expected one, in its standard deviations: within every gate.
ASIDE = 2.0
#: Change of an estimate that is only rounding: in m, or relative to the change by a measurement alone.
NOTHING = 1e-9
#: Least and largest age of a late scan, s; between them it is the latency of its sensor.
AGES = 0.1, 0.5
#: Least change of the estimate by a scan that is new, m; and largest difference from it, relative to it, of the change
#: by a late scan that is processed as new.
CLEAR, NEAR = 0.05, 0.2
#: Share of a late scan's age by which the estimate gets ahead where the same time is predicted twice; and factor of a
#: variance where the same process noise is added twice.
AHEAD, GROWN = 0.4, 1.05


@doctor_check(
    Question("same_instant", "Do two sensors' measurements of one instant both count?"),
    place=170,
    of_filters=True,
    least_sensors=2,
    faults={
        "second_measurement_dropped": KnownFault(
            "of two measurements at one instant only the first is used",
            "Where a scan with the time of the last one (a time step of zero) returns early.",
            "With a time step of zero leave out the prediction alone, and make the update.",
            Role("exact", rank=27, drive="uneven_steps"),
        ),
    },
)
def same_instant(tracker: TrackerUnderTest) -> PartResult:
    """Give measurements of two sensors at one instant, in both orders: the second must move the estimate too."""
    counts: dict[tuple[str, str], list[bool]] = {}
    for probe in tracker.probes.general[:3]:
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        for first, second in permutations(tracker.sensors, 2):
            with tracker.recording_failures(probe.name):
                if session is not None:
                    moved_alone, moved_after = (
                        _moved_by(session, [*before, tracker.scan(probe, second, 0.0)])
                        for before in ([], [tracker.scan(probe, first, 0.0)])
                    )
                    if moved_alone > NOTHING:
                        counts.setdefault((first, second), []).append(moved_after > NOTHING * moved_alone)
    dropped = [pair for pair, used in counts.items() if not any(used)]
    if not dropped:
        text = f"yes, in {len(counts)} orders of two sensors" if counts else "there was no estimate"
        return PartResult().add("same_instant", True if counts else None, text)
    first, second = dropped[0]
    text = (
        f"a measurement of {second} that comes after one of {first} with the same time does not move the estimate "
        f"({len(counts[first, second])} trials); it does if it comes alone"
    )
    sensor = second if len(dropped) == 1 else None
    finding = Finding("second_measurement_dropped", 0.98, text, sensor=sensor, shown_by="uneven_steps")
    return PartResult().add("same_instant", False, text, finding)


def _moved_by(session: TrackerSession, scans: Sequence[Scan]) -> float:
    """Return the largest change of the last mean if the last measurement moves by 2 sigma; 0 without estimates."""
    *before, last = scans
    aside = last._replace(measurement=last.measurement + ASIDE * np.sqrt(np.diag(last.noise_covariance)))
    first, second = (session.copy().follow([*before, scan])[-1] for scan in (last, aside))
    if first is None or second is None or not (finite(first) and finite(second)):
        return 0.0
    return float(np.abs(first.mean - second.mean).max())


@doctor_check(
    Question(
        "late",
        "Are late measurements compared with where the target was?",
        "Are late measurements of {sensor} compared with where the target was?",
        each_sensor=True,
        misses=True,
        late=True,
    ),
    place=175,
    of_filters=True,
    faults={
        "late_processed_as_new": KnownFault(
            "a late measurement is processed as if it were new",
            "Where the time since the last scan is computed, and where the time of a scan is read.",
            "Compare scan.time with the state's time: drop an older scan, or go back to its time; arrival_time is not "
            "its time.",
            Role("exact", rank=26, drive="uneven_steps"),
        ),
        "late_state_goes_back": KnownFault(
            "a late measurement takes the state back in time",
            "Where the time since the last scan is negative, and where the time of the state is stored.",
            "Drop a scan that is older than the state, or keep the earlier states and take all scans since then again.",
            Role("exact", rank=26, drive="uneven_steps"),
        ),
    },
)
def late_measurements(tracker: TrackerUnderTest) -> PartResult:
    """Give old noise-free scans of sensors that are late in the scenario, which must not change the estimate much."""
    result = PartResult()
    for name, latency in tracker.assumptions.late.items():
        age = float(np.clip(latency, *AGES))
        tracked = [_ask_at_zero(tracker, probe, name, age) for probe in tracker.probes.regular]
        answers = [estimates for estimates in tracked if len(estimates) == 3]
        if not answers:
            result.add(f"late.{name}", None, "there was no estimate after a late scan")
            continue
        without, late, new = (
            np.array([[*estimate.mean, *np.diag(estimate.covariance)] for estimate in estimates])
            for estimates in zip(*answers, strict=True)
        )
        moved, as_new, velocity = (late - without)[:, :2], (new - without)[:, :2], without[:, 2:4]
        distance, if_new, gap = (float(np.median(np.hypot(*move.T))) for move in (moved, as_new, moved - as_new))
        ahead = float(np.median(np.sum(moved * velocity, axis=1) / np.maximum(np.sum(velocity**2, axis=1), 1.0)))
        grown = float(np.median(np.max((late / without)[:, 4:], axis=1)))
        text = (
            f"after a scan that is older by {age:g} s than the one before, the estimate is {distance:.2g} m from where "
            f"it was without, {ahead:+.2g} s of its motion, and a variance is {grown:.3g} times that without; if the "
            f"scan were new the distance would be {if_new:.2g} m (medians of {len(answers)} targets)"
        )
        fault = None
        if gap < NEAR * if_new and if_new > CLEAR:
            fault = "late_processed_as_new"
        elif ahead > AHEAD * age or grown > GROWN:
            fault = "late_state_goes_back"
        finding = None if fault is None else Finding(fault, 0.95, text, sensor=name, shown_by="uneven_steps")
        result.add(f"late.{name}", finding is None, text, finding)
    return result


def _ask_at_zero(tracker: TrackerUnderTest, probe: Probe, name: str, age: float) -> list[Estimate]:
    """Return the estimates at time 0: without an old scan, with the old scan, and with the old scan dated as new."""
    sensor_set = tracker.sensor_sets()[-1]
    session, latest = tracker.session_at(probe, sensor_set), tracker.approach(probe, sensor_set)[-1].time
    old = tracker.scan(probe, name, latest - age)._replace(arrival_time=latest)
    request, estimates = tracker.missed(probe, name, 0.0)._replace(asked=True), list[Estimate | None]()
    if session is not None:
        with tracker.recording_failures(probe.name):
            for scans in ([], [old], [old._replace(time=latest)]):
                estimates.append(session.copy().follow([*scans, request])[-1])
    return [estimate for estimate in estimates if estimate is not None and finite(estimate)]
