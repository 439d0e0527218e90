"""Several motion models of one tracker, as a scenario names them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from trackbench.base.config import Config, Plugin, Positive, Probability, Problem
from trackbench.models.motion import MOTION_MODELS, MotionModel

Motion = Annotated[MotionModel, Plugin(MOTION_MODELS, "model", word=True)]
#: How far the sum of probabilities that a file states may be from one.
ROUNDING = 1e-6


class ImmConfig(Config):
    """Several motion models between which the motion switches: the interacting multiple model estimator (IMM)."""

    imm: list[Motion] = Field(
        min_length=2,
        description="The motion models, each with its options in a mapping: {model: cv, ...}. A model may come twice, "
        "with other options.",
    )
    stay_s: list[Positive] = Field(
        description="For each model the mean time for which the motion stays with it, s. It then goes over to any of "
        "the others alike, at any time, whatever the rate of the scans."
    )
    initial_probabilities: list[Probability] | None = Field(
        None,
        description="Probability of each model at a track's start. Unless given, in proportion to stay_s, as it is "
        "when nothing is known.",
    )

    @property
    def first_probabilities(self) -> tuple[float, ...]:
        """Probability of each model at a track's start, with the sum one."""
        weights = self.initial_probabilities or self.stay_s
        return tuple(value / sum(weights) for value in weights)

    @property
    def names(self) -> list[str]:
        """Of the modes: that of the model, with a number where a model comes several times."""
        models = [MOTION_MODELS.name_of(type(model)) for model in self.imm]
        return [
            name if models.count(name) == 1 else f"{name} {models[: i + 1].count(name)}"
            for i, name in enumerate(models)
        ]

    def problems(self) -> Iterator[Problem]:
        for key in ("stay_s", "initial_probabilities"):
            values = getattr(self, key)
            if values is not None and len(values) != len(self.imm):
                yield Problem((key,), f"one number for each of the {len(self.imm)} models is needed, not {len(values)}")
        if self.initial_probabilities is not None and abs(sum(self.initial_probabilities) - 1.0) > ROUNDING:
            total = sum(self.initial_probabilities)
            yield Problem(("initial_probabilities",), f"the sum must be 1, not {total:g}")


def _form(value: Any) -> str:
    return "<imm>" if isinstance(value, ImmConfig) or (isinstance(value, dict) and "imm" in value) else "<model>"


#: The value of ``motion:``.
OneOrSeveralMotions = Annotated[
    Annotated[Motion, Tag("<model>")] | Annotated[ImmConfig, Tag("<imm>")],
    Discriminator(_form),
]
