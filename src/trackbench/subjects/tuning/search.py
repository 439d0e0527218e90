"""A quadratic model of an objective's parts around the best trial."""

from __future__ import annotations

import itertools
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
