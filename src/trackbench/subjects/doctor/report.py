"""The report of an examination: as a document, and as text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

from trackbench.base.errors import counted
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
from trackbench.report.numbers import percent
from trackbench.subjects.doctor.drive_figures import figures
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.exhibit_figures import exhibit_figure
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults

WIDTH = 80


def verdict(examination: Examination) -> str:
    """The result in one sentence."""
    causes, failed = _roots(examination), sum(check.passed is False for check in examination.checks)
    if causes:
        return f"{examination.tracker}: {counted(len(causes), 'fault')} found"
    if failed:
        return f"{examination.tracker}: no known fault found, but {counted(failed, 'check')} failed"
    requested = [check for check in examination.checks if not check.skipped]
    not_made = [check.name for check in requested if check.passed is None]
    skipped = len(examination.checks) - len(requested)
    if not not_made:
        but = f" but for {counted(skipped, 'check')} skipped" if skipped else ""
        return f"{examination.tracker}: healthy{but}"
    and_skipped = f"; {skipped} skipped" if skipped else ""
    return (
        f"{examination.tracker}: healthy in {len(requested) - len(not_made)} of {counted(len(requested), 'check')}; "
        f"{len(not_made)} not made: {', '.join(not_made)}{and_skipped}"
    )


def _roots(examination: Examination) -> list[Finding]:
    """The findings that are no consequence of another."""
    return [finding for finding in examination.findings if finding.consequence_of is None]


def _consequences(examination: Examination) -> list[Finding]:
    return [finding for finding in examination.findings if finding.consequence_of is not None]


def _facts(finding: Finding) -> str:
    """Fault, confidence, sensor and factor."""
    facts = [f"confidence {percent(finding.confidence)}".replace("\N{NO-BREAK SPACE}", " ")]
    if finding.sensor is not None:
        facts.append(f"sensor {finding.sensor}")
    if finding.factor is not None:
        facts.append(f"factor {finding.factor:.3g}")
    return f"{finding.fault}: {', '.join(facts)}"


def _mark(check: CheckResult) -> str:
    """Whether the check passed."""
    return "skipped" if check.skipped else {True: "passed", False: "FAILED", None: "not made"}[check.passed]


def _not_made(examination: Examination) -> list[tuple[str, str]]:
    """The reasons for which checks were not made, with the names of these checks."""
    reasons: dict[str, list[str]] = {}
    for check in examination.checks:
        if check.passed is None:
            reasons.setdefault(check.result, []).append(check.name)
    return [(reason, ", ".join(names)) for reason, names in reasons.items()]


def text(examination: Examination, every_check: bool = False) -> str:
    """The verdict, each root cause with its evidence and fix, the consequences, and the checks.

    Args:
        examination: the findings and checks.
        every_check: all checks with their results, instead of the failed ones only.
    """
    lines = [*_wrapped(verdict(examination))]
    for number, finding in enumerate(_roots(examination), start=1):
        fault = known_faults()[finding.fault]
        lines += ["", *_wrapped(f"{number}. {fault.title}", "   "), *_wrapped(f"   {_facts(finding)}", "   ")]
        for label, sentence in (("evidence", finding.evidence), ("look at", fault.where), ("fix", fault.fix)):
            lines += _wrapped(f"   {label:<9} {sentence}", " " * 13)
    caused = _consequences(examination)
    if caused:
        lines += ["", "Probably consequences; check them again after the fix:"]
        for finding in caused:
            lines += _wrapped(f"  {finding.fault} (of {finding.consequence_of}): {finding.evidence}", "    ")
    return "\n".join([*lines, "", *_checks(examination, every_check)])


def _checks(examination: Examination, every: bool) -> Iterator[str]:
    checks = examination.checks
    made = [check for check in checks if check.passed is not None]
    failed = [check for check in made if not check.passed]
    yield f"Checks: {len(made) - len(failed)} of {len(made)} passed" + (", failed:" if failed and not every else "")
    if every:
        for check in checks:
            yield from _wrapped(f"  {_mark(check):<8} {check.name}: {check.question}", " " * 11)
            yield from _wrapped(f"{' ' * 11}{check.result}", " " * 11)
        return
    for check in failed:
        yield from _wrapped(f"  {check.name}: {check.question}", "    ")
    left_out = len(checks) - len(made)
    if left_out:
        yield f"{counted(left_out, 'check')} not made:"
        for reason, names in _not_made(examination):
            yield from _wrapped(f"  {names}: {reason}", "    ")


def _wrapped(line: str, indent: str = "") -> list[str]:
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def examination_document(examination: Examination, evidence: Sequence[EvidenceRun] = ()) -> Document:
    """The report of an examination.

    Args:
        examination: the findings and checks.
        evidence: the runs that show the findings, of which the figures are drawn; a saved examination has none.
    """
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: ""}
    rows = [
        (Cell(_mark(check), tone=tones[check.passed]), Cell(check.name), Cell(check.question), Cell(check.result))
        for check in examination.checks
    ]
    columns = tuple(Column(heading, left=True) for heading in ("result", "check", "question", "measured"))
    sections = [
        Section("Verdict", tuple(_verdict(examination))),
        *([Section("Findings", tuple(_findings(examination)))] if examination.findings else []),
        *(Section(f"Drive: {run.description}", tuple(_drive(run))) for run in evidence),
        Section("All checks", (Table("checks", columns, tuple(rows)),)),
    ]
    return Document("examination", examination.tracker, tuple(sections))


def _verdict(examination: Examination) -> Iterator[Block]:
    made = [check for check in examination.checks if check.passed is not None]
    passed = sum(check.passed is True for check in made)
    yield Paragraph(verdict(examination), strong=True)
    yield Status(*(("no fault found", "good") if examination.healthy else ("not healthy", "bad")))
    yield Status(f"{passed} of {len(made)} checks passed", "good" if passed == len(made) else "bad")
    if left_out := _not_made(examination):
        yield Paragraph("Not made:")
        yield Items(tuple(Item(reason, names) for reason, names in left_out))


def _findings(examination: Examination) -> Iterator[Block]:
    faults = known_faults()
    for number, finding in enumerate(_roots(examination), 1):
        fault = faults[finding.fault]
        advice: Block = Items(
            (Item(finding.evidence, "Evidence"), Item(fault.where, "Where to look"), Item(fault.fix, "Fix"))
        )
        if finding.exhibit is not None:
            advice = Row((exhibit_figure(f"finding-{number}", finding.exhibit), advice))
        yield Section(f"{number}. {fault.title}", (Paragraph(_facts(finding)), advice))
    caused = [
        Item(f"{finding.evidence} (of {finding.consequence_of})", faults[finding.fault].title)
        for finding in _consequences(examination)
    ]
    if caused:
        yield Section("Probably consequences: check them again after the fix", (Items(tuple(caused)),))


def _drive(run: EvidenceRun) -> Iterator[Block]:
    faults = known_faults()
    if run.findings:
        yield Paragraph(f"It shows: {'; '.join(faults[finding.fault].title for finding in run.findings)}.")
    yield Row(tuple(figures(run)))


def saved_document(file: Path) -> Document:
    """The report of a saved examination."""
    return examination_document(Examination.load(file))
