"""The likelihood of a state under measurements to come, for the smoother of several motion models."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Mask
from trackbench.base.units import difference
from trackbench.filters.base import wrap_components

#: What differs by no more is the same, relative to the variances before.
ROUNDING = 1e-9


class Future(NamedTuple):
    """The likelihood of a state under measurements to come: the ratio of two Gaussians, before and after them.

    In coordinates ``u`` with ``x = mean + L u``, in which the Gaussian before is standard normal, it is proportional to
    ``exp(-u^T J u / 2 + h^T u)``.
    """

    mean: Array
    """``(n, ...)``"""
    factor: linalg.Cholesky
    """``L``"""
    information: Array
    """``J``, ``(n, n, ...)``"""
    gradient: Array
    """``h``, ``(n, ...)``"""
    angular: tuple[int, ...]
    """Which components are angles."""

    def joined(self, part: Gaussian) -> tuple[Gaussian, Array, Mask | None]:
        """A Gaussian given those measurements, the logarithm of its likelihood, and where it had to be repaired.

        The likelihoods of several parts have a common factor.
        """
        whiten = self.factor.whiten
        away = whiten(difference(part.mean, self.mean, self.angular))
        spread = linalg.ensure_definite(whiten(np.swapaxes(whiten(part.covariance), 0, 1)))
        # With A = B B^T and M = 1 + B^T J B the covariance A^-1 + J is inverted by B M^-1 B^T.
        root = spread.factor.lower()
        size = len(root)
        scaled = linalg.matmul(np.swapaxes(root, 0, 1), linalg.matmul(self.information, root))
        m = linalg.ensure_definite(linalg.symmetrise(scaled) + linalg.expand(np.eye(size), scaled))
        after = m.factor.whiten(np.swapaxes(root, 0, 1))
        slope = self.gradient - linalg.apply(self.information, away)
        step = linalg.apply(after, slope)
        logarithm = np.einsum("i...,i...->...", self.gradient + slope, away) + np.einsum("i...,i...->...", step, step)
        determinant = np.log(np.prod(np.stack(m.factor.inverse_diagonal), axis=0))
        lower = self.factor.lower()
        mean = self.mean + linalg.apply(lower, away + linalg.apply_transposed(after, step))
        covariance = linalg.gram(linalg.matmul_transposed(after, lower))
        return Gaussian(wrap_components(mean, self.angular), covariance), 0.5 * logarithm + determinant, m.repaired


def future(before: Gaussian, after: Gaussian, angular: tuple[int, ...]) -> Future:
    """What made ``after``, a smoothed belief, of ``before``.

    Where ``before`` stands for several Gaussians, ``after`` may be wider in some direction; of that it says nothing.
    """
    factor = linalg.ensure_definite(before.covariance).factor
    spread = linalg.symmetrise(factor.whiten(np.swapaxes(factor.whiten(after.covariance), 0, 1)))
    change = factor.whiten(difference(after.mean, before.mean, angular))
    unit = np.broadcast_to(linalg.expand(np.eye(len(change)), spread), spread.shape)
    inverse = linalg.gram(linalg.cholesky(spread).whiten(unit))
    information, gradient = inverse - unit, linalg.apply(inverse, change)
    # What overflows is wider.
    with np.errstate(over="ignore", invalid="ignore"):
        wider = ~linalg.cholesky((1.0 + ROUNDING) * unit - spread).positive
    if np.any(wider):
        values, vectors = np.linalg.eigh(np.moveaxis(spread[..., wider], -1, 0))
        inverses = np.where(values < 1.0, 1.0 / np.maximum(values, ROUNDING), 0.0)[:, None]
        across = np.swapaxes(vectors, 1, 2)
        information[..., wider] = np.moveaxis(vectors * np.maximum(inverses - 1.0, 0.0) @ across, 0, -1)
        gradient[..., wider] = linalg.apply(np.moveaxis(vectors * inverses @ across, 0, -1), change[..., wider])
    return Future(before.mean, factor, information, gradient, angular)
