"""A map as test cases, one for each tracker in each cell, which CI systems show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from trackbench.report.junit import Case, Suite
from trackbench.scenario import Scenario
from trackbench.subjects.envelope.claim import Claim, ClaimedLimit, State, TrackerState, place_of_cell

_OUTCOMES: dict[State, Literal["passed", "failed", "undecided"]] = {
    "holds": "passed",
    "fails": "failed",
    "undecided": "undecided",
}


def suite_of_claim(claim: Claim, loaded: Scenario) -> Suite:
    """The cells of a map; what is required stands in the scenario."""
    cases = []
    for cell in claim.cells:
        for name, tracker in cell.trackers.items():
            limits = claim.limits_of(name)
            required = " and ".join(limit.text.removeprefix(f"{name} ") for limit in limits)
            text = f"{name}: {required} at {place_of_cell(claim.axes, cell.at)}"
            message = tracker.cause or "; ".join(_values(limits, tracker))
            stated = enumerate(loaded.document.value["expect"])
            number = next((number for number, item in stated if item["tracker"] == name), 0)
            line = loaded.document.origin(("expect", number)).line
            group = f"{claim.scenario}.{name}"
            cases.append(Case(text, group, _OUTCOMES[tracker.state], message, str(loaded.path), line))
    return Suite(f"envelope of {claim.scenario}", cases)


def _values(limits: list[ClaimedLimit], tracker: TrackerState) -> Iterator[str]:
    for limit, value in zip(limits, tracker.values, strict=False):
        if value.value is not None:
            ends = ["" if end is None else f"{end:.4g}" for end in (value.low, value.high)]
            yield f"{value.state}: {limit.metric} is {value.value:.4g}, surely {' to '.join(filter(None, ends))}"
