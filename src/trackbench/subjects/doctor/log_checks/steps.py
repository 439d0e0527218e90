"""Do the scans of a log come in order, does every step return an estimate, and does that move by its own velocity?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.errors import counted
from trackbench.base.types import Scan
from trackbench.subjects.doctor.checks.steps import fault_of_error
from trackbench.subjects.doctor.findings import Finding, PartResult, Question, doctor_check
from trackbench.subjects.doctor.log_doctor import GAP, RecordedLog
from trackbench.subjects.doctor.session import NO_PREDICTION

#: Share of its velocity times the time step by which an estimate is predicted, below and above which it is wrong: a
#: turn at 60 degrees/s over 1 s takes 9 % off.
SHARE = (0.85, 1.15)
#: Displacement from which on a step counts, m; how many are needed.
DISPLACEMENT, LEAST = 0.05, 20


@doctor_check(
    Question(
        "log_stamps",
        "Has each scan of the log a time of its own?",
        "Has each scan of {sensor} in the log a time of its own?",
        each_sensor=True,
    ),
    place=10,
)
def stamps(log: RecordedLog) -> PartResult:
    """Report the time steps of each sensor, and scans of one sensor that have the same time."""
    result = PartResult()
    for sensor in log.sensors:
        of_objects = [[scan for scan in scans if scan.sensor == sensor] for scans in log.objects]
        scans: Sequence[Scan] = max(of_objects, key=len)
        steps = np.diff([scan.time for scan in scans])
        if not len(steps):
            result.add(f"log_stamps.{sensor}", None, f"it has {counted(len(scans), 'scan')}")
            continue
        late = [scan.arrival_time - scan.time for scan in scans]
        repeated, back = int(np.sum(steps == 0.0)), int(np.sum(steps < 0.0))
        text = (
            f"{len(scans)} scans, {np.median(steps):.4g} s apart in the median, {np.max(steps):.4g} s at most "
            f"({np.sum(steps > GAP)} gaps of more than {GAP:g} s); they arrive {np.median(late):.3g} s after their "
            f"time; {repeated} have the time of the one before, {back} an earlier one"
        )
        result.add(f"log_stamps.{sensor}", repeated == 0, text)
    return result


@doctor_check(Question("log_steps", "Does every scan of the log give an estimate?"), place=20)
def answered(log: RecordedLog) -> PartResult:
    """Report the steps that failed and the estimates that are not finite, the first of each as a finding."""
    failures, not_finite = log.followed.failures, log.followed.not_finite
    if not failures and not not_finite:
        return PartResult().add("log_steps", True, f"each of {log.followed.scans} gives one, or None before the start")
    texts, findings = [], []
    if failures:
        first = failures[0]
        place = "" if first.fault.place is None else f"{first.fault.place}, "
        texts.append(
            f"{first.fault.cause} ({place}at {first.scan.time:.4g} s, at a scan of {first.scan.sensor}); "
            f"{len(failures)} of {counted(len(log.objects), 'object')} were not followed to the end"
        )
        findings.append(Finding(fault_of_error(first), 0.95, texts[-1]))
    if not_finite:
        scan = not_finite[0]
        texts.append(f"{len(not_finite)} estimates are not finite, first at {scan.time:.4g} s, after {scan.sensor}")
        findings.append(Finding("nonfinite", 0.95, texts[-1]))
    return PartResult().add("log_steps", False, "; ".join(texts), *findings)


@doctor_check(
    Question(
        "log_prediction",
        "Is the estimate predicted by its velocity times the time step between the scans of the log?",
        misses=True,
        shows=("time_offset",),
    ),
    place=30,
)
def predicted_motion(log: RecordedLog) -> PartResult:
    """Compare how far predictions move along their velocity with the velocity times the time step."""
    if not log.followed.moved:
        return PartResult().add("log_prediction", None, NO_PREDICTION)
    ratios = np.array([along / far for _, along, far in log.followed.moved if far > DISPLACEMENT])
    if len(ratios) < LEAST:
        return PartResult().add("log_prediction", None, f"{len(ratios)} predictions move by more than {DISPLACEMENT} m")
    ratio = float(np.median(ratios))
    text = f"the estimate moves {ratio:.3g} times as far as its velocity says (median of {len(ratios)} predictions)"
    if SHARE[0] <= ratio <= SHARE[1]:
        return PartResult().add("log_prediction", True, text)
    still = abs(ratio) < 1.0 - SHARE[0]
    fault = "missed_scan_not_predicted" if still else "wrong_dt"
    return PartResult().add("log_prediction", False, text, Finding(fault, 0.9, text, factor=None if still else ratio))
