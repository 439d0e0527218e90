"""What a failed step means: the scans before it are given again, to fresh trackers.

A failed step is a finding, or the tracker is one of which nothing can be asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import TrackbenchError, counted
from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.copyable_tracker import NOT_COPIED
from trackbench.subjects.doctor.course_jump import course_jump, followed
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import (
    SINGULAR,
    Make,
    fault_of_step,
    indefinite,
    indefinite_entries,
)
from trackbench.subjects.doctor.probes import TURNS, turned_mounting
from trackbench.subjects.doctor.session import FAR, MissGiven, StepFailed, TrackerSession, apart, finite, plausible
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import TOO_LARGE

#: In the messages of NumPy and SciPy, where there is no Cholesky factor.
INDEFINITE = ("not positive definite",)
#: In the messages of math, NumPy and SciPy, where a number is not finite or leads to one that is not.
NOT_FINITE = ("math domain error", "infs or NaNs", "did not converge")

#: Errors that numbers can bring about, and those that only the code can.
OF_NUMBERS = ("covariance_not_psd", "exception_raised")
OF_CODE = ("KeyError", "IndexError", "NameError", "UnboundLocalError", "AttributeError", "TypeError", "ImportError")
#: Probes and drives in which the failures of one line are examined, those with the fewest scans.
TRIED = 6
#: Probes and drives whose names are said.
SHOWN = 4

#: Eigenvalue of a covariance over its largest one that rounding explains, negative or not: an update rounds sums of
#: some 16 products to 2e-16 of the largest term, and 300 scans add up to 1e-12.
ROUNDED = 1e-12
#: Difference of two estimates that rounding does not explain, in standard deviations.
APART = 1e-3
#: How far an estimate that follows its target may be from the last measured position, beside six of its standard
#: deviations, m.
NEAR = 1.0

Failures = Sequence[tuple[str, StepFailed]]
"""Each with the name of the probe, drive or check where it happened."""


Cause = tuple[str, str, str | None]
"""A fault, the evidence and the sensor."""


class CannotRun(TrackbenchError):
    """A tracker that cannot process one scan of any sensor, or gives no estimate at any."""


def require_runnable(tracker: TrackerUnderTest) -> None:
    """Follow targets in general position with each sensor alone, until a scan is processed.

    Raises:
        CannotRun: none is.
    """
    for probe in tracker.probes.general:
        for name in tracker.sensors:
            session = tracker.session_at(probe, (name,))
            if session is not None or tracker.failures[-1][1].given:
                return
            if tracker.failures[-1][1].fault.kind == "died":
                raise CannotRun(_sentence(*tracker.failures[-1]))
    raise CannotRun(_sentence(*tracker.failures[0]))


@doctor_check(
    Question("steps", "Does every step return an estimate?"),
    place=1000,
    faults={
        "exception_raised": KnownFault(
            "a step raises an exception",
            "At the named line.",
            "Give the named measurement to the tracker in a test, and make the step pass it; a missed one (scan.valid "
            "is False) is to be predicted, unless --no-misses says that there is none.",
            Role("exact root", drive="uneven_steps"),
        ),
        "invalid_estimate": KnownFault(
            "what a step returns is no estimate",
            "Where the step returns.",
            "Return (state, (mean, covariance)) with a mean (4,) and a covariance (4, 4) of finite size, or (state, "
            "None) before the track has started.",
            Role("exact numerical", drive="uneven_steps"),
        ),
        "process_ended": KnownFault(
            "the tracker's process ended",
            "At the named line, or in a compiled extension.",
            "Look for a crash, an exit or an endless loop at the named measurement; with --in-process a debugger can "
            "stop there.",
            Role("exact", drive="uneven_steps"),
        ),
    },
)
def steps(tracker: TrackerUnderTest) -> PartResult:
    """Report on the steps that failed in all other checks."""
    findings, failed = failure_findings(tracker), tracker.failures
    text = "no step failed" if not failed else f"{counted(len(failed), 'step')} failed, first: {_sentence(*failed[0])}"
    if failed and not findings:
        text += "; none counts, since rounding alone can break a correct filter at the sensor's own position"
    return PartResult().add("steps", all(finding.fragile for finding in findings), text, *findings)


def failure_findings(tracker: TrackerUnderTest) -> list[Finding]:
    """One finding for each fault, and for each line that raises for no known one.

    Args:
        tracker: after all checks.
    """
    groups: dict[tuple[str, str | None, bool], list[tuple[str, StepFailed]]] = {}
    driven = any(_overflows(failure) and _in_drive(tracker, where) for where, failure in tracker.failures)
    for where, failure in tracker.failures:
        if driven and _overflows(failure) and not _in_drive(tracker, where):
            # The drive shows how the estimate goes astray.
            continue
        if where not in SINGULAR or fault_of_error(failure) != "covariance_not_psd":
            # A copy fails before any scan.
            measured_then = bool(failure.scan.valid.any()) and not failure.fault.cause.startswith(NOT_COPIED)
            key = (failure.fault.cause.partition(":")[0], failure.fault.place, measured_then)
            groups.setdefault(key, []).append((where, failure))
    return [finding for group in groups.values() for finding in _findings(tracker, group)]


def _findings(tracker: TrackerUnderTest, group: Failures) -> Iterator[Finding]:
    """Of failures with the same error at the same line, one for each fault that is behind them."""
    first: dict[str, StepFailed] = {}
    for where, failure in group:
        first.setdefault(where, failure)
    # What goes before a failure tells more than a failure at the first scan, and the less of it, the clearer. At a
    # range of 0 much fails that fails nowhere else.
    tried = sorted(first.items(), key=lambda one: (one[0] in SINGULAR, not one[1].given, len(one[1].given)))[:TRIED]
    sensors = {failure.scan.sensor for _, failure in group}
    only = sensors.pop() if len(sensors) == 1 and len(tracker.sensors) > 1 else None
    causes = {where: _cause(tracker, where, failure) for where, failure in tried}
    count = Counter(cause[0] for cause in causes.values() if cause is not None)
    if 2 * count["course_not_wrapped"] < count.total():
        # What mostly fails elsewhere does not fail where the course jumps.
        causes = {
            where: None if cause is None or cause[0] == "course_not_wrapped" else cause
            for where, cause in causes.items()
        }
    named: set[str] = set()
    for where, failure in tried:
        if _overflows(failure) and _in_drive(tracker, where):
            fault, because, sensor = "too_far_off", "", None
        else:
            fault, because, sensor = causes[where] or (fault_of_error(failure), "", only)
        known = circumstances(tracker.make, failure)
        if _overflows(failure) and known is not None and (grown := _grown(known.before)) is not None:
            fault, because = "covariance_unbelievable", grown
        if fault in named:
            continue
        named.add(fault)
        parts = [_sentence(where, failure), *(() if known is None else _replayed(failure, known)), because]
        if len(group) > 1:
            places = list(first) if len(first) <= SHOWN else [*list(first)[:SHOWN], f"{len(first) - SHOWN} others"]
            parts.append(f"{len(group)} steps failed at that line, in {', '.join(places)}")
        # A track that has diverged may fail for that alone.
        confidence = 0.97 if known is None or known.before is None or plausible(known.before) else 0.85
        text = "; ".join(filter(None, parts))
        yield Finding(fault, confidence, text, sensor=sensor, shown_by=where)


def _grown(before: Estimate | None) -> str | None:
    """That it is the covariance that has diverged, and not the estimate."""
    if before is None or not finite(before):
        return None
    (px, py, vx, vy), largest = before.mean, float(np.sqrt(np.abs(np.diag(before.covariance)).max()))
    if not float(np.abs(before.mean).max()) < FAR < largest:
        return None
    return (
        f"at the scan before, the estimate is px, py, vx, vy = {px:.3g}, {py:.3g}, {vx:.3g}, {vy:.3g}, and its largest "
        f"standard deviation has grown to {largest:.3g} m or m/s"
    )


def _overflows(failure: StepFailed) -> bool:
    return failure.fault.cause == TOO_LARGE


def _in_drive(tracker: TrackerUnderTest, where: str) -> bool:
    return any(drive.name == where for drive, _ in tracker.drives)


def fault_of_error(failure: StepFailed) -> str:
    """By the error alone."""
    fault = failure.fault
    if fault.cause.startswith(NOT_COPIED):
        return "not_deterministic"
    if fault.kind == "died":
        return "process_ended"
    if any(words in fault.cause for words in INDEFINITE):
        return "covariance_not_psd"
    if fault.kind == "arithmetic" or any(words in fault.cause for words in NOT_FINITE):
        return "nonfinite"
    return "invalid_estimate" if fault.kind == "answer" else "exception_raised"


def _cause(tracker: TrackerUnderTest, where: str, failure: StepFailed) -> Cause | None:
    """What the same scans, given again, tell."""
    if fault_of_error(failure) not in OF_NUMBERS or failure.fault.cause.startswith(OF_CODE) or where in SINGULAR:
        return None
    if (angle := jumping_angle(tracker.make, failure)) is not None:
        return angle
    step = indefinite(tracker.make, [*failure.given, failure.scan])
    if step is None:
        return None
    text = f"the covariance first is not positive definite {step.words}: {indefinite_entries(step)}"
    return fault_of_step("covariance_not_psd", step), text, None


def _passes(make: Make, scans: Sequence[Scan]) -> bool:
    """Whether no step fails, and the estimate after the last measurement is at it."""
    session, last = TrackerSession(make), None
    try:
        for scan in scans:
            estimate = session.step(scan)
            last = (scan, estimate) if scan.valid else last
    except StepFailed:
        return False
    if last is None or last[1] is None or not finite(last[1]):
        return False
    position = SENSOR_MODELS[last[0].kind].position(last[0])
    return bool(np.hypot(*(last[1].mean[:2] - position.mean)) < NEAR + 6.0 * np.sqrt(np.trace(position.covariance)))


def jumping_angle(make: Make, failure: StepFailed) -> Cause | None:
    """Whether a step fails where an angle jumps: then the same scene, turned, does not break the tracker.

    A sensor mounted at another yaw measures other azimuths of the same target; a scene turned about the origin has
    other courses, and the same azimuths.
    """
    scans = [*failure.given, failure.scan]
    for angle in TURNS:
        turned = [turned_mounting(scan, angle) for scan in scans]
        if _passes(make, turned):
            return _azimuth(make, scans, turned, angle)
    course = course_jump(make, scans, followed(make, scans))
    return None if course is None else ("course_not_wrapped", course.text, None)


def _azimuth(make: Make, scans: Sequence[Scan], turned: Sequence[Scan], angle: float) -> Cause | None:
    """Whether it is the mean of sigma points or the innovation: the former acts without an innovation too."""
    here, there = TrackerSession(make), TrackerSession(make)
    # The first scan after which the estimates differ; the last one fails in one of them.
    pairs = zip(scans[:-1], turned, strict=False)
    k = next(
        (k for k, (scan, other) in enumerate(pairs) if not _same(here.step(scan), there.step(other))), len(scans) - 1
    )
    scan, angular = scans[k], SENSOR_MODELS[scans[k].kind].angular
    try:
        predicted = TrackerSession.after(make, scans[:k]).predict(scan)
    except StepFailed:
        return None
    if predicted is None or not finite(predicted) or not scan.valid or not angular:
        return None
    measurement = SENSOR_MODELS[scan.kind].measure(predicted.mean, scan.sensor_pose, scan.sensor_velocity)
    if all(np.pi - abs(measurement[i]) >= max(TURNS) for i in angular):
        return None
    text = (
        f"from a sensor mounted at another yaw ({-angle:+g} rad) the same target does not break it: the azimuth jumps "
        f"at pi, first at {scan.time:.4g} s, where {_measured(scan)}"
    )
    expected = scan._replace(measurement=measurement)
    with_jump = _after(make, scans[:k], expected)
    if _same(with_jump, _after(make, turned[:k], turned_mounting(expected, angle))):
        return "azimuth_not_wrapped", text, scan.sensor
    text += "; the update by its own predicted measurement, without an innovation, is wrong too"
    return "angle_mean_not_circular", text, scan.sensor


def _same(one: Estimate | None, other: Estimate | None) -> bool:
    if one is None or other is None:
        return one is other
    return apart(one, other) < APART


def _after(make: Make, earlier: Sequence[Scan], scan: Scan) -> Estimate | None:
    """The estimate after a scan, and None where a step fails."""
    try:
        return TrackerSession.after(make, earlier).step(scan)
    except StepFailed:
        return None


class Circumstances(NamedTuple):
    """What goes before a failed step."""

    before: Estimate | None
    """After the scan before."""
    predicted: Estimate | None
    """Predicted to the time of the scan, as for a missed measurement."""
    missed_fails: bool | None
    """Whether a missed measurement at that time fails as well; None where none may be given."""


def circumstances(make: Make, failure: StepFailed) -> Circumstances | None:
    """Give the scans before the failed step to a fresh tracker, and then a missed measurement.

    None where that tells nothing, or the tracker fails at another scan this time.
    """
    if fault_of_error(failure) in ("not_deterministic", "process_ended"):
        return None
    session, before = TrackerSession(make), None
    try:
        for scan in failure.given:
            before = session.step(scan)
    except StepFailed:
        return None
    try:
        return Circumstances(before, session.step(empty_scan(failure.scan)), False)
    except MissGiven:
        return Circumstances(before, None, None)
    except StepFailed:
        return Circumstances(before, None, True)


def _replayed(failure: StepFailed, known: Circumstances) -> Iterator[str]:
    if failure.scan.valid.any() and known.missed_fails is not None:
        yield f"a missed measurement at that time {'breaks it too' if known.missed_fails else 'does not break it'}"
    eigenvalues = [
        f"{_least(estimate)} {when}"
        for estimate, when in (
            (known.before, f"after the scan before, at {failure.given[-1].time:.4g} s" if failure.given else ""),
            (known.predicted, "when predicted to this scan"),
        )
        if estimate is not None and finite(estimate)
    ]
    if eigenvalues:
        yield f"the smallest eigenvalue of the covariance is {' and '.join(eigenvalues)}"


def _least(estimate: Estimate) -> str:
    eigenvalues = np.linalg.eigvalsh(0.5 * (estimate.covariance + estimate.covariance.T))
    if abs(eigenvalues[0]) < ROUNDED * eigenvalues[-1]:
        return f"0 (below {ROUNDED:.0e} of the largest)"
    return f"{eigenvalues[0]:.3g}"


def _measured(scan: Scan) -> str:
    """The measurement in words."""
    if not scan.valid:
        return f"{scan.sensor} measures nothing"
    names = SENSOR_MODELS[scan.kind].components
    values = (f"{name.replace('_', ' ')} {scan.measurement[i]:.4g}" for i, name in enumerate(names))
    return f"{scan.sensor} measures {', '.join(values)}"


def _sentence(where: str, failure: StepFailed) -> str:
    scan = failure.scan
    measurement = f"a measurement of {scan.sensor}" if scan.valid.any() else f"a missed measurement of {scan.sensor}"
    place = "" if failure.fault.place is None else f"{failure.fault.place}, "
    values = f": {_measured(scan)}" if scan.valid.any() else ""
    values += ", where the range is 0" if where in SINGULAR else ""
    return f"{failure.fault.cause} ({place}at {scan.time:.4g} s of {where}, at {measurement}{values})"
