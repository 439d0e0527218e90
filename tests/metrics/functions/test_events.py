"""Events of the truth and the activity that answers them, against a search that looks at each."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.metrics.functions.events import TOLERANCE, answers, spans

Interval = tuple[int, int, int]


def intervals(active: np.ndarray, time: np.ndarray) -> list[Interval]:
    """Run, start and stop of each, one instant after the other."""
    found: list[Interval] = []
    for run in range(active.shape[1]):
        for instant in np.flatnonzero(active[:, run]).tolist():
            last = found[-1] if found and found[-1][0] == run else None
            if last and time[instant] - time[min(last[2], len(time) - 1)] < TOLERANCE - 1e-9:
                found[-1] = (run, last[1], instant + 1)
            else:
                found.append((run, instant, instant + 1))
    return found


def brute(truth: list[Interval], own: list[Interval], time: np.ndarray) -> tuple[list, list, list]:
    ends = [*time, time[-1]]
    delays, missing = [], []
    for place, (run, start, stop) in enumerate(truth):
        same = [item for item in own if item[0] == run and ends[item[2]] >= ends[start] - TOLERANCE - 1e-9]
        same = [item for item in same if ends[item[1]] <= ends[stop] + TOLERANCE + 1e-9]
        if not same:
            delays.append(ends[stop] - ends[start])
        else:
            begin = ends[same[0][1]]
            if place and truth[place - 1][0] == run:
                begin = max(begin, ends[truth[place - 1][2]])
            delays.append(begin - ends[start])
        missing.append(not same)
    false = [
        not any(
            r == run and ends[s] <= ends[stop] + TOLERANCE + 1e-9 and ends[e] >= ends[start] - TOLERANCE - 1e-9
            for r, s, e in truth
        )
        for run, start, stop in own
    ]
    return delays, missing, false


@pytest.mark.parametrize("seed", range(40))
def test_random_activity_is_matched_as_by_hand(seed: int):
    random = np.random.default_rng(seed)
    steps, runs = 60, 4
    time = np.cumsum(random.choice([0.05, 0.1, 0.2], size=steps))
    switching = random.choice([0.05, 0.2, 0.5])
    truth, own = (np.cumsum(random.random((steps, runs)) < switching, axis=0) % 2 == 1 for _ in range(2))
    events, mine = spans(truth, time), spans(own, time)
    assert list(zip(*(each.tolist() for each in events), strict=True)) == intervals(truth, time)
    result = answers(events, mine, time)
    delays, missing, false = brute(intervals(truth, time), intervals(own, time), time)
    np.testing.assert_allclose(result.delay, delays, atol=1e-9)
    assert result.missing.tolist() == missing
    assert result.false.tolist() == false
