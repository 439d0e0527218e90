"""The protocol, as protocol.yaml states it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

import trackbench as tb
from trackbench.subjects.tuning.parameters import Parameter, parse_range

HERE = Path(__file__).parent
SCENARIOS = HERE.parents[1] / "scenarios"


@dataclass(frozen=True)
class Budget:
    """So many scenes of so many runs."""

    scenes: int
    runs: int

    def __str__(self) -> str:
        return f"{self.scenes} scenes of {self.runs} {'run' if self.runs == 1 else 'runs'}"


@dataclass(frozen=True)
class Protocol:
    """How trackers are tuned and compared."""

    objective: str
    trials: int
    """Of each search."""
    tuned_on: Budget
    scored_on: Budget
    families: dict[str, list[str]]
    trackers: dict[str, dict[str, Any]]
    remarks: str
    """What a reader of the scores should know."""

    @property
    def scenarios(self) -> list[str]:
        """All of them."""
        return [name for names in self.families.values() for name in names]

    @property
    def entries(self) -> dict[str, Any]:
        """The trackers as the search begins with them."""
        return {tracker: stated["entry"] for tracker, stated in self.trackers.items()}

    def parameters(self, tracker: str, loaded: Any) -> list[Parameter]:
        """What is tuned of a tracker of a loaded scenario."""
        return [parse_range(text, loaded, tracker) for text in self.trackers[tracker]["ranges"]]

    def family_of(self, scenario: str) -> str:
        """The family that a scenario belongs to."""
        return next(family for family, names in self.families.items() if scenario in names)

    def loaded(self, scenario: str, trackers: dict[str, Any], **more: Any) -> Any:
        """A shipped scenario with other trackers, of which nothing is expected."""
        content = yaml.safe_load((SCENARIOS / f"{scenario}.yaml").read_text(encoding="utf-8"))
        return tb.load({**content, "trackers": trackers, "expect": []}, **more)


def read() -> Protocol:
    """The protocol of the file."""
    content = yaml.safe_load((HERE / "protocol.yaml").read_text(encoding="utf-8"))
    budgets = {name: Budget(**content.pop(name)) for name in ("tuned_on", "scored_on")}
    return Protocol(**budgets, **content)
