"""Objects along and across the path of the ego."""

from __future__ import annotations

import numpy as np
import pytest
from tests.subjects.functions.scenes import ego

from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import OnPath, on_path
from trackbench.subjects.functions.protocol import Objects

RANDOM = np.random.default_rng(5)


def placed(own: Ego, state: np.ndarray, covariance: np.ndarray | None = None) -> OnPath:
    """Of one object."""
    spread = np.zeros((4, 4)) if covariance is None else covariance
    there, size = np.array([True]), np.array([4.5])
    return on_path(own, Objects(state.reshape(4, 1), spread.reshape(4, 4, 1), there, size, size / 2.5))


def coordinates(own: Ego, state: np.ndarray) -> np.ndarray:
    return np.concatenate(placed(own, state)[:4])


def test_an_object_on_a_circle_is_as_far_away_as_the_arc_is_long():
    own = ego(speed=20.0, yaw_rate=0.2, yaw=0.7, x=3.0, y=-4.0)  # a radius of 100 m, to the left
    angle, offset = 0.9, 1.5
    centre = np.array([3.0, -4.0]) + 100.0 * np.array([-np.sin(0.7), np.cos(0.7)])
    heading = 0.7 + angle
    place = centre + (100.0 - offset) * np.array([np.sin(heading), -np.cos(heading)])
    velocity = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]) @ [8.0, 0.5]
    found = coordinates(own, np.concatenate([place, velocity]))
    np.testing.assert_allclose(found, [100.0 * angle, offset, 8.0, 0.5], atol=1e-9)


def test_a_straight_path_is_a_rotation():
    found = coordinates(ego(yaw=np.pi / 2, x=1.0), np.array([0.0, 30.0, -1.0, 12.0]))
    np.testing.assert_allclose(found, [30.0, 1.0, 12.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("yaw_rate", [0.0, 1e-9, 0.03, -0.3])
def test_the_gradient_is_that_of_finite_differences(yaw_rate: float):
    own, state = ego(yaw_rate=yaw_rate, yaw=0.4), np.array([25.0, 6.0, 11.0, -2.0])
    step = 1e-5
    ends = [[coordinates(own, state + sign * step * unit) for sign in (1, -1)] for unit in np.eye(4)]
    differences = np.array([(above - below) / (2 * step) for above, below in ends]).T
    gradients = [placed(own, state).gradient(unit)[:, 0] for unit in np.eye(4).tolist()]
    np.testing.assert_allclose(gradients, differences, atol=1e-6)


def test_the_variance_of_a_linear_margin_is_that_of_a_sample():
    root = RANDOM.normal(size=(4, 4))
    covariance, own = root @ root.T / 4, ego(yaw=0.4)
    state = np.array([25.0, 6.0, 11.0, -2.0])
    partials = (-1.0, 0.3, -2.4, 0.7)
    variance = placed(own, state, covariance).variance(partials)
    sample = RANDOM.multivariate_normal(state, covariance, size=200_000).T
    there = np.ones(sample.shape[1], dtype=bool)
    objects = Objects(sample, np.zeros((4, 4, len(there))), there, np.array(4.5), np.array(1.8))
    margins = sum(factor * values for factor, values in zip(partials, on_path(own, objects)[:4], strict=True))
    assert margins.var() == pytest.approx(variance.item(), rel=0.02)
