"""Known faults, the findings of an examination and the results of its checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import yaml
from pydantic import ConfigDict, TypeAdapter

from trackbench.subjects.doctor.exhibits import Exhibit


class KnownFault(NamedTuple):
    """An entry of faults.yaml."""

    title: str
    """The fault in a few words."""
    where: str
    """Where in the tracker's code to look."""
    fix: str
    """How to fix it."""


@cache
def known_faults() -> Mapping[str, KnownFault]:
    """Every fault that the doctor can name: of trackers of one object, then of several."""
    return {**faults_of("trackbench.subjects.doctor"), **faults_of("trackbench.subjects.doctor.traffic")}


@cache
def faults_of(package: str) -> Mapping[str, KnownFault]:
    """Those in the faults.yaml of a package, in its order."""
    text = files(package).joinpath("faults.yaml").read_text(encoding="utf-8")
    return {name: KnownFault(**entry) for name, entry in yaml.safe_load(text).items()}


@dataclass(frozen=True)
class Finding:
    """A fault and the evidence for it."""

    fault: str
    confidence: float
    """That the fault is the one named, 0 to 1."""
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
    exhibit: Exhibit | None = field(default=None, compare=False, repr=False)
    """The numbers of the evidence, for a figure."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        known = known_faults()[self.fault]
        return {
            "fault": self.fault,
            "confidence": round(self.confidence, 3),
            "sensor": self.sensor,
            "factor": None if self.factor is None else float(f"{self.factor:.3g}"),
            "evidence": self.evidence,
            "advice": f"{known.where} {known.fix}",
            "consequence_of": self.consequence_of,
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Finding:
        """The finding that :meth:`json` describes, without what shows it and its exhibit.

        Raises:
            KeyError: a value is missing.
            ValueError: the fault is none of the known ones, or a value is of another type.
        """
        if values["fault"] not in known_faults():
            raise ValueError(f"unknown fault {values['fault']!r}")
        keys = ("fault", "confidence", "evidence", "sensor", "factor", "consequence_of")
        return TypeAdapter(cls).validate_python({key: values[key] for key in keys})


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

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        return {
            "name": self.name,
            "question": self.question,
            "passed": self.passed,
            "skipped": self.skipped,
            "result": self.result,
        }


@dataclass
class PartResult:
    """The checks and findings of one part of an examination."""

    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
