"""Trackers of several objects with one fault."""

from __future__ import annotations

from collections.abc import Iterator

from . import builtin_faults, greedy_faults, ipda_faults, nearest_faults
from .subject import TrafficSubject


def _subjects() -> Iterator[TrafficSubject]:
    for part in (builtin_faults, nearest_faults, greedy_faults, ipda_faults):
        yield from part.subjects()


FAULTY: list[TrafficSubject] = list(_subjects())
