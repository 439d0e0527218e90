"""What a failed step means: a finding, or a tracker of which nothing can be asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.base.errors import TrackbenchError, counted
from trackbench.base.types import Estimate
from trackbench.driving.alone import NOT_COPIED
from trackbench.subjects.doctor.covariance_origin import indefinite, indefinite_entries, indefinite_shown, named
from trackbench.subjects.doctor.exhibits import Exhibit
from trackbench.subjects.doctor.failed_step import Circumstances, circumstances, jumping_angle, measured
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.output_checks import SINGULAR
from trackbench.subjects.doctor.session import FAR, StepFailed, finite, plausible
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

Failures = Sequence[tuple[str, StepFailed]]
"""Each with the name of the probe, drive or check where it happened."""


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


def steps(tracker: TrackerUnderTest) -> PartResult:
    """Report on the steps that failed in all other checks."""
    findings, failed = failure_findings(tracker), tracker.failures
    text = "no step failed" if not failed else f"{counted(len(failed), 'step')} failed, first: {_sentence(*failed[0])}"
    if failed and not findings:
        text += "; none counts, since rounding alone can break a correct filter at the sensor's own position"
    return PartResult().add("steps", not findings, text, *findings)


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
        if where not in SINGULAR or _named(failure) != "covariance_not_psd":
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
    named: set[str] = set()
    for where, failure in tried:
        if _overflows(failure) and _in_drive(tracker, where):
            fault, because, sensor, exhibit = "too_far_off", "", None, None
        else:
            fault, because, sensor, exhibit = _cause(tracker, where, failure) or (_named(failure), "", only, None)
        known = _circumstances(tracker, failure)
        if _overflows(failure) and known is not None and known.before is not None and _grown(known.before):
            fault, because = "covariance_unbelievable", _grown_to(known.before)
        if fault in named:
            continue
        named.add(fault)
        parts = [_sentence(where, failure), *_replayed(failure, known), because]
        if len(group) > 1:
            places = list(first) if len(first) <= SHOWN else [*list(first)[:SHOWN], f"{len(first) - SHOWN} others"]
            parts.append(f"{len(group)} steps failed at that line, in {', '.join(places)}")
        # A track that has diverged may fail for that alone.
        confidence = 0.97 if known is None or known.before is None or plausible(known.before) else 0.85
        text = "; ".join(filter(None, parts))
        yield Finding(fault, confidence, text, sensor=sensor, shown_by=where, exhibit=exhibit)


def _grown(before: Estimate) -> bool:
    """Whether it is the covariance that has diverged, and not the estimate."""
    if not finite(before):
        return False
    return float(np.abs(before.mean).max()) < FAR < float(np.sqrt(np.abs(np.diag(before.covariance)).max()))


def _grown_to(before: Estimate) -> str:
    px, py, vx, vy = before.mean
    largest = float(np.sqrt(np.abs(np.diag(before.covariance)).max()))
    return (
        f"at the scan before, the estimate is px, py, vx, vy = {px:.3g}, {py:.3g}, {vx:.3g}, {vy:.3g}, and its largest "
        f"standard deviation has grown to {largest:.3g} m or m/s"
    )


def _overflows(failure: StepFailed) -> bool:
    return failure.fault.cause == TOO_LARGE


def _in_drive(tracker: TrackerUnderTest, where: str) -> bool:
    return any(drive.name == where for drive, _ in tracker.drives)


def _named(failure: StepFailed) -> str:
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


def _cause(
    tracker: TrackerUnderTest, where: str, failure: StepFailed
) -> tuple[str, str, str | None, Exhibit | None] | None:
    """What the same scans, given again, tell: the fault, the evidence, the sensor and the exhibit."""
    if _named(failure) not in OF_NUMBERS or failure.fault.cause.startswith(OF_CODE) or where in SINGULAR:
        return None
    angle = jumping_angle(tracker.make, failure)
    if angle is not None:
        return angle
    found = indefinite(tracker.make, [*failure.given, failure.scan])
    if found is None:
        return None
    text = f"the covariance first is not positive definite {found.words}: {indefinite_entries(found)}"
    return named("covariance_not_psd", found), text, None, indefinite_shown(found)


def _circumstances(tracker: TrackerUnderTest, failure: StepFailed) -> Circumstances | None:
    if _named(failure) in ("not_deterministic", "process_ended"):
        return None
    try:
        return circumstances(tracker.make, failure)
    except StepFailed:
        return None


def _replayed(failure: StepFailed, known: Circumstances | None) -> list[str]:
    return [] if known is None else [_missed(failure, known), _definite(failure, known)]


def _missed(failure: StepFailed, known: Circumstances) -> str:
    if not failure.scan.valid.any() or known.missed_fails is None:
        return ""
    return f"a missed measurement at that time {'breaks it too' if known.missed_fails else 'does not break it'}"


def _definite(failure: StepFailed, known: Circumstances) -> str:
    found = [
        f"{_least(estimate)} {when}"
        for estimate, when in (
            (known.before, f"after the scan before, at {failure.given[-1].time:.4g} s" if failure.given else ""),
            (known.predicted, "when predicted to this scan"),
        )
        if estimate is not None and finite(estimate)
    ]
    return f"the smallest eigenvalue of the covariance is {' and '.join(found)}" if found else ""


def _least(estimate: Estimate) -> str:
    eigenvalues = np.linalg.eigvalsh(0.5 * (estimate.covariance + estimate.covariance.T))
    if abs(eigenvalues[0]) < ROUNDED * eigenvalues[-1]:
        return f"0 (below {ROUNDED:.0e} of the largest)"
    return f"{eigenvalues[0]:.3g}"


def _sentence(where: str, failure: StepFailed) -> str:
    scan = failure.scan
    measurement = f"a measurement of {scan.sensor}" if scan.valid.any() else f"a missed measurement of {scan.sensor}"
    place = "" if failure.fault.place is None else f"{failure.fault.place}, "
    values = f": {measured(scan)}" if scan.valid.any() else ""
    values += ", where the range is 0" if where in SINGULAR else ""
    return f"{failure.fault.cause} ({place}at {scan.time:.4g} s of {where}, at {measurement}{values})"


STEPS_CHECK = DoctorCheck(
    steps,
    place=1000,
    questions=(Question("steps", "Does every step return an estimate?"),),
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
