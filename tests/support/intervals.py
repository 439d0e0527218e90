"""Intervals of scaled values."""

from __future__ import annotations

from trackbench.metrics import Interval


def scaled(interval: Interval, factor: float) -> Interval:
    """A positive multiple of a value."""
    limits = {"at_least": interval.at_least * factor, "at_most": interval.at_most * factor}
    return interval._replace(value=interval.value * factor, influence=interval.influence * factor, **limits)
