"""When a result was made and of which code, in ``result.json``."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field, field_validator

from trackbench.results.metric_value import ResultModel


class Provenance(ResultModel):
    """When the runs began, and what of the user's own code they were made of. No number depends on it."""

    made_at: str
    """When the runs began: UTC, ISO 8601."""
    commit: str | None
    """Of the git repository that holds the scenario; None where there is none."""
    changed: bool | None
    """Whether files of the repository differed from the commit; files that git does not track do not count."""
    no_commit: str = ""
    """Why there is no commit."""
    code: dict[str, str | None] = Field(default_factory=dict)
    """By name of each tracker with code of its own, the sha256 of that code; None where it was not found."""

    @field_validator("made_at")
    @classmethod
    def _with_zone(cls, text: str) -> str:
        if datetime.fromisoformat(text).tzinfo is None:
            raise ValueError("a time with its zone is needed")
        return text

    @property
    def time(self) -> datetime:
        """When the runs began."""
        return datetime.fromisoformat(self.made_at)

    @property
    def commit_in_words(self) -> str:
        """Its first letters and whether it was changed, or that there is none."""
        if self.commit is None:
            return "none"
        return self.commit[:10] + (" (changed)" if self.changed else "")
