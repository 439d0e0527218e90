"""An examination as text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import Finding, known_faults
from trackbench.subjects.doctor.report.sentences import consequences, facts, mark, not_made, roots, verdict

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
