"""The report of an examination: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.doctor.examine import Examination
from trackbench.doctor.exhibits import Exhibit
from trackbench.doctor.findings import advice
from trackbench.report.examination_figures import pictures
from trackbench.report.examination_words import consequences, facts, mark, roots, verdict
from trackbench.report.page import page


def render(examination: Examination, exhibits: Sequence[Exhibit]) -> str:
    """The text of an HTML file, the same for the same examination.

    Args:
        examination: what was found.
        exhibits: the drives that show it.
    """
    known = advice()
    return page(
        "examination.html.j2",
        title=examination.tracker,
        examination=examination,
        verdict=verdict(examination),
        findings=[(finding, known[finding.fault], facts(finding)) for finding in roots(examination)],
        consequences=[(finding, known[finding.fault]) for finding in consequences(examination)],
        exhibits=[
            (exhibit, [known[f.fault].title for f in exhibit.findings], list(pictures(exhibit))) for exhibit in exhibits
        ],
        checks=[(check, mark(check)) for check in examination.checks],
        passed=sum(check.passed is True for check in examination.checks),
        asked=sum(check.passed is not None for check in examination.checks),
    )
