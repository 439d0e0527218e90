"""Trackers with a fault outside of the filter, in their scans, their time or their estimates.

The wrappers work with any tracker, batched or not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from trackbench.base.types import Estimate, Scan

When = Literal["always", "starting", "started"]


class AlteredScans:
    """Alters each scan (or only those before the first estimate, or only those after it)."""

    def __init__(self, tracker: Any, alter: Callable[[Scan], Scan], when: When = "always") -> None:
        self.tracker, self.alter, self.when = tracker, alter, when
        self.batched = getattr(tracker, "batched", False)

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        inner, started = (None, False) if state is None else state
        if self.when == "always" or (self.when == "started") == started:
            scan = self.alter(scan)
        inner, answer = self.tracker.step(inner, scan)
        return (inner, started or (answer is not None and bool(np.all(np.isfinite(answer[0]))))), answer


class WrongClock:
    """Steps the tracker with the wrong time.

    ``clock(now, before, time)`` gives the tracker's time at a scan from its time and the true time at the previous
    scan, and the true time of this one.
    """

    def __init__(self, tracker: Any, clock: Callable[[float, float, float], float]) -> None:
        self.tracker, self.clock = tracker, clock
        self.batched = getattr(tracker, "batched", False)

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        inner, now, before = (None, scan.time, None) if state is None else state
        if before is not None:
            now = self.clock(now, before, scan.time)
        inner, answer = self.tracker.step(inner, scan._replace(time=now))
        return (inner, now, scan.time), answer


class AlteredEstimates:
    """Alters the mean and covariance that are returned; the tracker goes on with the right ones."""

    def __init__(self, tracker: Any, alter: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        self.tracker, self.alter = tracker, alter
        self.batched = getattr(tracker, "batched", False)

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        state, answer = self.tracker.step(state, scan)
        if answer is None:
            return state, None
        said = Estimate(*answer)
        altered = self.alter(said.mean, said.covariance)
        return state, Estimate(*altered, innovation=said.innovation, innovation_covariance=said.innovation_covariance)


class Single:
    """Any tracker as one of a single track, so that what wraps it may decide by the scan's one measurement."""

    batched = False

    def __init__(self, tracker: Any) -> None:
        self.tracker = tracker

    def inner_step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        if not getattr(self.tracker, "batched", False):
            return self.tracker.step(state, scan)
        given = scan._replace(measurement=scan.measurement[:, None], valid=np.array([bool(scan.valid)]))
        state, answer = self.tracker.step(state, given)
        if answer is None or np.isnan(answer[0]).all():
            return state, None
        return state, (answer[0][..., 0], answer[1][..., 0])


class MissedSkipped(Single):
    """At a missed scan the last answer is given again; its time counts at the next measurement, or is lost."""

    def __init__(self, tracker: Any, lost: bool) -> None:
        super().__init__(tracker)
        self.lost = lost

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        inner, behind, time, answer = (None, 0.0, scan.time, None) if state is None else state
        if not scan.valid and answer is not None:
            behind += self.lost * (scan.time - time)
        else:
            inner, answer = self.inner_step(inner, scan._replace(time=scan.time - behind))
        return (inner, behind, scan.time, answer), answer
