"""Content of ``result.json``: metrics and settings of a run, and the time and code version of the run."""

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
    """Time at which the runs began, and versions of the user's code. No metric depends on time or versions."""

    made_at: AwareDatetime
    commit: str | None
    """Commit of the git repository that holds the scenario; None without a repository."""
    changed: bool | None
    """Whether files tracked by git differed from the commit at the time of the run; None without a repository."""
    no_commit: str = ""
    """Reason why the commit is unknown; empty where it is known."""
    code: dict[str, str | None] = Field(default_factory=dict)
    """Sha256 of the code of each tracker that is not built in, by name of the tracker; None if no code was found."""

    @property
    def commit_in_words(self) -> str:
        """First letters of the commit, and whether files were changed since; "none" without a commit."""
        if self.commit is None:
            return "none"
        return self.commit[:10] + (" (changed)" if self.changed else "")


SCHEMA_VERSION = 7


class ExpectationResult(ResultModel):
    """Condition that the scenario states on a metric of a tracker, such as a limit, with value and outcome."""

    tracker: str
    metric: str
    operator: str
    limit: float | str
    value: float | str | None
    passed: bool
    undecided: bool = False
    """Whether the runs or scenes show neither that the expectation holds nor that it does not; ``passed`` is False
    then."""
    text: str

    @property
    def outcome(self) -> Literal["passed", "undecided", "failed"]:
        return "passed" if self.passed else "undecided" if self.undecided else "failed"


class Summary(ResultModel):
    """Content of ``result.json``: scenario, truth, sensors, rules of scoring, and metrics and ranking of trackers."""

    schema_version: int = SCHEMA_VERSION
    scenario: ScenarioSummary
    seed: int
    runs: int = Field(ge=1)
    """Number of Monte-Carlo runs of all scenes together."""
    versions: dict[str, str]
    engine: ComputedBy = "numpy"
    """Engine, such as ``numpy`` or compiled kernels, that computed the built-in trackers."""
    command: str
    identities: Literal["known", "hidden"] = "known"
    """known: each measurement names its object. hidden: measurements do not name objects, and trackers are scored by
    their tracks."""
    fingerprints: list[str]
    """Fingerprint of all measurements of each run: equal fingerprints mean equal measurements."""
    truth: TruthSummary
    sensors: dict[str, SensorSummary]
    reference: ReferenceSummary | None
    """Cramér-Rao reference that errors are compared with; None with hidden identities."""
    score: ScoreSummary
    recorded_run: int
    trackers: list[TrackerResult]
    ranking: list[str]
    expectations: list[ExpectationResult]
    passed: bool
    artifacts: dict[str, str]
    tables: dict[str, str] = Field(default_factory=dict)
    """Sha256 of the file of each written table, by name of the table."""
    provenance: Provenance | None = None
    """Time and code versions of the runs; None for a result that was made in memory alone."""

    @property
    def has_recording(self) -> bool:
        """Whether a Rerun recording was written beside the numbers."""
        return "recording" in self.artifacts

    @property
    def recorded_scene(self) -> int:
        """Index from 0 of the scene of the run whose estimates are kept; of the log, if logs are cut into stretches."""
        logs = len(self.truth.scenes) // max(self.truth.log_stretches, 1)
        return self.recorded_run * max(logs, 1) // self.runs

    @property
    def made_with(self) -> str:
        """Versions of Python and of the packages, and the engine, in one line."""
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return f"{versions}; {self.engine_in_words}"

    @property
    def engine_in_words(self) -> str:
        """Name of the engine that computed the trackers, with the noun, such as "numpy engine"."""
        return f"{self.engine} {'engines' if ' and ' in self.engine else 'engine'}"

    @property
    def held_against(self) -> ReferenceSummary:
        """Cramér-Rao reference that errors are compared with, in a result with known identities."""
        assert self.reference is not None
        return self.reference

    @property
    def headline(self) -> str:
        """Path of the metric that ranks trackers; ``track_count`` without a truth, where nothing is ranked."""
        if not self.truth.known:
            return "track_count"
        return "position_rmse" if self.identities == "known" else "tgospa"

    @property
    def headline_name(self) -> str:
        """Name in text of the metric that ranks trackers: "position RMSE" or "T-GOSPA"."""
        return "position RMSE" if self.identities == "known" else "T-GOSPA"

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the measurements of all runs together: equal for equal measurements."""
        return hashlib.sha256(" ".join(self.fingerprints).encode()).hexdigest()[:16]
