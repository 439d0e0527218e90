"""The doctor's terms for ``trackbench explain``: faults, checks, and the words of an examination."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

from trackbench.base.subjects import TermPage
from trackbench.subjects.doctor.certainty import MEANING
from trackbench.subjects.doctor.findings import (
    CHECKS,
    LOG_CHECKS,
    TRAFFIC_CHECKS,
    DoctorCheck,
    Question,
    checks_of,
    known_faults,
)


def faults_terms() -> Iterator[TermPage]:
    """Every fault that the doctor can name."""
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
    """Every question that is asked of a tracker."""
    for package in (CHECKS, TRAFFIC_CHECKS, LOG_CHECKS):
        for check in checks_of(package):
            for question in check.questions:
                yield TermPage(question.name, tuple(_of_check(check, question)))


def examination_terms() -> Iterator[TermPage]:
    """The words that an examination uses."""
    return (TermPage(word, (("in an examination", text),)) for word, text in MEANING.items())


def _of_check(check: DoctorCheck[...], question: Question) -> Iterator[tuple[str, str]]:
    each = " For each sensor." if question.each_sensor else ""
    yield "check", f"{(question.full or question.asks).format(sensor='a sensor')}{each}"
    how = (inspect.getdoc(check.make) or "").partition("\n\n")[0]
    if how and not check.every_drive:
        yield "how", re.sub(r"`+", "", " ".join(how.split()))
    needs = ["scans without a detection"] if question.misses else []
    needs += ["an observer that moves"] if question.motion else []
    if needs:
        yield "needs", " and ".join(needs)
    if faults := (*(question.finds or check.faults), *question.shows):
        yield "finds", ", ".join(faults)
