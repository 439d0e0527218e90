"""What a sensor model is."""

from __future__ import annotations

from typing import ClassVar, Protocol

from trackbench.types import Array, Gaussian, Scan


class SensorModel(Protocol):
    """How a sensor at a known pose and velocity sees a target of Cartesian state px, py, vx, vy (fixed frame).

    ``pose`` is ``(3, ...)`` x, y, yaw and ``velocity`` ``(2, ...)`` vx, vy of the sensor.
    """

    kind: ClassVar[str]
    components: ClassVar[tuple[str, ...]]
    """Names of the measurement's components."""
    angular: ClassVar[tuple[int, ...]]
    """Which components are angles."""

    def measure(self, target: Array, pose: Array, velocity: Array) -> Array:
        """``(m, ...)`` what an ideal sensor reads of a target ``(4, ...)``."""
        ...

    def jacobian(self, target: Array, pose: Array, velocity: Array) -> Array:
        """``(m, 4, ...)`` derivative of ``measure`` with respect to the target's state."""
        ...

    def position(self, scan: Scan) -> Gaussian:
        """The position ``(2, ...)`` in the fixed frame that a measurement states, with its covariance."""
        ...

    def radial_velocity(self, scan: Scan) -> Array:
        """The velocity ``(2, ...)`` in the fixed frame of a target that moves along the line of sight.

        A first guess from one measurement; zero where the measurement says nothing of the velocity.
        """
        ...
