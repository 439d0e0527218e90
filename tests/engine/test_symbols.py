"""Random functions, traced and compiled, against NumPy."""

from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.engine.programs import BATCHES, random_program, random_values

from trackbench.engine.kernels import Kernels

#: How much more than some random rounding errors the difference may be.
MARGIN = 30.0


def agrees(found: Any, expected: Any, disturbed: Any) -> Any:
    """Where a value is that of NumPy, as far as rounding errors leave it determined."""
    same = (found == expected) | ((found != found) & (expected != expected))
    if expected.dtype == bool:
        return same | np.any(disturbed != expected, axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        change = np.where(disturbed == expected, 0.0, np.abs(disturbed - expected))
        # Where an error makes a value infinite, or no number, it may be any.
        bound = np.nan_to_num(np.max(change, axis=0), nan=np.inf)
        return same | (np.abs(found - expected) <= 1e-12 * np.abs(expected) + MARGIN * bound) | np.isposinf(bound)


def compare(random: Random, kernels: Kernels, length: int, special: float) -> None:
    batch = random.choice(BATCHES)
    values = random_values(random, batch, special=special)
    program = random_program(random, values, batch, length)
    equations = program.equations()
    rng = np.random.default_rng(1)
    with np.errstate(all="ignore"):
        expected = program(values)
        disturbed = [program.disturbed(values, rng) for _ in range(20)]
        before = {name: np.copy(value) for name, value in values.items()}
        found = kernels(equations, values)
    assert equations.key not in kernels.untraced, kernels.untraced[equations.key]
    for name, value in values.items():
        np.testing.assert_array_equal(value, before[name])
    assert found.keys() == expected.keys()
    for name, wanted in expected.items():
        full = wanted.shape[: wanted.ndim - len(batch)] + batch
        assert found[name].shape == full
        others = np.stack([np.broadcast_to(other[name], full) for other in disturbed])
        wrong = ~agrees(found[name], np.broadcast_to(wanted, full), others)
        assert not np.any(wrong), (name, found[name][wrong], np.broadcast_to(wanted, full)[wrong])


RANDOM = st.randoms(use_true_random=False)
SETTINGS = {"deadline": None, "suppress_health_check": list(HealthCheck)}


@given(random=RANDOM, length=st.integers(1, 12))
@settings(max_examples=30, **SETTINGS)
def test_a_random_function_gives_what_numpy_gives(kernels: Kernels, random: Random, length: int) -> None:
    compare(random, kernels, length, special=0.0)


@given(random=RANDOM, length=st.integers(1, 8))
@settings(max_examples=30, **SETTINGS)
def test_infinities_and_nan_are_those_of_numpy(kernels: Kernels, random: Random, length: int) -> None:
    compare(random, kernels, length, special=0.3)


@pytest.mark.slow
@given(random=RANDOM, length=st.integers(1, 30), special=st.sampled_from([0.0, 0.05, 0.3]))
@settings(max_examples=1500, **SETTINGS)
def test_many_random_functions(kernels: Kernels, random: Random, length: int, special: float) -> None:
    compare(random, kernels, length, special)
