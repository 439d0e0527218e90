"""Expectations and limits of a comparison as test cases of a JUnit file, for CI systems.

The file is valid against the schema of Ant's JUnit tasks (https://github.com/windyroad/JUnit-Schema).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from markupsafe import Markup, escape

from trackbench.compare import Comparison
from trackbench.compare.comparison import GateOutcome, GateResult
from trackbench.document.template import environment
from trackbench.report.sentences import value_and_limit
from trackbench.results import Result

#: Characters that XML 1.0 forbids.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

#: XML element inside a test case, for the outcomes that fail.
_ELEMENTS: Mapping[GateOutcome, str] = {"failed": "failure", "error": "error"}
#: Line break in an attribute, where XML would read "\n" as a space.
LINE_BREAK = Markup("&#10;")


@dataclass(frozen=True)
class Case:
    """Test case of a JUnit file: a scenario's expectation, a limit on a regression, or that a tracker did not fail."""

    name: str
    group: str
    """Scenario and tracker, "highway.ekf", by which CI systems group test cases."""
    outcome: GateOutcome = "passed"
    """Outcome: passed, failed, error or undecided; a CI system shows an undecided case as skipped."""
    message: str = ""


@dataclass(frozen=True)
class Suite:
    """Test cases of one scenario, or of one result against the baseline."""

    name: str
    cases: list[Case]

    def number(self, outcome: GateOutcome) -> int:
        """Return the number of test cases with an outcome, such as ``failed``."""
        return sum(case.outcome == outcome for case in self.cases)


def suite_of_run(result: Result) -> Suite:
    """Return the test cases of a run: one for each tracker, whether it ran to the end, and one for each expectation."""
    cases = []
    for tracker in result.summary.trackers:
        why = tracker.failed or result.why_suspect(tracker)
        outcome: GateOutcome = "error" if tracker.failed else "failed" if why else "passed"
        cases.append(Case(f"{tracker.name} runs to the end", f"{result.name}.{tracker.name}", outcome, str(why)))
    for item in result.summary.expectations:
        # An undecided expectation fails here too, as its exit status is 1.
        outcome, message = ("passed", "") if item.passed else ("failed", f"{item.outcome}: {value_and_limit(item)}")
        cases.append(Case(item.text, f"{result.name}.{item.tracker}", outcome, message))
    return Suite(result.name, cases)


def suites_of_comparison(comparison: Comparison) -> list[Suite]:
    """Return a suite for each result but the baseline, with a test case for each limit."""
    suites = []
    gates = [item for group in comparison.groups for item in group.gates]
    for scenario in (scenario for group in comparison.groups for scenario in group.scenarios):
        baseline, *later = scenario.results
        for result in later:
            limits = [item for item in gates if item.scenario == scenario.name and item.entrant.set == result.set]
            suites.append(Suite(f"{result.label} against {baseline.label}", list(map(_limit_case, limits))))
    return suites


def _limit_case(limit: GateResult) -> Case:
    """Return the test case of a limit on one tracker; an undecided limit fails."""
    name = f"{limit.entrant.tracker} {limit.metric} not worse by more than {limit.percent:g} %"
    outcome, message = limit.outcome, limit.text
    if outcome == "undecided":
        outcome, message = "failed", f"not shown to be kept: {message}"
    return Case(name, f"{limit.scenario}.{limit.entrant.tracker}", outcome, message)


def to_xml(suites: Sequence[Suite]) -> str:
    """Return the XML text of the JUnit file, with ``localhost`` in place of the machine's name."""
    replacement = "\N{REPLACEMENT CHARACTER}"
    templates = environment(lambda text: escape(_FORBIDDEN.sub(replacement, text)).replace("\n", LINE_BREAK))
    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return templates.get_template("junit.xml.j2").render(suites=suites, written=written, elements=_ELEMENTS)
