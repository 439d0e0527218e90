"""Trackers whose filter is computed by kernels, held against the same by NumPy."""

from __future__ import annotations

import pytest
from tests.engine import agreement
from tests.engine.agreement import LIMIT, Drive, drive

pytestmark = pytest.mark.usefixtures("kernels")


def largest_difference(name: str, of: Drive) -> float:
    """Between the states and estimates of the two engines, over all scans."""
    tracker, fused = of.tracker(name), of.tracker(name, "fused")
    angular = tuple(motion.angular for motion in tracker.filter.motions)
    state = other = None
    largest = 0.0
    for scan in of.scans:
        state, said = tracker.step(state, scan)
        other, by_kernels = fused.step(other, scan)
        of_beliefs = agreement.apart(other.belief, state.belief, angular)
        largest = max(largest, of_beliefs, agreement.of_estimates(by_kernels, said))
    assert fused.engine_used[:3] == ("fused", "", 0)
    return largest


@pytest.mark.parametrize("name", agreement.CHOSEN)
def test_sixty_scans(name: str) -> None:
    assert largest_difference(name, drive(60, 21)) < LIMIT
