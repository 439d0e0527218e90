"""Expectations and limits that are not met, as the lines that GitHub Actions shows beside a file.

Source: GitHub, "Workflow commands for GitHub Actions": ``::error file=F,line=N,title=T::message``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from trackbench.report.junit import Case, Suite

_LEVELS = {"failed": "error", "error": "error", "undecided": "warning"}
#: What would end a message, and of a property also what would end that.
_MESSAGE = {"%": "%25", "\r": "%0D", "\n": "%0A"}
_PROPERTY = {**_MESSAGE, ":": "%3A", ",": "%2C"}


def to_annotations(suites: Iterable[Suite]) -> Iterator[str]:
    """A line for each case that is not passed; an undecided one is a warning."""
    for suite in suites:
        for case in suite.cases:
            if case.outcome != "passed":
                yield _annotation(suite, case)


def _annotation(suite: Suite, case: Case) -> str:
    properties = {"file": case.file, "line": str(case.line or ""), "title": suite.name}
    stated = ",".join(f"{name}={_escaped(value, _PROPERTY)}" for name, value in properties.items() if value)
    message = _escaped(f"{case.name}: {case.message}" if case.message else case.name, _MESSAGE)
    return f"::{_LEVELS[case.outcome]} {stated}::{message}"


def _escaped(text: str, table: Mapping[str, str]) -> str:
    return "".join(table.get(letter, letter) for letter in text)
