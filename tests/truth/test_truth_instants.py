"""The velocity at an instant, of bodies that a simulator moves by steps of constant velocity."""

import numpy as np
import pytest

from trackbench.base.types import Array, Observer, Truth
from trackbench.truth.audit import by_euler
from trackbench.truth.environment import rates_at_instants

DT, STEPS, SPEED, RADIUS = 0.05, 200, 15.0, 20.0
TIME = DT * np.arange(STEPS)


def stepped(course: Array, speed: Array) -> Truth:
    """A body that moves with the given course and speed during each step, and carries the observer too."""
    velocity = speed * np.exp(1j * course)
    position = np.concatenate([[0.0], np.cumsum(velocity[:-1]) * DT])

    def rate(values: Array) -> Array:
        return np.append(np.diff(values), values[-1] - values[-2]) / DT

    column = (slice(None), None, None)
    carrier = Observer(position.real, position.imag, course, velocity.real, velocity.imag, rate(course))
    return Truth(
        time=TIME,
        ids=("car",),
        px=position.real[column],
        py=position.imag[column],
        heading=course[column],
        course=course[column],
        speed=speed[column],
        acceleration=rate(speed)[column],
        yaw_rate=rate(course)[column],
        alive=np.ones((STEPS, 1), dtype=bool),
        length=np.array([5.0]),
        width=np.array([2.0]),
        observer=carrier,
    )


def test_on_a_circle_the_velocity_is_tangential_at_each_instant() -> None:
    truth = stepped(SPEED / RADIUS * TIME, np.full(STEPS, SPEED))
    found = rates_at_instants(truth, by_euler(truth))
    # The positions lie on a circle; its tangent there is the mean of the chords before and after.
    half = 0.5 * SPEED / RADIUS * DT
    np.testing.assert_allclose(found.course[1:, 0, 0], np.angle(np.exp(1j * (SPEED / RADIUS * TIME[1:] - half))))
    np.testing.assert_allclose(found.speed[1:, 0, 0], SPEED * np.cos(half))
    np.testing.assert_allclose(found.yaw_rate, SPEED / RADIUS)
    before = np.hypot(truth.vx - found.vx, truth.vy - found.vy)[1:]
    assert before.max() == pytest.approx(SPEED**2 / RADIUS * DT / 2, rel=1e-3)
    np.testing.assert_allclose(found.observer.vx, found.vx[:, 0, 0])


def test_an_acceleration_is_that_between_the_steps_before_and_after() -> None:
    speed = 10.0 + np.where(TIME < 5.0, 0.0, 2.0 * (TIME - 5.0))
    truth = stepped(np.zeros(STEPS), speed)
    found = rates_at_instants(truth, by_euler(truth))
    np.testing.assert_allclose(found.speed[1:, 0, 0], 0.5 * (speed[1:] + speed[:-1]))
    np.testing.assert_allclose(found.acceleration[1:, 0, 0], np.diff(speed) / DT)
    assert found.acceleration[100, 0, 0] == pytest.approx(0.0, abs=1e-9)
    assert found.acceleration[101, 0, 0] == pytest.approx(2.0)


def test_a_body_at_rest_keeps_its_course_and_others_keep_all() -> None:
    speed = np.where(TIME < 2.0, 5.0, 0.0)
    truth = stepped(np.full(STEPS, 0.7), speed)
    found = rates_at_instants(truth, by_euler(truth))
    np.testing.assert_allclose(found.course, 0.7)
    same = rates_at_instants(truth, np.array([False]))
    for name in ("speed", "course", "acceleration", "yaw_rate"):
        np.testing.assert_array_equal(getattr(same, name), getattr(truth, name))


def test_an_object_has_no_step_before_the_one_in_which_it_appears() -> None:
    truth = stepped(np.zeros(STEPS), 10.0 + TIME)
    truth.alive[:50] = False
    found = rates_at_instants(truth, np.array([True]))
    assert found.speed[50, 0, 0] == truth.speed[50, 0, 0]
    assert found.speed[51, 0, 0] == pytest.approx(truth.speed[51, 0, 0] - 0.5 * DT)
