"""An examination with its report: as a document, and as text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from trackbench import results
from trackbench.api.result import Report
from trackbench.base.errors import InputError, counted
from trackbench.base.files import read_json
from trackbench.base.subjects import offered, resolve
from trackbench.document import Block, Cell, Column, Document, Item, Items, Paragraph, Row, Section, Status, Table, Tone
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.report.numbers import percent
from trackbench.results import EXAMINATION
from trackbench.subjects.doctor.drive_figures import figures
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.exhibit_figures import exhibit_figure
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults
from trackbench.subjects.doctor.replay import examination_replay

WIDTH = 80


@dataclass(frozen=True)
class Examination:
    """The findings and checks of one tracker. A notebook shows them as a page, ``print`` as text."""

    tracker: str
    findings: list[Finding]
    checks: list[CheckResult]
    evidence: tuple[EvidenceRun, ...] = field(default=(), compare=False, repr=False)
    """The test drives that show the findings; none of a tracker of several objects."""
    notes: tuple[str, ...] = ()
    """How the examination differs from the scenario."""

    @property
    def healthy(self) -> bool:
        """Whether there is no finding and no failed check."""
        return not self.findings and all(check.passed is not False for check in self.checks)

    @property
    def causes(self) -> list[Finding]:
        """The findings that are no consequence of another."""
        return [finding for finding in self.findings if finding.consequence_of is None]

    @property
    def consequences(self) -> list[Finding]:
        """The others."""
        return [finding for finding in self.findings if finding.consequence_of is not None]

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        return {
            "tracker": self.tracker,
            "healthy": self.healthy,
            "findings": [finding.json() for finding in self.findings],
            "checks": [check.json() for check in self.checks],
        }

    @classmethod
    def load(cls, file: Path) -> Examination:
        """The examination in a file of :meth:`json`.

        Raises:
            InputError: it cannot be read, or is no examination.
        """
        try:
            values = read_json(file)
            findings = [Finding.from_json(entry) for entry in values["findings"]]
            checks = TypeAdapter(list[CheckResult]).validate_python(values["checks"])
            return cls(str(values["tracker"]), findings, checks)
        except ValidationError as invalid:
            first = invalid.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise InputError(f"not a readable examination: {where}: {first['msg']}", file=file) from None
        except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"not a readable examination: {error}", file=file) from error

    def report(self) -> Report:
        """The report, as ``trackbench doctor`` writes it."""
        return Report(examination_document(self))

    def save(self, folder: Path | str) -> list[str]:
        """Write the findings, the report, and the replays that are offered; returns the names of the files.

        Raises:
            TrackbenchError: the folder cannot be written, or holds something else.
        """
        place = Path(folder)
        results.require_replaceable(place, EXAMINATION)
        document = self.report().document
        files: dict[str, Callable[[Path], object]] = {
            EXAMINATION: partial(results.write_file, results.to_json(self.json())),
            "report.html": partial(results.write_file, to_html(document)),
        }
        if self.evidence:
            replay = examination_replay(self.tracker, to_markdown(document), self.evidence)
            files |= {name: partial(resolve(write), replay) for name, write in offered("replays")}
        results.save_files(files, place, EXAMINATION)
        return list(files)

    def __str__(self) -> str:
        return text(self)

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def verdict(examination: Examination) -> str:
    """The result in one sentence."""
    causes, failed = examination.causes, sum(check.passed is False for check in examination.checks)
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
    for number, finding in enumerate(examination.causes, start=1):
        fault = known_faults()[finding.fault]
        lines += ["", *_wrapped(f"{number}. {fault.title}", "   "), *_wrapped(f"   {_facts(finding)}", "   ")]
        for label, sentence in (("evidence", finding.evidence), ("look at", fault.where), ("fix", fault.fix)):
            lines += _wrapped(f"   {label:<9} {sentence}", " " * 13)
    if examination.consequences:
        lines += ["", "Probably consequences; check them again after the fix:"]
        for finding in examination.consequences:
            lines += _wrapped(f"  {finding.fault} (of {finding.consequence_of}): {finding.evidence}", "    ")
    made = [check for check in examination.checks if check.passed is not None]
    failed = [check for check in made if not check.passed]
    names_follow = ", failed:" if failed and not every_check else ""
    lines += ["", f"Checks: {len(made) - len(failed)} of {len(made)} passed{names_follow}"]
    for check in examination.checks if every_check else failed:
        if every_check:
            lines += _wrapped(f"  {_mark(check):<8} {check.name}: {check.question}", " " * 11)
            lines += _wrapped(f"{' ' * 11}{check.result}", " " * 11)
        else:
            lines += _wrapped(f"  {check.name}: {check.question}", "    ")
    left_out = len(examination.checks) - len(made)
    if left_out and not every_check:
        lines.append(f"{counted(left_out, 'check')} not made:")
        for reason, names in _not_made(examination):
            lines += _wrapped(f"  {names}: {reason}", "    ")
    return "\n".join(lines)


def _wrapped(line: str, indent: str = "") -> list[str]:
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def examination_document(examination: Examination) -> Document:
    """The report of an examination, with the figures of the runs that show its findings; a saved one has no runs."""
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: ""}
    rows = [
        (Cell(_mark(check), tone=tones[check.passed]), Cell(check.name), Cell(check.question), Cell(check.result))
        for check in examination.checks
    ]
    columns = tuple(Column(heading, left=True) for heading in ("result", "check", "question", "measured"))
    sections = [
        Section("Verdict", tuple(_verdict(examination))),
        *([Section("Findings", tuple(_findings(examination)))] if examination.findings else []),
        *(_drive(run) for run in examination.evidence),
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
    for number, finding in enumerate(examination.causes, 1):
        fault = faults[finding.fault]
        advice: Block = Items(
            (Item(finding.evidence, "Evidence"), Item(fault.where, "Where to look"), Item(fault.fix, "Fix"))
        )
        if finding.exhibit is not None:
            advice = Row((exhibit_figure(f"finding-{number}", finding.exhibit), advice))
        yield Section(f"{number}. {fault.title}", (Paragraph(_facts(finding)), advice))
    caused = [
        Item(f"{finding.evidence} (of {finding.consequence_of})", faults[finding.fault].title)
        for finding in examination.consequences
    ]
    if caused:
        yield Section("Probably consequences: check them again after the fix", (Items(tuple(caused)),))


def _drive(run: EvidenceRun) -> Section:
    titles = [known_faults()[finding.fault].title for finding in run.findings]
    shows = [Paragraph(f"It shows: {'; '.join(titles)}.")] if titles else []
    return Section(f"Drive: {run.description}", (*shows, Row(tuple(figures(run)))))


def saved_document(file: Path) -> Document:
    """The report of a saved examination."""
    return examination_document(Examination.load(file))
