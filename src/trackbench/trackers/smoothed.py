"""A smoother of a built-in filter, which knows all measurements of a run before it gives its first estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

from trackbench.base.types import Estimate, Scan
from trackbench.filters import bare
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.in_order import TrackState


class _Instant(NamedTuple):
    state: TrackState
    own: bool
    """Whether it was a scan that the filter reads; at others there is a prediction."""


@dataclass(frozen=True)
class SmoothedTracker:
    """The estimates of a tracker, each given the measurements after it too. Tracks start where the tracker starts them.

    Between two scans that it reads, what is predicted from the earlier is smoothed by the later.
    """

    tracker: FilterTracker

    def estimates(self, scans: Sequence[Scan]) -> list[Estimate]:
        """The estimate at each scan, whatever their order: offline none comes late."""
        instants = self._filtered(sorted((scan.prompt() for scan in scans), key=lambda scan: scan.time))
        smoothed: dict[float, Estimate] = {}
        later: TrackState | None = None
        while instants:
            state, own = instants.pop()
            if later is not None:
                state = self.tracker.smoothed(state, later)
            # The filter's own state, of which nothing is scored, would take as much memory again.
            smoothed[state.time] = self.tracker.estimate(state)._replace(state=None, state_covariance=None)
            if own:
                later = state
        return [smoothed[scan.time] for scan in scans]

    def _filtered(self, scans: Sequence[Scan]) -> list[_Instant]:
        # Where a track loses its course, there is no way back from position and velocity.
        when = self.tracker.cartesian_fallback
        tracker = replace(self.tracker, cartesian_fallback="at_start" if when == "always" else when, lag_s=0.0)
        state: TrackState | None = None
        instants = []
        for time, group in groupby(scans, key=lambda scan: scan.time):
            own = False
            for scan in group:
                state, _ = tracker.step(state, scan)
                own = own or tracker.advances(scan.sensor)
            assert state is not None
            seen = state if own else tracker.predicted(state, time)
            instants.append(_Instant(seen._replace(time=time, belief=bare(seen.belief)), own))
        return instants
