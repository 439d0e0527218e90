"""Certainty that a tracker has the named fault, as one of three words; glossary pages of faults and checks."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

from trackbench.base.errors import counted
from trackbench.base.subjects import TermPage
from trackbench.subjects.doctor.findings import (
    CERTAIN,
    CHECKS,
    PROVEN,
    SURE,
    TRAFFIC_CHECKS,
    CheckResult,
    DoctorCheck,
    Finding,
    Question,
    checks_of,
    known_faults,
)

Word = Literal["shown", "likely", "unclear"]
#: Least confidence of a finding for each word.
LEAST: dict[Word, float] = {"shown": CERTAIN, "likely": SURE, "unclear": 0.0}
#: Meanings of the words of an examination, for users.
MEANING = {
    "shown": "No other fault looks like this one, and it explains all failed checks.",
    "likely": "There is evidence of this fault beside the errors of drives, and it explains at least half of the "
    "failed checks: those that found it or its consequences.",
    "unclear": "Something is wrong, as the failed checks show. The name may be another.",
    "healthy": "No check has failed. Those that could not be made are counted and listed.",
}


class Certainty(NamedTuple):
    """How certain a diagnosis is, and which failed checks the diagnosed fault explains."""

    word: Word
    explained: int
    """Number of failed checks that found the fault or its consequences."""
    besides: tuple[str, ...]
    """Names of the failed checks that the fault does not explain."""

    @property
    def failed(self) -> int:
        return self.explained + len(self.besides)

    def __str__(self) -> str:
        """Return a text such as "likely, explains 5 of 7 failed checks"."""
        if not self.failed:
            return self.word
        share = f"{self.explained} of " if self.besides else "" if self.failed == 1 else "all "
        return f"{self.word}, explains {share}{counted(self.failed, 'failed check')}"


def certainty(findings: Sequence[Finding], checks: Sequence[CheckResult], cause: Finding | None) -> Certainty:
    """Return how certain it is that a root cause has the right name: ``shown``, ``likely`` or ``unclear``.

    ``shown``: an exact finding (no other fault looks like it) that explains all failed checks. ``likely``: a finding
    with evidence beside the errors of drives, which explains at least half of the failed checks. ``unclear``: another.

    Args:
        findings: all findings of the examination.
        checks: all checks of the examination.
        cause: root cause; None explains no failed check.
    """
    failed = [check for check in checks if check.passed is False]
    if cause is None:
        return Certainty("unclear", 0, tuple(check.name for check in failed))
    of_cause = {other.fault for other in findings if other.consequence_of == cause.fault} | {cause.fault}
    besides = tuple(check.name for check in failed if of_cause.isdisjoint(check.faults))
    explained, kinds = len(failed) - len(besides), known_faults()[cause.fault].kinds
    word: Word = "unclear"
    exact = cause.confidence >= PROVEN or ("exact" in kinds and cause.confidence >= LEAST["shown"])
    if exact and not besides:
        word = "shown"
    elif "driven" not in kinds and cause.confidence >= LEAST["likely"] and 2 * explained >= len(failed):
        word = "likely"
    return Certainty(word, explained, besides)


def faults_terms() -> Iterator[TermPage]:
    """Yield a glossary page for each fault that the doctor can name."""
    found_by: dict[str, list[str]] = {}
    for package in (CHECKS, TRAFFIC_CHECKS):
        for check in checks_of(package):
            for name in check.faults:
                of_questions = [question for question in check.questions if name in question.finds]
                found_by.setdefault(name, []).extend(question.name for question in of_questions or check.questions)
    for name, fault in known_faults().items():
        page = (
            ("fault", fault.title),
            ("look at", fault.where),
            ("fix", fault.fix),
            ("found by", ", ".join(found_by[name])),
        )
        yield TermPage(name, page)


def checks_terms() -> Iterator[TermPage]:
    """Yield a glossary page for each question that is asked of a tracker."""
    for package in (CHECKS, TRAFFIC_CHECKS):
        for check in checks_of(package):
            for question in check.questions:
                yield TermPage(question.name, tuple(_check_page(check, question)))


def listed_checks() -> Iterator[tuple[str, str]]:
    """Return name and question of every check, for ``trackbench list``."""
    return ((term.name, term.page[0][1]) for term in checks_terms())


def examination_terms() -> Iterator[TermPage]:
    """Return a glossary page for each word that an examination uses for a result: shown, likely, unclear, healthy."""
    return (TermPage(word, (("in an examination", text),)) for word, text in MEANING.items())


def _check_page(check: DoctorCheck[...], question: Question) -> Iterator[tuple[str, str]]:
    each = " For each sensor." if question.each_sensor else ""
    yield "check", f"{(question.full or question.asks).format(sensor='a sensor')}{each}"
    how = (inspect.getdoc(check.make) or "").partition("\n\n")[0]
    if how and not check.every_drive:
        yield "how", re.sub(r"`+", "", " ".join(how.split()))
    needs = ["scans without a detection"] if question.misses else []
    needs += ["an observer that moves"] if question.motion else []
    if needs:
        yield "needs", " and ".join(needs)
    if faults := question.finds or check.faults:
        yield "finds", ", ".join(faults)
