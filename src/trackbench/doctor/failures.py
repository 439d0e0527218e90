"""What a failed step means: a finding, or a tracker that cannot be examined."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.doctor.findings import Finding
from trackbench.doctor.output_checks import SINGULAR
from trackbench.doctor.probes import GENERAL
from trackbench.doctor.session import StepFailed
from trackbench.doctor.tracker_under_test import TrackerUnderTest
from trackbench.errors import TrackbenchError
from trackbench.stepping.faults import TrackFault

#: In the messages of NumPy and SciPy, where there is no Cholesky factor.
INDEFINITE = ("not positive definite",)
#: In the messages of math, NumPy and SciPy, where a number is not finite or leads to one that is not.
NOT_FINITE = ("math domain error", "infs or NaNs", "did not converge")
_GENERAL = tuple(probe.name for probe in GENERAL)


class CannotRun(TrackbenchError):
    """A tracker raises, or returns no valid estimate, at an ordinary measurement."""


def require_runnable(tracker: TrackerUnderTest) -> None:
    """Follow targets in general position with each sensor alone, up to a missed measurement.

    Raises:
        CannotRun: the tracker fails.
    """
    for probe in GENERAL:
        for name in tracker.sensors:
            tracker.trial(probe, name, (name,))
            if tracker.failures and _fault(tracker.failures[-1][1].fault) != "nonfinite":
                raise _cannot_run(*tracker.failures[-1])


def failure_findings(tracker: TrackerUnderTest, found: Sequence[Finding]) -> list[Finding]:
    """The findings that follow from the errors that the tracker raised.

    Args:
        tracker: after all checks.
        found: the findings of the checks.

    Raises:
        CannotRun: an error is of no known kind, and there is no finding that could explain it.
    """
    findings = []
    unexplained = []
    for where, failure in tracker.failures:
        fault = _fault(failure.fault)
        general = where in _GENERAL
        if failure.fault.kind in ("answer", "died") or (general and fault != "nonfinite"):
            raise _cannot_run(where, failure)
        if fault is None:
            unexplained.append((where, failure))
        elif fault == "nonfinite" or where not in SINGULAR:
            findings.append(Finding(fault, 0.97, _sentence(where, failure), shown_by=where))
    if unexplained and not (findings or found):
        raise _cannot_run(*unexplained[0])
    return findings


def _fault(fault: TrackFault) -> str | None:
    if any(words in fault.cause for words in INDEFINITE):
        return "covariance_not_psd"
    return "nonfinite" if fault.kind == "arithmetic" or any(words in fault.cause for words in NOT_FINITE) else None


def _cannot_run(where: str, failure: StepFailed) -> CannotRun:
    return CannotRun(_sentence(where, failure))


def _sentence(where: str, failure: StepFailed) -> str:
    scan = failure.scan
    measurement = "a measurement" if scan.valid.any() else "a missed measurement"
    place = "" if failure.fault.place is None else f"{failure.fault.place}, "
    return f"{failure.fault.cause} ({place}at {scan.time:.4g} s of {where}, at {measurement} of {scan.sensor})"
