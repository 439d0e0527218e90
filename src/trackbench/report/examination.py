"""The report of an examination: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.doctor.evidence import EvidenceRun
from trackbench.doctor.examine import Examination
from trackbench.doctor.findings import known_faults
from trackbench.report.examination_figures import pictures
from trackbench.report.examination_words import consequences, facts, mark, roots, verdict
from trackbench.report.page import page


def render(examination: Examination, evidence: Sequence[EvidenceRun]) -> str:
    """The text of an HTML file, the same for the same examination.

    Args:
        examination: the findings and checks.
        evidence: the runs that show the findings.
    """
    known = known_faults()
    return page(
        "examination.html.j2",
        title=examination.tracker,
        examination=examination,
        verdict=verdict(examination),
        findings=[(finding, known[finding.fault], facts(finding)) for finding in roots(examination)],
        consequences=[(finding, known[finding.fault]) for finding in consequences(examination)],
        evidence=[(run, [known[f.fault].title for f in run.findings], list(pictures(run))) for run in evidence],
        checks=[(check, mark(check)) for check in examination.checks],
        passed=sum(check.passed is True for check in examination.checks),
        made=sum(check.passed is not None for check in examination.checks),
    )
