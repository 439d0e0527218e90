"""Scores by manoeuvre and range band, and the classes behind them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.metrics.test_metrics_scorer import estimate, target
from tests.support.scenes import truth

from trackbench.metrics import Scorer
from trackbench.metrics.breakdown import band_name, breakdown
from trackbench.metrics.conditions import AGES, JUMPS, MANOEUVRES, SHAPE, condition_classes
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import independent_scores
from trackbench.metrics.intervals import ratio, root
from trackbench.models.sensors import Lidar
from trackbench.sensing.scans import ideal_sensors

LIDAR = Lidar(rate_hz=10, position_sigma_m=0.1)


def standing(distance, steps=1, **more):
    """One object at rest, so far along x, for some steps of 0.1 s."""
    x = np.broadcast_to(np.asarray(distance, dtype=float), (steps,))[:, None, None]
    return truth(np.arange(steps) * 0.1, x, 0 * x, 0 * x, 0 * x, **more)


def classes(of, config=LIDAR, runs=range(1)):
    sensors = ideal_sensors(of, {"lidar": config})
    found = condition_classes(of, np.arange(len(of.time)), sensors, runs)
    return [named(code) for code in found[:, 0, 0]]


def named(code):
    """The manoeuvre, the range band and the age of a class."""
    manoeuvre, band, age, _ = np.unravel_index(code, SHAPE)
    return MANOEUVRES[manoeuvre], band_name(band), AGES[age]


def code_of(manoeuvre="straight", band=0, age="later", jump="elsewhere"):
    return int(np.ravel_multi_index((MANOEUVRES.index(manoeuvre), band, AGES.index(age), JUMPS.index(jump)), SHAPE))


@pytest.mark.parametrize(
    ("acceleration", "turn_degps", "expected"),
    [
        (0.9, 2.9, "straight"),
        (1.1, 0, "accelerating"),
        (-0.9, -2.9, "straight"),
        (-1.1, 0, "braking"),
        (0, 3.1, "turning"),
        (0, -3.1, "turning"),
        (-5, 30, "turning"),
    ],
)
def test_manoeuvres(acceleration, turn_degps, expected):
    of = standing(10, acceleration=acceleration, yaw_rate=np.deg2rad(turn_degps))
    assert classes(of) == [(expected, "0 to 20 m", "first second")]


def test_a_manoeuvre_is_more_than_one_noisy_step():
    """Means over half a second: at 10 Hz those of five steps."""
    once, lasting = np.zeros((20, 1, 1)), np.zeros((20, 1, 1))
    once[10], lasting[8:12] = 4.0, 4.0
    assert {name for name, *_ in classes(standing(10, steps=20, acceleration=once))} == {"straight"}
    found = [name for name, *_ in classes(standing(10, steps=20, acceleration=lasting))]
    assert found == ["straight"] * 7 + ["accelerating"] * 6 + ["straight"] * 7
    # To one side and back again; at the ends there are fewer steps.
    to_and_fro = np.deg2rad(10) * np.where(np.arange(20) % 2, 1.0, -1.0)[:, None, None]
    assert {name for name, *_ in classes(standing(10, steps=20, yaw_rate=to_and_fro))[2:-2]} == {"straight"}


def test_what_an_object_did_before_it_came_means_nothing():
    alive = np.arange(20)[:, None] >= 10
    speeding_up = np.where(np.arange(20) < 10, 100.0, 0.0)[:, None, None]
    of = standing(10, steps=20, acceleration=speeding_up, alive=alive)
    assert {name for name, *_ in classes(of)[10:]} == {"straight"}


def test_the_first_second_begins_when_a_sensor_can_see_the_object():
    config = LIDAR.model_copy(update={"max_range_m": 30.0})
    of = standing([40, 40, *[10] * 20], steps=22)
    ages = [age for *_, age in classes(of, config)]
    assert ages == ["first second"] * 12 + ["later"] * 10


def test_range_bands_cover_every_distance():
    names = [classes(standing(distance))[0][1] for distance in (0, 20, 19.9, 75, 150, 300, 999, 5000)]
    assert names == [
        "0 to 20 m",
        "20 to 50 m",
        "0 to 20 m",
        "50 to 100 m",
        "100 to 200 m",
        "200 to 500 m",
        "500 to 1000 m",
        "above 1000 m",
    ]


def test_a_gap_begins_after_three_periods_without_a_view_and_ends_with_the_next():
    config = LIDAR.model_copy(update={"max_range_m": 30.0})
    # Out of range from the third instant to the ninth.
    of = standing([10, 10, *[40] * 7, 10], steps=10)
    found = [name for name, *_ in classes(of, config)]
    assert found == ["straight"] * 5 + ["sensor gap"] * 4 + ["straight"]


def test_chance_misses_make_no_gap():
    config = LIDAR.model_copy(update={"detection_probability": 0.01})
    assert {name for name, *_ in classes(standing(10, steps=20), config)} == {"straight"}


def test_each_run_has_its_own_classes_where_its_motion_is_its_own():
    of = standing(10, steps=2)
    own = truth(of.time, np.array([[[10.0, 30, 60]]] * 2), *[np.zeros((2, 1, 3))] * 3, yaw_rate=np.array([0, 1, 0]))
    found = condition_classes(own, np.arange(2), ideal_sensors(own, {"lidar": LIDAR}), range(1, 3))
    assert found.shape == (2, 1, 2)
    assert [named(code)[:2] for code in found[0, 0]] == [("turning", "20 to 50 m"), ("straight", "50 to 100 m")]


def test_a_class_says_whether_the_velocity_jumped_shortly_before():
    steps = np.arange(30)
    vx = np.where(steps < 10, 10.0, 15.0)[:, None, None]
    of = truth(steps * 0.1, np.cumsum(vx, axis=0) * 0.1, 0 * vx, vx, 0 * vx)
    found = condition_classes(of, steps, ideal_sensors(of, {"lidar": LIDAR}), range(1))
    assert [JUMPS[jump] for jump in np.unravel_index(found[:, 0, 0], SHAPE)[3]] == (
        ["elsewhere"] * 10 + ["after a velocity jump"] * 11 + ["elsewhere"] * 9
    )


def scored(errors, codes, runs, covariance=None):
    """By condition, estimates with errors ``(instants, 4, batch)`` of an object that stays at the origin."""
    of = target(np.zeros((4, len(errors), 1)), runs)
    made = Scorer(of, np.asarray(codes, dtype=np.int16), {})
    for error in errors:
        made.estimate(estimate(error, covariance))
    return independent_scores(made.close()[ESTIMATES.name], np.zeros(runs, dtype=int))


@pytest.mark.parametrize("own", [False, True], ids=["the same in every run", "its own in each run"])
def test_errors_of_each_class_by_hand(own):
    random = np.random.default_rng(0)
    errors = random.normal(size=(6, 4, 5))
    straight, turning, far = code_of(), code_of("turning", jump=JUMPS[1]), code_of("straight", 2, "first second")
    shared = np.array([straight, straight, turning, turning, code_of("turning", 2, "first second"), far])
    codes = shared[:, None, None] if not own else random.permuted(np.repeat(shared[:, None, None], 5, 2), axis=0)
    found = breakdown(scored(errors, codes, 5))
    manoeuvre, band, age, jump = np.unravel_index(np.broadcast_to(codes[:, 0], (6, 5)), SHAPE)
    position, velocity = (errors[:, :2] ** 2).sum(axis=1), (errors[:, 2:] ** 2).sum(axis=1)
    for group, chosen in (
        (found[""], band >= 0),
        (found["manoeuvre: turning"], manoeuvre == MANOEUVRES.index("turning")),
        (found["manoeuvre: straight"], manoeuvre == MANOEUVRES.index("straight")),
        (found["range: 50 to 100 m"], band == 2),
        (found["age: first second"], age == 0),
        (found["jump: after a velocity jump"], jump == 1),
    ):
        assert group.count == chosen.sum()
        assert group.metrics["position_rmse"].value == pytest.approx(np.sqrt(position[chosen].mean()))
        assert group.metrics["velocity_rmse"].value == pytest.approx(np.sqrt(velocity[chosen].mean()))
        # With unit covariances the NEES is the sum of squares.
        assert group.metrics["nees"].mean == pytest.approx((position + velocity)[chosen].mean())
        assert group.metrics["nees_position"].mean == pytest.approx(position[chosen].mean())
        assert group.metrics["nees_velocity"].mean == pytest.approx(velocity[chosen].mean())
        count, total = chosen.sum(axis=0).astype(float), np.where(chosen, position, 0).sum(axis=0)
        if (count > 0).all():
            assert group.metrics["position_rmse"].ci95 == pytest.approx(root(ratio(total, count)).ci95)
    assert "manoeuvre: braking" not in found


def test_velocities_that_are_correlated_to_the_last_bit_break_nothing():
    tight = np.eye(4)
    tight[2:, 2:] = [[1, 1 - 1e-15], [1 - 1e-15, 1]]
    found = breakdown(scored(np.zeros((1, 4, 2)), np.zeros((1, 1, 1)), 2, np.repeat(tight[..., None], 2, 2)))
    assert found[""].metrics["nees_velocity"].mean == 0
