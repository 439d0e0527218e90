"""What is kept of the recorded run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from trackbench.base.types import Array, Gaussian, Mask


@dataclass
class RecordedEstimates:
    """One tracker's estimates of the recorded run."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, instants, objects)``"""
    due: Mask
    """``(instants, objects)`` where an estimate is due, and scored."""
    nis: dict[str, list[Array]] = field(default_factory=dict)
    """Per sensor and measurement ``(objects,)``, NaN where there is none."""


class RecordedInstant(NamedTuple):
    """The estimates of the recorded run at one instant."""

    number: int
    """Of the instant, from 0."""
    estimates: dict[str, Gaussian]
    """By tracker that has not failed: mean ``(4, objects)``, NaN where there is none, and covariance."""
