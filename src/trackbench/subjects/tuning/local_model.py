"""A quadratic model of an objective's parts around the best trial."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.trials import TuningTrial

#: Random points at which the model is looked at for its smallest value, in two passes.
LOOKS = 4000
#: Of an area that has been narrowed down, the share of the range that is not narrowed further.
SMALLEST_RADIUS = 0.01

Loss = Callable[[Mapping[str, float]], tuple[float, ...]]


@dataclass(frozen=True)
class LocalModel:
    """``c + g d + d H d / 2`` of each part, where ``d`` is the way from the centre, each range being one long."""

    parameters: Sequence[Parameter]
    """The continuous ones."""
    centre: Array
    """``(d,)``"""
    coefficients: Mapping[str, Array]
    residual: Mapping[str, float]
    """Root mean square of what the model misses, by part."""

    def parts(self, shares: Array) -> dict[str, Array]:
        """Each part at some points ``(k, d)``."""
        rows = _terms(shares - self.centre)
        return {name: rows @ found for name, found in self.coefficients.items()}

    def losses(self, shares: Array, loss: Loss) -> Array:
        """``(k,)`` the loss at some points."""
        parts = self.parts(shares)
        return np.array(
            [loss({name: float(values[i]) for name, values in parts.items()})[0] for i in range(len(shares))]
        )

    def smallest(self, loss: Loss, reach: float, random: np.random.Generator) -> Array:
        """``(d,)`` where the loss is smallest, within a distance of the centre along each axis."""
        best, size = self.centre, reach
        for _ in range(2):
            points = best + size * random.uniform(-1.0, 1.0, (LOOKS // 2, len(best)))
            points = np.clip(points, np.maximum(self.centre - reach, 0.0), np.minimum(self.centre + reach, 1.0))
            points = np.vstack([best, points])
            best, size = points[np.argmin(self.losses(points, loss))], size / 10
        return best


def shares_of(parameters: Sequence[Parameter], trials: Sequence[TuningTrial]) -> Array:
    """``(trials, d)`` where in their ranges the values of the trials lie."""
    return np.array([[item.to_unit(trial.values[item.key]) for item in parameters] for trial in trials]).reshape(
        len(trials), len(parameters)
    )


def fit(
    parameters: Sequence[Parameter], trials: Sequence[TuningTrial], centre: Array, radius: float
) -> LocalModel | None:
    """The model from trials that did not fail, which count less the further away they are; None with too few of them.

    Args:
        parameters: the continuous ones, along which the model goes.
        trials: those whose other values are alike.
        centre: ``(d,)`` shares of the ranges.
        radius: at which distance a trial counts 0.6.
    """
    done = [trial for trial in trials if trial.losses]
    size = _size(len(parameters))
    if len(done) < size:
        return None
    away = shares_of(parameters, done) - centre
    weight = np.exp(-0.25 * (away**2).sum(axis=1) / radius**2)
    if (weight > 0.05).sum() < size:
        # A wider look, for want of trials nearby.
        nearest = np.sort((away**2).sum(axis=1))[size - 1]
        weight = np.exp(-0.25 * (away**2).sum(axis=1) / max(nearest, radius**2))
    rows = _terms(away)
    found, residual = {}, {}
    for name in done[0].parts:
        values = np.array([trial.parts[name] for trial in done])
        solution, _, rank, _ = np.linalg.lstsq(rows * weight[:, None], values * weight, rcond=1e-10)
        if rank < size:
            return None
        found[name] = solution
        residual[name] = float(np.sqrt(np.average((values - rows @ solution) ** 2, weights=weight**2)))
    return LocalModel(parameters, centre, found, residual)


def _size(dimensions: int) -> int:
    return (dimensions + 1) * (dimensions + 2) // 2


def _terms(away: Array) -> Array:
    """``(k, terms)`` constant, linear and quadratic terms of points ``(k, d)``."""
    i, j = np.triu_indices(away.shape[1])
    return np.hstack([np.ones((len(away), 1)), away, away[:, i] * away[:, j]])
