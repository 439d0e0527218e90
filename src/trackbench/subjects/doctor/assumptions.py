"""What the user states of the tracker and its sensors, and the checks that are not made for it."""

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
    """What an examination takes for granted."""

    no_misses: bool = False
    """Every scan has a detection."""
    skip: tuple[str, ...] = ()
    """Checks that the user does not ask for, by name or by name and sensor: ``gain``, ``gain.radar``."""
    still: str = ""
    """Why no observer moves; nothing where one does."""
    late: Mapping[str, float] = field(default_factory=dict)
    """Latency of each sensor whose scans come late, s."""

    def left_out(self, check: DoctorCheck[Any], sensors: Sequence[str], why: str | None = None) -> list[CheckResult]:
        """The questions of a check that are not asked, with the reason.

        Args:
            check: its record.
            sensors: those for each of which it asks some.
            why: of all others of it too.
        """
        results = []
        for question in check.questions:
            reason = self._reason(question) or why
            asked_of = self.late if question.late else sensors
            names = [f"{question.name}.{sensor}" for sensor in asked_of] if question.each_sensor else [question.name]
            for name in names:
                if question.name in self.skip or name in self.skip:
                    results.append(CheckResult(name, question.asks, None, "skipped (--skip)", skipped=True))
                elif reason is not None:
                    results.append(CheckResult(name, question.asks, None, reason))
        return results

    def applied(self, result: PartResult, left_out: Sequence[CheckResult], check: DoctorCheck[Any]) -> PartResult:
        """The result of a check, with the questions that are not asked in place of their answers."""
        names = {one.name for one in left_out}
        made = [one for one in result.checks if one.name not in names]
        return PartResult([*made, *left_out], [one for one in result.findings if not self._drops(one, check)])

    def _reason(self, question: Question) -> str | None:
        if question.misses and self.no_misses:
            return "it needs scans without a detection (--no-misses)"
        return f"it needs an observer that moves ({self.still})" if question.motion and self.still else None

    def _drops(self, finding: Finding, check: DoctorCheck[Any]) -> bool:
        """Whether a finding is that of a question that is not asked."""
        return any(
            f"{question.name}.{finding.sensor}" in self.skip
            or (finding.fault in question.finds and (question.name in self.skip or self._reason(question) is not None))
            for question in check.questions
        )


NONE = Assumptions()


def require_known_checks(names: Iterable[str], sensors: Iterable[str], key: str = "skip") -> None:
    """Refuse a name that is no check's.

    Args:
        names: of checks, or of one of a sensor: ``gain.radar``.
        sensors: their names.
        key: what is said to have the wrong name.

    Raises:
        InputError: there is no such check; the message has the nearest name.
    """
    of_sensors = list(sensors)
    valid: list[str] = []
    for name, question in questions().items():
        valid += [name, *(f"{name}.{sensor}" for sensor in of_sensors if question.each_sensor)]
    for name in names:
        if name not in valid:
            hints = filter(None, [did_you_mean(similar_names(name, valid)), "`trackbench list checks` shows all"])
            message = f"there is no check {name!r}: {' '.join(hints)}"
            raise InputError(message, key=key)
