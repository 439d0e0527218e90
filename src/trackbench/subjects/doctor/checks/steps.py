"""Failed steps and their causes, found by giving the earlier scans to a fresh tracker.

A failed step is a finding, or shows that nothing can be asked of the tracker.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import TrackbenchError, counted
from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.copyable_tracker import NOT_COPIED
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import (
    Make,
    fault_of_step,
    first_indefinite_step,
    indefinite_entries,
)
from trackbench.subjects.doctor.session import FAR, MissGiven, StepFailed, TrackerSession, finite, plausible
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import TOO_LARGE

#: Words in the messages of NumPy and SciPy where there is no Cholesky factor.
INDEFINITE = ("not positive definite",)
#: Words in the messages of math, NumPy and SciPy where a number is not finite or leads to one that is not.
NOT_FINITE = ("math domain error", "infs or NaNs", "did not converge")

#: Faults that numbers can bring about, and errors that only code can.
OF_NUMBERS = ("covariance_not_psd", "exception_raised")
OF_CODE = ("KeyError", "IndexError", "NameError", "UnboundLocalError", "AttributeError", "TypeError", "ImportError")
#: Largest number of probes and drives in which the failures of one line are examined, fewest scans first.
TRIED = 6
#: Largest number of probes and drives that are named.
SHOWN = 4

Failures = Sequence[tuple[str, StepFailed]]
"""Failed steps, each with the name of the probe (test target), test drive or check where it happened."""


Cause = tuple[str, str, str | None]
"""Name of a fault, its evidence in words, and the name of its sensor, None if it is not of one sensor alone."""


class CannotRun(TrackbenchError):
    """Error of a tracker that cannot process one scan of any sensor, or gives no estimate at any scan."""


def require_runnable(tracker: TrackerUnderTest) -> None:
    """Follow test targets with each sensor alone, until the tracker processes a scan without an error.

    Raises:
        CannotRun: the tracker processes no scan of any sensor.
    """
    for probe in tracker.probes.general:
        for name in tracker.sensors:
            session = tracker.session_at(probe, (name,))
            if session is not None or tracker.failures[-1][1].earlier_scans:
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
            "Give the named measurement to the tracker in a test, and make the step pass it; predict at a missed one "
            "(scan.valid is False), unless --no-misses says that there is none.",
            Role("exact", drive="uneven_steps"),
        ),
        "invalid_estimate": KnownFault(
            "a step returns something other than an estimate",
            "Where the step returns.",
            "Return (state, (mean, covariance)) with a mean (4,) and a covariance (4, 4) of finite size, or (state, "
            "None) before the track has started.",
            Role(drive="uneven_steps"),
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
    """Report the steps of the tracker that failed during earlier checks, with their causes."""
    findings, failed = failure_findings(tracker), tracker.failures
    text = "no step failed" if not failed else f"{counted(len(failed), 'step')} failed, first: {_sentence(*failed[0])}"
    return PartResult().add("steps", not findings, text, *findings)


def failure_findings(tracker: TrackerUnderTest) -> list[Finding]:
    """Return one finding for each fault, and one for each line that raises an error of no known fault.

    Args:
        tracker: tracker under test, after all other checks.
    """
    groups: dict[tuple[str, str | None, bool], list[tuple[str, StepFailed]]] = {}
    driven = any(_overflows(failure) and _in_drive(tracker, where) for where, failure in tracker.failures)
    for where, failure in tracker.failures:
        if driven and _overflows(failure) and not _in_drive(tracker, where):
            # The drive shows better how the estimate diverges.
            continue
        # A copy fails before any scan.
        measured_then = bool(failure.scan.valid.any()) and not failure.fault.cause.startswith(NOT_COPIED)
        key = (failure.fault.cause.partition(":")[0], failure.fault.place, measured_then)
        groups.setdefault(key, []).append((where, failure))
    return [finding for group in groups.values() for finding in _findings(tracker, group)]


def _findings(tracker: TrackerUnderTest, group: Failures) -> Iterator[Finding]:
    """Yield a finding for each fault that is behind failures with the same error at the same line."""
    first: dict[str, StepFailed] = {}
    for where, failure in group:
        first.setdefault(where, failure)
    # The fewer scans go before a failure, the clearer it is; but a failure at the first scan tells least.
    tried = sorted(first.items(), key=lambda item: (not item[1].earlier_scans, len(item[1].earlier_scans)))[:TRIED]
    sensors = {failure.scan.sensor for _, failure in group}
    only = sensors.pop() if len(sensors) == 1 and len(tracker.sensors) > 1 else None
    causes = {where: _cause(tracker, failure) for where, failure in tried}
    named: set[str] = set()
    for where, failure in tried:
        if _overflows(failure) and _in_drive(tracker, where):
            fault, reason, sensor = "too_far_off", "", None
        else:
            fault, reason, sensor = causes[where] or (fault_of_error(failure), "", only)
        context = circumstances(tracker.make, failure)
        if _overflows(failure) and context is not None and (grown := _diverged_covariance(context.before)) is not None:
            fault, reason = "covariance_unbelievable", grown
        if fault in named:
            continue
        named.add(fault)
        parts = [_sentence(where, failure), *(() if context is None else _replayed(failure, context)), reason]
        if len(group) > 1:
            places = list(first) if len(first) <= SHOWN else [*list(first)[:SHOWN], f"{len(first) - SHOWN} others"]
            parts.append(f"{len(group)} steps failed at that line, in {', '.join(places)}")
        # A track that has diverged may fail because of that alone.
        confidence = 0.97 if context is None or context.before is None or plausible(context.before) else 0.85
        text = "; ".join(filter(None, parts))
        yield Finding(fault, confidence, text, sensor=sensor, shown_by=where)


def _diverged_covariance(before: Estimate | None) -> str | None:
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
    """Return the name of the fault that a failed step's error shows, without a repetition of the step."""
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


def _cause(tracker: TrackerUnderTest, failure: StepFailed) -> Cause | None:
    """Repeat the scans of a failed step; return the fault of the covariance that then shows, or None."""
    if fault_of_error(failure) not in OF_NUMBERS or failure.fault.cause.startswith(OF_CODE):
        return None
    step = first_indefinite_step(tracker.make, [*failure.earlier_scans, failure.scan])
    if step is None:
        return None
    text = f"the covariance first is not positive definite {step.words}: {indefinite_entries(step)}"
    return fault_of_step("covariance_not_psd", step), text, None


class Circumstances(NamedTuple):
    """Answers of a fresh tracker to the scans before a failed step, and to a scan without a detection in its place."""

    before: Estimate | None
    """Estimate after the scans before the failed step; None without an estimate."""
    predicted: Estimate | None
    """Estimate at a scan without a detection at the time of the failed step; None without an estimate."""
    missed_fails: bool | None
    """Whether the scan without a detection fails, too; None if the user excludes such scans."""


def circumstances(make: Make, failure: StepFailed) -> Circumstances | None:
    """Give the scans before a failed step, and one without a detection, to a fresh tracker; return its answers.

    None where the answers tell nothing, or the tracker fails at another scan this time.
    """
    if fault_of_error(failure) in ("not_deterministic", "process_ended"):
        return None
    session, before = TrackerSession(make), None
    try:
        for scan in failure.earlier_scans:
            before = session.step(scan)
    except StepFailed:
        return None
    try:
        return Circumstances(before, session.step(empty_scan(failure.scan)), False)
    except MissGiven:
        return Circumstances(before, None, None)
    except StepFailed:
        return Circumstances(before, None, True)


def _replayed(failure: StepFailed, context: Circumstances) -> Iterator[str]:
    if failure.scan.valid.any() and context.missed_fails is not None:
        yield f"a missed measurement at that time {'breaks it too' if context.missed_fails else 'does not break it'}"


def _describe_measurement(scan: Scan) -> str:
    if not scan.valid:
        return f"{scan.sensor} measures nothing"
    names = SENSOR_MODELS[scan.kind].components
    values = (f"{name.replace('_', ' ')} {scan.measurement[i]:.4g}" for i, name in enumerate(names))
    return f"{scan.sensor} measures {', '.join(values)}"


def _sentence(where: str, failure: StepFailed) -> str:
    scan = failure.scan
    measurement = f"a measurement of {scan.sensor}" if scan.valid.any() else f"a missed measurement of {scan.sensor}"
    place = "" if failure.fault.place is None else f"{failure.fault.place}, "
    values = f": {_describe_measurement(scan)}" if scan.valid.any() else ""
    return f"{failure.fault.cause} ({place}at {scan.time:.4g} s of {where}, at {measurement}{values})"
