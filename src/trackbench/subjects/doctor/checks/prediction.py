"""Does the tracker predict the motion of a target, and the growth of its uncertainty, over the right time?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Estimate
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Time steps of the predictions, s.
STEPS = (0.002, 0.01, 0.05, 0.1, 0.2, 0.4, 1.0)
#: Largest error of a time step, relative to it.
TOLERANCE = 0.1
#: Longest step that identifies a unit even if it is taken a thousand times too long, s.
SHORT = 0.01
#: Units of time, as their number in a second; and largest error of the logarithm of such a number.
UNITS, FAR_APART = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}, 0.3
#: Longest time of motion of an estimate that does not move, s.
STILL = 1e-3
#: Largest turn of the velocity, rad, and largest relative change of the speed, in a straight prediction.
STRAIGHT = 0.05
#: Least share of the predictions that are straight.
MOST = 0.8
#: Time after which a measurement shows whether there is a prediction to it, s, and largest error then, relative to the
#: motion.
LATER, MISSED = 0.4, 0.25


class PredictedStep(NamedTuple):
    """A prediction without measurements over a time step, after an earlier prediction."""

    step: float
    """Length of the step, s."""
    moved: float
    """Displacement along the velocity divided by the speed, s: the time step that the tracker used."""
    previous: float
    """Length of the time step of the earlier prediction, s."""
    before: Estimate
    after: Estimate

    @property
    def straight(self) -> bool:
        """Whether the velocity stays constant, and the estimated position moves along the velocity."""
        velocity, later = self.before.mean[2:], self.after.mean[2:]
        across = np.array([-velocity[1], velocity[0]]) / (velocity @ velocity)
        aside = abs(float(across @ (self.after.mean - self.before.mean)[:2]))
        change = np.linalg.norm(later - velocity) / np.linalg.norm(velocity)
        return bool(change < STRAIGHT and aside < STRAIGHT * max(abs(self.moved), STILL))


@doctor_check(
    Question("prediction", "Is the estimate predicted by its velocity times the time step?", misses=True),
    place=80,
    of_filters=True,
    faults={
        "wrong_dt": KnownFault(
            "the time step is wrong",
            "Where the time since the last scan is computed and stored.",
            "dt = scan.time - time of the state, in s, at every scan, missed ones too; store the new time with the "
            "state.",
            Role("motion", rank=12, drive="uneven_steps"),
        ),
        "missed_scan_not_predicted": KnownFault(
            "there is no prediction at a missed scan",
            "Where a scan without a measurement (scan.valid is False) returns early.",
            "Predict to scan.time at every scan, and leave out only the update where there is no measurement.",
            Role("exact", rank=11, drive="uneven_steps"),
        ),
    },
)
def motion_prediction(tracker: TrackerUnderTest) -> PartResult:
    """Predict over steps of several lengths, and compare the motion with the velocity times the step."""
    steps = [item for probe in tracker.probes.general[:2] for item in _predicted_steps(tracker, probe)]
    if len(steps) < len(STEPS):
        return PartResult().add("prediction", None, "there was no moving estimate to predict")
    step, moved = (np.array([item[i] for item in steps]) for i in range(2))
    wrong = np.abs(moved - step) > TOLERANCE * np.maximum(step, 0.02)
    ratios = moved / step
    text = (
        f"over steps of {step.min():g} to {step.max():g} s the estimate moves {ratios.min():.3g} to {ratios.max():.3g} "
        "times as far as its velocity says"
    )
    passed = float(np.mean(wrong)) < 0.1
    finding = None if passed else _explain(tracker, steps)
    return PartResult().add("prediction", passed, text, finding)


def _explain(tracker: TrackerUnderTest, steps: Sequence[PredictedStep]) -> Finding | None:
    """Report the first cause that fits the displacements, such as a wrong unit of time; None if no cause fits."""
    step, moved, previous = (np.array([item[i] for item in steps]) for i in range(3))
    ratios, shown_by = moved / step, tracker.probes.general[0].name
    ratio = float(np.median(ratios))
    # A turning model goes round in circles over a step that is far too long: only short steps show a unit.
    unit = _unit(float(np.median(ratios[step <= SHORT])))
    extra = float(np.median(moved - step - previous))
    if extra > -STILL and np.allclose(moved, step + previous + extra, rtol=TOLERANCE, atol=2e-3):
        text = (
            f"a prediction over {step[-1]:g} s moves the estimate by {moved[-1]:.3g} s times its velocity: the time of "
            "the scan before it, a missed one, was not stored"
        )
        return Finding("wrong_dt", 0.97, text, shown_by=shown_by)
    error = _error_at_measurements(tracker) if float(np.abs(moved).max()) < STILL else None
    if error is not None:
        text = (
            f"a missed scan {step.max():g} s later leaves the estimate where it is, while after a measurement "
            f"{LATER:g} s later it is at the target (error {error:.2g} m)"
        )
        return Finding("missed_scan_not_predicted", 0.98, text, shown_by="uneven_steps")
    if np.ptp(moved) < TOLERANCE * float(np.abs(moved).max()) + 1e-6:
        text = (
            f"the estimate moves by {np.median(moved):.3g} s times its velocity, whether the step is {step.min():g} or "
            f"{step.max():g} s long"
        )
        return Finding(
            "wrong_dt", 0.97, text, factor=float(np.median(moved)) / float(np.median(step)), shown_by=shown_by
        )
    if unit is not None:
        name, factor = unit
        text = (
            f"a prediction over {step[0]:g} s moves the estimate by {moved[0]:.3g} s times its velocity: {name} and "
            "seconds are confused"
        )
        return Finding("wrong_dt", 0.97, text, factor=factor, shown_by=shown_by)
    if not float(np.std(ratios)) < TOLERANCE * abs(ratio):
        return _other_time(steps)
    text = f"a prediction over {step[-1]:g} s moves the estimate by {moved[-1]:.3g} s times its velocity"
    return Finding("wrong_dt", 0.97, text, factor=ratio, shown_by=shown_by)


def _unit(ratio: float) -> tuple[str, float] | None:
    """Return the name of the unit of time confused with seconds, and its exact ratio; None where no unit fits."""
    for name, size in UNITS.items():
        for exact in (size, 1.0 / size):
            if ratio > 0.0 and abs(np.log(ratio / exact)) < FAR_APART:
                return name, exact
    return None


def _other_time(steps: Sequence[PredictedStep]) -> Finding | None:
    """Report predictions straight along the velocity over wrong times, such as cut or rounded steps."""
    wrong = [step for step in steps if abs(step.moved - step.step) > TOLERANCE * max(step.step, 0.02)]
    if np.mean([step.straight for step in steps]) < MOST:
        return None
    moved = {step.step: f"{step.step:g} s by {step.moved:.3g} s" for step in wrong}
    text = f"predictions move the estimate along its velocity, and over other times: over {', '.join(moved.values())}"
    return Finding("wrong_dt", 0.95, text, shown_by="uneven_steps")


def _error_at_measurements(tracker: TrackerUnderTest) -> float | None:
    """Return the position error after a noise-free measurement, m; None without an estimate near the target."""
    errors = []
    sensor_set = tracker.sensor_sets()[-1]
    for probe in tracker.probes.general[:2]:
        session = tracker.session_at(probe, sensor_set)
        scan = tracker.scan(probe, sensor_set[0], LATER)
        estimate = tracker.peek(session, scan, probe.name)
        if estimate is None or not finite(estimate):
            return None
        error = estimate.mean - probe.truth(LATER)
        speed = float(np.hypot(*probe.target[2:]))
        # Without a prediction the position lags, and the tracker takes the lag for speed.
        if np.hypot(*error[:2]) > MISSED * LATER * speed or np.hypot(*error[2:]) > MISSED * speed:
            return None
        errors.append(float(np.hypot(*error[:2])))
    return max(errors)


def _predicted_steps(tracker: TrackerUnderTest, probe: Probe) -> list[PredictedStep]:
    at_probe, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
    predicted: list[PredictedStep] = []
    if at_probe is None:
        return predicted
    with tracker.recording_failures(probe.name):
        for previous in (0.05, 0.15):
            session = at_probe.copy()
            session.step(tracker.missed(probe, name, 0.0))
            first = session.step(tracker.missed(probe, name, previous))
            for step in STEPS:
                later = session.peek(tracker.missed(probe, name, previous + step))
                if first is None or later is None or not (finite(first) and finite(later)):
                    continue
                speed = float(np.hypot(*first.mean[2:]))
                displacement = (later.mean - first.mean)[:2]
                # A velocity in another unit may be small.
                if speed > 1.0 or (speed > 1e-6 and np.hypot(*displacement) > 0.05):
                    moved = displacement @ first.mean[2:] / speed**2
                    predicted.append(PredictedStep(step, float(moved), previous, first, later))
    return predicted
