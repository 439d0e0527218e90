"""What is scored, in ``result.json``."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from trackbench.results.metric_value import ResultModel


class MetricSummary(ResultModel):
    """A metric, of a result that can be read where its class is not."""

    name: str
    unit: str
    meaning: str
    better: Literal["smaller", "larger"] | None
    compared: bool
    """Whether trackers are compared by it, run by run."""
    per_sensor: bool
    options: dict[str, Any] = Field(default_factory=dict)


class MarginSummary(ResultModel):
    """Differences that do not matter: up to the larger of a share of the better value and an absolute part."""

    percent: float
    position_m: float
    velocity_mps: float
    course_deg: float

    def absolute(self, unit: str) -> float:
        """The absolute part of metrics of a unit; 0 where there is none."""
        return {"m": self.position_m, "m/s": self.velocity_mps, "deg": self.course_deg}.get(unit, 0.0)

    def at(self, value: float, unit: str) -> float:
        """The margin where the better of the two values is this one."""
        return max(self.percent / 100 * abs(value), self.absolute(unit))


class ScoreSummary(ResultModel):
    """Which errors count, and what is computed of them beside the built-in metrics."""

    settle_s: float
    each: Literal["instant", "measurement"] = "instant"
    """Whether the estimate after the last measurement of an instant is scored, or the one after each."""
    divergence_m: float
    lost_after_s: float
    """An object that has been out of view of every sensor for longer is not scored."""
    min_coverage: float
    """A tracker with a smaller share of the estimates that it should give is not ranked."""
    from_s: float
    """The first instant at which a sensor looks; trackers are asked and scored from here on."""
    to_s: float
    """The last one."""
    margin: MarginSummary
    baseline: str | None = None
    """The ranked tracker that all others are held against, where the scenario names one."""
    best: str | None = None
    """The best of so many trackers that all others are held against it alone."""
    cutoff_m: float | None = None
    """Where identities are hidden, the distance from which a track is not on an object."""
    switch_costs_s: float | None = None
    """Where identities are hidden, how long an object may be missed for the cost of a switch."""
    metrics: list[MetricSummary] = Field(default_factory=list)

    @property
    def against(self) -> str | None:
        """The tracker that all others are held against; None where every pair is compared."""
        return self.baseline or self.best
