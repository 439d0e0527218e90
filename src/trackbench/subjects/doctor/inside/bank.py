"""The models of an interacting multiple model filter, found by their values in what the tracker holds."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Indices
from trackbench.subjects.doctor.inside.values import SAME, Held, HeldAt, held_values

#: Models of a filter, at most.
MOST = 6
#: By how much the sum of probabilities may differ from 1.
ROUNDED = 1e-6
#: Values of one form in places that differ by one name, at most, of which some are taken for those of models.
MOST_ALIKE = 8
#: Before the way to logarithms of probabilities.
LOGARITHM = "log "
#: Sizes of a model's state.
SIZES = range(2, 13)


class Models(NamedTuple):
    """Means, covariances and probabilities of the models at one instant."""

    mean: Array
    """``(m, n)``"""
    covariance: Array
    """``(m, n, n)``"""
    probability: Array
    """``(m,)``"""

    def mixed(self, weights: Array) -> tuple[Array, Array]:
        """Mean ``(n,)`` and covariance ``(n, n)`` of a mixture with weights ``(m,)``.

        Bar-Shalom, Li and Kirubarajan 2001, section 1.4.16.
        """
        mean = weights @ self.mean
        spread = self.mean - mean
        within = np.einsum("j,jab->ab", weights, self.covariance)
        return mean, within + np.einsum("j,ja,jb->ab", weights, spread, spread)


class ModelWays(NamedTuple):
    """Where the parts of the models are held, as `families` finds them."""

    mean: str
    covariance: str
    probability: str
    outputs: Indices
    """``(4,)`` places of px, py, vx, vy in a model's state."""

    def models(self, families: dict[str, Array]) -> Models | None:
        """Those of another instant; None where they are not there."""
        probability_way = self.probability.removeprefix(LOGARITHM)
        if not {self.mean, self.covariance, probability_way} <= families.keys():
            return None
        probability = families[probability_way].ravel()
        probability = probability if probability_way == self.probability else np.exp(probability)
        mean = families[self.mean].reshape(len(probability), -1)
        covariance = families[self.covariance].reshape(*mean.shape, -1)
        return Models(mean, covariance, probability)


def transition_matrices(values: Iterable[Held]) -> list[tuple[Held, Array]]:
    """The matrices that can be transition probabilities, each also with a row for the model before."""
    rows = ((entry, with_rows(entry.value)) for entry in values)
    return [(entry, matrix) for entry, matrix in rows if matrix is not None]


def with_rows(matrix: Array) -> Array | None:
    """Transition probabilities with a row for the model before; None where it can be none."""
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not 2 <= len(matrix) <= MOST:
        return None
    if (matrix < 0.0).any() or np.isin(matrix, (0.0, 1.0)).all():
        return None
    rows, columns = (np.abs(matrix.sum(axis=axis) - 1.0).max() < ROUNDED for axis in (1, 0))
    if rows:
        return matrix
    return matrix.T if columns else None


def of_module(tracker: Any) -> Iterator[Held]:
    """The numbers that the module of a tracker's class holds."""
    module = sys.modules.get(type(tracker).__module__)
    for name, value in [] if module is None else list(vars(module).items()):
        if not name.startswith("__"):
            yield from (
                entry._replace(path=(name, *entry.path), place=HeldAt(module, name))
                for entry in held_values(value, depth=0)
            )


def families(values: Iterable[Held], count: int) -> dict[str, Array]:
    """The values that there are of each of some models, the model first, by their way.

    They are the parts of one array, or what is held in places that differ by one number or name. Of states of different
    sizes the first entries are taken that all of them have.

    Args:
        values: what a tracker holds.
        count: of models.
    """
    matches: dict[str, Array] = {}
    groups: dict[tuple[Any, ...], dict[str | int, Array]] = {}
    for entry in values:
        way = ".".join(map(str, entry.path))
        for axis in range(entry.value.ndim):
            if entry.value.shape[axis] == count:
                matches[f"{way}:{axis}"] = np.moveaxis(entry.value, axis, 0)
        for at, key in enumerate(entry.path):
            form = (*entry.path[:at], "*", *entry.path[at + 1 :], _form(entry.value))
            groups.setdefault(form, {})[key] = entry.value
    for form, members in groups.items():
        if len(members) > MOST_ALIKE or form[-1] is None:
            continue
        for chosen in combinations(members, count):
            parts = [members[key] for key in chosen]
            size = min(len(part) for part in parts) if parts[0].ndim else 0
            cut = [part[:size, :size] if form[-1] == "matrix" else part[:size] if size else part for part in parts]
            matches[f"{'.'.join(map(str, form[:-1]))}:{','.join(map(str, chosen))}"] = np.stack(cut)
    return matches


def _form(value: Array) -> str | None:
    """Of values that may be of different sizes; None where they cannot be of models."""
    if value.ndim == 2 and value.shape[0] == value.shape[1] > 1:
        return "matrix"
    if value.size == 1 or max(value.shape) == value.size:
        return "number" if value.size == 1 else "vector" if value.ndim == 1 else f"vector {value.shape}"
    return None


def found_models(held_by: dict[str, Array], estimate: Estimate, count: int) -> list[tuple[ModelWays, bool]]:
    """The models whose mixture an estimate is, and whether its covariance is theirs too.

    One where it is; else those that can be, of which only their steps tell which they are; none where the mean is none.

    Args:
        held_by: families after a step.
        estimate: of that step.
        count: of models.
    """
    rows = {way: value.reshape(count) for way, value in held_by.items() if value.size == count}
    probabilities = {way: row for way, row in rows.items() if (row >= 0.0).all() and row.max() > 0.0}
    probabilities |= {
        LOGARITHM + way: np.exp(row) for way, row in rows.items() if abs(np.logaddexp.reduce(row)) < ROUNDED
    }
    means = {way: value.reshape(count, -1) for way, value in held_by.items() if value[0].size in SIZES}
    possible: list[tuple[ModelWays, bool]] = []
    normalised = sorted(probabilities.items(), key=lambda entry: round(abs(float(entry[1].sum()) - 1.0), 6))
    for (pway, weights), (xway, mean) in product(normalised, means.items()):
        outputs = _places(weights @ mean, estimate.mean)
        if outputs is None or np.ptp(mean, axis=0).max() == 0.0:
            continue
        size = mean.shape[1]
        for way, covariance in held_by.items():
            if covariance[0].size != size**2 or covariance.ndim < 3 or not np.isfinite(covariance).all():
                continue
            models = Models(mean, covariance.reshape(count, size, size), weights)
            _, mixed = models.mixed(weights)
            fits = np.allclose(mixed[np.ix_(outputs, outputs)], estimate.covariance, rtol=1e-7, atol=1e-12)
            values = np.linalg.eigvalsh(models.covariance)
            # One without a spread in some direction counts where all the rest fits.
            if values.min() > (-SAME * values.max() if fits else 0.0):
                possible.append((ModelWays(xway, way, pway, outputs), bool(fits)))
                if fits:
                    return possible[-1:]
    return possible[:MOST_ALIKE]


def _places(mixture: Array, mean: Array) -> Indices | None:
    """Where the entries of an estimate are in a mixture; None where one is not there."""
    apart = np.abs(mixture[:, None] - mean) <= SAME * np.maximum(np.abs(mean), 1.0)
    if not apart.any(axis=0).all():
        return None
    places = np.argmax(apart, axis=0)
    return np.asarray(places) if len(set(places.tolist())) == len(mean) else None


def stationary(earlier: Sequence[tuple[Held, Array]], now: Sequence[tuple[Held, Array]]) -> list[tuple[Held, Array]]:
    """Of the matrices at one instant those that are held in the same place at another."""
    later = {(held_there.path, matrix.tobytes()) for held_there, matrix in now}
    return [entry for entry in earlier if (entry[0].path, entry[1].tobytes()) in later]
