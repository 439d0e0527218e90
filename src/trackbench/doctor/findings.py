"""What an examination can find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import yaml


class Advice(NamedTuple):
    """What is known of a fault before any tracker is examined."""

    title: str
    """The fault in a few words."""
    where: str
    """Where in the tracker's code to look."""
    fix: str
    """What a fix looks like."""


@cache
def advice() -> Mapping[str, Advice]:
    """Every fault that can be named, in the order of the file."""
    text = files("trackbench.doctor").joinpath("advice.yaml").read_text(encoding="utf-8")
    return {name: Advice(**entry) for name, entry in yaml.safe_load(text).items()}


@dataclass(frozen=True)
class Finding:
    """A fault, and what speaks for it."""

    fault: str
    confidence: float
    """0 to 1."""
    evidence: str
    """A sentence with its numbers."""
    sensor: str | None = None
    """The sensor whose measurements are treated wrongly, where it is one."""
    factor: float | None = None
    """What the tracker uses over what would be right, where the fault is a wrong size; of a noise, its variances."""
    station: str | None = None
    """Where it shows best."""
    consequence_of: str | None = None
    """The fault that explains this one."""

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        known = advice()[self.fault]
        return {
            "fault": self.fault,
            "confidence": round(self.confidence, 3),
            "sensor": self.sensor,
            "factor": None if self.factor is None else float(f"{self.factor:.3g}"),
            "evidence": self.evidence,
            "advice": f"{known.where} {known.fix}",
            "consequence_of": self.consequence_of,
        }


@dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str
    question: str
    passed: bool | None
    """None where it could not be looked at."""
    result: str
    """What was seen, with its numbers."""

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        return {"name": self.name, "question": self.question, "passed": self.passed, "result": self.result}


@dataclass
class Outcome:
    """What one part of the examination has come to."""

    checks: list[Check] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
