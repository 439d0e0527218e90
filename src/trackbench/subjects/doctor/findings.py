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

from trackbench.subjects.doctor.output_checks import BEYOND, SINGULAR

#: The packages whose modules are checks: of trackers of one object, and of several.
CHECKS, TRAFFIC_CHECKS = "trackbench.subjects.doctor.checks", "trackbench.subjects.doctor.traffic_checks"
P = ParamSpec("P")


#: Groups of faults, by which a fault names its consequences.
KINDS = {
    "numerical": "Invalid outputs. What is sure of them has begun at a good estimate, and has no other cause.",
    "exact": "Found without a model of the tracker, or by one that fits it exactly: no other fault looks like them.",
    "motion": "Found without a measurement: the use of one sensor's measurements does not change them.",
    "driven": "What the estimates of drives show of any fault.",
    "root": "Never a consequence.",
    "gain": "What a wrong gain is called, with a Jacobian, with sigma points, and by what its update adds.",
    "noise": "A measurement noise that is wrong.",
    "growth": "A process noise that is wrong.",
    "offset": "Measurements that are off by a constant, a factor or a time.",
    "step": "What a wrong mean or covariance can look like after a step, or after many.",
    "points": "Sigma points that are wrong.",
    "angle": "Angles that are not wrapped.",
    "ego": "Of the sensor's own pose and velocity.",
}
_MEASURED = ("gain", "step", "points", "numerical", "course_not_wrapped", "overconfident_start")
_AXES = (*_MEASURED, "angle", "ego", "noise", "growth", "arctan_quadrant", "wrong_dt", "velocity_unit")
#: Consequences that several faults have.
COMMON = {
    # Of measurements that are predicted or read wrongly.
    "measured": _MEASURED,
    # Of a wrong step of the state, after which the innovations of all measurements are wrong too.
    "stepped": (*_MEASURED, "noise", "growth", "offset", "angle"),
    # Of a wrong covariance.
    "covariance": ("gain", "noise", "growth", "step", "azimuth_not_wrapped", "overconfident_start"),
    # Of swapped or mirrored axes.
    "axes": _AXES,
    # Of a wrong assignment of detections to tracks.
    "tracks": (
        "double_tracks",
        "wrong_track_deleted",
        "confirms_too_late",
        "confirms_too_soon",
        "never_deletes",
        "empty_scan_not_predicted",
    ),
    # Of wrong sums over sigma points.
    "sums": ("numerical", "course_not_wrapped", "angle_mean_not_circular"),
}


class Role(NamedTuple):
    """The part of a fault in a diagnosis. Names are separated by blanks."""

    kinds: str = ""
    """Of ``KINDS``."""
    rank: int = 100
    """Its place among the causes; those with a lower one are tried first."""
    causes: str = ""
    """Names and kinds of the faults that it can cause of the same sensor, and names of ``COMMON``."""
    always: str = ""
    """The same, whatever their sensor and although they are exact. ``every``: all but those that are a ``root``."""
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


def _includes(faults: str, name: str, fault: KnownFault) -> bool:
    if faults == "every":
        return "root" not in fault.kinds
    included = {item for entry in faults.split() for item in COMMON.get(entry, (entry,))}
    return not included.isdisjoint({name, *fault.kinds})


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
    finds: tuple[str, ...] = ()
    """The faults that it alone finds, where its check has several questions."""
    shows: tuple[str, ...] = ()
    """Faults that other checks find and that make it fail."""


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
    late_sensors: bool = False
    """Whether it is made only for the sensors whose measurements come late."""
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

    def with_faults(
        self, checks: Iterable[CheckResult], findings: Sequence[Finding], others: Sequence[Finding] = ()
    ) -> list[CheckResult]:
        """The results of its function, a failed one without faults with those that it shows.

        Args:
            checks: the results.
            findings: its own.
            others: those of other checks, of which questions ``show`` some.
        """
        questions = {question.name: question for question in self.questions}
        shared = {fault for question in self.questions for fault in question.finds}

        def shown(check: CheckResult) -> Iterator[str]:
            name, _, sensor = check.name.partition(".")
            finds, shows = (questions[name].finds, questions[name].shows) if name in questions else ((), ())
            own = [finding for finding in findings if finding.fault in finds or finding.fault not in shared]
            for finding in [*own, *(other for other in others if other.fault in shows)]:
                if not sensor or finding.sensor in (None, sensor):
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


def listed_checks() -> Iterator[tuple[str, str]]:
    """Name and question of every check, for ``trackbench list``."""
    for name, question in questions().items():
        yield name, question.asks + (" For each sensor." if question.each_sensor else "")


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

    @property
    def fragile(self) -> str | None:
        """Where it alone arises, if that is no fault: at range 0, or in the drive that is beyond motion models."""
        if self.shown_by in SINGULAR:
            return "range 0"
        return "a turn in a gap" if self.shown_by == BEYOND and self.fault in OF_DRIVES else None


#: What a drive alone shows.
OF_DRIVES = ("too_far_off", "covariance_unbelievable")
#: Confidence from which on a finding can be the cause of others.
SURE = 0.8
#: Confidence from which on an exact finding is the consequence of no other.
CERTAIN = 0.9
#: That of a line that is seen to compute another value than the right one, and what it can cause.
PROVEN, CAUSED = 1.0, {"numerical", "gain", "noise", "growth", "step", "points", "angle", "offset"}


def rank_findings(findings: Iterable[Finding], package: str = CHECKS) -> list[Finding]:
    """One finding for each fault and sensor: root causes first, then consequences, each by falling confidence.

    Args:
        findings: in the order in which they were found.
        package: of the checks that found them.
    """
    faults = faults_of(package)
    unique: dict[tuple[str, str | None], Finding] = {}
    for finding in findings:
        key = (finding.fault, finding.sensor)
        if key not in unique or finding.confidence > unique[key].confidence:
            unique[key] = finding
    of_sensors = {fault for fault, sensor in unique if sensor is not None}
    ordered = sorted(
        (finding for (fault, sensor), finding in unique.items() if sensor is not None or fault not in of_sensors),
        key=lambda finding: (
            finding.confidence < SURE,
            finding.confidence < PROVEN,
            "driven" in faults[finding.fault].kinds,
            faults[finding.fault].role.rank,
        ),
    )
    ranked: list[Finding] = []
    for finding in ordered:
        roots = (root for root in ranked if root.consequence_of is None)
        cause = next((root.fault for root in roots if _causes(faults, root, finding)), None)
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda finding: (finding.consequence_of is not None, -finding.confidence))


def _causes(faults: Mapping[str, KnownFault], root: Finding, finding: Finding) -> bool:
    """Whether a finding can be the consequence of a root cause, in its sensor and place."""
    cause, fault = faults[root.fault], faults[finding.fault]
    if root.confidence < SURE or root.fault == finding.fault:
        return False
    if "driven" in fault.kinds and "driven" not in cause.kinds:
        return True
    if _includes(cause.role.always, finding.fault, fault):
        return True
    if root.confidence >= PROVEN and not CAUSED.isdisjoint(fault.kinds):
        return True
    if not _includes(cause.role.causes, finding.fault, fault):
        return False
    if "exact" in fault.kinds and finding.confidence >= CERTAIN:
        return False
    if "motion" in fault.kinds or (finding.fault == "jacobian_wrong" and finding.sensor is None):
        return root.sensor is None
    return root.sensor is None or finding.sensor is None or root.sensor == finding.sensor


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
