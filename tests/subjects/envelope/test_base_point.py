"""The scenario's own values of the axes."""

from pathlib import Path

import pytest

import trackbench as tb
from trackbench.scenario.load import scenario_of
from trackbench.subjects.envelope.axes import axes_of
from trackbench.subjects.envelope.task import base_point

SCENARIO = {
    "name": "small",
    "truth": {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 10,
        "objects": {"car": {"start": {"x": 20, "y": 5, "speed_mps": 10}}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3}},
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1}},
    "expect": [{"tracker": "kf", "metric": "position_rmse", "below": 0.25}],
}
WAYS = {
    "precise": {"sensors.lidar.position_sigma_m": 0.1},
    "as it is": {"sensors.lidar.position_sigma_m": 0.3, "sensors.lidar.rate_hz": 10},
}


@pytest.mark.parametrize(
    ("axis", "own"),
    [
        ({"key": "sensors.lidar.position_sigma_m", "from": 0.1, "to": 1}, 0.3),
        ({"key": "sensors.lidar.detection_probability", "from": 0.5, "to": 1}, 1.0),
        ({"key": "truth.objects.car.start.speed_mps", "values": [5, 20]}, 10.0),
        ({"key": "trackers.kf.motion", "choices": ["ca", "cv"]}, "cv"),
        ({"choices": WAYS}, "as it is"),
        ({"choices": {"a": {"sensors.lidar.rate_hz": 5}, "b": {"sensors.lidar.rate_hz": 20}}}, None),
        (
            {
                "keys": {"sensors.lidar.position_sigma_m": {"factor": 0.1}, "sensors.lidar.rate_hz": {"offset": 7}},
                "from": 1,
                "to": 4,
            },
            3.0,
        ),
        ({"keys": {"truth.objects.car.start.x": {"factor": 0.3, "offset": 2.3}}, "from": 1, "to": 99}, 59.0),
        ({"keys": {"sensors.lidar.position_sigma_m": {}, "sensors.lidar.rate_hz": {}}, "from": 1, "to": 4}, None),
    ],
)
def test_it_is_what_the_scenario_says_or_its_default(axis, own):
    loaded = tb.load(SCENARIO | {"envelope": {"axes": {"a": axis}}})
    (value,) = base_point(loaded, axes_of(loaded.config.envelope))
    assert value == own


@pytest.mark.parametrize(("stated", "own"), [(None, "human"), ("typical", "typical")])
def test_without_a_world_the_first_of_the_worlds_is_the_base(stated, own):
    text = tb.load("envelope/sensor_quality").text.replace("choices: [ideal, human,", "choices: [human, ideal,")
    loaded = scenario_of(text.replace("world: ideal\n", f"world: {stated}\n" if stated else ""), Path("x.yaml"), [])
    assert base_point(loaded, axes_of(loaded.config.envelope)) == [own, 0.5, 10.0]
