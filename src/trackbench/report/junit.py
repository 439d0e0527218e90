"""Results as a JUnit file, which CI systems show: expectations and regressions as test cases.

Valid against the schema of Ant's JUnit tasks (https://github.com/windyroad/JUnit-Schema), the strictest in use.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from xml.etree import ElementTree as ET

from trackbench.compare.regression import ERROR, FAILED, PASSED, UNDECIDED, Judgement
from trackbench.report.wording import failure

#: Characters that XML 1.0 cannot hold.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_ELEMENTS = {FAILED: "failure", ERROR: "error", UNDECIDED: "skipped"}
_COUNTS = {"failures": FAILED, "errors": ERROR, "skipped": UNDECIDED}


@dataclass(frozen=True)
class Case:
    """One test case."""

    name: str
    group: str
    """What it belongs to; CI systems sort by it."""
    outcome: str = PASSED
    """One of those of a ``Judgement``; an undecided one is shown as skipped."""
    message: str = ""


@dataclass(frozen=True)
class Suite:
    """The test cases of one scenario, or of one comparison."""

    name: str
    cases: list[Case]


def suite_of_run(summary: Mapping[str, Any]) -> Suite:
    """The trackers (an error where one could not go on) and the expectations of a run."""
    scenario = summary["scenario"]["name"]
    cases = [
        Case(
            f"{tracker['name']} runs to the end",
            f"{scenario}.{tracker['name']}",
            ERROR if tracker["failed"] else PASSED,
            failure(tracker) if tracker["failed"] else "",
        )
        for tracker in summary["trackers"]
    ]
    for item in summary["expectations"]:
        found = "n/a" if item["value"] is None else item["value"]
        outcome, message = (PASSED, "") if item["passed"] else (FAILED, f"{item['text']}: found {found}")
        cases.append(Case(item["text"], f"{scenario}.{item['tracker']}", outcome, message))
    return Suite(scenario, cases)


def suites_of_comparison(labels: Sequence[str], judgements: Sequence[Judgement]) -> list[Suite]:
    """The limits held against each later run, a suite each; ``labels`` name the runs, the baseline first."""
    suites = []
    for number, label in enumerate(labels[1:], 1):
        cases = [
            Case(
                f"{item.entrant.tracker} {item.limit.metric} not worse by more than {item.limit.percent:g} %",
                f"regression.{item.entrant.tracker}",
                item.outcome,
                item.text,
            )
            for item in judgements
            if item.entrant.run == number
        ]
        suites.append(Suite(f"{label} against {labels[0]}", cases))
    return suites


def to_xml(suites: Sequence[Suite]) -> str:
    """The whole file."""
    root = ET.Element("testsuites")
    written = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    for number, suite in enumerate(suites):
        counts = {key: str(sum(case.outcome == outcome for case in suite.cases)) for key, outcome in _COUNTS.items()}
        element = ET.SubElement(
            root,
            "testsuite",
            {
                "id": str(number),
                "package": "trackbench",
                "name": _plain(suite.name),
                "timestamp": written,
                # No machine is named: a result does not depend on it.
                "hostname": "localhost",
                "tests": str(len(suite.cases)),
                **counts,
                "time": "0",
            },
        )
        ET.SubElement(element, "properties")
        for case in suite.cases:
            _add(element, case)
        ET.SubElement(element, "system-out")
        ET.SubElement(element, "system-err")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add(suite: ET.Element, case: Case) -> None:
    element = ET.SubElement(
        suite, "testcase", {"name": _plain(case.name), "classname": _plain(case.group), "time": "0"}
    )
    if case.outcome == PASSED:
        return
    kind = {} if case.outcome == UNDECIDED else {"type": case.outcome}
    found = ET.SubElement(element, _ELEMENTS[case.outcome], {"message": _plain(case.message), **kind})
    found.text = _plain(case.message)


def _plain(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
