"""The examination of a tracker of one object on the recorded scans of a log: what can be told without a truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from trackbench.api.scenario import loaded_scenario, sense
from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Scan
from trackbench.subjects.doctor.assumptions import Assumptions, require_known_checks
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.findings import (
    LOG_CHECKS,
    CheckResult,
    DoctorCheck,
    Finding,
    PartResult,
    checks_of,
    questions,
    rank_findings,
)
from trackbench.subjects.doctor.followed_log import RecordedLog
from trackbench.subjects.doctor.log_checks.consistency import CAUSES
from trackbench.subjects.doctor.output_checks import quiet
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.session import Examined
from trackbench.trackers.answers import Tracker

#: Scans that are given to a tracker at most: of the objects with the most measurements.
MOST = 6000
NOT_ASKED = "it needs a truth, or scans that are tried; a log has neither"


def objects_of(file: Path) -> list[list[Scan]]:
    """The scans of each object of a log, as they arrive: from its first measurement to its last.

    Raises:
        InputError: the file is no scenario, or its detections do not say of which object they are.
    """
    loaded = loaded_scenario(file)
    if loaded.config.sensing.identities == "hidden":
        raise InputError("its detections do not say of which object they are (identities: hidden)", file=file)
    scans = sorted(sense(loaded), key=lambda scan: scan.arrival_time)
    objects = []
    for i in range(scans[0].valid.shape[0] if scans else 0):
        own = [scan._replace(measurement=scan.measurement[:, i, 0], valid=scan.valid[i, 0]) for scan in scans]
        measured = [k for k, scan in enumerate(own) if scan.valid]
        if measured:
            objects.append(own[measured[0] : measured[-1] + 1])
    return objects


class LogDoctor:
    """Examines trackers on the scans of a log.

    Args:
        objects: the scans of each object, as of ``objects_of``; those with the most measurements are used.
        no_misses: whether every scan has a detection.
        skip: checks that are not made.

    Raises:
        InputError: there is no such check.
    """

    def __init__(self, objects: Sequence[Sequence[Scan]], *, no_misses: bool = False, skip: Sequence[str] = ()) -> None:
        used: list[list[Scan]] = []
        count = 0
        for all_scans in sorted(objects, key=lambda scans: -sum(bool(scan.valid) for scan in scans)):
            scans = [scan for scan in all_scans if scan.valid or not no_misses]
            count += len(scans)
            if not used or count <= MOST:
                used.append(scans)
        self._objects = used
        self._assumptions = Assumptions(no_misses=no_misses, skip=tuple(skip))
        require_known_checks(skip, {scan.sensor for scans in used for scan in scans}, package=LOG_CHECKS)

    @one_blas_thread()
    @quiet()
    def examine(self, name: str, make: Callable[[], Tracker]) -> Examination:
        """Make the checks of a log; those of an examination with a truth are listed as not made.

        Args:
            name: what the tracker is called in the results.
            make: gives a fresh tracker.

        Raises:
            CannotRun: it gives no estimate at any scan.
        """
        log = RecordedLog(Examined(make, self._assumptions.no_misses), self._objects)
        if not log.followed.estimates:
            failures = log.followed.failures
            raise CannotRun(str(failures[0]) if failures else "it gave no estimate at any scan")
        records = checks_of(LOG_CHECKS)
        results = [self._made(check, log) for check in records]
        findings = [finding for result in results for finding in result.findings]
        checks = [
            result
            for check, part in zip(records, results, strict=True)
            for result in check.with_faults(part.checks, part.findings, findings)
        ]
        checks += [CheckResult(question, of.asks, None, NOT_ASKED) for question, of in questions().items()]
        return Examination(name, _explained(rank_findings(findings)), checks)

    def _made(self, check: DoctorCheck[[RecordedLog]], log: RecordedLog) -> PartResult:
        result = check.make(log)
        result.checks = check.with_questions(result.checks)
        return self._assumptions.applied(result, self._assumptions.left_out(check, log.sensors), check)


def _explained(ranked: Sequence[Finding]) -> list[Finding]:
    """What the innovations show of a wrong time, noise or bias is its consequence, and a bias that of the others."""
    cause = min((finding.fault for finding in ranked if finding.fault in CAUSES), key=CAUSES.index, default=None)
    roots = {cause, *CAUSES[:-1]}
    explained = [
        finding if cause is None or finding.fault in roots else replace(finding, consequence_of=cause)
        for finding in ranked
    ]
    return sorted(explained, key=lambda finding: finding.consequence_of is not None)
