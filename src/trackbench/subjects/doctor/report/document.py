"""The report of an examination."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from trackbench.document import (
    Block,
    Cell,
    Column,
    Document,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    Tone,
)
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import CheckResult, known_faults
from trackbench.subjects.doctor.report.exhibits import exhibit_figure
from trackbench.subjects.doctor.report.figures import figures
from trackbench.subjects.doctor.report.text import consequences, facts, mark, not_made, roots, verdict


def examination_document(examination: Examination, evidence: Sequence[EvidenceRun] = ()) -> Document:
    """The report of an examination.

    Args:
        examination: the findings and checks.
        evidence: the runs that show the findings, of which the figures are drawn; a saved examination has none.
    """
    sections = [
        Section("Verdict", tuple(_verdict(examination))),
        *([Section("Findings", tuple(_findings(examination)))] if examination.findings else []),
        *(Section(f"Drive: {run.description}", tuple(_drive(run))) for run in evidence),
        Section("All checks", (_checks(examination.checks),)),
    ]
    return Document("examination", examination.tracker, tuple(sections))


def _verdict(examination: Examination) -> Iterator[Block]:
    made = [check for check in examination.checks if check.passed is not None]
    passed = sum(check.passed is True for check in made)
    yield Paragraph(verdict(examination), strong=True)
    yield Status(*(("no fault found", "good") if examination.healthy else ("not healthy", "bad")))
    yield Status(f"{passed} of {len(made)} checks passed", "good" if passed == len(made) else "bad")
    if left_out := not_made(examination):
        yield Paragraph("Not made:")
        yield Items(tuple(Item(reason, ", ".join(names)) for reason, names in left_out))


def _findings(examination: Examination) -> Iterator[Block]:
    known = known_faults()
    for number, finding in enumerate(roots(examination), 1):
        fault = known[finding.fault]
        about = Paragraph(f"{finding.fault}: {', '.join(facts(finding))}")
        advice = (
            Item(finding.evidence, "Evidence"),
            Item(fault.where, "Where to look"),
            Item(fault.fix, "Fix"),
        )
        shown: tuple[Block, ...] = (Items(advice),)
        if finding.exhibit is not None:
            shown = (Row((exhibit_figure(f"finding-{number}", finding.exhibit), *shown)),)
        yield Section(f"{number}. {fault.title}", (about, *shown))
    caused = consequences(examination)
    if caused:
        items = [Item(f"{one.evidence} (of {one.consequence_of})", known[one.fault].title) for one in caused]
        yield Section("Probably consequences: check them again after the fix", (Items(tuple(items)),))


def _drive(run: EvidenceRun) -> Iterator[Block]:
    known = known_faults()
    if run.findings:
        yield Paragraph(f"It shows: {'; '.join(known[finding.fault].title for finding in run.findings)}.")
    yield Row(tuple(figures(run)))


def _checks(checks: Sequence[CheckResult]) -> Table:
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: ""}
    rows = [
        (
            Cell(mark(check), tone=tones[check.passed]),
            Cell(check.name),
            Cell(check.question),
            Cell(check.result),
        )
        for check in checks
    ]
    columns = tuple(Column(heading, left=True) for heading in ("result", "check", "question", "measured"))
    return Table("checks", columns, tuple(rows))


def saved_document(file: Path) -> Document:
    """The report of a saved examination."""
    return examination_document(Examination.load(file))
