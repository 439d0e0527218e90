"""The records of checks and faults, the findings of an examination and the results of its checks.

A check is a function in a module of ``checks/`` under :func:`doctor_check`, which has all that is known of it and of
the faults that it names.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from typing import Any, Generic, NamedTuple, ParamSpec

import numpy as np

#: The packages whose modules are checks: of trackers of one object, and of several.
CHECKS, TRAFFIC_CHECKS = "trackbench.subjects.doctor.checks", "trackbench.subjects.doctor.traffic_checks"
P = ParamSpec("P")


#: What a role says of a fault.
KINDS = {
    "exact": "Found without a model of the tracker, or by one that fits it exactly: no other fault looks like it.",
    "motion": "Found without a measurement: the use of one sensor's measurements does not change it.",
    "driven": "What the estimates of drives show of any fault.",
    "ego": "Of the sensor's own pose and velocity.",
}


class Role(NamedTuple):
    """The part of a fault in a diagnosis. Names are separated by blanks."""

    kinds: str = ""
    """Of ``KINDS``."""
    rank: int = 100
    """Its place among the causes; those with a lower one are tried first."""
    drive: str | None = None
    """The test drive in which it is visible."""


class KnownFault(NamedTuple):
    """A fault that a check names."""

    title: str
    """The fault in a few words."""
    where: str
    """Where in the tracker's code to look."""
    fix: str
    """How to fix it."""
    role: Role = Role()

    @property
    def kinds(self) -> list[str]:
        """Of ``KINDS``."""
        return self.role.kinds.split()


class Question(NamedTuple):
    """One of the questions that a check answers, as ``trackbench list checks`` shows it."""

    name: str
    asks: str
    full: str = ""
    """The same in a result, where it is longer there; with ``{sensor}`` for the name of the sensor."""
    each_sensor: bool = False
    """Whether it is asked for each sensor: its name is followed by a dot and that of the sensor."""
    misses: bool = False
    """Whether it needs scans without a detection."""
    motion: bool = False
    """Whether it needs an observer that moves."""
    late: bool = False
    """Whether it is asked of those sensors alone whose scans come late."""
    finds: tuple[str, ...] = ()
    """The faults that it alone finds, where its check has several questions."""


@dataclass(frozen=True)
class DoctorCheck(Generic[P]):
    """All that is known of a check."""

    make: Callable[P, PartResult]
    place: int
    """In an examination: first estimates, predictions, single measurements, whole tracks. Those that report on all
    estimates (900) and on the failed steps of all others (1000) come last."""
    questions: tuple[Question, ...] = ()
    of_filters: bool = False
    """Whether it needs a tracker that predicts and updates; one that returns the last measurement does not."""
    of_own_covariance: bool = False
    """Whether it takes the covariance that is returned for the tracker's own."""
    asks_at_misses: bool = False
    """Whether it asks for the estimate at a missed scan, as all checks of filters do: the prediction that updates are
    compared with."""
    least_sensors: int = 1
    every_drive: bool = False
    """Whether it takes the tracker through every test drive."""
    faults: Mapping[str, KnownFault] = field(default_factory=dict)
    """By name, those that it finds and no check before it has in its record."""

    @property
    def name(self) -> str:
        return self.make.__name__

    def with_questions(self, checks: Iterable[CheckResult]) -> list[CheckResult]:
        """The results of its function, each with the question that it answers."""
        full = {question.name: question.full or question.asks for question in self.questions}
        results = []
        for check in checks:
            name, _, sensor = check.name.partition(".")
            results.append(replace(check, question=check.question or full[name].format(sensor=sensor)))
        return results

    def with_faults(self, checks: Iterable[CheckResult], findings: Sequence[Finding]) -> list[CheckResult]:
        """Return the results of its function, a failed one without faults with those of its findings that it shows."""
        finds = {question.name: question.finds for question in self.questions}
        shared = {fault for faults in finds.values() for fault in faults}

        def shown(check: CheckResult) -> Iterator[str]:
            name, _, sensor = check.name.partition(".")
            for finding in findings:
                is_own = finding.fault in finds.get(name, ()) or finding.fault not in shared
                if is_own and (not sensor or finding.sensor in (None, sensor)):
                    yield finding.fault

        return [
            check
            if check.passed is not False or check.faults
            else replace(check, faults=tuple(dict.fromkeys(shown(check))))
            for check in checks
        ]


_RECORDS: dict[tuple[str, str], DoctorCheck[Any]] = {}


def doctor_check(*questions: Question, **about: Any) -> Callable[[Callable[P, PartResult]], Callable[P, PartResult]]:
    """Make a function a check that answers some questions; ``about``: further fields of :class:`DoctorCheck`."""

    def recorded(make: Callable[P, PartResult]) -> Callable[P, PartResult]:
        _RECORDS[make.__module__, make.__name__] = DoctorCheck(make, questions=questions, **about)
        return make

    return recorded


def checks_of(package: str) -> tuple[DoctorCheck[Any], ...]:
    """The checks in all modules of a package, in the order in which they are made."""
    return _checks_in(package, tuple(import_module(package).__path__))


@cache
def _checks_in(package: str, folders: tuple[str, ...]) -> tuple[DoctorCheck[Any], ...]:
    modules = {import_module(f"{package}.{module.name}").__name__ for module in pkgutil.iter_modules(folders)}
    records = (record for (module, _), record in _RECORDS.items() if module in modules)
    return tuple(sorted(records, key=lambda check: check.place))


def check_named(name: str) -> DoctorCheck[Any]:
    """That of trackers of one object with this name."""
    return next(check for check in checks_of(CHECKS) if check.name == name)


def faults_of(package: str) -> dict[str, KnownFault]:
    """Those that the checks of a package name."""
    return {name: fault for check in checks_of(package) for name, fault in check.faults.items()}


def known_faults() -> dict[str, KnownFault]:
    """Every fault that the doctor can name: of trackers of one object, then of several."""
    return {**faults_of(CHECKS), **faults_of(TRAFFIC_CHECKS)}


def questions() -> dict[str, Question]:
    """What is asked of a tracker of one object, by name, in the order in which it is asked."""
    return {question.name: question for check in checks_of(CHECKS) for question in check.questions}


@dataclass(frozen=True)
class Finding:
    """A fault and the evidence for it."""

    fault: str
    confidence: float
    """That the fault is the one named, 0 to 1: for the order of findings. :mod:`.certainty` has what is shown of it."""
    evidence: str
    """A sentence with its numbers."""
    sensor: str | None = None
    """The sensor whose measurements are processed wrongly, if it is one sensor."""
    factor: float | None = None
    """The tracker's value over the right one, if the fault is a wrong size; for noise, of its variances."""
    shown_by: str | None = None
    """The probe or test drive that shows it best."""
    run: int = 0
    """Of that test drive."""
    consequence_of: str | None = None
    """The fault that causes this one."""


#: Confidence from which on a finding can be the cause of others.
SURE = 0.8
#: Confidence from which on an exact finding is the consequence of no other.
CERTAIN = 0.9
#: Confidence of a line that is seen to compute another value than the right one.
PROVEN = 1.0


def rank_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Keep one finding for each fault, and order them: root causes, then consequences.

    Among the findings that are as certain, the fault with the lower rank is tried first: its symptoms include the
    others'. A finding is the consequence of the first root cause that it may depend on.

    Args:
        findings: in the order in which they were found.
    """
    faults = known_faults()
    of_faults: dict[str, list[Finding]] = {}
    for finding in findings:
        of_faults.setdefault(finding.fault, []).append(finding)
    ordered = sorted(
        map(_of_all_sensors, of_faults.values()),
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


def _of_all_sensors(findings: Sequence[Finding]) -> Finding:
    """Return the clearest of the findings of one fault, without its sensor where several show the fault."""
    of_sensors = [finding for finding in findings if finding.sensor is not None]
    clearest = max(of_sensors or findings, key=lambda finding: (finding.confidence, abs(np.log(finding.factor or 1.0))))
    sensors = {finding.sensor for finding in of_sensors}
    if len(sensors) < 2:
        return clearest
    others = " and ".join(sorted(name for name in sensors if name not in (None, clearest.sensor)))
    return replace(clearest, sensor=None, evidence=f"{clearest.evidence}; likewise {others}")


def _explains(root: Finding, finding: Finding, kinds: Sequence[str]) -> bool:
    """Whether a finding depends on what the root cause is about, and does not stand for itself."""
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
    """The outcome of one check."""

    name: str
    question: str
    passed: bool | None
    """None where the check could not be made."""
    result: str
    """What was measured, with its numbers; of a check that was not made, the reason."""
    skipped: bool = False
    """Whether it was not made because the user did not ask for it."""
    faults: tuple[str, ...] = ()
    """Of a failed check, those that it found."""

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
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
    """The checks and findings of one part of an examination."""

    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def add(
        self, name: str, passed: bool | None, result: str, *findings: Finding | None, question: str = ""
    ) -> PartResult:
        """Append the result of a check and what it found; its question is that of its record unless given."""
        shown = [finding for finding in findings if finding is not None]
        faults = tuple(dict.fromkeys(finding.fault for finding in shown)) if passed is False else ()
        self.checks.append(CheckResult(name, question, passed, result, faults=faults))
        self.findings += shown
        return self

    def add_evidence(self, name: str, finding: Finding | None, otherwise: str) -> PartResult:
        """Append a check that fails by a finding, with its evidence as the result; else it passes."""
        return self.add(name, finding is None, otherwise if finding is None else finding.evidence, finding)

    def note(self, name: str, passed: bool, text: str, fault: str) -> PartResult:
        """Append a check of a scene, and where it failed a finding with the same text."""
        finding = None if passed else Finding(fault, 0.9, text[0].upper() + text[1:] + ".")
        return self.add(name, bool(passed), text, finding)
