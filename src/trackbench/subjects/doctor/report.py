"""An examination with its report: as a document, and as text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from trackbench import results
from trackbench.api.result import Report
from trackbench.base.errors import counted
from trackbench.base.subjects import offered, resolve
from trackbench.document import Block, Cell, Column, Document, Item, Items, Paragraph, Row, Section, Status, Table
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.report.figures.map import map_of_scene
from trackbench.results import EXAMINATION
from trackbench.subjects.doctor.certainty import Certainty, certainty
from trackbench.subjects.doctor.drive_figures import evidence_figures
from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults, questions
from trackbench.subjects.doctor.replay import drive_scene, examination_replay

WIDTH = 80
#: Words in the result of a passed check that differs from the equations without harm.
NO_HARM = "and no harm: "
#: Sentence at the end of a fix where the observer of the examination moves.
STANDING = "If your sensors stand still, say so by --static-sensors, or by --scenario FILE."


@dataclass(frozen=True)
class Examination:
    """Findings and checks of one tracker. A notebook shows them as a page, ``print`` as text."""

    tracker: str
    findings: list[Finding]
    checks: list[CheckResult]
    evidence: tuple[EvidenceRun, ...] = field(default=(), compare=False, repr=False)
    """Runs of test drives that show the findings; none for a tracker of several objects."""
    notes: tuple[str, ...] = ()
    """Sentences that say how the examination differs from the scenario."""

    @property
    def healthy(self) -> bool:
        """Whether there is no finding and no failed check."""
        return not self.findings and all(check.passed is not False for check in self.checks)

    @property
    def causes(self) -> list[Finding]:
        """Root causes: findings that are no consequence of another."""
        return [finding for finding in self.findings if finding.consequence_of is None]

    @property
    def consequences(self) -> list[Finding]:
        """Findings that are the consequence of another."""
        return [finding for finding in self.findings if finding.consequence_of is not None]

    @property
    def remarks(self) -> list[str]:
        """Differences from the equations that do no harm, in the words of the checks that pass with them."""
        return [f"{check.name}: {check.result}" for check in self.checks if check.passed and NO_HARM in check.result]

    def certainty(self, cause: Finding | None = None) -> Certainty:
        """Return how certain it is that a root cause (by default the first one) has the right name."""
        return certainty(self.findings, self.checks, cause or next(iter(self.causes), None))

    def json(self) -> dict[str, Any]:
        """Return the examination as ``--json`` prints it.

        ``confidence`` is a word, null for a consequence; ``explains`` is the number of failed checks explained.
        """
        return {
            "tracker": self.tracker,
            "healthy": self.healthy,
            "findings": [self._finding_json(finding) for finding in self.findings],
            "checks": [check.json() for check in self.checks],
        }

    def _finding_json(self, finding: Finding) -> dict[str, Any]:
        sure = self.certainty(finding) if finding in self.causes else None
        return {
            "fault": finding.fault,
            "confidence": sure and sure.word,
            "explains": sure and sure.explained,
            "sensor": finding.sensor,
            "factor": None if finding.factor is None else float(f"{finding.factor:.3g}"),
            "evidence": finding.evidence,
            "advice": f"{known_faults()[finding.fault].where} {advise_fix(self, finding)}",
            "consequence_of": finding.consequence_of,
            "shown_by": finding.shown_by,
        }

    def report(self) -> Report:
        """Return the examination as a page: the verdict, the faults with evidence and fix, the checks, and figures."""
        return Report(examination_document(self))

    def save(self, folder: Path | str) -> list[str]:
        """Write the findings, the report, and the replays that are offered; return the names of the files.

        Raises:
            TrackbenchError: the folder cannot be written, or holds something else than an examination.
        """
        place = Path(folder)
        document = self.report().document
        files: dict[str, Callable[[Path], object]] = {
            EXAMINATION: partial(results.write_file, results.json_text(self.json())),
            "report.html": partial(results.write_file, to_html(document)),
        }
        if self.evidence:
            replay = examination_replay(self.tracker, to_markdown(document), self.evidence)
            files |= {name: partial(resolve(write), replay) for name, write in offered("replays")}
        results.save_files(files, place, EXAMINATION)
        return list(files)

    def __str__(self) -> str:
        return examination_text(self)

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def examination_verdict(examination: Examination) -> str:
    """Return the result of an examination in one sentence."""
    return f"{examination.tracker}: {_outcome(examination)}"


def _outcome(examination: Examination) -> str:
    causes, failed = examination.causes, sum(check.passed is False for check in examination.checks)
    if causes:
        unclear = examination.certainty().word == "unclear"
        return "something is wrong, and its name is unclear" if unclear else f"{counted(len(causes), 'fault')} found"
    if failed:
        return f"no known fault found, but {counted(failed, 'check')} failed"
    requested = [check for check in examination.checks if not check.skipped]
    not_made = sum(check.passed is None for check in requested)
    skipped = len(examination.checks) - len(requested)
    if not not_made:
        return f"healthy but for {counted(skipped, 'check')} skipped" if skipped else "healthy"
    made = f"healthy in {len(requested) - not_made} of {counted(len(requested), 'check')}; {not_made} not made"
    return f"{made}; {skipped} skipped" if skipped else made


def advise_fix(examination: Examination, finding: Finding) -> str:
    """Return how to fix a fault; if it is in the sensor's own motion, also how to state that sensors stand still."""
    fault, motion = known_faults()[finding.fault], {name for name, question in questions().items() if question.motion}
    is_moved = any(check.name in motion and check.passed is not None for check in examination.checks)
    return f"{fault.fix} {STANDING}" if "ego" in fault.kinds and is_moved else fault.fix


def _facts(examination: Examination, finding: Finding) -> str:
    facts = [str(examination.certainty(finding))]
    if finding.sensor is not None:
        facts.append(f"sensor {finding.sensor}")
    if finding.factor is not None:
        facts.append(f"factor {finding.factor:.3g}")
    return f"{finding.fault}: {', '.join(facts)}"


def _points(examination: Examination, finding: Finding) -> list[tuple[str, str]]:
    """Return evidence, place in the code, fix and unexplained checks of a root cause, each with its heading."""
    points = [
        ("evidence", finding.evidence),
        ("look at", known_faults()[finding.fault].where),
        ("fix", advise_fix(examination, finding)),
    ]
    besides = examination.certainty(finding).besides
    return [*points, ("besides", f"not explained by it: {', '.join(besides)}")] if besides else points


def _reasons_not_made(examination: Examination) -> list[tuple[str, str]]:
    reasons: dict[str, list[str]] = {}
    for check in examination.checks:
        if check.passed is None:
            reasons.setdefault(check.result, []).append(check.name)
    return [(reason, ", ".join(names)) for reason, names in reasons.items()]


def examination_text(examination: Examination) -> str:
    """Return an examination as text: the verdict, root causes with evidence and fix, consequences, failed checks."""
    lines = [*_wrapped(examination_verdict(examination))]
    for remark in examination.remarks:
        lines += ["", *_wrapped(f"remark: {remark}", "  ")]
    for number, finding in enumerate(examination.causes, start=1):
        fault = known_faults()[finding.fault]
        facts = _wrapped(f"   {_facts(examination, finding)}", "   ")
        lines += ["", *_wrapped(f"{number}. {fault.title}", "   "), *facts]
        for label, sentence in _points(examination, finding):
            lines += _wrapped(f"   {label:<9} {sentence}", " " * 13)
    if examination.consequences:
        lines += ["", "Probably consequences; check them again after the fix:"]
        for finding in examination.consequences:
            lines += _wrapped(f"  {finding.fault} (of {finding.consequence_of}): {finding.evidence}", "    ")
    made = [check for check in examination.checks if check.passed is not None]
    failed = [check for check in made if not check.passed]
    names_follow = ", failed:" if failed else ""
    lines += ["", f"Checks: {len(made) - len(failed)} of {len(made)} passed{names_follow}"]
    for check in failed:
        # The findings say the rest.
        result = "" if check.faults else f" {check.result}"
        lines += _wrapped(f"  {check.name}: {check.question}{result}", "    ")
    left_out = len(examination.checks) - len(made)
    if left_out:
        lines.append(f"{counted(left_out, 'check')} not made:")
        for reason, names in _reasons_not_made(examination):
            lines += _wrapped(f"  {names}: {reason}", "    ")
    return "\n".join(lines)


def _wrapped(line: str, indent: str = "") -> list[str]:
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def examination_document(examination: Examination) -> Document:
    """Return the report of an examination as a document, with figures of the runs that show its findings."""
    failed, passed = ([check for check in examination.checks if check.passed is state] for state in (False, True))
    blocks = [
        *_verdict(examination),
        *_findings(examination),
        *(_drive(run) for run in examination.evidence),
        *([Section("Checks that failed", (_checks("failed-checks", failed),))] if failed else []),
        *_not_made_section(examination),
        *([Section("Checks that passed", (_checks("checks", passed),), folded=True)] if passed else []),
    ]
    return Document("examination", examination.tracker, tuple(blocks))


def _checks(name: str, checks: Sequence[CheckResult]) -> Table:
    columns = tuple(Column(heading, left=True) for heading in ("check", "question", "measured"))
    rows = tuple(tuple(map(Cell, (check.name, check.question, check.result))) for check in checks)
    return Table(name, columns, rows)


def _verdict(examination: Examination) -> Iterator[Block]:
    made = [check for check in examination.checks if check.passed is not None]
    passed = sum(check.passed is True for check in made)
    titles = "; ".join(known_faults()[finding.fault].title for finding in examination.causes)
    yield Paragraph(f"{examination_verdict(examination)}{f': {titles}' if titles else ''}", strong=True)
    yield from (Paragraph(f"Remark: {remark}") for remark in examination.remarks)
    yield Status(*(("no fault found", "good") if examination.healthy else ("not healthy", "bad")))
    yield Status(f"{passed} of {len(made)} checks passed", "good" if passed == len(made) else "bad")


def _findings(examination: Examination) -> Iterator[Block]:
    faults = known_faults()
    for number, finding in enumerate(examination.causes, 1):
        points = [Item(text, label.capitalize()) for label, text in _points(examination, finding)]
        facts = Paragraph(_facts(examination, finding))
        yield Section(f"{number}. {faults[finding.fault].title}", (facts, Items(tuple(points))))
    caused = [
        Item(f"{finding.evidence} (of {finding.consequence_of})", faults[finding.fault].title)
        for finding in examination.consequences
    ]
    if caused:
        yield Section("Probably consequences: check them again after the fix", (Items(tuple(caused)),))


def _not_made_section(examination: Examination) -> Iterator[Section]:
    items = tuple(Item(reason, names) for reason, names in _reasons_not_made(examination))
    if items:
        yield Section("Not made", (Items(items),))


def _drive(run: EvidenceRun) -> Section:
    titles = dict.fromkeys(known_faults()[finding.fault].title for finding in run.findings)
    shows = [Paragraph(f"It shows: {'; '.join(titles)}.")] if titles else []
    drive = map_of_scene(drive_scene(run), "", f"{run.drive}-map".replace("_", "-"))
    return Section(f"Drive: {run.description}", (*shows, Row((drive, *evidence_figures(run)))))
