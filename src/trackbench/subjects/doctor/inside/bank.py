"""Models of an interacting multiple model filter (IMM), found by their values in what the tracker holds."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Indices
from trackbench.subjects.doctor.inside.values import SAME, Held, HeldAt, held_values

#: Largest number of models of a filter.
MOST = 6
#: Largest difference of a sum of probabilities from 1.
ROUNDED = 1e-6
#: Largest number of alike values, in places that differ by one name, among which the values of models are looked for.
MOST_ALIKE = 8
#: Prefix of the path to logarithms of probabilities.
LOGARITHM = "log "
#: Sizes of a model's state.
SIZES = range(2, 13)


class Models(NamedTuple):
    """Means, covariances and probabilities of the models of a filter at one instant."""

    mean: Array
    """Means ``(m, n)`` of m models, whose states have n entries."""
    covariance: Array
    """Covariances ``(m, n, n)`` of the models' states."""
    probability: Array
    """Probabilities ``(m,)`` of the models."""

    def mixed(self, weights: Array) -> tuple[Array, Array]:
        """Return mean ``(n,)`` and covariance ``(n, n)`` of the mixture of the models with weights ``(m,)``.

        Bar-Shalom, Li and Kirubarajan 2001, section 1.4.16.
        """
        mean = weights @ self.mean
        spread = self.mean - mean
        within = np.einsum("j,jab->ab", weights, self.covariance)
        return mean, within + np.einsum("j,ja,jb->ab", weights, spread, spread)


class ModelPaths(NamedTuple):
    """Paths from a tracker down to the means, covariances and probabilities of its models, keys of `families`."""

    mean: str
    covariance: str
    probability: str
    outputs: Indices
    """Indices ``(4,)`` of px, py, vx, vy in a model's state."""

    def models(self, families: dict[str, Array]) -> Models | None:
        """Return the models of the bank, from arrays by attribute path; None where one is missing."""
        probability_path = self.probability.removeprefix(LOGARITHM)
        if not {self.mean, self.covariance, probability_path} <= families.keys():
            return None
        probability = families[probability_path].ravel()
        probability = probability if probability_path == self.probability else np.exp(probability)
        mean = families[self.mean].reshape(len(probability), -1)
        covariance = families[self.covariance].reshape(*mean.shape, -1)
        return Models(mean, covariance, probability)


def transition_matrices(values: Iterable[Held]) -> list[tuple[Held, Array]]:
    """Return values that can be transition probabilities, each with the matrix whose rows are the earlier models."""
    rows = ((entry, with_rows(entry.value)) for entry in values)
    return [(entry, matrix) for entry, matrix in rows if matrix is not None]


def with_rows(matrix: Array) -> Array | None:
    """Return a matrix, transposed if only its columns add up to 1; None if it cannot be transition probabilities."""
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not 2 <= len(matrix) <= MOST:
        return None
    if (matrix < 0.0).any() or np.isin(matrix, (0.0, 1.0)).all():
        return None
    rows, columns = (np.abs(matrix.sum(axis=axis) - 1.0).max() < ROUNDED for axis in (1, 0))
    if rows:
        return matrix
    return matrix.T if columns else None


def values_of_module(tracker: Any) -> Iterator[Held]:
    """Yield the numeric global variables of the module that defines a tracker's class."""
    module = sys.modules.get(type(tracker).__module__)
    for name, value in [] if module is None else list(vars(module).items()):
        if not name.startswith("__"):
            yield from (
                entry._replace(path=(name, *entry.path), place=HeldAt(module, name))
                for entry in held_values(value, depth=0)
            )


def families(values: Iterable[Held], count: int) -> dict[str, Array]:
    """Return, by path, the arrays that have one entry for each model along their first axis.

    The entries are slices of one array, or values whose paths differ in one index or name. States of different sizes
    are cut to the entries that all of them have.

    Args:
        values: values that a tracker holds.
        count: number of models.
    """
    matches: dict[str, Array] = {}
    groups: dict[tuple[Any, ...], dict[str | int, Array]] = {}
    for entry in values:
        path = ".".join(map(str, entry.path))
        for axis in range(entry.value.ndim):
            if entry.value.shape[axis] == count:
                matches[f"{path}:{axis}"] = np.moveaxis(entry.value, axis, 0)
        for position, key in enumerate(entry.path):
            form = (*entry.path[:position], "*", *entry.path[position + 1 :], _form(entry.value))
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
    """Classify a value as a matrix, a number or a vector, whatever its size; None for any other array."""
    if value.ndim == 2 and value.shape[0] == value.shape[1] > 1:
        return "matrix"
    if value.size == 1 or max(value.shape) == value.size:
        return "number" if value.size == 1 else "vector" if value.ndim == 1 else f"vector {value.shape}"
    return None


def find_models(values_by_path: dict[str, Array], estimate: Estimate, count: int) -> list[tuple[ModelPaths, bool]]:
    """Return paths to models whose mixture has an estimate's mean, and whether it has the estimate's covariance.

    The first match of both is returned alone. Otherwise all matches of the mean are: their steps decide.

    Args:
        values_by_path: arrays with an entry for each model, after a step.
        estimate: estimate after that step.
        count: number of models.
    """
    rows = {path: value.reshape(count) for path, value in values_by_path.items() if value.size == count}
    probabilities = {path: row for path, row in rows.items() if (row >= 0.0).all() and row.max() > 0.0}
    probabilities |= {
        LOGARITHM + path: np.exp(row) for path, row in rows.items() if abs(np.logaddexp.reduce(row)) < ROUNDED
    }
    means = {path: value.reshape(count, -1) for path, value in values_by_path.items() if value[0].size in SIZES}
    possible: list[tuple[ModelPaths, bool]] = []
    normalised = sorted(probabilities.items(), key=lambda entry: round(abs(float(entry[1].sum()) - 1.0), 6))
    for (probability_path, weights), (mean_path, mean) in product(normalised, means.items()):
        outputs = _indices_in(weights @ mean, estimate.mean)
        if outputs is None or np.ptp(mean, axis=0).max() == 0.0:
            continue
        size = mean.shape[1]
        for path, covariance in values_by_path.items():
            if covariance[0].size != size**2 or covariance.ndim < 3 or not np.isfinite(covariance).all():
                continue
            models = Models(mean, covariance.reshape(count, size, size), weights)
            _, mixed = models.mixed(weights)
            fits = np.allclose(mixed[np.ix_(outputs, outputs)], estimate.covariance, rtol=1e-7, atol=1e-12)
            values = np.linalg.eigvalsh(models.covariance)
            # A covariance without a spread in some direction counts where all the rest fits.
            if values.min() > (-SAME * values.max() if fits else 0.0):
                possible.append((ModelPaths(mean_path, path, probability_path, outputs), bool(fits)))
                if fits:
                    return possible[-1:]
    return possible[:MOST_ALIKE]


def _indices_in(mixture: Array, mean: Array) -> Indices | None:
    """Return the indices in ``mixture`` of the entries of ``mean`` ``(4,)``; None where one is missing."""
    is_equal = np.abs(mixture[:, None] - mean) <= SAME * np.maximum(np.abs(mean), 1.0)
    if not is_equal.any(axis=0).all():
        return None
    indices = np.argmax(is_equal, axis=0)
    return np.asarray(indices) if len(set(indices.tolist())) == len(mean) else None


def constant_matrices(
    earlier: Sequence[tuple[Held, Array]], later: Sequence[tuple[Held, Array]]
) -> list[tuple[Held, Array]]:
    """Return the earlier matrices that are held unchanged, at the same path, at a later instant."""
    held_later = {(entry.path, matrix.tobytes()) for entry, matrix in later}
    return [entry for entry in earlier if (entry[0].path, entry[1].tobytes()) in held_later]
