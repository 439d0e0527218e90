"""Points of the map: values, shares, distances, changes, and where the map is refined."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.subjects.envelope.conftest import small

from trackbench.subjects.envelope.axes import MapAxis, axes_of, halfway_point, overrides, point_distance, start_points
from trackbench.subjects.envelope.config import Axis, EnvelopeConfig
from trackbench.subjects.envelope.mapping import refine
from trackbench.subjects.envelope.task import base_point


def axis(**config: Any) -> MapAxis:
    return MapAxis("x", Axis.model_validate(config))


LINEAR = axis(key="sensors.lidar.position_sigma_m", **{"from": 0.0, "to": 2.0}, levels=3)
LOG = axis(key="sensors.lidar.position_sigma_m", **{"from": 0.01, "to": 1.0}, levels=3, scale="log")
RATES = axis(key="sensors.lidar.rate_hz", values=[20, 5, 10])
WORLDS = axis(key="world", choices=["ideal", "human"])
SUITES = axis(choices={"radar": {"a": 1}, "both": {"a": 2, "b": 3}})


def test_values_and_shares() -> None:
    assert LINEAR.values == (0.0, 1.0, 2.0)
    assert LOG.values == (0.01, 0.1, 1.0)
    assert RATES.values == (5, 10, 20)
    assert SUITES.values == ("radar", "both")
    for each in (LINEAR, LOG, RATES, WORLDS, SUITES):
        assert [each.share(value) for value in (each.values[0], each.values[-1])] == [0.0, 1.0]
    assert LOG.share(0.1) == pytest.approx(0.5)
    assert LINEAR.unit == "m"


def test_linked_keys_follow_the_value() -> None:
    linked = axis(
        keys={"truth.observer.start.speed_mps": {}, "truth.objects.lead.start.x": {"factor": 4, "offset": 5}},
        **{"from": 10, "to": 20},
    )

    assert overrides([linked], (12.5,)) == ["truth.observer.start.speed_mps=12.5", "truth.objects.lead.start.x=55"]
    assert overrides([SUITES, RATES], ("both", 10.0)) == ["a=2", "b=3", "sensors.lidar.rate_hz=10"]


def test_distance_is_in_shares_of_the_range() -> None:
    axes = [LINEAR, LOG, WORLDS]

    assert point_distance(axes, (0.0, 0.01, "ideal"), (1.0, 0.1, "ideal")) == pytest.approx(0.5**0.5)
    assert point_distance(axes, (0.0, 0.01, "ideal"), (0.0, 0.01, "human")) == 1.0


@given(st.floats(0, 1), st.floats(0, 1))
def test_between_is_half_way(a: float, b: float) -> None:
    x, y = LOG.at(a), LOG.at(b)

    point = halfway_point([LOG], (x,), (y,), 1 / 8)

    if abs(LOG.share(x) - LOG.share(y)) <= 1 / 8:
        assert point is None
    else:
        assert point is not None
        assert LOG.share(point[0]) == pytest.approx((LOG.share(x) + LOG.share(y)) / 2, abs=1e-4)


def test_the_map_is_refined_at_the_border_alone() -> None:
    config = EnvelopeConfig.model_validate(
        {
            "axes": {
                "x": {"key": "a.b", "from": 0, "to": 1, "levels": 5},
                "y": {"key": "a.c", "from": 0, "to": 1, "levels": 5},
            }
        }
    )
    axes = [MapAxis(name, item) for name, item in config.axes.items()]
    states = {
        point: {"kf": "fails" if float(point[0]) > 0.6 else "holds"} for point in start_points(axes, config, [0.5, 0.5])
    }

    points = refine(axes, states, 100, 1 / 32)

    assert {point[0] for point in points} == {0.625}
    assert len(points) == 5
    assert len(refine(axes, states, 2, 1 / 32)) == 2
    assert refine(axes, states, 100, 0.25) == []


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
    loaded = small(axes={"a": axis})
    (value,) = base_point(loaded, axes_of(loaded.config.envelope))
    assert value == own
