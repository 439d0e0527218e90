"""A sweep of a thousand trackers stays within its time and memory."""

import pytest
from benchmarks.many_trackers import GOAL_GIB, GOAL_POINTS, GOAL_SECONDS, measure


@pytest.mark.slow
def test_a_thousand_points() -> None:
    spent = measure(GOAL_POINTS)
    assert spent["gib"] < GOAL_GIB
    assert spent["filtering_s"] + spent["rest_s"] < GOAL_SECONDS
