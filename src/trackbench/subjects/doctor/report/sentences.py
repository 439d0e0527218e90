"""The sentences of an examination."""

from __future__ import annotations

from trackbench.base.errors import counted
from trackbench.report.numbers import percent
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import CheckResult, Finding


def verdict(examination: Examination) -> str:
    """The result in one sentence."""
    found, failed = roots(examination), sum(check.passed is False for check in examination.checks)
    if found:
        return f"{examination.tracker}: {counted(len(found), 'fault')} found"
    if failed:
        return f"{examination.tracker}: no known fault found, but {counted(failed, 'check')} failed"
    return f"{examination.tracker}: {_healthy(examination)}"


def _healthy(examination: Examination) -> str:
    """How much of the examination could be made."""
    asked = [check for check in examination.checks if not check.skipped]
    open_ = [check.name for check in asked if check.passed is None]
    skipped = len(examination.checks) - len(asked)
    but = f" but for {counted(skipped, 'check')} skipped" if skipped else ""
    if not open_:
        return f"healthy{but}"
    made = len(asked) - len(open_)
    and_skipped = f"; {skipped} skipped" if skipped else ""
    return (
        f"healthy in {made} of {counted(len(asked), 'check')}; {len(open_)} not made: {', '.join(open_)}{and_skipped}"
    )


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
    return "skipped" if check.skipped else {True: "passed", False: "FAILED", None: "not made"}[check.passed]


def not_made(examination: Examination) -> list[tuple[str, list[str]]]:
    """The reasons for which checks were not made, with the names of these checks."""
    reasons: dict[str, list[str]] = {}
    for check in examination.checks:
        if check.passed is None:
            reasons.setdefault(check.result, []).append(check.name)
    return list(reasons.items())
