"""Is the process noise the same wherever the target and the sensors are?

The same scans, with target and sensors moved by a constant, have the same innovations. So the estimates are moved by
it, and their covariances are the same.
"""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.subjects.doctor.exhibits import Course, OverTime
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.samples import OTHER_ANSWERS, has_samples
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: By which target and observer are moved, m.
SHIFT = (47.0, -35.0)
#: Time of the prediction, s.
STEP = 0.4
#: Ratio of the growths of the velocity's variance that is one, and how many of the probes have to have a larger one.
SAME, LEAST = 1.3, 2
#: Distance of the moved estimate from where it should be, in standard deviations, from which on it is another track.
ANOTHER = 1.0


@doctor_check(
    Question("noise_place", "Is the process noise the same wherever the scene is?", misses=True, motion=True),
    place=115,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "q_depends_on_state": KnownFault(
            "the process noise depends on the position",
            "Where Q is computed from entries of the state.",
            "Q of G G^T sigma^2 depends on dt alone; where it is scaled by the state, take the entry that is meant: a "
            "speed, not a position in the fixed frame.",
            Role("motion growth", rank=20, causes="growth numerical", drive="manoeuvre"),
        )
    },
)
def noise_place(tracker: TrackerUnderTest) -> PartResult:
    """Compare the growth of the covariance without measurements with that of the same scene elsewhere."""
    if has_samples(tracker):
        return PartResult().add("noise_place", None, OTHER_ANSWERS)
    growths = []
    for probe in tracker.probes.general[:3]:
        here, there = (tracker.predicted(place, STEP) for place in (probe, _moved(probe)))
        if here is not None and there is not None and _alike(here[0], there[0]):
            pair = np.array([_growth(*here), _growth(*there)])
            if pair.min() > 0.0:
                growths.append((pair, probe))
    if not growths:
        return PartResult().add("noise_place", None, "there was no estimate that grows, or it was another elsewhere")
    ratios = [float(pair[1] / pair[0]) for pair, _ in growths]
    where = f"{SHIFT[0]:g}, {SHIFT[1]:g} m away"
    words = ", ".join(f"{ratio:.3g}" for ratio in ratios)
    text = f"over {STEP:g} s without a measurement the variance of the velocity grows {where} {words} times as much"
    off = [(pair, probe) for pair, probe in growths if abs(np.log(pair[1] / pair[0])) > np.log(SAME)]
    if len(off) < LEAST:
        return PartResult().add("noise_place", True, text)
    pair, probe = off[0]
    course = Course("growth of variance, m²/s²", pair, np.repeat(pair[0], 2))
    title = f"Growth of the velocity's variance in {STEP:g} s: {probe.description}"
    distance: Array = np.array([0.0, float(np.hypot(*SHIFT))])
    exhibit = OverTime(title, "distance by which the scene is moved, m", distance, (course,), right_name="the same")
    finding = Finding("q_depends_on_state", 0.95, text, shown_by=probe.name, exhibit=exhibit)
    return PartResult().add("noise_place", False, text, finding)


def _moved(probe: Probe) -> Probe:
    px, py, vx, vy = probe.target
    observer = probe.observer._replace(x=probe.observer.x + SHIFT[0], y=probe.observer.y + SHIFT[1])
    return probe._replace(target=(px + SHIFT[0], py + SHIFT[1], vx, vy), observer=observer)


def _alike(here: Estimate, there: Estimate) -> bool:
    sigma = np.sqrt(np.maximum(np.diag(here.covariance), np.finfo(float).tiny))
    apart = np.abs(there.mean - here.mean - np.array([*SHIFT, 0.0, 0.0])) / sigma
    return bool(apart.max() < ANOTHER)


def _growth(now: Estimate, then: Estimate) -> float:
    return float(np.trace((then.covariance - now.covariance)[2:, 2:]))
