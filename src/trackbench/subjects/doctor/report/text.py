"""The sentences of an examination, and all of it as text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.report.numbers import percent
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults


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


WIDTH = 80


def text(examination: Examination, every_check: bool = False) -> str:
    """The verdict, each root cause with its evidence and fix, the consequences, and the checks.

    Args:
        examination: the findings and checks.
        every_check: all checks with their results, instead of the failed ones only.
    """
    lines = [*_wrapped(verdict(examination))]
    for number, finding in enumerate(roots(examination), start=1):
        lines += ["", *_finding(number, finding)]
    caused = consequences(examination)
    if caused:
        lines += ["", "Probably consequences; check them again after the fix:"]
        for one in caused:
            lines += _wrapped(f"  {one.fault} (of {one.consequence_of}): {one.evidence}", "    ")
    return "\n".join([*lines, "", *_checks(examination, every_check)])


def _finding(number: int, finding: Finding) -> Iterator[str]:
    known = known_faults()[finding.fault]
    yield from _wrapped(f"{number}. {known.title}", "   ")
    yield from _wrapped(f"   {finding.fault}: {', '.join(facts(finding))}", "   ")
    for label, said in (("evidence", finding.evidence), ("look at", known.where), ("fix", known.fix)):
        yield from _wrapped(f"   {label:<9} {said}", " " * 13)


def _checks(examination: Examination, every: bool) -> Iterator[str]:
    checks = examination.checks
    made = [check for check in checks if check.passed is not None]
    failed = [check for check in made if not check.passed]
    yield f"Checks: {len(made) - len(failed)} of {len(made)} passed" + (", failed:" if failed and not every else "")
    if every:
        for check in checks:
            yield from _wrapped(f"  {mark(check):<8} {check.name}: {check.question}", " " * 11)
            yield from _wrapped(f"{' ' * 11}{check.result}", " " * 11)
        return
    for check in failed:
        yield from _wrapped(f"  {check.name}: {check.question}", "    ")
    left_out = len(checks) - len(made)
    if left_out:
        yield f"{counted(left_out, 'check')} not made:"
        for reason, names in not_made(examination):
            yield from _wrapped(f"  {', '.join(names)}: {reason}", "    ")


def _wrapped(said: str, indent: str = "") -> list[str]:
    return textwrap.wrap(said, WIDTH, subsequent_indent=indent, break_on_hyphens=False)
