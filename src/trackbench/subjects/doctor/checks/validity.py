"""Is every estimate finite with a valid covariance, and are the estimates repeatable?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import (
    ROUNDING,
    WorstCase,
    fault_of_step,
    first_asymmetric_step,
    first_indefinite_step,
    indefinite_entries,
    mirrored_entries,
)
from trackbench.subjects.doctor.probes import Probe, with_measurement_noise
from trackbench.subjects.doctor.session import FAR, StepFailed, TrackerSession, plausible
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Largest deviation of a tracker with random numbers from its own mean, in standard deviations of its estimate. A mean
#: of N samples has N^-1/2: this is 4 samples, and adds a quarter to the variance of the error.
SAMPLES = 0.5
#: Number of scans within which a track starts.
STARTED = 4
#: Share of indefinite covariances below which they are probably the consequence of another fault.
SELDOM = 0.02
#: Share of indefinite covariances below which they are no fault: sigma points started from two measurements close
#: together have one at times.
RARE = 1e-3


@doctor_check(
    Question("finite", "Is every number of every estimate finite?", finds=("nonfinite",)),
    Question(
        "symmetric",
        "Is every covariance symmetric?",
        finds=("covariance_asymmetric", "predicted_covariance_asymmetric"),
    ),
    Question(
        "definite",
        "Is every covariance positive definite?",
        finds=("covariance_not_psd", "predicted_covariance_not_psd"),
    ),
    place=900,
    asks_at_misses=True,
    faults={
        "nonfinite": KnownFault(
            "the estimate is not finite",
            "At square roots, and at divisions by a range, a speed, a yaw rate or a time step that can be zero.",
            "Use the limit where the divisor is zero (straight motion for a turn rate of zero); skip a time step of "
            "zero.",
            Role(drive="uneven_steps"),
        ),
        "covariance_asymmetric": KnownFault(
            "the covariance is not symmetric",
            "In the update of the covariance, and where the first one is set or the estimate is returned.",
            "Use Joseph's form or P - K S K^T, and P = (P + P^T) / 2 after it.",
            Role(rank=29, drive="long_run"),
        ),
        "predicted_covariance_asymmetric": KnownFault(
            "the prediction makes the covariance asymmetric",
            "In the prediction, where Q is written out and where F P F^T is computed.",
            "Compute Q as G G^T sigma^2, or mirror the named entry, and transpose the second F; P = (P + P^T) / 2 only "
            "hides a wrong entry.",
            Role(rank=23, drive="long_run"),
        ),
        "covariance_not_psd": KnownFault(
            "the covariance is not positive definite",
            "In the update of the covariance, and in the weights of sigma points.",
            "Use Joseph's form, or P - K S K^T with the gain of the same S; check the sign of each weight.",
            Role(rank=41, drive="long_run"),
        ),
        "predicted_covariance_not_psd": KnownFault(
            "the prediction makes the covariance indefinite",
            "In the prediction, where Q is computed, and in the weights of sigma points.",
            "Compute Q as G G^T sigma^2, which has no negative eigenvalue; check the sign and the power of dt of each "
            "entry, and the central weight. Symmetrising does not mend it.",
            Role(rank=24, drive="long_run"),
        ),
    },
)
def validity(tracker: TrackerUnderTest) -> PartResult:
    """Check that all estimates, also of a target at rest, are finite, with symmetric positive definite covariances."""
    for sensor_set in tracker.sensor_sets():
        tracker.session_at(tracker.probes.at_rest, sensor_set)
    for name in tracker.sensors:
        _measure_at_once(tracker, tracker.probes.at_rest, name)
    checks, result = tracker.output_checks, PartResult()
    bad = checks.not_finite
    text = (
        f"all of {checks.estimates} estimates"
        if bad is None
        else f"not at {bad.time:g} s of {bad.where}, after {bad.sensor}"
    )
    result.add("finite", bad is None, text)
    if bad is not None:
        text = f"the estimate is not finite at {bad.time:g} s of {bad.where}, after a measurement of {bad.sensor}"
        # A track that has diverged may overflow because of that alone.
        session, before, after = TrackerSession(tracker.make), None, None
        for scan in bad.scans():
            before, after = after, session.step(scan)
        confidence = 0.98 if before is None or plausible(before) else 0.85
        result.findings.append(Finding("nonfinite", confidence, text, shown_by=bad.where))
    _symmetric(tracker, result)
    _definite(tracker, result)
    return result


def _symmetric(tracker: TrackerUnderTest, result: PartResult) -> None:
    worst, finding = tracker.output_checks.asymmetry, None
    if worst is None:
        result.add("symmetric", None, "there was no covariance")
        return
    text = f"mirrored entries differ by up to {worst.size:.2g} of their standard deviations{_at(worst)}"
    if worst.size >= ROUNDING:
        step = first_asymmetric_step(tracker.make, worst.scans())
        fault = fault_of_step("covariance_asymmetric", step)
        evidence = text if step is None else f"{text}; it arises {step.words}: {mirrored_entries(step)}"
        finding = Finding(fault, 0.95, evidence, shown_by=worst.where)
    result.add("symmetric", finding is None, text, finding)


def _definite(tracker: TrackerUnderTest, result: PartResult) -> None:
    checks, finding = tracker.output_checks, None
    worst = checks.indefinite
    if worst is None:
        result.add("definite", None, "there was no covariance")
        return
    share = checks.indefinite_estimates / checks.estimates
    text = (
        f"{checks.indefinite_estimates} of {checks.estimates} are not; scaled to unit variances the smallest "
        f"eigenvalue is {-worst.size:.2g}{_at(worst)}"
    )
    if share >= RARE:
        step = first_indefinite_step(tracker.make, worst.scans())
        fault = fault_of_step("covariance_not_psd", step)
        evidence = text if step is None else f"{text}; it arises {step.words}: {indefinite_entries(step)}"
        diverged = step is not None and step.before is not None and np.abs(np.diag(step.before)).max() > FAR**2
        confidence = 0.6 if share < SELDOM else 0.85 if diverged else 0.95
        finding = Finding(fault, confidence, evidence, shown_by=worst.where)
    result.add("definite", finding is None, text, finding)


def _at(worst: WorstCase) -> str:
    return f" (at {worst.time:g} s of {worst.where}, after {worst.sensor})"


def _measure_at_once(tracker: TrackerUnderTest, probe: Probe, first: str) -> None:
    """Start a track with one sensor, and update it at the same instant with each sensor."""
    session = TrackerSession(tracker.make)
    with tracker.recording_failures(probe.name):
        for k in range(STARTED):
            if session.step(tracker.scan(probe, first, 0.1 * k)) is not None:
                break
        for name, sensor in tracker.sensors.items():
            scan = probe.scan(name, sensor, 0.1 * k)
            tracker.output_checks.add(session.copy().step(scan), scan, probe.name, [*session.scans, scan])


def _sigma(estimate: Estimate) -> Array:
    return np.asarray(np.sqrt(np.abs(np.diag(estimate.covariance))))


def _sampling_deviation(runs: Sequence[Array], sigmas: Sequence[Array]) -> float:
    """Return the median over scans of the runs' RMS deviation from their mean, in stated standard deviations."""
    deviation = (np.array(runs) - np.mean(runs, axis=0)) / np.array(sigmas)
    squares = np.mean(deviation**2, axis=(0, 2)) * len(runs) / (len(runs) - 1)
    # A median, since few samples carry the weight of the first measurements.
    return float(np.sqrt(np.nanmedian(squares)))


@doctor_check(
    Question(
        "repeatable",
        "Do three fresh trackers give the same estimates?",
        "Do three fresh trackers give the same estimates from the same measurements?",
    ),
    place=10,
    faults={
        "not_deterministic": KnownFault(
            "the same measurements give another estimate",
            "At random numbers without a seed, and at values kept in the class or module instead of the state.",
            "Seed the generator in __init__, and keep all memory in the state or the instance. A filter of samples "
            "says random = True.",
            Role(rank=1, drive="uneven_steps"),
        )
    },
)
def repeatability(tracker: TrackerUnderTest) -> PartResult:
    """Give the same noisy measurements to three fresh trackers, and compare their estimates."""
    probe = tracker.probes.general[0]
    random = np.random.default_rng([tracker.seed, 1])
    scans = [with_measurement_noise(scan, random) for scan in tracker.approach(probe, tracker.sensor_sets()[-1])]
    try:
        runs: list[Array] = []
        sigmas: list[Array] = []
        for _ in range(3):
            session = TrackerSession(tracker.make)
            estimates = session.follow(scans)
            nothing = np.full(4, np.nan)
            runs.append(np.array([nothing if estimate is None else estimate.mean for estimate in estimates]))
            sigmas.append(np.array([nothing if estimate is None else _sigma(estimate) for estimate in estimates]))
    except StepFailed as failure:
        tracker.failures.append((probe.name, failure))
        return PartResult().add("repeatable", None, f"the tracker failed: {failure}")
    copied = _note_on_copies(session)
    gap = max(float(np.nanmax(np.abs(runs[0] - run), initial=0.0)) for run in runs[1:])
    if all(np.array_equal(runs[0], run, equal_nan=True) for run in runs[1:]):
        return PartResult().add("repeatable", True, f"three fresh trackers agree to the last bit{copied}")
    text = f"three fresh trackers differ by up to {gap:.3g} m or m/s on the same {len(scans)} measurements{copied}"
    if tracker.random:
        noise = _sampling_deviation(runs, sigmas)
        text += f", {noise:.2g} of their standard deviations in the median; they are said to draw random numbers"
        if noise < SAMPLES:
            return PartResult().add("repeatable", True, text)
    finding = Finding("not_deterministic", 0.99, text, shown_by=probe.name)
    return PartResult().add("repeatable", False, text, finding)


def _note_on_copies(session: TrackerSession) -> str:
    """Return a note on why ``copy.deepcopy`` cannot copy the session's tracker; empty where it can."""
    try:
        reason = session.copy().not_copied
    except StepFailed as failure:
        return f"; {failure}: no measurement can be tried on it"
    return "" if reason is None else f"; copy.deepcopy cannot copy it ({reason}): fresh ones are given all scans again"
