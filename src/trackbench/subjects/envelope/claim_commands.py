"""The command ``trackbench envelope diff``, which compares two maps, and the cells of a map as test cases."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import click

from trackbench import results
from trackbench.cli.answer import print_answer
from trackbench.cli.options import FAILED_EXPECTATION, junit_option, write_suites
from trackbench.report.junit import Case, Suite
from trackbench.subjects.envelope.claim import Claim, ClaimedLimit, State, TrackerState, place_of_cell

_OUTCOMES: dict[State, Literal["passed", "failed", "undecided"]] = {
    "holds": "passed",
    "fails": "failed",
    "undecided": "undecided",
}


def suite_of_claim(claim: Claim) -> Suite:
    """Return the cells of a map as test cases, one for each tracker in each cell."""
    cases = []
    for cell in claim.cells:
        for name, tracker in cell.trackers.items():
            limits = claim.limits_of(name)
            text = f"{name}: {claim.required_of(name)} at {place_of_cell(claim.axes, cell.at)}"
            message = tracker.cause or "; ".join(_value_texts(limits, tracker))
            cases.append(Case(text, f"{claim.scenario}.{name}", _OUTCOMES[tracker.state], message))
    return Suite(f"envelope of {claim.scenario}", cases)


def _value_texts(limits: list[ClaimedLimit], tracker: TrackerState) -> Iterator[str]:
    for limit, value in zip(limits, tracker.values, strict=False):
        if value.value is not None:
            yield f"{value.state}: {limit.metric} is {value.text}"


@click.command("diff")
@click.argument("before", type=click.Path(path_type=Path), metavar="A")
@click.argument("after", type=click.Path(path_type=Path), metavar="B")
@junit_option("Write the cells as JUnit XML.")
@click.option("--json", "as_json", is_flag=True, help="Print the differences as JSON, and nothing else.")
def diff_command(before: Path, after: Path, junit: Path | None, as_json: bool) -> None:
    """Show the cells in which a tracker no longer meets its requirement.

    A and B are folders of envelopes with the same axes and requirements. A cell is lost if it holds in A and fails in
    B, and B is shown to be worse there: run by run where both have the same measurements. The probability that any
    cell is lost by chance is at most one minus the confidence. Nothing is run again.

    \b
    Example:
      trackbench envelope diff before/highway-envelope after/highway-envelope

    \b
    Exit status: 0 no cell lost, 1 a cell lost, 2 bad input or not comparable,
    4 cannot write
    """
    from trackbench.subjects.envelope.claim import read_envelope
    from trackbench.subjects.envelope.diff import diff

    if junit is not None:
        results.require_file(junit, "--junit")
    change = diff(read_envelope(before), read_envelope(after))
    write_suites([change.suite()], junit)
    if as_json:
        print_answer(results.json_text(change.json()), nl=False)
    else:
        for line in change.lines():
            print_answer(line)
    raise click.exceptions.Exit(0 if change.passed else FAILED_EXPECTATION)
