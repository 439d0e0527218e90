"""What the models share whose axes move alike and apart: a chain of derivatives, driven by white noise."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field
from pydantic.config import JsonDict

from trackbench.base import linalg
from trackbench.base.config import Problem
from trackbench.base.types import Array
from trackbench.models.motion.base import MOTION_MODELS, MotionModel

NoiseForm = Literal["piecewise", "continuous"]
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


def stated_by_form(options: Mapping[NoiseForm, str]) -> JsonDict:
    """The part of a JSON Schema that says which option each form of the noise needs."""
    return {
        "if": {"properties": {"noise": {"const": "continuous"}}, "required": ["noise"]},
        "then": {"required": [options["continuous"]]},
        "else": {"required": [options["piecewise"]]},
    }


class WhiteAxes(DrivenAxes):
    """Axes driven by the derivative after the last of the state, which is white noise of either form.

    A piecewise constant noise is one number for each step. What a continuous one adds to n derivatives has a covariance
    of full rank, and so is a sum of n independent numbers: the gain is a square root of that covariance.
    """

    noise: NoiseForm = Field(
        "piecewise",
        description="Of the white noise that drives the motion. piecewise: constant over each step, so that what it "
        "adds in a second depends on the rate of the scans. continuous: white in continuous time, whatever the rate.",
    )

    noise_options: ClassVar[Mapping[NoiseForm, str]]
    """The option that states each form: a standard deviation, or the root of a power spectral density."""

    def model_post_init(self, context: Any) -> None:
        if self.noise == "continuous":
            object.__setattr__(self, "driving_noise", (self.noise_options["continuous"],) * len(self.components))

    @classmethod
    def replaceable(cls, options: Mapping[str, Any]) -> tuple[str, ...]:
        return (cls.noise_options["continuous" if options.get("noise") == "continuous" else "piecewise"],)

    def problems(self) -> Iterator[Problem]:
        for form, option in self.noise_options.items():
            stated = getattr(self, option) is not None
            if form == self.noise and not stated:
                words = "" if form == "piecewise" else f" with noise: {form}"
                yield Problem((option,), f"missing: motion {MOTION_MODELS.name_of(type(self))}{words} needs {option}")
            elif form != self.noise and stated:
                needed = self.noise_options[self.noise]
                yield Problem((option,), f"not used with noise: {self.noise}, which needs {needed}")
