"""Base class of motion models, and the registry of the models that a scenario can name."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.config import Config
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Gaussian, Scan


class Kinematics(NamedTuple):
    """Motion of rigid bodies in the fixed frame, arrays ``(...)``, from which any motion model's state can be built."""

    px: Array
    py: Array
    speed: Array
    course: Array
    acceleration: Array
    yaw_rate: Array


#: Standard deviation of an unknown angle (uniform over the circle), rad.
UNKNOWN_ANGLE = np.pi / np.sqrt(3.0)


class InitialSigmas(NamedTuple):
    """Standard deviations of state components that position and velocity do not determine."""

    acceleration: float
    """Standard deviation of the acceleration, m/s^2."""
    yaw_rate: float
    """Standard deviation of the yaw rate, rad/s."""


#: Components whose initial uncertainty a scenario states, by quantity.
POSITION, VELOCITY, ACCELERATION = ("px", "py"), ("vx", "vy", "v"), ("ax", "ay", "a")
YAW, YAW_RATE = ("yaw",), ("yaw_rate",)


class SensorErrors(NamedTuple):
    """Equations of a measurement whose sensor's errors are part of the state x: ``z = h(x) + E x + w``."""

    gain: Array
    """Matrix ``E``, ``(m, n, ...)``, which adds the errors in the state to the measurement."""
    noise: Array
    """Covariance ``(m, m, ...)`` of the remaining white noise ``w``."""


class MotionModel(Config, ABC):
    """Model of a state's motion, driven by white noise that is constant over each step.

    The fields of a subclass are its options in a scenario, and its methods the equations. Inherited methods suit a
    state that begins with px, py, vx, vy. A state is ``(n, ...)``; ``dt`` is in seconds and may be zero.
    """

    components: ClassVar[tuple[str, ...]]
    """Names of the state's components, such as "px" and "vx"."""
    angular: ClassVar[tuple[int, ...]] = ()
    """Indices of the state's components that are angles."""
    linear: ClassVar[bool] = False
    """Whether the transition, the noise gain and the conversion to px, py, vx, vy are linear in the state."""
    driving_noise: ClassVar[tuple[str, ...]]
    """Name of the option with the standard deviation of the driving noise, for each column of the noise gain."""
    pure: ClassVar[bool] = False
    """Whether the results of all methods depend on their arguments and the options alone, so that the fused engine may
    compile them. A subclass must state this anew."""
    first_sigmas: ClassVar[Mapping[str, float]] = {}
    """Standard deviations at a track's start of the components for which scenarios have no key. Scenarios have keys for
    positions, velocities, accelerations (px, py, vx, vy, v, ax, ay, a), yaw and yaw_rate."""

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        """Standard deviations ``(q,)`` of the driving noises; ``(q, ...)`` if they differ within the batch."""
        return tuple(getattr(self, name) for name in self.driving_noise)

    @property
    def batched(self) -> bool:
        """Whether the standard deviations of the driving noises differ within the batch."""
        return any(np.ndim(sigma) > 0 for sigma in self.noise_sigma)

    @abstractmethod
    def transition(self, x: Array, dt: float) -> Array:
        """Return the state ``(n, ...)`` after ``dt`` seconds, without noise."""

    @abstractmethod
    def jacobian(self, x: Array, dt: float) -> Array:
        """Return the derivative ``(n, n, ...)`` of the transition with respect to the state."""

    @abstractmethod
    def noise_gain(self, x: Array, dt: float) -> Array:
        """Return the effect ``(n, q, ...)`` on the state of each driving noise, which is constant over ``dt``."""

    def to_cartesian(self, x: Array) -> Array:
        """Return px, py, vx, vy ``(4, ...)`` of a state ``(n, ...)``."""
        return x[:4]

    def cartesian_jacobian(self, x: Array) -> Array:
        """Return the derivative ``(4, n, ...)`` of ``to_cartesian`` with respect to the state."""
        return np.eye(4, len(self.components))

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        """Return an approximate mean and covariance of px, py, vx, vy under a belief of the state."""
        return Gaussian(belief.mean[:4], belief.covariance[:4, :4])

    def cartesian_moments(self, belief: Gaussian) -> Gaussian:
        """Return the exact mean and covariance of px, py, vx, vy under a belief of the state."""
        return self.cartesian_belief(belief)

    @property
    def sensors_with_errors(self) -> frozenset[str]:
        """Names of the sensors whose errors are part of the state."""
        return frozenset()

    def sensor_errors(self, scan: Scan) -> SensorErrors | None:
        """Return how errors of the scan's sensor in the state enter its measurement; None if the state has none."""
        return None

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        """Return a belief of the state with the px, py, vx, vy of ``belief``; other components have mean zero."""
        if len(self.components) == 4:
            return belief
        return pad_state(self, belief, sigmas)

    def from_kinematics(self, motion: Kinematics) -> Array:
        """Return the state ``(n, ...)`` of a body with the given motion."""
        c, s = np.cos(motion.course), np.sin(motion.course)
        tangential, normal = motion.acceleration, motion.speed * motion.yaw_rate
        values = {
            "px": motion.px,
            "py": motion.py,
            "vx": motion.speed * c,
            "vy": motion.speed * s,
            "ax": tangential * c - normal * s,
            "ay": tangential * s + normal * c,
            "yaw_rate": motion.yaw_rate,
        }
        return linalg.vector([values.get(name, np.zeros_like(motion.px)) for name in self.components])

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        """Return the motion of a body in the state ``x``; driving noise stands in for rates that the state lacks.

        Args:
            x: state ``(n, ...)``.
            noise: ``(q, ...)`` driving noise at that time.
            resting: ``(...)`` course of a body at rest, whose velocity has no direction.
        """
        px, py, vx, vy = x[:4]
        if "ax" in self.components:
            ax, ay = (x[self.components.index(name)] for name in ("ax", "ay"))
        else:
            ax, ay = noise if len(noise) == 2 else np.zeros_like(x[:2])
        speed = np.hypot(vx, vy)
        moving = speed > 0.0
        course = np.where(moving, np.arctan2(vy, vx), resting)
        c, s = np.cos(course), np.sin(course)
        yaw_rate = np.where(moving, c * ay - s * ax, 0.0) / np.where(moving, speed, 1.0)
        return Kinematics(px, py, speed, course, c * ax + s * ay, yaw_rate)


def pad_state(model: MotionModel, first: Gaussian, sigmas: InitialSigmas) -> Gaussian:
    """Return a belief of a model's state from its first four components; other components have mean zero."""
    size, batch = len(model.components), first.mean.shape[1:]
    mean = np.zeros_like(first.mean, dtype=float, shape=(size, *batch))
    mean[:4] = first.mean
    covariance = np.zeros_like(first.covariance, dtype=float, shape=(size, size, *batch))
    covariance[:4, :4] = first.covariance
    for i, name in enumerate(model.components[4:], start=4):
        sigma = sigmas.yaw_rate if name in YAW_RATE else model.first_sigmas.get(name, 0.0)
        covariance[i, i] = (sigmas.acceleration if name in ACCELERATION else sigma) ** 2
    return Gaussian(mean, covariance)


def scaled_noise_gain(model: MotionModel, x: Array, dt: float) -> Array:
    """Return the effect ``G diag(sigma)``, ``(n, q, ...)``, on the state of one sigma of each driving noise."""
    sigma = linalg.vector(model.noise_sigma)
    gain = linalg.expand(model.noise_gain(x, dt), sigma[None])
    return gain * linalg.expand(sigma, gain[0])


def process_noise_covariance(model: MotionModel, x: Array, dt: float) -> Array:
    """Return the process noise over ``dt``: the covariance ``G diag(sigma^2) G^T``, ``(n, n, ...)``."""
    scaled = scaled_noise_gain(model, x, dt)
    return linalg.matmul_transposed(scaled, scaled)


class WrappedMotion(MotionModel):
    """Motion model that extends an inner motion model, whose state comes first in the combined state."""

    motion: MotionModel

    def to_cartesian(self, x: Array) -> Array:
        return self.motion.to_cartesian(self._inner_state(x))

    def cartesian_jacobian(self, x: Array) -> Array:
        return self.motion.cartesian_jacobian(self._inner_state(x))

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        return self.motion.cartesian_belief(self._inner_belief(belief))

    def cartesian_moments(self, belief: Gaussian) -> Gaussian:
        return self.motion.cartesian_moments(self._inner_belief(belief))

    @property
    def _inner_size(self) -> int:
        return len(self.motion.components)

    def _inner_state(self, x: Array) -> Array:
        return x[: self._inner_size]

    def _inner_belief(self, belief: Gaussian) -> Gaussian:
        return Gaussian(belief.mean[: self._inner_size], belief.covariance[: self._inner_size, : self._inner_size])


class ConstantProcessNoise(WrappedMotion):
    """Motion model with the same process noise at every step, however long the step is.

    Each component of the state has a driving noise. A step of zero length adds none.
    """

    variances: tuple[float, ...]
    """Diagonal ``(n,)`` of the covariance that each step adds, in squared units of the state's components."""

    def model_post_init(self, context: Any) -> None:
        for name in ("components", "angular", "linear", "first_sigmas"):
            object.__setattr__(self, name, getattr(self.motion, name))

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        return tuple(np.sqrt(variance) for variance in self.variances)

    def transition(self, x: Array, dt: float) -> Array:
        return self.motion.transition(x, dt)

    def jacobian(self, x: Array, dt: float) -> Array:
        return self.motion.jacobian(x, dt)

    def noise_gain(self, x: Array, dt: float) -> Array:
        return np.where(dt > 0.0, np.eye(len(self.variances)), 0.0)

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        return self.motion.from_cartesian(belief, sigmas)

    def from_kinematics(self, motion: Kinematics) -> Array:
        return self.motion.from_kinematics(motion)

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        # This noise drives the state only, and stands in for no rate that the state lacks.
        none = np.zeros((len(self.motion.noise_sigma), *noise.shape[1:]))
        return self.motion.to_kinematics(x, none, resting)


KNOWN = (*POSITION, *VELOCITY, *ACCELERATION, *YAW, *YAW_RATE)


def _lacks(model: Any) -> str | None:
    lacking = lacks_class(MotionModel)(model)
    if lacking is not None:
        return lacking
    for name in ("components", "driving_noise"):
        if not _names(getattr(model, name)):
            return f"its {name} must be a tuple of names, not {getattr(model, name)!r}"
    if not isinstance(model.angular, tuple) or not set(model.angular) <= set(range(len(model.components))):
        return f"its angular must be a tuple of places in its components, not {model.angular!r}"
    if not isinstance(model.linear, bool):
        return f"its linear must be True or False, not {model.linear!r}"
    if not isinstance(model.first_sigmas, Mapping):
        return f"its first_sigmas must be a mapping of components to standard deviations, not {model.first_sigmas!r}"
    for name, sigma in model.first_sigmas.items():
        if not isinstance(sigma, int | float) or not 0 < sigma < math.inf:
            return f"its first_sigmas say {sigma!r} of {name}, where a positive number is needed"
    unsaid = [name for name in model.components if name not in KNOWN and name not in model.first_sigmas]
    if unsaid:
        return f"its first_sigmas do not say how uncertain {' and '.join(unsaid)} is at a track's start"
    unknown = [name for name in model.driving_noise if name not in model.model_fields]
    return f"its driving_noise names {unknown[0]!r}, which is no option of it" if unknown else None


def _names(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(name, str) for name in value)


#: Motion models by the names that scenarios use.
MOTION_MODELS: Registry[type[MotionModel]] = Registry("trackbench.motion_models", "motion model", _lacks)
