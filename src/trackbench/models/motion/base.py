"""What a motion model is."""

from __future__ import annotations

from collections.abc import Hashable
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from trackbench import linalg
from trackbench.types import Array, Gaussian


class Kinematics(NamedTuple):
    """The motion of a rigid body in the fixed frame, each ``(...)``: the way into the state of any model."""

    px: Array
    py: Array
    speed: Array
    course: Array
    acceleration: Array
    yaw_rate: Array


#: Standard deviation of an angle of which nothing is known (uniform over the circle), rad.
UNKNOWN_ANGLE = np.pi / np.sqrt(3.0)


class InitialSigmas(NamedTuple):
    """Standard deviations for the components of a state that position and velocity do not determine."""

    acceleration: float
    """m/s^2"""
    yaw_rate: float
    """rad/s"""
    yaw: float = UNKNOWN_ANGLE
    """rad; the most that is said of a course that the velocity leaves open."""


class MotionModel(Hashable, Protocol):
    """How a state moves, with piecewise constant white noise on its highest derivatives.

    Shapes: a state is ``(n, ...)``; ``dt`` is in seconds and may be zero.
    """

    components: ClassVar[tuple[str, ...]]
    """Names of the state's components."""
    angular: ClassVar[tuple[int, ...]]
    """Which components are angles."""
    linear: ClassVar[bool]
    """Whether the transition, its noise gain and the way to Cartesian are linear."""

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        """``(q,)`` standard deviation of each driving noise."""
        ...

    def transition(self, x: Array, dt: float) -> Array:
        """``(n, ...)`` the state after ``dt``, without noise."""
        ...

    def jacobian(self, x: Array, dt: float) -> Array:
        """``(n, n, ...)`` derivative of the transition."""
        ...

    def noise_gain(self, x: Array, dt: float) -> Array:
        """``(n, q, ...)`` effect of each driving noise on the state, where the noise is constant over ``dt``."""
        ...

    def to_cartesian(self, x: Array) -> Array:
        """``(4, ...)`` px, py, vx, vy."""
        ...

    def cartesian_jacobian(self, x: Array) -> Array:
        """``(4, n, ...)`` derivative of ``to_cartesian``."""
        ...

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        """The distribution of px, py, vx, vy under a belief of the state."""
        ...

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        """The state whose position and velocity have the given distribution."""
        ...

    def from_kinematics(self, motion: Kinematics) -> Array:
        """``(n, ...)`` the state of a body in the given motion."""
        ...


def process_noise(model: MotionModel, x: Array, dt: float) -> Array:
    """``(n, n, ...)`` covariance of the process noise over ``dt``: ``G diag(sigma^2) G^T``."""
    gain = model.noise_gain(x, dt)
    scaled = gain * linalg.expand(np.asarray(model.noise_sigma), gain[0])
    return linalg.matmul_transposed(scaled, scaled)
