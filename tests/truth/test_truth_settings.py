"""The environment's own configuration, checked key by key."""

from typing import Any

import pytest

from trackbench.base.errors import InputError
from trackbench.truth.environment import complete

DEFAULTS: dict[str, Any] = {
    "lanes_count": 4,
    "vehicles_density": 1,
    "duration": 40,
    "offroad_terminal": False,
    "initial_lane_id": None,
    "destination": "o1",
    "policy_frequency": 1,
    "reward_speed_range": [20, 30],
    "action": {"type": "Meta", "lateral": True, "target_speeds": [0, 5, 10]},
}
VARIANTS = {"action": {"Meta": {"lateral", "longitudinal", "target_speeds"}, "Both": {"clip", "action_config"}}}


def test_partial_action_keeps_the_defaults_of_its_type() -> None:
    assert complete({"action": {"lateral": False}}, DEFAULTS, VARIANTS) == {
        "action": {"type": "Meta", "lateral": False, "target_speeds": [0, 5, 10]}
    }


def test_action_of_another_type_takes_nothing_over() -> None:
    given = {"action": {"type": "Both", "clip": True}}
    assert complete(given, DEFAULTS, VARIANTS) == given


@pytest.mark.parametrize(
    "given",
    [
        {"vehicles_density": 1.5, "duration": 12.5},
        {"initial_lane_id": 2},
        {"destination": None},
        {"action": {"target_speeds": [1, 2, 3, 4]}},
        {"lanes_count": 0},
    ],
)
def test_valid_values_pass(given: dict[str, Any]) -> None:
    assert set(complete(given, DEFAULTS, VARIANTS)) == set(given)


@pytest.mark.parametrize(
    ("given", "key", "message"),
    [
        ({"lane_count": 3}, "lane_count", "unknown key; did you mean 'lanes_count'"),
        ({"lanes_count": "3"}, "lanes_count", "must be a number, not '3'"),
        ({"lanes_count": 3.5}, "lanes_count", "whole number from 0 to 1000"),
        ({"lanes_count": True}, "lanes_count", "must be a number, not True"),
        ({"policy_frequency": 0}, "policy_frequency", "whole number from 1 to 1000"),
        ({"vehicles_density": float("nan")}, "vehicles_density", "must be finite"),
        ({"offroad_terminal": 1}, "offroad_terminal", "must be true or false"),
        ({"duration": None}, "duration", "must be a number"),
        ({"reward_speed_range": [20]}, "reward_speed_range", "must have 2 numbers"),
        ({"reward_speed_range": [20, "a"]}, "reward_speed_range", "list of numbers"),
        ({"action": "Meta"}, "action", "must be a mapping"),
        ({"action": {"type": "Mta"}}, "action.type", "did you mean 'Meta'"),
        ({"action": {"latral": True}}, "action.latral", "did you mean 'lateral'"),
        ({"action": {"lateral": 1}}, "action.lateral", "must be true or false"),
        (
            {"action": {"type": "Both", "action_config": {"type": "Meta", "latral": 1}}},
            "action.action_config.latral",
            "did you mean 'lateral'",
        ),
    ],
)
def test_mistakes_are_named_with_their_key(given: dict[str, Any], key: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        complete(given, DEFAULTS, VARIANTS)
    assert caught.value.key == f"truth.config.{key}"
