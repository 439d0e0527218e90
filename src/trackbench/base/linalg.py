"""Small dense linear algebra on stacks of matrices whose batch axes come last.

A matrix is ``(n, m, ...)`` and a vector ``(n, ...)``; batch axes broadcast, so that one matrix may serve a whole batch.
Loops run over the few components and every NumPy call works along the batch, which is several times faster than
``numpy.linalg`` on a leading batch axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.base.units import TWO_PI

_einsum: Callable[..., Array] = np.einsum
#: Types of entries with which an array can be filled.
_NUMBERS = frozenset({float, int, bool, np.float64, np.int64, np.ndarray})


def matrix(rows: Sequence[Sequence[Array | float]]) -> Array:
    """Build a matrix ``(n, m, ...)`` from its entries, each a number or an array over the batch."""
    flat = vector([entry for row in rows for entry in row])
    return flat.reshape(len(rows), len(rows[0]), *flat.shape[1:])


def vector(entries: Sequence[Array | float]) -> Array:
    """Build a vector ``(n, ...)`` from its entries, each a number or an array over the batch."""
    if not _NUMBERS.issuperset(map(type, entries)):
        return np.stack(np.broadcast_arrays(*entries))
    # Filling is several times faster than numpy.stack, which needs every entry at its full size.
    # numpy.broadcast is three times faster than numpy.broadcast_shapes, but takes 64 arrays at most.
    shape = np.broadcast(*entries).shape if len(entries) <= 64 else np.broadcast_shapes(*map(np.shape, entries))
    filled = np.empty((len(entries), *shape))
    for i, entry in enumerate(entries):
        filled[i] = entry
    return filled


def matmul(a: Array, b: Array) -> Array:
    """Compute the matrix product ``A B``."""
    if a.ndim == 2 and b.ndim > 2:
        # One matrix for the whole batch: a product with one wide matrix, for which BLAS is twice as fast.
        return (a @ b.reshape(len(b), -1)).reshape(len(a), *b.shape[1:])
    return _einsum("ik...,kj...->ij...", a, b)


def matmul_transposed(a: Array, b: Array) -> Array:
    """Compute the matrix product ``A B^T``."""
    return _einsum("ik...,jk...->ij...", a, b)


def transposed_matmul(a: Array, b: Array) -> Array:
    """Compute the matrix product ``A^T B``."""
    return _einsum("ki...,kj...->ij...", a, b)


def gram(a: Array) -> Array:
    """Compute the matrix product ``A^T A``, exactly symmetric in spite of rounding."""
    return _einsum("ki...,kj...->ij...", a, a)


def matvec(a: Array, x: Array) -> Array:
    """Compute the product ``A x`` of a matrix and a vector."""
    return _einsum("ik...,k...->i...", a, x)


def apply_transposed(a: Array, x: Array) -> Array:
    """Compute the product ``A^T x`` of a transposed matrix and a vector."""
    return _einsum("ki...,k...->i...", a, x)


def quadratic(a: Array, p: Array) -> Array:
    """Compute the matrix product ``A P A^T`` for a symmetric ``P``."""
    product = matmul(a, p)
    if a.ndim == 2 and p.ndim > 2:
        # One product with a wide matrix for each row of A P.
        rows = product.reshape(len(a), len(p), -1)
        return (a @ rows).reshape(len(a), len(a), *p.shape[2:])
    return matmul_transposed(product, a)


def symmetrise(p: Array) -> Array:
    """Compute the symmetric part ``(P + P^T) / 2`` of a square matrix."""
    return 0.5 * (p + np.swapaxes(p, 0, 1))


#: Relative amount by which a variance is rounded up: 64 units in the last place.
MARGIN = 2.0**-46


def rounded_up(p: Array) -> Array:
    """Return a computed covariance, made exactly symmetric, with each variance enlarged by the share ``MARGIN``.

    The lower triangle is copied to the upper one. Then a sum of products that is semidefinite but for rounding has a
    Cholesky factor. Rounding moves an entry by a few units in the last place of the two standard deviations, and a
    semidefinite matrix with this margin keeps its factor (Demmel 1989; Higham 2002, theorem 10.7).
    """
    result: Array = p[_lower(len(p))]
    for i in range(len(p)):
        result[i, i] *= 1.0 + MARGIN
    return result


@cache
def _lower(size: int) -> tuple[Indices, Indices]:
    i, j = np.indices((size, size))
    return np.maximum(i, j), np.minimum(i, j)


def expand(a: Array, like: Array) -> Array:
    """Append axes of length one to ``a``, so that it broadcasts against the batch axes of the matrix ``like``."""
    return a.reshape(a.shape + (1,) * (like.ndim - a.ndim))


class Cholesky(NamedTuple):
    """Lower triangular factor ``L`` with ``P = L L^T``, stored as its entries."""

    rows: tuple[tuple[Array, ...], ...]
    """Entries of ``L``: ``rows[i][j]`` for row ``i`` and column ``j <= i``, each an array over the batch axes."""
    inverse_diagonal: tuple[Array, ...]
    positive: Mask
    """Mask over the batch axes; False where ``P`` is not positive definite, and the entries of ``L`` mean nothing."""

    def lower(self) -> Array:
        """Return the factor ``L`` as one array ``(n, n, ...)``."""
        size = len(self.rows)
        return matrix([[*row, *[0.0] * (size - len(row))] for row in self.rows])

    def log_density(self, whitened: Array) -> Array:
        """Return log densities ``(...)`` of a Gaussian, ``N(y; 0, P)``, from ``L^-1 y``, ``(n, ...)``."""
        normalised = np.prod(np.stack(self.inverse_diagonal), axis=0) * TWO_PI ** (-len(whitened) / 2)
        logarithm: Array = np.log(normalised) - 0.5 * _einsum("i...,i...->...", whitened, whitened)
        return logarithm

    def whiten(self, b: Array) -> Array:
        """Solve ``L X = B`` for a vector or a matrix ``b`` of ``n`` rows; return ``X``."""
        solved: list[Array] = []
        for i, row in enumerate(self.rows):
            rest = b[i]
            for j in range(i):
                rest = rest - row[j] * solved[j]
            solved.append(rest * self.inverse_diagonal[i])
        return vector(solved)

    def whiten_transposed(self, b: Array) -> Array:
        """Solve ``L^T X = B`` for a vector or a matrix ``b`` of ``n`` rows; return ``X``."""
        size = len(self.rows)
        solved: list[Array] = [*b]
        for i in reversed(range(size)):
            for j in range(i + 1, size):
                solved[i] = solved[i] - self.rows[j][i] * solved[j]
            solved[i] = solved[i] * self.inverse_diagonal[i]
        return vector(solved)


def cholesky(p: Array) -> Cholesky:
    """Factor each matrix in a stack ``(n, n, ...)``, from its lower triangle.

    A pivot that is not positive is replaced by one, and the matrix is marked in ``positive``.
    """
    rows: list[tuple[Array, ...]] = []
    inverse_diagonal: list[Array] = []
    positive: Mask | None = None
    for i in range(len(p)):
        row: list[Array] = []
        for j in range(i):
            rest = p[i, j]
            for k in range(j):
                rest = rest - row[k] * rows[j][k]
            row.append(rest * inverse_diagonal[j])
        pivot = p[i, i]
        for entry in row:
            pivot = pivot - entry * entry
        good = pivot > 0.0
        positive = good if positive is None else positive & good
        diagonal = np.sqrt(pivot if good.all() else np.where(good, pivot, 1.0))
        row.append(diagonal)
        rows.append(tuple(row))
        inverse_diagonal.append(1.0 / diagonal)
    assert positive is not None
    return Cholesky(tuple(rows), tuple(inverse_diagonal), positive)


class Definite(NamedTuple):
    """Positive definite covariance with its Cholesky factor."""

    covariance: Array
    factor: Cholesky
    repaired: Mask | None
    """Mask over the batch axes, True where the covariance had to be changed; None where no covariance had to be."""


#: Smallest eigenvalue after a repair, relative to the largest.
RELATIVE_FLOOR = 1e-9


def ensure_definite(p: Array) -> Definite:
    """Replace each matrix without a Cholesky factor by the nearest positive definite matrix.

    That is the nearest symmetric matrix in the Frobenius norm whose eigenvalues are at least ``RELATIVE_FLOOR`` of the
    largest (Higham 1988, Theorem 2.1). Matrices with entries that are not finite are left unchanged, and not marked.
    """
    factor = cholesky(p)
    if factor.positive.all():
        return Definite(p, factor, None)
    size = len(p)
    flat = symmetrise(p).reshape(size, size, -1)
    broken = ~factor.positive.reshape(-1) & np.isfinite(flat).all(axis=(0, 1))
    batch = np.moveaxis(flat[:, :, broken], -1, 0)
    values, vectors = np.linalg.eigh(batch)
    largest = np.maximum(values[:, -1:], np.finfo(float).tiny)
    values = np.maximum(values, RELATIVE_FLOOR * largest)
    fixed = flat.copy()
    fixed[:, :, broken] = np.moveaxis((vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2), 0, -1)
    covariance = symmetrise(fixed).reshape(p.shape)
    return Definite(covariance, cholesky(covariance), broken.reshape(factor.positive.shape))
