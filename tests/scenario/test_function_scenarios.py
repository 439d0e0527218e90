"""The protocols that ship under functions/ have the figures that they name, by closed forms."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from trackbench.base.types import Array, Truth
from trackbench.metrics.ego import Ego
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.shipped import shipped
from trackbench.scenario.truth import truth_of, truths_of
from trackbench.subjects.functions.protocol import Objects

KMPH, MPH, G = 1 / 3.6, 0.44704, 9.80665
#: Values are written with four decimals.
WRITTEN = 2e-4
#: Time to collision at the start of the protocols without braking, s, and half of the lengths of both cars, m.
START_S, TOUCH = 5.0, 4.75


class Pair(NamedTuple):
    """The ego and the one object of a scenario at each step, in the frame in which the ego starts along x."""

    time: Array
    gap: Array
    """From bumper to bumper, m."""
    across: Array
    """Of the object's centre, m to the left."""
    ego: Array
    """Speed along x, m/s, as ``other``."""
    other: Array

    @property
    def closing(self) -> Array:
        return self.ego - self.other

    @property
    def ttc(self) -> Array:
        """At constant speed, s."""
        return self.gap / self.closing


@cache
def scenario_and_truth(name: str) -> tuple[Scenario, Truth]:
    loaded = load_scenario(f"functions/{name}")
    return loaded, truth_of(loaded).truth


def pair(name: str, *settings: str) -> Pair:
    truth = truth_of(load_scenario(f"functions/{name}", settings)).truth if settings else scenario_and_truth(name)[1]
    ego = truth.observer
    touch = (ego.length + truth.length[0]) / 2
    assert (touch, ego.width, truth.width[0]) == (TOUCH, 2.0, 1.8)
    px, py, vx = (field[:, 0, 0] for field in (truth.px, truth.py, truth.vx))
    return Pair(truth.time, px - ego.px - touch, py - ego.py, ego.vx, vx)


def at(of: Pair, time: float, values: Array) -> float:
    """A value between the steps."""
    return float(np.interp(time, of.time, values))


@pytest.mark.parametrize(
    ("name", "ego", "other"),
    [
        ("euro_ncap_stationary", 50 * KMPH, 0.0),
        ("euro_ncap_moving", 50 * KMPH, 20 * KMPH),
        ("nhtsa_stopped", 45 * MPH, 0.0),
        ("nhtsa_slower", 45 * MPH, 20 * MPH),
    ],
)
def test_an_approach_at_constant_speed(name: str, ego: float, other: float) -> None:
    of = pair(name)
    np.testing.assert_allclose(of.ego, ego, atol=WRITTEN)
    np.testing.assert_allclose(of.other, other, atol=WRITTEN)
    np.testing.assert_allclose(of.ttc, START_S - of.time, atol=WRITTEN)
    assert of.gap[-2] > -10 * WRITTEN > of.gap[-1], "it ends with the step after impact"


@pytest.mark.parametrize(
    ("name", "speed", "gap", "deceleration"),
    [("euro_ncap_braking", 50 * KMPH, 12.0, 6.0), ("nhtsa_braking", 45 * MPH, 30.0, 0.3 * G)],
)
def test_a_lead_that_brakes(name: str, speed: float, gap: float, deceleration: float) -> None:
    of = pair(name)
    braking = np.maximum(of.time - 2, 0)
    np.testing.assert_allclose(of.ego, speed, atol=WRITTEN)
    np.testing.assert_allclose(of.closing, deceleration * braking, atol=WRITTEN)
    np.testing.assert_allclose(of.gap, gap - deceleration / 2 * braking**2, atol=10 * WRITTEN)
    impact = 2 + np.sqrt(2 * gap / deceleration)
    assert of.time[-1] - 0.05 <= impact + 1e-9 < of.time[-1]


def keyed(values: dict[str, float]) -> list[str]:
    return [f"truth.{key}={value!r}" for key, value in values.items()]


@pytest.mark.parametrize(
    ("name", "speed", "x"),
    [
        *(("euro_ncap_stationary", v * KMPH, 4.75 + 5 * v * KMPH) for v in (10, 80)),
        *(("euro_ncap_moving", v * KMPH, 5 * v * KMPH - 23.028) for v in (30, 80)),
    ],
)
def test_keys_that_go_with_the_speed(name: str, speed: float, x: float) -> None:
    """As the comments of the files have it."""
    of = pair(name, *keyed({"observer.start.speed_mps": speed, "objects.lead.start.x": x}))
    np.testing.assert_allclose(of.ttc, START_S - of.time, atol=10 * WRITTEN)


@pytest.mark.parametrize("gap", [12.0, 40.0])
@pytest.mark.parametrize("deceleration", [2.0, 6.0])
def test_each_braking_of_euro_ncap(gap: float, deceleration: float) -> None:
    speed = 50 * KMPH
    lead = {"objects.lead.start.x": 4.75 + gap, "objects.lead.pieces.1.acceleration_mps2": -deceleration}
    of = pair("euro_ncap_braking", *keyed(lead | {"duration_s": 9}))
    stop = speed / deceleration
    closed = deceleration / 2 * stop**2
    wait = np.sqrt(2 * gap / deceleration) if gap < closed else stop + (gap - closed) / speed
    impact = float(of.time[np.argmax(of.gap <= 0)])
    assert impact - 0.05 - 1e-3 <= 2 + wait <= impact + 1e-3
    np.testing.assert_array_equal(of.other[of.time > 2 + stop], 0)


@pytest.mark.parametrize("ttc", [0.5, 1.0, 1.5])
def test_cut_in(ttc: float) -> None:
    """Where the side of the car is 0.3 m over the marking, between lanes of 3.5 m."""
    of = pair("cut_in", *keyed({"objects.cutting.start.x": 22.6582 + 5.663 * ttc}))
    np.testing.assert_allclose([of.ego[0], of.other[0]], [80 * KMPH, 60 * KMPH], atol=WRITTEN)
    intrusion = float(np.interp(-(3.5 / 2 - 0.3 + 1.8 / 2), -of.across, of.time))
    assert intrusion == pytest.approx(3.2156, abs=2e-3)
    assert at(of, intrusion, of.ttc) == pytest.approx(ttc, abs=3e-3)
    closing = at(of, intrusion, of.closing)
    assert [closing / 12 + 0.35, closing / 12 + 0.25] == pytest.approx([0.822, 0.722], abs=1e-3)
    assert of.across[0] == 3.5
    assert abs(of.across[-1]) < 0.5


def test_the_car_beside_the_curve_is_never_in_the_path() -> None:
    _, truth = scenario_and_truth("curve_standing_car")
    ego = truth.observer
    np.testing.assert_allclose(np.hypot(ego.vx, ego.vy), 50 * KMPH, atol=WRITTEN)
    np.testing.assert_allclose(np.hypot(ego.px, ego.py - 100), 100, atol=1e-3)
    np.testing.assert_allclose(np.hypot(truth.px, truth.py - 100), 103.5, atol=1e-3)
    assert (truth.speed == 0).all()
    # Along the curve it is 76.4 m away, of which the ego drives all but a few centimetres.
    angle = np.arctan2(truth.px[0, 0, 0], 100 - truth.py[0, 0, 0])
    assert 100 * angle == pytest.approx(76.4, abs=1e-3)
    assert truth.heading[0, 0, 0] == pytest.approx(angle, abs=1e-5)
    assert 100 * angle - 50 * KMPH * truth.time[-1] == pytest.approx(0, abs=0.02)
    # Straight ahead at the start, where the line along x crosses its circle.
    assert np.sqrt(103.5**2 - 100**2) == pytest.approx(26.7, abs=0.1)


def test_the_lead_is_out_of_the_path_before_a_warning_is_due() -> None:
    of = pair("lead_leaves")
    np.testing.assert_allclose([of.ego[0], of.other[0]], [20, 14])
    gone = float(np.interp((2.0 + 1.8) / 2, -of.across, of.time))
    assert gone == pytest.approx(3.305, abs=2e-3)
    assert at(of, gone, of.ttc) == pytest.approx(2.6, abs=3e-3)
    assert of.across[-1] == pytest.approx(-3.5, abs=1e-3)


def onset(name: str, label: str) -> float:
    """The first time at which a function is active on the truth."""
    loaded, truth = scenario_and_truth(name)
    mean = np.stack([field[..., 0].T for field in (truth.px, truth.py, truth.vx, truth.vy)])
    size = (np.broadcast_to(values[:, None], mean.shape[1:]) for values in (truth.length, truth.width))
    objects = Objects(mean, np.zeros((4, *mean.shape)), truth.alive.T, *size)
    active = loaded.config.functions[label].decide(Ego.of(truth.observer, slice(None)), objects).active
    return float(truth.time[np.argmax(active)]) if active.any() else np.inf


def required(closing: float) -> float:
    """Time to collision at which 6 m/s^2 are required: v^2 / (2 d) = 6."""
    return closing / 12


@pytest.mark.parametrize(
    ("name", "label", "expected"),
    [
        ("euro_ncap_stationary", "fcw", START_S - (1.2 + 50 * KMPH / 8)),
        ("euro_ncap_stationary", "aeb", START_S - required(50 * KMPH)),
        ("euro_ncap_moving", "fcw", START_S - (1.2 + 30 * KMPH / 8)),
        ("euro_ncap_moving", "aeb", START_S - required(30 * KMPH)),
        # After s seconds of braking the gap is 12 - 3 s^2, and closes by 6 s.
        ("euro_ncap_braking", "fcw", 2 - 2.4 + np.sqrt(2.4**2 + 4)),
        ("euro_ncap_braking", "aeb", 2 + np.sqrt(2)),
        ("euro_ncap_braking", "lead", 2 + np.sqrt((12 - 0.8 * 50 * KMPH) / 3)),
        ("nhtsa_stopped", "fcw", START_S - 2.1),
        ("nhtsa_slower", "fcw", START_S - 2.0),
        ("nhtsa_braking", "fcw", 2 - 2.4 + np.sqrt(2.4**2 + 2 * 30 / (0.3 * G))),
        # The car is expected to overlap the path of the ego a second later: 3.5 - a s^2 / 2 - a s = 1.9.
        ("cut_in", "cut_in", 2 - 1 + np.sqrt(1 + 2 * 1.6 / 1.558)),
        ("curve_standing_car", "fcw", np.inf),
        ("curve_standing_car", "lead", np.inf),
        ("lead_leaves", "fcw", np.inf),
    ],
)
def test_when_a_function_is_active_on_the_truth(name: str, label: str, expected: float) -> None:
    """At the first step after the time that a closed form gives; thresholds are written with two decimals."""
    result = onset(name, label)
    assert result == expected or -5e-3 < result - expected < 0.05 + 5e-3


@pytest.mark.parametrize("name", [name for name in shipped() if name.startswith("functions/")])
def test_expectations_hold(name: str) -> None:
    loaded = load_scenario(name)
    summary = run_scenario(loaded, truths_of(loaded)).summary
    assert [item.text for item in summary.expectations if not item.passed] == []
    assert summary.passed
