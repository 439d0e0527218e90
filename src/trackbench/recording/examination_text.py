"""The findings of an examination, as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.doctor.examine import Examination
from trackbench.doctor.findings import Finding, advice


def findings(examination: Examination) -> str:
    """What was found, with the evidence, and the checks that failed."""
    lines = [f"## {examination.tracker}", "", "Healthy: no fault found." if examination.healthy else ""]
    for finding in examination.findings:
        lines += _finding(finding)
    failed = [check for check in examination.checks if check.passed is False]
    if failed:
        lines += ["", "### Failed checks", "", *(f"- **{check.name}**: {check.result}" for check in failed)]
    lines += [
        "",
        "### In the pictures",
        "",
        "Grey is the truth, orange the tracker, blue the reference; dots are measurements of the last 0.5 s. Ellipses "
        "hold 95 % of what each says of the position. Of the innovations, orange is what the tracker took each "
        "measurement for, blue what a sound model makes of the same prediction; grey are two standard deviations of "
        "the noise.",
    ]
    return "\n".join(lines)


def _finding(finding: Finding) -> Iterator[str]:
    known = advice()[finding.fault]
    of = "" if finding.sensor is None else f", {finding.sensor}"
    yield from ("", f"### {known.title}{of}", "")
    yield f"`{finding.fault}`, confidence {100 * finding.confidence:.0f} %: {finding.evidence}"
    if finding.consequence_of is not None:
        yield f"\nProbably a consequence of `{finding.consequence_of}`."
        return
    yield f"\n{known.where} {known.fix}"
