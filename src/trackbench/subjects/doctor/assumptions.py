"""Statements of the user about the tracker and its sensors, and the checks that are left out because of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from trackbench.base.errors import InputError, did_you_mean, similar_names
from trackbench.subjects.doctor.findings import (
    CheckResult,
    DoctorCheck,
    Finding,
    PartResult,
    Question,
    questions,
)


@dataclass(frozen=True)
class Assumptions:
    """Statements of the user that an examination takes for granted."""

    no_misses: bool = False
    """Whether every scan has a detection; then the tracker is given no scan without a detection."""
    skip: tuple[str, ...] = ()
    """Checks that the user leaves out, by name or by name and sensor: ``gain``, ``gain.radar``."""
    rest_reason: str = ""
    """Reason why no observer (carrier of the sensors) moves in the examination; empty where an observer moves."""
    late: Mapping[str, float] = field(default_factory=dict)
    """Longest latency, s, by name of the sensor; only sensors whose scans come late."""

    def left_out(self, check: DoctorCheck[Any], sensors: Sequence[str], reason: str | None = None) -> list[CheckResult]:
        """Return a result without a verdict, and with the reason, for each question of a check that is not asked.

        Args:
            check: record of the check.
            sensors: names of the sensors.
            reason: reason for which no question of the check is asked; None where questions are asked.
        """
        results = []
        for question in check.questions:
            question_reason = self._reason(question) or reason
            asked = self.late if question.late else sensors
            names = [f"{question.name}.{sensor}" for sensor in asked] if question.each_sensor else [question.name]
            for name in names:
                if question.name in self.skip or name in self.skip:
                    results.append(CheckResult(name, question.asks, None, "skipped (--skip)", skipped=True))
                elif question_reason is not None:
                    results.append(CheckResult(name, question.asks, None, question_reason))
        return results

    def apply(self, result: PartResult, left_out: Sequence[CheckResult], check: DoctorCheck[Any]) -> PartResult:
        """Replace the answers to left-out questions in a check's result by their reasons, and drop their findings."""
        names = {check_result.name for check_result in left_out}
        made = [check_result for check_result in result.checks if check_result.name not in names]
        findings = [find for find in result.findings if not self._answers_excluded_question(find, check)]
        return PartResult([*made, *left_out], findings)

    def _reason(self, question: Question) -> str | None:
        if question.misses and self.no_misses:
            return "it needs scans without a detection (--no-misses)"
        return f"it needs an observer that moves ({self.rest_reason})" if question.motion and self.rest_reason else None

    def _answers_excluded_question(self, finding: Finding, check: DoctorCheck[Any]) -> bool:
        return any(
            f"{question.name}.{finding.sensor}" in self.skip
            or (finding.fault in question.finds and (question.name in self.skip or self._reason(question) is not None))
            for question in check.questions
        )


NONE = Assumptions()


def require_known_checks(names: Iterable[str], sensors: Iterable[str], key: str = "skip") -> None:
    """Raise an error for a name that no check has.

    Args:
        names: names of checks, or of the check of one sensor: ``gain.radar``.
        sensors: names of the sensors.
        key: key or option that the error names.

    Raises:
        InputError: there is no such check; the message has the nearest name.
    """
    sensor_names = list(sensors)
    valid: list[str] = []
    for name, question in questions().items():
        valid += [name, *(f"{name}.{sensor}" for sensor in sensor_names if question.each_sensor)]
    for name in names:
        if name not in valid:
            hints = filter(None, [did_you_mean(similar_names(name, valid)), "`trackbench list checks` shows all"])
            message = f"there is no check {name!r}: {' '.join(hints)}"
            raise InputError(message, key=key)
