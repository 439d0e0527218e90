"""Results for CI systems: expectations and regressions as test cases of a JUnit file.

Valid against the schema of Ant's JUnit tasks (https://github.com/windyroad/JUnit-Schema), the strictest in use.
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


@dataclass(frozen=True)
class Suite:
    """The test cases of one scenario, or of one comparison."""

    name: str
    cases: list[Case]

    def number(self, outcome: GateOutcome) -> int:
        """How many cases have an outcome."""
        return sum(case.outcome == outcome for case in self.cases)


def suite_of_run(result: Result) -> Suite:
    """Return the trackers of a run, an error where one could not go on, and its expectations as test cases."""
    cases = []
    for tracker in result.summary.trackers:
        why = tracker.failed or result.why_suspect(tracker)
        outcome: GateOutcome = "error" if tracker.failed else "failed" if why else "passed"
        cases.append(Case(f"{tracker.name} runs to the end", f"{result.name}.{tracker.name}", outcome, str(why)))
    for item in result.summary.expectations:
        # The exit status is 1 where one is undecided too.
        outcome, message = ("passed", "") if item.passed else ("failed", f"{item.outcome}: {value_and_limit(item)}")
        cases.append(Case(item.text, f"{result.name}.{item.tracker}", outcome, message))
    return Suite(result.name, cases)


def suites_of_comparison(comparison: Comparison) -> list[Suite]:
    """The limits held against each later result, a suite each."""
    suites = []
    gates = [item for group in comparison.groups for item in group.gates]
    for scenario in (scenario for group in comparison.groups for scenario in group.scenarios):
        baseline, *later = scenario.results
        for result in later:
            own = [item for item in gates if item.scenario == scenario.name and item.entrant.set == result.set]
            suites.append(Suite(f"{result.label} against {baseline.label}", list(map(_limit_case, own))))
    return suites


def _limit_case(limit: GateResult) -> Case:
    """Return the test case of a limit on one tracker in a result; an undecided limit is not kept, and a failure."""
    name = f"{limit.entrant.tracker} {limit.metric} not worse by more than {limit.percent:g} %"
    outcome, message = limit.outcome, limit.text
    if outcome == "undecided":
        outcome, message = "failed", f"not shown to be kept: {message}"
    return Case(name, f"{limit.scenario}.{limit.entrant.tracker}", outcome, message)


def to_xml(suites: Sequence[Suite]) -> str:
    """The whole file. No machine is named: a result does not depend on it."""
    made = environment(lambda text: escape(_FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)).replace("\n", LINE_BREAK))
    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return made.get_template("junit.xml.j2").render(suites=suites, written=written, elements=_ELEMENTS)
