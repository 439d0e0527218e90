"""What the models share whose axes move alike and apart: a chain of derivatives, driven by white noise."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.models.motion.base import MotionModel

#: A row for each derivative on one axis: numbers, or arrays over a batch.
Rows = Sequence[Sequence[Array | float]]


def on_both_axes(rows: Rows) -> Array:
    """The matrix ``(2 n, 2 m, ...)`` of a state px, py, vx, vy, ... from that of one axis ``(n, m, ...)``."""
    return linalg.matrix(
        [[entry if i == j else 0.0 for entry in row for j in range(2)] for row in rows for i in range(2)]
    )


class DrivenAxes(MotionModel):
    """A linear model of two axes that move alike and apart."""

    linear: ClassVar[bool] = True

    @abstractmethod
    def axis_jacobian(self, dt: float) -> Rows:
        """``(n, n)`` the transition of position, velocity and so on along one axis."""

    @abstractmethod
    def axis_gain(self, dt: float) -> Rows:
        """``(n, q)`` what each driving noise of one axis adds to them."""

    def jacobian(self, x: Array, dt: float) -> Array:
        return on_both_axes(self.axis_jacobian(dt))

    def noise_gain(self, x: Array, dt: float) -> Array:
        return on_both_axes(self.axis_gain(dt))
