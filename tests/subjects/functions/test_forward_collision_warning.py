"""Forward collision warning, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.forward_collision_warning import ForwardCollisionWarning
from trackbench.subjects.functions.protocol import Objects

TIME = np.arange(0.0, 8.0, 0.01)
SPEED, LENGTHS = 20.0, (5.0 + 4.5) / 2


def approach(covariance: np.ndarray | None = None, across: float = 0.0) -> tuple[Ego, Objects]:
    """An ego that comes nearer to a car that stands, whose front is 100 m away at first."""
    steady = np.zeros_like(TIME)
    own = Ego(SPEED * TIME, steady, steady, steady + SPEED, steady, steady, 5.0, 2.0)
    state = np.stack([steady + 100.0 + LENGTHS, steady + across, steady, steady])[:, None]
    spread = np.zeros((4, 4)) if covariance is None else covariance
    spread = np.broadcast_to(spread[..., None, None], (4, 4, *state.shape[1:]))
    one = np.ones((1, 1))
    return own, Objects(state, spread, np.ones(state.shape[1:], dtype=bool), 4.5 * one, 1.8 * one)


def test_it_warns_when_the_time_to_collision_is_reached():
    own, objects = approach()
    decision = ForwardCollisionWarning(ttc_s=2.4).decide(own, objects)
    assert TIME[np.argmax(decision.active)] == pytest.approx(100.0 / SPEED - 2.4, abs=0.0101)
    np.testing.assert_allclose(decision.quantity[: len(TIME) // 2], 5.0 - TIME[: len(TIME) // 2], atol=1e-9)
    assert (decision.object[TIME < 5.0] == 0).all()


def test_what_is_beside_or_behind_or_drives_away_is_not_warned_of():
    assert not ForwardCollisionWarning().decide(*approach(across=2.0)).active.any()
    own, objects = approach()
    passed = TIME > 5.0 + 2 * LENGTHS / SPEED
    assert not ForwardCollisionWarning().decide(own, objects).active[passed].any()
    faster = objects._replace(mean=objects.mean + np.array([0.0, 0.0, 25.0, 0.0])[:, None, None])
    assert not ForwardCollisionWarning().decide(own, faster).active[TIME < 5.0].any()
