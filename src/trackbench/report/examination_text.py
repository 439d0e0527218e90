"""What an examination found, for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator

from trackbench.doctor.examine import Examination
from trackbench.doctor.findings import Check, Finding, advice
from trackbench.report.examination_words import consequences, facts, mark, roots, verdict
from trackbench.words import counted

WIDTH = 80


def text(examination: Examination, every_check: bool = False) -> str:
    """The verdict, each fault with its evidence and advice, what follows from them, and the checks.

    Args:
        examination: what to tell of.
        every_check: tell what each check saw, and not of the failed ones alone.
    """
    lines = [*_wrapped(verdict(examination))]
    for number, finding in enumerate(roots(examination), start=1):
        lines += ["", *_finding(number, finding)]
    following = consequences(examination)
    if following:
        lines += ["", "Probably consequences, to be looked at again after the fix:"]
        lines += [_short(f"  {one.fault} (of {one.consequence_of}): {one.evidence}") for one in following]
    return "\n".join([*lines, "", *_checks(examination.checks, every_check)])


def _finding(number: int, finding: Finding) -> Iterator[str]:
    known = advice()[finding.fault]
    yield from _wrapped(f"{number}. {known.title}", "   ")
    yield from _wrapped(f"   {finding.fault}: {', '.join(facts(finding))}", "   ")
    for label, said in (("evidence", finding.evidence), ("look at", known.where), ("fix", known.fix)):
        yield from _wrapped(f"   {label:<9} {said}", " " * 13)


def _checks(checks: Iterable[Check], every: bool) -> Iterator[str]:
    asked = [check for check in checks if check.passed is not None]
    failed = [check for check in asked if not check.passed]
    yield f"Checks: {len(asked) - len(failed)} of {len(asked)} passed" + (", failed:" if failed and not every else "")
    left_out = [check for check in checks if check.passed is None]
    if every:
        for check in checks:
            yield from _wrapped(f"  {mark(check):<8} {check.name}: {check.question}", " " * 11)
            yield from _wrapped(f"{' ' * 11}{check.result}", " " * 11)
        return
    for check in failed:
        yield from _wrapped(f"  {check.name}: {check.question}", "    ")
    if left_out:
        names = ", ".join(check.name for check in left_out)
        yield from _wrapped(f"{counted(len(left_out), 'check')} could not be made: {names}", "  ")


def _wrapped(said: str, indent: str = "") -> list[str]:
    return textwrap.wrap(said, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def _short(said: str) -> str:
    """One line; what does not fit into it is left out."""
    return said if len(said) <= WIDTH else said[: WIDTH - 3].rstrip() + "..."
