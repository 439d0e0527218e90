"""Are the stated covariances the tracker's own, and do the gains go with them?"""

from __future__ import annotations

from trackbench.subjects.doctor.findings import CheckResult, PartResult
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest


def stated_covariance(tracker: TrackerUnderTest) -> PartResult:
    """Look whether the covariances change, and whether the gains are made of them, whole and in the order returned."""
    question = "Is the covariance computed, whole, and in the order of the estimate?"
    if not any(tracker.trials.values()):
        return PartResult([CheckResult("stated_covariance", question, None, "there was no estimate to update")])
    fault = tracker.stated_covariance_fault
    if fault is not None:
        return PartResult([CheckResult("stated_covariance", question, False, fault.evidence)], [fault])
    text = "it changes, and neither a zero nor another order is told by the gains"
    return PartResult([CheckResult("stated_covariance", question, True, text)])


def one_gain(tracker: TrackerUnderTest) -> PartResult:
    """Hold the updates of the mean and of the covariance against those of the right gain."""
    result = PartResult()
    for name, trials in tracker.trials.items():
        question = f"Do the mean and the covariance change by one gain with {name}?"
        fault = tracker.update_faults.get(name)
        if fault is not None:
            result.findings.append(fault)
            result.checks.append(CheckResult(f"one_gain.{name}", question, False, fault.evidence))
        elif trials:
            text = "where one of the two is that of the right gain, the other is too"
            result.checks.append(CheckResult(f"one_gain.{name}", question, True, text))
        else:
            result.checks.append(CheckResult(f"one_gain.{name}", question, None, "there was no estimate to update"))
    return result
