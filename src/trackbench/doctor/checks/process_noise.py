"""How much change of the velocity does the tracker's process noise allow?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.doctor.findings import CheckResult, Finding, PartResult
from trackbench.doctor.probes import Probe
from trackbench.doctor.session import finite
from trackbench.doctor.tracker_under_test import TrackerUnderTest
from trackbench.stepping.steppers import masked
from trackbench.types import Estimate

#: Growth of the standard deviation of a road vehicle's speed in 1 s without measurements, at 20 steps a second, m/s.
#: White accelerations of 0.5 and 18 m/s^2 cause these: the rule of half to all of the largest acceleration (Bar-Shalom,
#: Li and Kirubarajan 2001, section 6.3.2) with 1 to 9 m/s^2 lies well within.
BAND = (0.115, 4.0)
#: The same of the reference, a white acceleration of 3 m/s^2.
REFERENCE = 3.0 * np.sqrt(0.05)
#: A growth below this is the rounding of the difference of two variances, m/s.
NONE = 1e-6
#: s
STEP = 0.05


def process_noise(tracker: TrackerUnderTest) -> PartResult:
    """Predict for 1 s without measurements, and measure the growth of the speed's standard deviation."""
    question = "Does the process noise fit a road vehicle?"
    # A tracker may leave a sensor out; one that starts from a sensor alone reads it.
    alone = [(name,) for name in tracker.sensors]
    found = _growths(tracker, alone) or _growths(tracker, [tuple(tracker.sensors)])
    if not found:
        return PartResult([CheckResult("process_noise", question, None, "there was no estimate to predict")])
    growth = float(np.median(found))
    if growth < NONE:
        text = f"in 1 s without a measurement the variance of the speed does not grow (at most by {max(found):.2g} m/s)"
        finding = Finding("process_noise_omitted", 0.97, text, shown_by=tracker.probes.general[0].name)
        return PartResult([CheckResult("process_noise", question, False, text)], [finding])
    equal = growth / np.sqrt(STEP)
    text = (
        f"in 1 s without a measurement the standard deviation of the speed grows by {growth:.3g} m/s (root of the "
        f"difference of the squares), as with a white acceleration of {equal:.3g} m/s^2 at 20 steps a second; "
        f"{BAND[0]:g} to {BAND[1]:g} m/s fit road vehicles"
    )
    result = PartResult([CheckResult("process_noise", question, BAND[0] <= growth <= BAND[1], text)])
    if not BAND[0] <= growth <= BAND[1]:
        fault = "q_too_small" if growth < BAND[0] else "q_too_large"
        excess = BAND[0] / max(growth, 1e-9) if growth < BAND[0] else growth / BAND[1]
        result.findings.append(
            Finding(
                fault,
                min(0.97, 0.8 + 0.1 * np.log(excess)),
                text,
                factor=(growth / REFERENCE) ** 2,
                shown_by=tracker.probes.general[0].name,
            )
        )
    return result


def _growths(tracker: TrackerUnderTest, sensor_sets: Sequence[tuple[str, ...]]) -> list[float]:
    return [
        one
        for probe in tracker.probes.general[:3]
        for sensor_set in sensor_sets
        if (one := _growth(tracker, probe, sensor_set)) is not None
    ]


def _growth(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> float | None:
    session = tracker.session_at(probe, sensor_set)
    if session is None:
        return None
    session = session.copy()
    name = sensor_set[0]
    with tracker.recording_failures(probe.name):
        scans = (masked(probe.scan(name, tracker.sensors[name], STEP * k)) for k in range(21))
        estimates = [session.step(scan) for scan in scans]
        first, last = estimates[0], estimates[-1]
        if first is not None and last is not None and finite(first) and finite(last):
            return float(np.sqrt(max(0.0, _speed_variance(last) - _speed_variance(first))))
    return None


def _speed_variance(estimate: Estimate) -> float:
    direction = estimate.mean[2:] / max(float(np.hypot(*estimate.mean[2:])), 1e-9)
    return float(direction @ estimate.covariance[2:, 2:] @ direction)
