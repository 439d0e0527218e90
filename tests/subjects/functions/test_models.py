"""Each function against its closed form, and its probability against a sample."""

from __future__ import annotations

import numpy as np
import pytest
from tests.subjects.functions.scenes import LENGTHS, WIDTHS, ego, objects

from trackbench.subjects.functions.cut_in import CutIn
from trackbench.subjects.functions.emergency_braking import LARGEST, EmergencyBraking
from trackbench.subjects.functions.following_distance import FollowingDistance
from trackbench.subjects.functions.forward_collision_warning import ForwardCollisionWarning
from trackbench.subjects.functions.lane_change import LaneChange
from trackbench.subjects.functions.protocol import FUNCTIONS, Function


def active(function: Function, *states: list[float], speed: float = 20.0) -> bool:
    return bool(function.decide(ego(speed), objects(*states)).active)


@pytest.mark.parametrize("closing", [5.0, 12.0, 20.0])
def test_it_brakes_where_the_stopping_distance_is_the_gap(closing: float):
    distance = closing**2 / (2 * 6.0)
    function = EmergencyBraking(deceleration_mps2=6.0)
    near, far = ([distance + LENGTHS + offset, 0.0, 20.0 - closing, 0.0] for offset in (-0.01, 0.01))
    assert active(function, near)
    assert not active(function, far)
    decision = function.decide(ego(), objects(far))
    assert decision.quantity == pytest.approx(closing**2 / (2 * (distance + 0.01)))


def test_no_more_is_required_than_tyres_give_and_nothing_of_what_drives_away():
    assert EmergencyBraking().decide(ego(), objects([LENGTHS + 0.1, 0, 0, 0])).quantity == LARGEST
    decision = EmergencyBraking().decide(ego(), objects([30.0, 0, 25.0, 0]))
    assert decision.object == -1
    assert not decision.active


def test_the_lead_is_the_nearest_in_the_path_and_its_headway_the_time_to_its_rear():
    cars = [60.0, 0, 20, 0], [25.0, 0.5, 20, 0], [10.0, 3.5, 20, 0], [-10.0, 0, 20, 0]
    decision = FollowingDistance().decide(ego(), objects(*cars))
    assert decision.object == 1
    assert decision.quantity == pytest.approx((25.0 - LENGTHS) / 20.0)
    assert not decision.active
    assert active(FollowingDistance(headway_s=(25.0 - LENGTHS) / 20.0 + 0.01), *cars)


def test_a_lead_is_no_farther_than_the_range():
    function = FollowingDistance(range_m=100.0)
    assert function.decide(ego(), objects([LENGTHS + 99.9, 0, 20, 0])).object == 0
    assert function.decide(ego(), objects([LENGTHS + 100.1, 0, 20, 0])).object == -1
    assert function.decide(ego(40.0), objects([LENGTHS + 100.1, 0, 20, 0])).object == -1
    assert FollowingDistance().decide(ego(), objects([400.0, 0, 20, 0])).object == -1


def test_the_lead_in_a_curve_is_on_the_arc_not_straight_ahead():
    radius, angle = 100.0, 0.4
    ahead = [radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0, 0.0]
    straight_on = [40.0, 0.0, 0.0, 0.0]
    decision = FollowingDistance().decide(ego(20.0, yaw_rate=20.0 / radius), objects(straight_on, ahead))
    assert decision.object == 1
    assert decision.quantity == pytest.approx((radius * angle - LENGTHS) / 20.0)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_lane_change_is_critical_below_the_distance_of_the_regulation(side: str):
    function, faster = LaneChange(side=side), 28.0
    closing = faster - 20.0
    distance = 20.0 * 1.0 + closing * 0.4 + closing**2 / (2 * 3.0)
    across = 3.5 if side == "left" else -3.5
    assert active(function, [-LENGTHS - distance + 0.01, across, faster, 0.0])
    assert not active(function, [-LENGTHS - distance - 0.01, across, faster, 0.0])
    assert not active(function, [-LENGTHS - distance + 0.01, -across, faster, 0.0])
    decision = function.decide(ego(), objects([-LENGTHS - distance, across, faster, 0.0]))
    assert decision.quantity == pytest.approx(3.0)


def test_a_car_beside_is_in_the_way_and_one_that_is_past_is_not():
    assert active(LaneChange(), [0.0, 3.5, 20.0, 0.0])
    assert active(LaneChange(), [LENGTHS - 0.1, 3.5, 20.0, 0.0])
    assert not active(LaneChange(), [LENGTHS + 0.1, 3.5, 20.0, 0.0])
    for speed in (10.0, 20.0, 30.0):
        assert active(LaneChange(), [0.1 - LENGTHS, 3.5, speed, 0.0])
        assert np.isnan(LaneChange().decide(ego(), objects([0.0, 3.5, speed, 0.0])).quantity)


def test_only_a_car_behind_that_approaches_would_have_to_brake():
    near = [-LENGTHS - 19.0, 3.5]
    assert active(LaneChange(), [*near, 20.1, 0.0])
    assert not active(LaneChange(), [*near, 19.9, 0.0])
    assert not active(LaneChange(), [*near, 10.0, 0.0])
    # With a covariance the border is where it does not approach too.
    covariance = np.diag([0.01, 0.01, 1.0, 0.01])
    decide = LaneChange().decide
    assert decide(ego(), objects([*near, 20.1, 0.0], covariance=covariance)).active
    assert not decide(ego(), objects([*near, 19.9, 0.0], covariance=covariance)).active


def test_a_cut_in_is_expected_the_horizon_before_it_is_in_the_path():
    function = CutIn(headway_s=1.0, ttc_s=0.0)
    for sign in (1.0, -1.0):
        assert active(function, [15.0, sign * (WIDTHS + 0.99), 20.0, -sign])
        assert not active(function, [15.0, sign * (WIDTHS + 1.01), 20.0, -sign])
        assert not active(function, [15.0, sign * (WIDTHS + 0.5), 20.0, sign])
        assert function.decide(ego(), objects([15.0, sign * (WIDTHS + 0.5), 20.0, -sign])).quantity == pytest.approx(
            0.5
        )
    assert not active(function, [15.0, 0.0, 20.0, 0.0])
    assert active(function, [LENGTHS + 19.9, WIDTHS + 0.5, 20.0, -1.0])
    assert not active(function, [LENGTHS + 20.1, WIDTHS + 0.5, 20.0, -1.0])
    assert active(CutIn(headway_s=1.0, ttc_s=3.0), [LENGTHS + 29.9, WIDTHS + 0.5, 10.0, -1.0])
    assert not active(CutIn(headway_s=1.0, ttc_s=3.0), [LENGTHS + 30.1, WIDTHS + 0.5, 10.0, -1.0])


#: A state near the border of each; what is left of the first order in the margins that are not linear.
NEAR_BORDER = [
    (ForwardCollisionWarning(), [50.0, 1.2, 1.0, 0.0], 0.005),
    (FollowingDistance(), [20.0, 1.5, 15.0, 0.0], 0.005),
    (CutIn(), [25.0, 2.8, 18.0, -1.0], 0.005),
    (EmergencyBraking(), [30.0, 0.5, 2.0, 0.0], 0.01),
    (LaneChange(), [-40.0, 3.0, 28.0, 0.0], 0.01),
    (LaneChange(), [-15.0, 3.5, 20.1, 0.0], 0.01),
    (LaneChange(), [-5.0, 3.5, 15.0, 0.0], 0.01),
]


@pytest.mark.parametrize(("function", "state", "tolerance"), NEAR_BORDER, ids=lambda item: type(item).__name__)
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_probability_is_the_share_of_a_sample(function: Function, state: list[float], tolerance: float, yaw: float):
    """``probability`` is found by halving: it is where the decision changes."""
    turn = np.kron(np.eye(2), [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    covariance = turn @ np.diag([1.0, 0.09, 0.25, 0.04]) @ turn.T
    drawn = np.random.default_rng(8).multivariate_normal(turn @ state, covariance, size=200_000).T
    share = function.decide(ego(yaw=yaw), objects(drawn)).active.mean()
    estimate = objects(turn @ state, covariance=covariance)
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = (low + high) / 2
        above = function.model_copy(update={"probability": middle}).decide(ego(yaw=yaw), estimate).active
        low, high = (middle, high) if above else (low, middle)
    assert 0.05 < share < 0.95
    assert middle == pytest.approx(share, abs=tolerance)


@pytest.mark.parametrize("name", FUNCTIONS.names())
def test_every_instant_and_run_is_decided_by_itself_and_no_object_is_no_decision(name: str):
    function, random = FUNCTIONS[name](), np.random.default_rng(2)
    states = [random.normal([10.0 * k, 1.0, 18.0, 0.0], [5.0, 2.0, 5.0, 1.0], size=(6, 3, 4)).T for k in range(4)]
    spread = np.diag([1.0, 0.3, 0.5, 0.2])
    whole = function.decide(ego(), objects(*states, covariance=spread))
    for place in np.ndindex(3, 6):
        single = function.decide(ego(), objects(*(state[:, *place] for state in states), covariance=spread))
        assert single.active == whole.active[place]
        assert single.object == whole.object[place]
        np.testing.assert_allclose(single.quantity, whole.quantity[place])
    gone = objects(*states, covariance=spread)
    gone = gone._replace(there=np.zeros_like(gone.there))
    decision = function.decide(ego(), gone)
    assert not decision.active.any()
    assert (decision.object == -1).all()
    assert np.isnan(decision.quantity).all()
