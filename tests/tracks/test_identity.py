"""What identities cost, alike at any rate."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.types import DUE, Array
from trackbench.metrics.traffic import TRACK_METRICS, TrackHistory, TrafficScoreOptions, TruthHistory, score_run


def wandering(rate: float, seed: int, factor: float = 1.0) -> tuple[TruthHistory, TrackHistory]:
    """Two objects for 60 s whose tracks wander around them and have a new identity every 3 s."""
    time = np.arange(0, 60, 1 / rate)
    random = np.random.default_rng(seed)
    knots, phase = np.arange(61.0), random.uniform(0, 6, (2, 2))
    offset = random.normal(0, 0.5, (2, 2, 61))
    truth, mean = (np.zeros((4, len(time), 2)) for _ in range(2))
    truth[0], truth[1] = 20 * time[:, None], [0, 4]
    mean[:2] = truth[:2]
    for axis in range(2):
        for item in range(2):
            mean[axis, :, item] += np.interp(time, knots, offset[axis, item])
    ids: Array = np.floor((time[:, None] + phase[0]) / (3 / factor)) * 2 + [0, 1]
    unit = np.broadcast_to(np.eye(4)[:, :, None, None], (4, 4, len(time), 2))
    status = np.full((len(time), 2), DUE, dtype=np.int8)
    return TruthHistory(time, truth, status), TrackHistory(ids.astype(int), mean, unit)


def value(path: str, histories: tuple[TruthHistory, TrackHistory], options: TrafficScoreOptions | None = None) -> float:
    total, count = score_run(*histories, options).values[path]
    return float(np.sqrt(total / count))


@pytest.mark.parametrize("seed", range(5))
def test_a_rate_twice_as_high_gives_the_same_value(seed: int) -> None:
    slow, fast = (value("tgospa", wandering(rate, seed)) for rate in (20, 40))
    assert slow == pytest.approx(fast, rel=0.005)
    # Switches are what it mostly is.
    assert slow > 1.5 * value("gospa", wandering(20, seed))


def test_what_is_beside_gospa_is_what_the_identities_cost() -> None:
    histories = wandering(10, 0)
    squares = {path: value(path, histories) ** 2 for path in TRACK_METRICS if "gospa" in path}
    assert squares["tgospa"] == pytest.approx(squares["gospa"] + squares["gospa_switch"])
    # Some 20 changes of each of two objects in 60 s, each as if it were missed for half a second.
    assert squares["gospa_switch"] == pytest.approx(2 * 19.5 * 0.5 * 12.5 / 60, rel=0.03)
