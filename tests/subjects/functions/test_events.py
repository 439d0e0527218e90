"""Events of the truth and the activity that answers them, against a search that looks at each."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.subjects.functions.sums import TOLERANCE, match_events, spans

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


def brute(truth: list[Interval], own: list[Interval], time: np.ndarray, impact: np.ndarray) -> tuple[list, list, list]:
    ends, near = [*time, time[-1]], TOLERANCE + 1e-9
    delays, missing = [], []
    for place, (run, start, stop) in enumerate(truth):
        same = [item for item in own if item[0] == run and item[2] > start and ends[item[1]] <= ends[stop] + near]
        if not same:
            delays.append(min(ends[stop] + TOLERANCE, impact[run]) - ends[start])
        else:
            begin = ends[same[0][1]]
            if place and truth[place - 1][0] == run:
                begin = max(begin, ends[truth[place - 1][2]])
            delays.append(max(begin - ends[start], -TOLERANCE))
        missing.append(not same)
    false = []
    for run, start, stop in own:
        around = [(s, e) for r, s, e in truth if r == run and ends[s] - near <= ends[start] <= ends[e] + near]
        false.append(not around or stop <= around[0][0])
    return delays, missing, false


@pytest.mark.parametrize("seed", range(10))
def test_random_activity_is_matched_as_by_hand(seed: int):
    random = np.random.default_rng(seed)
    steps, runs = 60, 4
    time = np.cumsum(random.choice([0.05, 0.1, 0.2], size=steps))
    switching = random.choice([0.05, 0.2, 0.5])
    truth, own = (np.cumsum(random.random((steps, runs)) < switching, axis=0) % 2 == 1 for _ in range(2))
    events, mine = spans(truth, time), spans(own, time)
    assert list(zip(*(each.tolist() for each in events), strict=True)) == intervals(truth, time)
    impact = np.where([True, False, True, False], np.inf, time[-1])
    result = match_events(events, mine, time, impact)
    delays, missing, false = brute(intervals(truth, time), intervals(own, time), time, impact)
    np.testing.assert_allclose(result.delay, delays, atol=1e-9)
    assert result.missing.tolist() == missing
    assert result.false.tolist() == false


#: The event is from 3 to 5 s.
@pytest.mark.parametrize(
    ("own", "delay", "false"),
    [
        ([(0.0, 9.0)], -0.5, [True]),
        ([(2.5, 9.0)], -0.5, [False]),
        ([(0.0, 2.7)], 2.5, [True]),
        ([(2.7, 3.0)], 2.5, [True]),
        ([(2.5, 2.6), (3.2, 5.0)], 0.2, [True, False]),
        ([(0.0, 1.0), (3.2, 5.0)], 0.2, [True, False]),
        ([(5.5, 7.0)], 2.5, [False]),
        ([(5.6, 7.0)], 2.5, [True]),
        ([(4.9, 5.0), (5.5, 6.0)], 1.9, [False, False]),
    ],
)
def test_a_warning_is_in_time_only_near_its_event(own: list[tuple[float, float]], delay: float, false: list[bool]):
    time = np.arange(0.0, 10.0, 0.1)

    def active(*parts: tuple[float, float]) -> np.ndarray:
        return np.any([(time > start - 1e-9) & (time < stop - 1e-9) for start, stop in parts], axis=0)[:, None]

    result = match_events(spans(active((3, 5)), time), spans(active(*own), time), time, np.array([np.inf]))
    assert result.delay.tolist() == pytest.approx([delay])
    assert result.false.tolist() == false
