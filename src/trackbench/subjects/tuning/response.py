"""How the objective changes around the best values: which option matters, and how sharply."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.search import fit, shares_of
from trackbench.subjects.tuning.study import TuningTrial

#: Of a positive value: by which factors it is changed.
FACTORS = (0.25, 0.5, 0.7071, 0.8409, 1.1892, 1.4142, 2.0, 4.0)
#: Of another one: by which shares of the range.
SHARES = (-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4)
STEPS = (-4, -2, -1, 1, 2, 4)
#: A rise of the objective that does not matter: 1 % of an error.
NEGLIGIBLE = math.log(1.01)
#: Two estimates whose correlation is larger can hardly be told apart.
STRONG = 0.8


@dataclass(frozen=True)
class ResponsePoint:
    """The objective where one option differs from the best values."""

    value: Any
    parts: Mapping[str, float]
    """Of the objective; empty where the trial failed."""
    rise: float
    """Of the loss, over that of the best values; NaN where the trial failed."""
    reach: float | None
    """Half of the 95 % interval of the rise, from the same runs; None where the runs tell of none."""
    best: bool = False

    @property
    def shown(self) -> bool:
        """Whether it is shown to be worse."""
        return self.reach is not None and self.rise > self.reach


@dataclass(frozen=True)
class Response:
    """The objective along one option, the others as in the best values."""

    parameter: Parameter
    points: tuple[ResponsePoint, ...]
    """In the order of the values, the best one among them."""

    def within(self, rise: float) -> tuple[float | None, float | None]:
        """The values between which the loss rises by less, of a continuous option; None where that is beyond what was
        tried."""
        return self._where(_root_of_rise, math.sqrt(rise), -1), self._where(_root_of_rise, math.sqrt(rise), 1)

    @property
    def optimum95(self) -> tuple[float | None, float | None]:
        """The 95 % interval of the optimum, of a continuous option whose objective is smooth, the others as they are;
        None where an end is beyond what was tried, or the runs do not tell.

        With curvature H and variance V of the slope over n runs the interval of an M-estimator ends at the distance
        ``d = 1.96 (V / n)^1/2 / H`` (van der Vaart 1998, "Asymptotic statistics", theorem 5.23). There the rise
        ``H d^2 / 2`` is half of ``1.96 d (V / n)^1/2``, which is that of the rise's own interval.
        """
        return self._where(_evidence, 0.5, -1), self._where(_evidence, 0.5, 1)

    @property
    def has_reach(self) -> bool:
        """Whether the runs tell how sure the rises are."""
        return any(point.reach is not None for point in self.points)

    @property
    def as_good(self) -> list[Any]:
        """The values tried that are not shown to be worse, of an option that is not continuous."""
        return [point.value for point in self.points if math.isfinite(point.rise) and not point.shown]

    @property
    def steepness(self) -> float:
        """The larger rise of half and twice the value, or of the values next to the best one."""
        best = self.points[self._best].value
        if self.parameter.scale == "log":
            near = [point for point in self.points if 1.9 < max(point.value / best, best / point.value) < 2.1]
        else:
            near = [self.points[i] for i in (self._best - 1, self._best + 1) if 0 <= i < len(self.points)]
        rises = [point.rise for point in near if math.isfinite(point.rise)]
        return max(rises, default=math.nan)

    @property
    def _best(self) -> int:
        return next(i for i, point in enumerate(self.points) if point.best)

    def _where(self, measure: Callable[[ResponsePoint], float], limit: float, side: int) -> float | None:
        """The value to one side at which a measure that grows with the distance reaches a limit."""
        place = self._best
        while 0 <= place + side < len(self.points):
            near, far = self.points[place], self.points[place + side]
            a, b = measure(near), measure(far)
            if not math.isfinite(b):
                return None
            if b >= limit:
                ends = [self.parameter.to_unit(point.value) for point in (near, far)]
                return self.parameter.from_unit(ends[0] + (limit - a) / (b - a) * (ends[1] - ends[0]))
            place += side
        return None


def _root_of_rise(point: ResponsePoint) -> float:
    """Of a parabola, it grows with the distance."""
    return math.sqrt(max(point.rise, 0.0)) if math.isfinite(point.rise) else math.nan


def _evidence(point: ResponsePoint) -> float:
    """The rise over half of its interval: one grows with the square of the distance, the other with the distance."""
    if point.best:
        return 0.0
    return point.rise / point.reach if point.reach else math.nan


def values_along(parameter: Parameter, best: Values) -> list[dict[str, Any]]:
    """The best values with others of one option: those at which the response is taken."""
    value, values = best[parameter.key], []
    if parameter.scale == "choice":
        values = list(parameter.choices)
    elif parameter.scale == "integer":
        values = [value + step for step in STEPS if parameter.low <= value + step <= parameter.high]
    elif parameter.scale == "log":
        rounded = [float(f"{value * factor:.4g}") for factor in FACTORS]
        values = [min(max(other, parameter.low), parameter.high) for other in rounded]
    else:
        place = parameter.to_unit(value)
        values = [parameter.from_unit(place + share) for share in SHARES]
    others = [other for i, other in enumerate(values) if other != value and other not in values[:i]]
    return [{**best, parameter.key: other} for other in others]


def correlations(
    parameters: Sequence[Parameter], trials: Sequence[TuningTrial], best: TuningTrial
) -> dict[tuple[str, str], float]:
    """By pair of continuous options how far one makes up for the other: the correlation that the curvature says.

    Empty where there are too few trials, or the loss has no minimum there.
    """
    axes = [item for item in parameters if item.continuous]
    if len(axes) < 2:
        return {}
    alike = [
        trial
        for trial in trials
        if all(item.continuous or trial.values[item.key] == best.values[item.key] for item in parameters)
    ]
    as_loss = [TuningTrial(trial.values, {"loss": trial.loss}, trial.losses) for trial in alike if trial.losses]
    model = fit(axes, as_loss, shares_of(axes, [best])[0], 0.1)
    if model is None:
        return {}
    size = len(axes)
    rows, columns = np.triu_indices(size)
    curvature = np.zeros((size, size))
    curvature[rows, columns] = model.coefficients["loss"][1 + size :]
    curvature = curvature + curvature.T
    if np.linalg.eigvalsh(curvature)[0] <= 0:
        return {}
    covariance = np.linalg.inv(curvature)
    scale = np.sqrt(np.diag(covariance))
    return {
        (axes[i].key, axes[j].key): float(covariance[i, j] / scale[i] / scale[j])
        for i in range(size)
        for j in range(i + 1, size)
    }
