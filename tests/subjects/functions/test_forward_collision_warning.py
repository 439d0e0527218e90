"""Forward collision warning, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

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


def first_warning(function: ForwardCollisionWarning, own: Ego, objects: Objects) -> float:
    active = function.decide(own, objects).active
    assert active.any()
    return float(TIME[np.argmax(active)])


def test_it_warns_when_the_time_to_collision_is_reached():
    own, objects = approach()
    decision = ForwardCollisionWarning(ttc_s=2.4).decide(own, objects)
    assert TIME[np.argmax(decision.active)] == pytest.approx(100.0 / SPEED - 2.4, abs=0.0101)
    np.testing.assert_allclose(decision.quantity[: len(TIME) // 2], 5.0 - TIME[: len(TIME) // 2], atol=1e-9)
    assert (decision.object[TIME < 5.0] == 0).all()


@pytest.mark.parametrize("probability", [0.2, 0.5, 0.9])
def test_a_covariance_shifts_it_by_the_quantile(probability: float):
    # The margin 2.4 v - gap has sigma sqrt(1 + 2.4^2 .3^2), and grows by v per second.
    sigma = np.sqrt(1.0 + (2.4 * 0.3) ** 2)
    function = ForwardCollisionWarning(ttc_s=2.4, probability=probability)
    warned = first_warning(function, *approach(np.diag([1.0, 1e-6, 0.09, 0.09])))
    shift = ndtri(probability) * sigma / SPEED
    assert warned == pytest.approx(100.0 / SPEED - 2.4 + shift, abs=0.0101)


def test_what_is_beside_or_behind_or_drives_away_is_not_warned_of():
    assert not ForwardCollisionWarning().decide(*approach(across=2.0)).active.any()
    own, objects = approach()
    passed = TIME > 5.0 + 2 * LENGTHS / SPEED
    assert not ForwardCollisionWarning().decide(own, objects).active[passed].any()
    faster = objects._replace(mean=objects.mean + np.array([0.0, 0.0, 25.0, 0.0])[:, None, None])
    assert not ForwardCollisionWarning().decide(own, faster).active[TIME < 5.0].any()


def test_the_nearest_of_several_is_chosen_and_without_any_there_is_none():
    own, objects = approach()
    several = Objects(
        np.concatenate(
            [objects.mean + np.array([shift, 0, 0, 0])[:, None, None] for shift in (40.0, 0.0, 20.0)], axis=1
        ),
        np.zeros((4, 4, 3, len(TIME))),
        np.ones((3, len(TIME)), dtype=bool),
        *np.full((2, 3, 1), 2.0),
    )
    before = TIME < 5.0
    assert (ForwardCollisionWarning().decide(own, several).object[before] == 1).all()
    none = Objects(*(np.empty((*values.shape[:-2], 0, len(TIME))) for values in objects[:2]), *np.empty((3, 0, 1)))
    decision = ForwardCollisionWarning().decide(own, none._replace(there=np.empty((0, len(TIME)), dtype=bool)))
    assert not decision.active.any()
    assert (decision.object == -1).all()
    assert np.isnan(decision.quantity).all()
