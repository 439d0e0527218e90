"""Results for CI systems: expectations and regressions as test cases of a JUnit file, and as lines of GitHub Actions.

Valid against the schema of Ant's JUnit tasks (https://github.com/windyroad/JUnit-Schema), the strictest in use.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from markupsafe import Markup, escape

from trackbench.base.config import KeyPath
from trackbench.compare import Comparison
from trackbench.compare.comparison import GateOutcome, GateResult
from trackbench.document.template import environment
from trackbench.report.sentences import value_and_limit
from trackbench.results import SUMMARY, ExpectationResult, Result
from trackbench.scenario import Scenario

#: Characters that XML 1.0 cannot hold.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

#: The element of a case that is neither passed nor undecided.
_ELEMENTS: Mapping[GateOutcome, str] = {"failed": "failure", "error": "error"}
#: Of a text in an attribute, where XML would read a space.
LINE_BREAK = Markup("&#10;")


@dataclass(frozen=True)
class Case:
    """One test case."""

    name: str
    group: str
    """What it belongs to; CI systems sort by it."""
    outcome: GateOutcome = "passed"
    """An undecided one is shown as skipped."""
    message: str = ""
    file: str = ""
    """Where it is stated, or else what it was found in."""
    line: int | None = None


@dataclass(frozen=True)
class Suite:
    """The test cases of one scenario, or of one comparison."""

    name: str
    cases: list[Case]

    def number(self, outcome: GateOutcome) -> int:
        """How many cases have an outcome."""
        return sum(case.outcome == outcome for case in self.cases)


def suite_of_run(result: Result, loaded: Scenario | None = None) -> Suite:
    """The trackers (an error where one could not go on) and the expectations of a run.

    Args:
        result: of the run.
        loaded: the scenario, whose file the cases name then.
    """
    cases = []
    for tracker in result.summary.trackers:
        why = tracker.failed or result.why_suspect(tracker)
        outcome: GateOutcome = "error" if tracker.failed else "failed" if why else "passed"
        name, message = f"{tracker.name} runs to the end", str(why)
        place = _place(loaded, ("trackers", tracker.name))
        cases.append(Case(name, f"{result.name}.{tracker.name}", outcome, message, *place))
    for item in result.summary.expectations:
        # The exit status is 1 where one is undecided too.
        outcome, message = ("passed", "") if item.passed else ("failed", f"{item.outcome}: {value_and_limit(item)}")
        place = _place(loaded, ("expect", _number(loaded, item)))
        cases.append(Case(item.text, f"{result.name}.{item.tracker}", outcome, message, *place))
    return Suite(result.name, cases)


def _place(loaded: Scenario | None, path: KeyPath) -> tuple[str, int | None]:
    """The file and the line of a key; the line is None of what stands in no file."""
    if loaded is None:
        return "", None
    return str(loaded.path), loaded.document.origin(path).line


def _number(loaded: Scenario | None, item: ExpectationResult) -> int:
    """Which of the scenario's expectations it is; those of other worlds and trackers are not judged."""
    stated = loaded.document.value.get("expect", []) if loaded else []
    wanted = {"tracker": item.tracker, "metric": item.metric, item.operator: item.limit}
    return next((i for i, entry in enumerate(stated) if wanted.items() <= entry.items()), 0)


def suites_of_comparison(comparison: Comparison) -> list[Suite]:
    """The limits held against each later result, a suite each."""
    suites = []
    gates = [item for group in comparison.groups for item in group.gates]
    for scenario in (scenario for group in comparison.groups for scenario in group.scenarios):
        baseline, *later = scenario.results
        for result in later:
            cases = [
                _limit_case(item, result.label)
                for item in gates
                if item.scenario == scenario.name and item.entrant.set == result.set
            ]
            suites.append(Suite(f"{result.label} against {baseline.label}", cases))
    return suites


def _limit_case(limit: GateResult, label: str) -> Case:
    """Return the test case of a limit on one tracker in a result; an undecided limit is not kept, and a failure."""
    name = f"{limit.entrant.tracker} {limit.metric} not worse by more than {limit.percent:g} %"
    outcome, message = limit.outcome, limit.text
    if outcome == "undecided":
        outcome, message = "failed", f"undecided: {message}"
    file = label if label.endswith(".json") else f"{label}/{SUMMARY}"
    return Case(name, f"{limit.scenario}.{limit.entrant.tracker}", outcome, message, file)


def to_xml(suites: Sequence[Suite]) -> str:
    """The whole file. No machine is named: a result does not depend on it."""
    made = environment(lambda text: escape(_FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)).replace("\n", LINE_BREAK))
    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return made.get_template("junit.xml.j2").render(suites=suites, written=written, elements=_ELEMENTS)


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
