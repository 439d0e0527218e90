"""The search: a quadratic model of an objective around the best trial, and the response of each option there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.study import Study, TuningTrial, best_trial

#: Random points at which the model is looked at for its smallest value, in two passes.
LOOKS = 4000
#: Of an area that has been narrowed down, the share of the range that is not narrowed further.
SMALLEST_RADIUS = 0.01

Loss = Callable[[Mapping[str, float]], tuple[float, ...]]


@dataclass(frozen=True)
class LocalModel:
    """``c + g d + d H d / 2`` of each part, where ``d`` is the way from the centre, each range being one long."""

    centre: Array
    """``(d,)``"""
    coefficients: Mapping[str, Array]

    def losses(self, shares: Array, loss: Loss) -> Array:
        """``(k,)`` the loss at some points ``(k, d)``."""
        rows = _terms(shares - self.centre)
        parts = {name: rows @ column for name, column in self.coefficients.items()}
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
    size = (len(parameters) + 1) * (len(parameters) + 2) // 2
    if len(done) < size:
        return None
    away = shares_of(parameters, done) - centre
    weight = np.exp(-0.25 * (away**2).sum(axis=1) / radius**2)
    if (weight > 0.05).sum() < size:
        # A wider look, for want of trials nearby.
        nearest = np.sort((away**2).sum(axis=1))[size - 1]
        weight = np.exp(-0.25 * (away**2).sum(axis=1) / max(nearest, radius**2))
    rows = _terms(away)
    coefficients = {}
    for name in done[0].parts:
        values = np.array([trial.parts[name] for trial in done])
        solution, _, rank, _ = np.linalg.lstsq(rows * weight[:, None], values * weight, rcond=1e-10)
        if rank < size:
            return None
        coefficients[name] = solution
    return LocalModel(centre, coefficients)


def _terms(away: Array) -> Array:
    """``(k, terms)`` constant, linear and quadratic terms of points ``(k, d)``."""
    i, j = np.triu_indices(away.shape[1])
    return np.hstack([np.ones((len(away), 1)), away, away[:, i] * away[:, j]])


#: Share of each range within which the local model begins; each further batch looks at half of it.
RADIUS = 0.15
LOCAL_BATCHES = 4

#: Makes some trials.
Make = Callable[[Sequence[Values]], list[TuningTrial]]


class Proposals(NamedTuple):
    """Trials that are proposed at once."""

    how: Literal["spread", "promising", "local"]
    size: int
    radius: float = 0.0


def schedule(parameters: Sequence[Parameter], front: bool) -> Iterator[Proposals]:
    """The batches of a search, without end; how many trials are made does not change them.

    Args:
        parameters: what is tuned.
        front: whether there are two losses.
    """
    continuous = sum(item.continuous for item in parameters)
    size = max(6, (continuous + 1) * (continuous + 2) // 2 + 2)
    yield Proposals("spread", 4 + 6 * len(parameters))
    discrete = len(parameters) > continuous
    while True:
        yield from [Proposals("promising", size)] * (3 if discrete or front else 1)
        if continuous and not front:
            yield from (Proposals("local", size, RADIUS * 0.5**number) for number in range(LOCAL_BATCHES))


def usual_trials(parameters: Sequence[Parameter], front: bool) -> int:
    """How many trials are made unless it is said."""
    once = list(itertools.islice(schedule(parameters, front), 1 + 3 + LOCAL_BATCHES))
    discrete = any(not item.continuous for item in parameters)
    batches = once if discrete or front else once[: 2 + LOCAL_BATCHES]
    return sum(batch.size for batch in batches)


def search(
    parameters: Sequence[Parameter],
    study: Study,
    start: Values | None,
    make: Make,
    loss: Loss,
    trials: int,
    seed: int,
    front: bool = False,
    batches: Iterable[Proposals] | None = None,
) -> None:
    """Make trials until there are so many in the study; those that it has already are not made again.

    What a batch proposes depends on the trials before it and the seed, not on when the search was interrupted.

    Args:
        parameters: what is tuned.
        study: that keeps the trials.
        start: the values that the search begins with, where they lie in the ranges.
        make: what makes trials.
        loss: of a trial's parts.
        trials: how many.
        seed: of what is drawn.
        front: whether there are two losses.
        batches: in which the trials are proposed; those of the schedule unless given.
    """
    first = 0
    for number, batch in enumerate(batches or schedule(parameters, front)):
        if first >= trials:
            return
        size = min(batch.size, trials - first)
        if len(study.trials) < first + size:
            made = study.trials[:first]
            points = _proposed(parameters, study, made, batch, loss, [seed, number])
            if number == 0 and start is not None:
                points = [dict(start), *points]
            missing = points[len(study.trials) - first : size]
            for trial in make(missing):
                study.add(trial)
        first += size


def _proposed(
    parameters: Sequence[Parameter],
    study: Study,
    made: Sequence[TuningTrial],
    batch: Proposals,
    loss: Loss,
    seed: list[int],
) -> list[dict[str, Any]]:
    """The values of a batch."""
    random = np.random.default_rng(seed)
    drawn = int(random.integers(2**31))
    best = best_trial(made)
    if batch.how == "spread" or best is None:
        return study.space_filling(batch.size, drawn)
    if batch.how == "promising":
        return study.promising(batch.size, drawn, made)
    return _around(parameters, made, best, batch, loss, random)


def _around(
    parameters: Sequence[Parameter],
    made: Sequence[TuningTrial],
    best: TuningTrial,
    batch: Proposals,
    loss: Loss,
    random: np.random.Generator,
) -> list[dict[str, Any]]:
    """The smallest value of a model of the trials around the best one, and points around it that sharpen the model."""
    axes = [item for item in parameters if item.continuous]
    others = {item.key: best.values[item.key] for item in parameters if not item.continuous}
    alike = [trial for trial in made if all(trial.values[key] == value for key, value in others.items())]
    centre = shares_of(axes, [best])[0]
    model = fit(axes, alike, centre, batch.radius)
    if model is not None:
        centre = model.smallest(loss, 2.0 * batch.radius, random)
    radius = max(batch.radius, SMALLEST_RADIUS)
    steps = np.vstack([np.zeros(len(axes)), radius * np.eye(len(axes)), -radius * np.eye(len(axes))])
    more = radius * random.uniform(-1.0, 1.0, (max(0, batch.size - len(steps)), len(axes)))
    shares = centre + np.vstack([steps, more])[: batch.size]
    # Points beyond an end of a range come back from it, so that no two fall onto the end.
    points = 1.0 - np.abs(1.0 - np.abs(shares) % 2.0)
    return [
        others | {item.key: item.from_unit(float(share)) for item, share in zip(axes, point, strict=True)}
        for point in points
    ]


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
