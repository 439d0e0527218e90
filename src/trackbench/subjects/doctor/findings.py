"""Records of checks and faults, findings of an examination, and results of its checks.

A check is a function in a module of ``checks`` or ``traffic_checks``, decorated with :func:`doctor_check`. Its record
says what it asks, what it needs, and which faults it names.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from typing import Any, Generic, NamedTuple, ParamSpec

import numpy as np

#: Package of the checks of trackers of one object, and package of the checks of trackers of several.
CHECKS, TRAFFIC_CHECKS = "trackbench.subjects.doctor.checks", "trackbench.subjects.doctor.traffic_checks"
P = ParamSpec("P")


#: Kinds of faults; they decide which finding may be the consequence of which.
KINDS = {
    "exact": "Found without a model of the tracker, or by one that fits it exactly: no other fault looks like it.",
    "motion": "Found from predictions alone, so the measurements of a sensor do not affect it.",
    "driven": "Found as errors of the estimates in a drive, which any fault may cause.",
    "ego": "A fault in the use of the sensor's own pose and velocity.",
}


class Role(NamedTuple):
    """How a fault is found, and its order among the possible causes of other findings."""

    kinds: str = ""
    """Kinds of the fault, separated by blanks: ``exact`` (no other fault looks like it), ``motion`` (of predictions),
    ``driven`` (seen by the errors in test drives), ``ego`` (of the sensor's own motion)."""
    rank: int = 100
    """Order of the fault among possible causes of other findings; a lower rank is tried first."""
    drive: str | None = None
    """Name of the test drive in which the fault is visible; None where the finding names one, or none does."""


class KnownFault(NamedTuple):
    """A fault that the doctor can name, with the place to look at and the fix."""

    title: str
    where: str
    """Sentence that says where in the tracker's code to look."""
    fix: str
    role: Role = Role()

    @property
    def kinds(self) -> list[str]:
        return self.role.kinds.split()


class Question(NamedTuple):
    """A question that a check answers, as ``trackbench list checks`` shows it."""

    name: str
    asks: str
    full: str = ""
    """Question as a result prints it, where it is longer than ``asks``; ``{sensor}`` stands for the sensor's name."""
    each_sensor: bool = False
    """Whether the question is asked for each sensor, under the name ``name.sensor``."""
    misses: bool = False
    """Whether the question needs scans without a detection."""
    motion: bool = False
    """Whether the question needs an observer that moves."""
    late: bool = False
    """Whether the question is asked only for sensors whose scans come late."""
    finds: tuple[str, ...] = ()
    """Names of the faults that only this question finds, where its check has several questions."""


@dataclass(frozen=True)
class DoctorCheck(Generic[P]):
    """Record of a check: its function, its questions, what it needs, and the faults that it names."""

    make: Callable[P, PartResult]
    place: int
    """Number that orders the checks of an examination, ascending: first estimates, predictions, single measurements,
    whole tracks. Checks of all estimates (900) and of all failed steps (1000) come last."""
    questions: tuple[Question, ...] = ()
    of_filters: bool = False
    """Whether the check needs a tracker that predicts and updates; returning the last measurement is not enough."""
    of_own_covariance: bool = False
    """Whether the check relies on the returned covariance being the one that the tracker computes with."""
    asks_at_misses: bool = False
    """Whether the check asks for estimates at missed scans. Checks ``of_filters`` always do, for their predictions."""
    least_sensors: int = 1
    every_drive: bool = False
    """Whether the check steps the tracker through every test drive."""
    faults: Mapping[str, KnownFault] = field(default_factory=dict)
    """Faults that the check finds, by name. A fault of several checks is in the first check's record."""

    @property
    def name(self) -> str:
        return self.make.__name__

    def with_questions(self, checks: Iterable[CheckResult]) -> list[CheckResult]:
        """Return results of this check, each with the text of the question that it answers."""
        full = {question.name: question.full or question.asks for question in self.questions}
        results = []
        for check in checks:
            name, _, sensor = check.name.partition(".")
            results.append(replace(check, question=check.question or full[name].format(sensor=sensor)))
        return results

    def with_faults(self, checks: Iterable[CheckResult], findings: Sequence[Finding]) -> list[CheckResult]:
        """Return results of this check; a failed one that names no fault gets the faults of findings that concern it.

        A finding concerns a result if the sensors fit, and its fault is found by the result's question or by no single
        question of the check.
        """
        finds = {question.name: question.finds for question in self.questions}
        shared = {fault for faults in finds.values() for fault in faults}

        def shown_faults(check: CheckResult) -> Iterator[str]:
            name, _, sensor = check.name.partition(".")
            for finding in findings:
                is_own = finding.fault in finds.get(name, ()) or finding.fault not in shared
                if is_own and (not sensor or finding.sensor in (None, sensor)):
                    yield finding.fault

        return [
            check
            if check.passed is not False or check.faults
            else replace(check, faults=tuple(dict.fromkeys(shown_faults(check))))
            for check in checks
        ]


_RECORDS: dict[tuple[str, str], DoctorCheck[Any]] = {}


def doctor_check(*questions: Question, **fields: Any) -> Callable[[Callable[P, PartResult]], Callable[P, PartResult]]:
    """Return a decorator that records a function as a check; ``fields``: further fields of :class:`DoctorCheck`."""

    def record(make: Callable[P, PartResult]) -> Callable[P, PartResult]:
        _RECORDS[make.__module__, make.__name__] = DoctorCheck(make, questions=questions, **fields)
        return make

    return record


def checks_of(package: str) -> tuple[DoctorCheck[Any], ...]:
    """Return the checks in all modules of a package, in the order in which they are made."""
    return _checks_in(package, tuple(import_module(package).__path__))


@cache
def _checks_in(package: str, folders: tuple[str, ...]) -> tuple[DoctorCheck[Any], ...]:
    modules = {import_module(f"{package}.{module.name}").__name__ for module in pkgutil.iter_modules(folders)}
    records = (record for (module, _), record in _RECORDS.items() if module in modules)
    return tuple(sorted(records, key=lambda check: check.place))


def check_named(name: str) -> DoctorCheck[Any]:
    """Return the check of trackers of one object that has this name."""
    return next(check for check in checks_of(CHECKS) if check.name == name)


def faults_of(package: str) -> dict[str, KnownFault]:
    """Return the faults that the checks in a package can find, by name."""
    return {name: fault for check in checks_of(package) for name, fault in check.faults.items()}


def known_faults() -> dict[str, KnownFault]:
    """Return every fault that the doctor can name: faults of trackers of one object, then of several."""
    return {**faults_of(CHECKS), **faults_of(TRAFFIC_CHECKS)}


def questions() -> dict[str, Question]:
    """Return the questions about a tracker of one object by name, in the order in which they are asked."""
    return {question.name: question for check in checks_of(CHECKS) for question in check.questions}


@dataclass(frozen=True)
class Finding:
    """A fault that a check found in the tracker, and the evidence for it."""

    fault: str
    confidence: float
    """Confidence that the tracker has this very fault, 0 to 1; a finding from 0.8 on can be the cause of others."""
    evidence: str
    """Sentence with the numbers that show the fault."""
    sensor: str | None = None
    """Name of the sensor whose measurements are processed wrongly; None unless it is one sensor alone."""
    factor: float | None = None
    """Tracker's value divided by the right one (for noise: of variances); None where no value has a wrong size."""
    shown_by: str | None = None
    """Name of the probe (test target) or test drive that shows the fault best; None if unknown."""
    run: int = 0
    """Index of the run that shows the fault best, where ``shown_by`` is a test drive."""
    consequence_of: str | None = None
    """Name of the fault that causes this one; None for a root cause."""


#: Least confidence of a finding that can be the cause of others.
SURE = 0.8
#: Least confidence at which an exact finding is the consequence of no other.
CERTAIN = 0.9
#: Confidence of a finding that names the line of code which computes a wrong value.
PROVEN = 1.0


def rank_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Keep one finding for each fault, and order them: root causes, then consequences.

    Among equally certain findings, the fault with the lower rank comes first: its symptoms include those of the others.
    A finding is the consequence of the first root cause that can explain it.

    Args:
        findings: findings of all checks, in the order in which they were found.
    """
    faults = known_faults()
    of_faults: dict[str, list[Finding]] = {}
    for finding in findings:
        of_faults.setdefault(finding.fault, []).append(finding)
    ordered = sorted(
        map(_merge_sensors, of_faults.values()),
        key=lambda finding: (
            "driven" in faults[finding.fault].kinds,
            -sum(finding.confidence >= limit for limit in (SURE, CERTAIN, PROVEN)),
            faults[finding.fault].role.rank,
        ),
    )
    ranked: list[Finding] = []
    for finding in ordered:
        roots = (root for root in ranked if root.consequence_of is None)
        cause = next((root.fault for root in roots if _explains(root, finding, faults[finding.fault].kinds)), None)
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda finding: finding.consequence_of is not None)


def _merge_sensors(findings: Sequence[Finding]) -> Finding:
    """Return the clearest of the findings of one fault, without a sensor where several sensors show the fault."""
    of_sensors = [finding for finding in findings if finding.sensor is not None]
    clearest = max(of_sensors or findings, key=lambda finding: (finding.confidence, abs(np.log(finding.factor or 1.0))))
    sensors = {finding.sensor for finding in of_sensors}
    if len(sensors) < 2:
        return clearest
    other_sensors = " and ".join(sorted(name for name in sensors if name not in (None, clearest.sensor)))
    return replace(clearest, sensor=None, evidence=f"{clearest.evidence}; likewise {other_sensors}")


def _explains(root: Finding, finding: Finding, kinds: Sequence[str]) -> bool:
    """Return whether a root cause is sure enough, and its reach wide enough, to explain a finding."""
    if root.confidence < SURE or root.fault == finding.fault:
        return False
    if "driven" in kinds:
        return True
    if finding.confidence >= (CERTAIN if "exact" in kinds else PROVEN):
        return False
    if root.sensor is None:
        return True
    return "motion" not in kinds and finding.sensor in (None, root.sensor)


@dataclass(frozen=True)
class CheckResult:
    """Answer to one question of a check, for one sensor where each sensor is asked about."""

    name: str
    question: str
    passed: bool | None
    """Whether the tracker passed; None where the check could not be made."""
    result: str
    """Sentence with the measured numbers, or with the reason why the check was not made."""
    skipped: bool = False
    """Whether the user left the check out (``--skip``)."""
    faults: tuple[str, ...] = ()
    """Names of the faults that a failed check found."""

    def json(self) -> dict[str, Any]:
        """Return the result as ``--json`` prints it."""
        return {
            "name": self.name,
            "question": self.question,
            "passed": self.passed,
            "skipped": self.skipped,
            "result": self.result,
            "faults": list(self.faults),
        }


@dataclass
class PartResult:
    """Answers of one check to its questions, and the faults that it found."""

    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def add(
        self, name: str, passed: bool | None, result: str, *findings: Finding | None, question: str = ""
    ) -> PartResult:
        """Append the answer to a question, and findings; with an empty ``question`` the recorded wording is taken."""
        shown = [finding for finding in findings if finding is not None]
        faults = tuple(dict.fromkeys(finding.fault for finding in shown)) if passed is False else ()
        self.checks.append(CheckResult(name, question, passed, result, faults=faults))
        self.findings += shown
        return self

    def add_evidence(self, name: str, finding: Finding | None, otherwise: str) -> PartResult:
        """Append an answer, failed if there is a finding; the text is the finding's evidence, or else ``otherwise``."""
        return self.add(name, finding is None, otherwise if finding is None else finding.evidence, finding)

    def note(self, name: str, passed: bool, text: str, fault: str) -> PartResult:
        """Append the answer of a scene; if it failed, add a finding of ``fault`` with the answer's text as evidence."""
        finding = None if passed else Finding(fault, 0.9, text[0].upper() + text[1:] + ".")
        return self.add(name, bool(passed), text, finding)
