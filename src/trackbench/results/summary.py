"""A whole ``result.json``, with when it was made and of which code."""

from __future__ import annotations

import hashlib
from typing import Literal

from pydantic import AwareDatetime, Field

from trackbench.engine.equations import ComputedBy
from trackbench.results.metric_value import ResultModel
from trackbench.results.scenario_summary import (
    ReferenceSummary,
    ScenarioSummary,
    ScoreSummary,
    SensorSummary,
    TruthSummary,
)
from trackbench.results.tracker_result import TrackerResult


class Provenance(ResultModel):
    """When the runs began, and what of the user's own code they were made of. No number depends on it."""

    made_at: AwareDatetime
    """When the runs began."""
    commit: str | None
    """Of the git repository that holds the scenario; None where there is none."""
    changed: bool | None
    """Whether files of the repository differed from the commit; files that git does not track do not count."""
    no_commit: str = ""
    """Why there is no commit."""
    code: dict[str, str | None] = Field(default_factory=dict)
    """By name of each tracker with code of its own, the sha256 of that code; None where it was not found."""

    @property
    def commit_in_words(self) -> str:
        """Its first letters and whether it was changed, or that there is none."""
        if self.commit is None:
            return "none"
        return self.commit[:10] + (" (changed)" if self.changed else "")


SCHEMA_VERSION = 7


class ExpectationResult(ResultModel):
    """What the scenario expects, and what was found."""

    tracker: str
    metric: str
    operator: str
    limit: float | str
    value: float | str | None
    passed: bool
    undecided: bool = False
    """The runs or scenes show neither that it holds nor the opposite; it is not passed then."""
    text: str

    @property
    def outcome(self) -> Literal["passed", "undecided", "failed"]:
        """In a word."""
        return "passed" if self.passed else "undecided" if self.undecided else "failed"


class Summary(ResultModel):
    """``result.json``"""

    schema_version: int = SCHEMA_VERSION
    scenario: ScenarioSummary
    seed: int
    runs: int = Field(ge=1)
    """Of all scenes together."""
    versions: dict[str, str]
    engine: ComputedBy = "numpy"
    """What computed the built-in trackers."""
    command: str
    identities: Literal["known", "hidden"] = "known"
    """hidden: scans do not say of which objects they are, and the result is one of tracks."""
    fingerprints: list[str]
    """One a run, of all its measurements: equal fingerprints mean equal measurements."""
    truth: TruthSummary
    sensors: dict[str, SensorSummary]
    reference: ReferenceSummary | None
    """None where identities are hidden."""
    score: ScoreSummary
    recorded_run: int
    trackers: list[TrackerResult]
    ranking: list[str]
    expectations: list[ExpectationResult]
    passed: bool
    artifacts: dict[str, str]
    tables: dict[str, str] = Field(default_factory=dict)
    """By the name of each table that was written, the sha256 of its file."""
    provenance: Provenance | None = None
    """When and of which code it was made; None of a result that was made in memory alone."""

    @property
    def has_recording(self) -> bool:
        """Whether a Rerun recording was written beside the numbers."""
        return "recording" in self.artifacts

    @property
    def recorded_scene(self) -> int:
        """Number of the scene that is recorded, from 0; of logs that are cut into stretches, that of the log."""
        logs = len(self.truth.scenes) // max(self.truth.log_stretches, 1)
        return self.recorded_run * max(logs, 1) // self.runs

    @property
    def made_with(self) -> str:
        """The versions and the engine, in a line."""
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return f"{versions}; {self.engine_in_words}"

    @property
    def engine_in_words(self) -> str:
        """Such as "numpy engine"."""
        return f"{self.engine} {'engines' if ' and ' in self.engine else 'engine'}"

    @property
    def held_against(self) -> ReferenceSummary:
        """The reference of a result whose identities are known."""
        assert self.reference is not None
        return self.reference

    @property
    def headline(self) -> str:
        """The metric that trackers are ranked by; without a truth, by nothing, and this one stands first."""
        if not self.truth.known:
            return "track_count"
        return "position_rmse" if self.identities == "known" else "tgospa"

    @property
    def headline_name(self) -> str:
        """In words."""
        return "position RMSE" if self.identities == "known" else "T-GOSPA"

    @property
    def fingerprint(self) -> str:
        """Of the measurements of all runs together."""
        return hashlib.sha256(" ".join(self.fingerprints).encode()).hexdigest()[:16]
