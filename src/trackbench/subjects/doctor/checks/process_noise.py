"""How much change of the velocity does the process noise allow, and how does it grow with the time step?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Estimate
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.matrices import cv_transition
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Growth of the standard deviation of a road vehicle's speed in 1 s without measurements, at 20 steps a second, m/s:
#: least and largest, by white accelerations of 0.5 and 18 m/s^2. The rule of half to all of the largest acceleration
#: (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2) with 1 to 9 m/s^2 lies well within.
BAND = (0.115, 4.0)
#: Growth in the reference, with a white acceleration of 3 m/s^2, m/s.
REFERENCE = 3.0 * np.sqrt(0.05)
#: Growth below which the difference of two variances is only rounding, m/s.
NONE = 1e-6
#: Time step of the predictions, s.
STEP = 0.05
#: Two steps whose process noises are compared, s, and largest noise of the short step relative to the long one's.
STEPS, CONSTANT = (0.002, 0.2), 0.3
#: Least growth of the variance of the velocity over the long step, relative to it, that is a process noise.
LEAST_GROWTH = 1e-6
#: Largest share of the growth over the short step that is not in proportion to the covariance, with a fading memory:
#: none with constant velocity, and what other motions add in so short a step.
ONLY = 0.2


@doctor_check(
    Question(
        "process_noise",
        "Is the process noise that of a road vehicle?",
        "Does the process noise fit a road vehicle?",
        misses=True,
        finds=("q_too_small", "q_too_large", "process_noise_omitted"),
    ),
    Question(
        "noise_per_step",
        "Does the process noise of a step depend on its length?",
        misses=True,
        finds=("q_constant_per_step",),
    ),
    place=110,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "q_too_small": KnownFault(
            "the process noise is too small",
            "Where Q is computed.",
            "For G G^T sigma^2, set sigma to half to all of the largest acceleration of the targets (1 to 9 m/s^2 for "
            "cars).",
            Role("motion", rank=48, drive="manoeuvre"),
        ),
        "q_too_large": KnownFault(
            "the process noise is too large",
            "Where Q is computed; check the powers of dt too.",
            "For G G^T sigma^2, set sigma to half to all of the largest acceleration of the targets (1 to 9 m/s^2 for "
            "cars).",
            Role("motion", rank=22, drive="own_model"),
        ),
        "q_constant_per_step": KnownFault(
            "the process noise does not depend on the time step",
            "Where Q is computed, or set once.",
            "Compute Q from the dt of every step: G G^T sigma^2 with G = (dt^2 / 2, dt)^T for each axis; it is zero "
            "for dt = 0.",
            Role("motion", rank=25, drive="uneven_steps"),
        ),
        "process_noise_omitted": KnownFault(
            "the process noise is missing from the predicted covariance",
            "Where the covariance is predicted.",
            "P = F P F^T + Q, or the sum over the moved points plus Q.",
            Role("motion", rank=33, drive="manoeuvre"),
        ),
    },
)
def growth_by_noise(tracker: TrackerUnderTest) -> PartResult:
    """Predict for 1 s without measurements, and measure the growth of the speed's standard deviation."""
    # A tracker may ignore one of several sensors; if it starts from one alone, it uses that one.
    single = [(name,) for name in tracker.sensors]
    growths = _growths(tracker, single) or _growths(tracker, [tuple(tracker.sensors)])
    if not growths:
        reason = "there was no estimate to predict"
        return PartResult().add("process_noise", None, reason).add("noise_per_step", None, reason)
    growth = float(np.median(growths))
    shown_by = tracker.probes.general[0].name
    if growth < NONE:
        text = (
            "in 1 s without a measurement the variance of the speed does not grow (its root by at most "
            f"{max(growths):.2g} m/s)"
        )
        finding = Finding("process_noise_omitted", 0.97, text, shown_by=shown_by)
        return PartResult().add("process_noise", False, text, finding)
    equal = growth / np.sqrt(STEP)
    text = (
        f"in 1 s without a measurement the standard deviation of the speed grows by {growth:.3g} m/s (root of the "
        f"difference of the squares), as with a white acceleration of {equal:.3g} m/s^2 at 20 steps a second; "
        f"{BAND[0]:g} to {BAND[1]:g} m/s fit road vehicles"
    )
    fits = BAND[0] <= growth <= BAND[1]
    result = PartResult().add("process_noise", fits, text)
    _per_step(tracker, result)
    if not fits:
        fault = "q_too_small" if growth < BAND[0] else "q_too_large"
        excess = BAND[0] / max(growth, 1e-9) if growth < BAND[0] else growth / BAND[1]
        confidence, factor = min(0.97, 0.8 + 0.1 * np.log(excess)), (growth / REFERENCE) ** 2
        finding = Finding(fault, confidence, text, factor=factor, shown_by=shown_by)
        result.findings.append(finding)
    return result


def _per_step(tracker: TrackerUnderTest, result: PartResult) -> None:
    """Add to ``result`` whether the velocity's variance grows in proportion to the time step, as by white noise."""
    pairs = []
    for probe in tracker.probes.general[:3]:
        estimates = [tracker.predicted(probe, step) for step in STEPS]
        if estimates[0] is None or estimates[1] is None:
            continue
        now, short, long = estimates[0][0], estimates[0][1], estimates[1][1]
        variances = [float(np.trace(estimate.covariance[2:, 2:])) for estimate in (now, short, long)]
        if variances[2] - variances[0] > LEAST_GROWTH * variances[0] and not _faded(now, short, STEPS[0]):
            pairs.append((variances[1] - variances[0], variances[2] - variances[0]))
    if not pairs:
        result.add("noise_per_step", None, "no process noise is added to the variance of the velocity")
        return
    share = float(np.median([short / long for short, long in pairs]))
    text = (
        f"over {STEPS[0] * 1e3:g} ms the variance of the velocity grows {share:.3g} times as much as over "
        f"{STEPS[1]:g} s ({pairs[0][0]:.3g} and {pairs[0][1]:.3g} m^2/s^2); in proportion to the "
        f"step it would be {STEPS[0] / STEPS[1]:g} times"
    )
    finding = Finding("q_constant_per_step", 0.96, text, shown_by="uneven_steps")
    result.add("noise_per_step", share < CONSTANT, text, finding if share >= CONSTANT else None)


def _faded(before: Estimate, after: Estimate, step: float) -> bool:
    """Return whether a prediction multiplies the moved covariance by a number only, as a fading memory does.

    Entries are scaled by standard deviations: the velocity's growth alone can be in proportion to its variances.
    """
    motion = cv_transition(step)
    moved = motion @ before.covariance @ motion.T
    spread = np.sqrt(np.abs(np.diag(moved)))
    p, grown = (matrix / np.outer(spread, spread) for matrix in (moved, after.covariance - moved))
    share = float(np.trace(grown) / np.trace(p))
    return float(np.linalg.norm(grown - share * p)) < ONLY * float(np.linalg.norm(grown))


def _growths(tracker: TrackerUnderTest, sensor_sets: Sequence[tuple[str, ...]]) -> list[float]:
    return [
        growth
        for probe in tracker.probes.general[:3]
        for sensor_set in sensor_sets
        if (growth := _growth_of_speed_sigma(tracker, probe, sensor_set)) is not None
    ]


def _growth_of_speed_sigma(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> float | None:
    session = tracker.session_at(probe, sensor_set)
    if session is None:
        return None
    with tracker.recording_failures(probe.name):
        scans = [tracker.missed(probe, sensor_set[0], STEP * k) for k in range(21)]
        first, *_, last = session.copy().follow(scans)
        if first is not None and last is not None and finite(first) and finite(last):
            return float(np.sqrt(max(0.0, _variance_of_speed(last) - _variance_of_speed(first))))
    return None


def _variance_of_speed(estimate: Estimate) -> float:
    speed = float(np.hypot(*estimate.mean[2:]))
    direction = estimate.mean[2:] / speed if speed > 0.0 else np.array([1.0, 0.0])
    return float(direction @ estimate.covariance[2:, 2:] @ direction)
