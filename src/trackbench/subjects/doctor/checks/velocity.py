"""Does the velocity stay as it is where nothing says that it changed?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Estimate
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: A step so short that no motion model changes the velocity, s, and the change of the speed from which on one does.
SHORT, CHANGED = 0.002, 0.004
#: Change of the speed over 1 s of a target that moved straight and at one speed before. An estimated acceleration that
#: is not quite zero, and a velocity that decays over half a minute, stay below.
CHANGED_IN_A_SECOND = 0.1
#: s
LONG = 1.0
#: Standard deviation of the course, rad, from which on the mean of the velocity is rightly shorter than the speed.
COURSE_UNKNOWN = 0.4
#: Speed below which a target says nothing, m/s.
MOVING = 2.0


@doctor_check(
    Question("velocity", "Does the velocity stay as it is where nothing says that it changed?", misses=True),
    place=90,
    of_filters=True,
    faults={
        "velocity_not_kept": KnownFault(
            "the velocity changes where nothing says so",
            "Where the transition is written out, and where the velocity is scaled, limited or smoothed after a step.",
            "Constant velocity leaves vx and vy as they are; a decay has to be exp(-dt / tau), with process noise for "
            "it.",
            Role("step", rank=26, causes="stepped wrong_dt", drive="tangential_pass"),
        )
    },
)
def velocity(tracker: TrackerUnderTest) -> PartResult:
    """Follow targets of constant velocity, and predict them; then measure them where they are predicted."""
    over = {step: _predicted(tracker, step) for step in (SHORT, LONG)}
    updated = [ratio for ratio, _ in _updated(tracker)]
    if len(over[SHORT]) < 3:
        return PartResult().add("velocity", None, "there was no moving estimate to predict")
    longest = LONG if over[LONG] else SHORT
    text = f"the speed is {np.median(over[longest]):.4g} times the one before after {longest:g} s"
    if updated:
        text += f", and {np.median(updated):.4g} times after a measurement where the target was predicted"
    for ratios, changed, when in (
        (over[SHORT], CHANGED, f"a prediction over {SHORT * 1e3:g} ms without a measurement"),
        (updated, CHANGED, "a measurement where the target was predicted"),
        (over[LONG], CHANGED_IN_A_SECOND, f"a prediction over {LONG:g} s without a measurement"),
    ):
        if _alike(ratios, changed):
            ratio, count = float(np.median(ratios)), len(ratios)
            words = f"after {when} the speed is {ratio:.4g} times the one before (median of {count} trials; 1 is right)"
            drive = "tangential_pass"
            finding = Finding("velocity_not_kept", 0.95, words, factor=ratio, shown_by=drive)
            return PartResult().add("velocity", False, text, finding)
    return PartResult().add("velocity", True, text)


def _alike(ratios: Sequence[float], changed: float) -> bool:
    """Whether the speed changes by much the same share in nearly all trials."""
    if len(ratios) < 3:
        return False
    change = np.array(ratios) - 1.0
    middle = float(np.median(change))
    return abs(middle) > changed and float(np.mean(np.abs(change - middle) < 0.5 * abs(middle))) > 0.8


def _predicted(tracker: TrackerUnderTest, step: float) -> list[float]:
    pairs = (tracker.predicted(probe, step) for probe in tracker.probes.general)
    return [ratio for pair in pairs if pair is not None for ratio in _ratio(*pair)]


def _updated(tracker: TrackerUnderTest) -> list[tuple[float, Trial]]:
    """The ratios after measurements where the target was predicted, with their trials."""
    trials = [trial for of_sensor in tracker.trials.values() for trial in of_sensor]
    updates = [(trial, trial.update(trial.predicted_measurement)) for trial in trials]
    return [
        (ratio, trial)
        for trial, update in updates
        if update is not None
        for ratio in _ratio(trial.prediction, update.estimate)
    ]


def _ratio(before: Estimate, after: Estimate) -> list[float]:
    if not (finite(before) and finite(after)) or np.hypot(*before.mean[2:]) < MOVING:
        return []
    (vx, vy), p = after.mean[2:], after.covariance[2:, 2:]
    across = vy * vy * p[0, 0] - 2.0 * vx * vy * p[0, 1] + vx * vx * p[1, 1]
    if across > COURSE_UNKNOWN**2 * (vx * vx + vy * vy) ** 2:
        return []
    return [float(np.hypot(vx, vy) / np.hypot(*before.mean[2:]))]
