"""Base of linear models whose two axes move independently and alike, as chains of derivatives with white noise."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.models.motion.base import MotionModel

#: Matrix of one axis with a row for each derivative: numbers, or arrays over a batch.
Rows = Sequence[Sequence[Array | float]]


def on_both_axes(rows: Rows) -> Array:
    """Expand a matrix of one axis ``(n, m, ...)`` to both, ``(2 n, 2 m, ...)``, for a state px, py, vx, vy, ..."""
    return linalg.matrix(
        [[entry if i == j else 0.0 for entry in row for j in range(2)] for row in rows for i in range(2)]
    )


class DrivenAxes(MotionModel):
    """Linear motion model whose two axes move independently and alike."""

    linear: ClassVar[bool] = True

    @abstractmethod
    def axis_jacobian(self, dt: float) -> Rows:
        """Return the transition matrix ``(n, n)`` over ``dt`` of position, velocity and so on along one axis."""

    @abstractmethod
    def axis_gain(self, dt: float) -> Rows:
        """Return the gain ``(n, q)`` over ``dt`` of one axis's driving noises on position, velocity and so on."""

    def jacobian(self, x: Array, dt: float) -> Array:
        return on_both_axes(self.axis_jacobian(dt))

    def noise_gain(self, x: Array, dt: float) -> Array:
        return on_both_axes(self.axis_gain(dt))
