"""What the audit of a truth found and did."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from trackbench.results.metric_value import ResultModel


class VelocityMismatch(ResultModel):
    """How far a velocity is from the displacement that it should cause; None where nothing moves."""

    max_mps: float | None
    mean_mps: float | None
    object: str | None
    """Where it is largest."""
    time_s: float | None


class PositionJump(ResultModel):
    """A body moves in a way that its velocity does not explain, and its track ends there."""

    object: str
    time_s: float
    distance_m: float


class VelocityJumps(ResultModel):
    """Steps in which a velocity changes by more than a car can do. They are counted and stay."""

    limit_mps2: float
    """Change of the velocity vector over the step's duration, above which it is a jump."""
    count: int = 0
    """In all runs of a random motion."""
    largest_mps: float | None = None
    """Change of the velocity vector in the largest one."""
    object: str | None = None
    """Whose it is."""
    time_s: float | None = None
    """At the end of its step."""
    peak_acceleration_mps2: float | None = None
    """Largest change of the velocity vector over the step's duration, jump or not."""


class EndedEarly(ResultModel):
    """The truth is shorter than the scenario asks for."""

    time_s: float
    reason: str


class Repairs(ResultModel):
    """What was corrected."""

    velocity_from_course_and_slip: list[str] = Field(default_factory=list)
    velocity_from_displacement: list[str] = Field(default_factory=list)
    cut_at_jump: list[str] = Field(default_factory=list)
    """Objects whose track ends at a jump."""
    own_clock: bool = False
    """Time is counted in steps, since the source's clock is off."""

    @property
    def any(self) -> bool:
        """Whether anything was."""
        return any(vars(self).values())


class TruthAudit(ResultModel):
    """What the audit of a truth found and did."""

    mode: Literal["repair", "refuse", "by construction"]
    verdict: Literal["consistent", "repaired", "exact"]
    tolerance_mps: float
    """Largest velocity mismatch that passes."""
    velocity_error_before: VelocityMismatch
    """Of the velocity that the source states."""
    velocity_error_after: VelocityMismatch
    jumps: list[PositionJump]
    velocity_jumps: VelocityJumps
    clock_drift_s: float | None
    """None where the source keeps no clock."""
    repaired: Repairs
    ended_early: EndedEarly | None = None
