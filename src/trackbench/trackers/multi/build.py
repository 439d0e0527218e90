"""Trackers of several objects, made from the keys that a scenario gives."""

from __future__ import annotations

from trackbench.trackers.builtin import filter_of
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi.tracker import MultiObjectTracker


def build_multi(config: FilterConfig) -> MultiObjectTracker:
    """The tracker that a scenario's ``filter:`` entry with ``associate:`` describes."""
    assert config.associate is not None
    return MultiObjectTracker(
        filter_of(config),
        config.associate,
        config.initial,
        assumed=config.assumed,
        sensors=config.sensors,
        advance_at=config.advance_at,
        late=config.late,
        lag_s=config.lag_s,
    )
