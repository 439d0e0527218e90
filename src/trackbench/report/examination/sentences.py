"""The sentences of an examination."""

from __future__ import annotations

from trackbench.doctor.examine import Examination
from trackbench.doctor.findings import CheckResult, Finding
from trackbench.report.numbers import percent
from trackbench.words import counted


def verdict(examination: Examination) -> str:
    """The result in one sentence."""
    found, failed = roots(examination), sum(check.passed is False for check in examination.checks)
    if found:
        return f"{examination.tracker}: {counted(len(found), 'fault')} found"
    if failed:
        return f"{examination.tracker}: no known fault found, but {counted(failed, 'check')} failed"
    return f"{examination.tracker}: healthy"


def roots(examination: Examination) -> list[Finding]:
    """The findings that are no consequence of another."""
    return [finding for finding in examination.findings if finding.consequence_of is None]


def consequences(examination: Examination) -> list[Finding]:
    """The findings that are consequences of another."""
    return [finding for finding in examination.findings if finding.consequence_of is not None]


def facts(finding: Finding) -> list[str]:
    """Confidence, sensor and factor."""
    said = [f"confidence {percent(finding.confidence)}".replace("\N{NO-BREAK SPACE}", " ")]
    if finding.sensor is not None:
        said.append(f"sensor {finding.sensor}")
    if finding.factor is not None:
        said.append(f"factor {finding.factor:.3g}")
    return said


def mark(check: CheckResult) -> str:
    """Whether the check passed."""
    return {True: "passed", False: "FAILED", None: "not made"}[check.passed]
