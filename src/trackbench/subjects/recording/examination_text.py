"""The findings of an examination, as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import Finding, known_faults


def findings(examination: Examination) -> str:
    """The findings with their evidence, and the failed checks."""
    lines = [f"## {examination.tracker}", "", "No fault found." if examination.healthy else ""]
    for finding in examination.findings:
        lines += _finding(finding)
    failed = [check for check in examination.checks if check.passed is False]
    if failed:
        lines += ["", "### Failed checks", "", *(f"- **{check.name}**: {check.result}" for check in failed)]
    left_out = [check for check in examination.checks if check.passed is None]
    if left_out:
        lines += ["", "### Checks not made", "", *(f"- **{check.name}**: {check.result}" for check in left_out)]
    lines += [
        "",
        "### In the pictures",
        "",
        "Grey: the truth. Orange: the tracker. Blue: the reference. Dots: measurements of the last 0.5 s. Ellipses: 95 "
        "% of the position by the estimate's covariance. Innovations: orange, applied by the tracker; blue, expected "
        "from the same prediction by the right measurement model; grey, two standard deviations of the noise.",
    ]
    return "\n".join(lines)


def _finding(finding: Finding) -> Iterator[str]:
    known = known_faults()[finding.fault]
    of = "" if finding.sensor is None else f", {finding.sensor}"
    yield from ("", f"### {known.title}{of}", "")
    yield f"`{finding.fault}`, confidence {100 * finding.confidence:.0f} %: {finding.evidence}"
    if finding.consequence_of is not None:
        yield f"\nProbably a consequence of `{finding.consequence_of}`."
        return
    yield f"\n{known.where} {known.fix}"
