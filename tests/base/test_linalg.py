"""Small dense linear algebra with the batch axes last."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackbench.base import linalg

SIZES = st.integers(1, 6)
BATCHES = st.sampled_from([(), (1,), (5,), (2, 3)])
SEEDS = st.integers(0, 2**32 - 1)


def leading(a: np.ndarray, core: int) -> np.ndarray:
    """The batch axes first, as numpy.linalg has them."""
    return np.moveaxis(a, range(core), range(-core, 0))


def definite(random: np.random.Generator, size: int, batch: tuple[int, ...]) -> np.ndarray:
    root = random.normal(size=(size, size, *batch))
    return np.einsum("ik...,jk...->ij...", root, root) + 0.1 * linalg.expand(np.eye(size), root)


@given(SIZES, SIZES, SIZES, BATCHES, BATCHES, SEEDS)
def test_products_agree_with_numpy(n, m, k, batch_a, batch_b, seed):
    if batch_a and batch_b:
        batch_b = batch_a
    random = np.random.default_rng(seed)
    a, b = random.normal(size=(n, m, *batch_a)), random.normal(size=(m, k, *batch_b))
    x, y, p = random.normal(size=(m, *batch_b)), random.normal(size=(n, *batch_b)), random.normal(size=(m, m, *batch_b))
    la, lb, lp = leading(a, 2), leading(b, 2), leading(p, 2)
    lat = np.swapaxes(la, -1, -2)
    for found, expected, core in [
        (linalg.matmul(a, b), la @ lb, 2),
        (linalg.matmul_transposed(a, np.swapaxes(b, 0, 1)), la @ lb, 2),
        (linalg.gram(a), lat @ la, 2),
        (linalg.quadratic(a, p), la @ lp @ lat, 2),
        (linalg.matvec(a, x), (la @ leading(x, 1)[..., None])[..., 0], 1),
        (linalg.apply_transposed(a, y), (lat @ leading(y, 1)[..., None])[..., 0], 1),
    ]:
        np.testing.assert_allclose(leading(found, core), expected, atol=1e-12)


@given(SIZES, SIZES, BATCHES, SEEDS)
def test_gram_is_symmetric_to_the_last_bit(n, m, batch, seed):
    g = linalg.gram(np.random.default_rng(seed).normal(size=(n, m, *batch)))
    np.testing.assert_array_equal(g, np.swapaxes(g, 0, 1))


def test_matrices_and_vectors_from_numbers_and_arrays():
    batch = np.array([1.0, 2.0])
    np.testing.assert_array_equal(linalg.vector([batch, 3]), [[1, 2], [3, 3]])
    np.testing.assert_array_equal(linalg.matrix([[batch, 0], [5, -batch]]), [[[1, 2], [0, 0]], [[5, 5], [-1, -2]]])
    assert linalg.matrix([[1, 2, 3]]).shape == (1, 3)
    np.testing.assert_array_equal(linalg.vector([np.float32(0.5), batch, 3]), [[0.5, 0.5], [1, 2], [3, 3]])


def test_symmetrise_and_expand():
    p = np.array([[[1.0], [2.0]], [[4.0], [3.0]]])
    np.testing.assert_array_equal(linalg.symmetrise(p)[..., 0], [[1, 3], [3, 3]])
    assert linalg.expand(np.eye(2), np.empty((2, 2, 5, 6))).shape == (2, 2, 1, 1)


@given(SIZES, BATCHES, SEEDS)
def test_cholesky_agrees_with_numpy(size, batch, seed):
    random = np.random.default_rng(seed)
    p, b = definite(random, size, batch), random.normal(size=(size, 3, *batch))
    factor = linalg.cholesky(p)
    lower = np.linalg.cholesky(leading(p, 2))
    assert factor.positive.shape == batch
    assert np.all(factor.positive)
    np.testing.assert_allclose(leading(factor.lower(), 2), lower, atol=1e-10)
    np.testing.assert_allclose(leading(factor.whiten(b), 2), np.linalg.solve(lower, leading(b, 2)), atol=1e-8)
    np.testing.assert_allclose(factor.whiten(b[:, 0]), factor.whiten(b)[:, 0], atol=1e-14)


BAD = [np.diag([1.0, -1e-3, 1.0]), np.zeros((3, 3)), np.full((3, 3), np.nan), np.ones((3, 3))]


@pytest.mark.parametrize("bad", BAD)
def test_cholesky_marks_what_has_no_factor(bad):
    stack = np.stack([np.eye(3), bad, 2 * np.eye(3)], axis=-1)
    np.testing.assert_array_equal(linalg.cholesky(stack).positive, [True, False, True])


@given(SIZES, SEEDS)
def test_a_definite_matrix_is_not_touched(size, seed):
    p = definite(np.random.default_rng(seed), size, (4,))
    result = linalg.ensure_definite(p)
    assert result.repaired is None
    assert result.covariance is p


@given(SIZES, SEEDS)
def test_repair_gives_the_nearest_definite_matrix_and_spares_the_others(size, seed):
    random = np.random.default_rng(seed)
    p = definite(random, size, (3,))
    broken = p[:, :, 1] - (np.linalg.eigvalsh(p[:, :, 1])[0] + 0.5) * np.eye(size)
    p[:, :, 1] = broken
    result = linalg.ensure_definite(p)
    np.testing.assert_array_equal(result.repaired, [False, True, False])
    np.testing.assert_allclose(result.covariance[:, :, ::2], p[:, :, ::2], rtol=1e-15)
    fixed = result.covariance[:, :, 1]
    np.testing.assert_array_equal(fixed, fixed.T)
    np.testing.assert_allclose(result.factor.lower()[:, :, 1] @ result.factor.lower()[:, :, 1].T, fixed, atol=1e-12)
    # Nearest: what is added is what lifts the negative eigenvalues to the floor.
    values = np.linalg.eigvalsh(broken)
    lifted = np.maximum(values, linalg.RELATIVE_FLOOR * max(values[-1], np.finfo(float).tiny))
    assert np.linalg.norm(fixed - broken) == pytest.approx(np.linalg.norm(lifted - values), rel=1e-6)


def test_a_matrix_that_is_not_finite_is_left_and_not_marked():
    p = np.stack([np.eye(2), np.full((2, 2), np.nan), -np.eye(2)], axis=-1)
    result = linalg.ensure_definite(p)
    np.testing.assert_array_equal(result.repaired, [False, False, True])
    assert np.isnan(result.covariance[:, :, 1]).all()
    assert np.isfinite(result.covariance[:, :, [0, 2]]).all()
