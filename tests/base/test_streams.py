"""Random streams: generators of many runs are made at once, and are those of NumPy's seed sequence to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.streams import _mixed, stream, streams

#: Numbers of one, two and three words of 32 bits.
NUMBERS = (0, 1, 2**32 - 1, 2**32, 2**63, 2**70 + 3)


@pytest.mark.parametrize("seed", NUMBERS)
@pytest.mark.parametrize(("scenario", "purpose"), [("highway", "radar"), ("", "a name " * 20), ("x", "")])
def test_generators_of_many_runs_are_those_of_single_runs(seed: int, scenario: str, purpose: str) -> None:
    for first in NUMBERS:
        runs = range(first - 40, first + 1) if first == 2**32 - 1 else range(first, first + 40)
        made = [generator.bit_generator.state for generator in streams(seed, scenario, runs, purpose)]
        assert made == [stream(seed, scenario, run, purpose).bit_generator.state for run in runs]


@pytest.mark.parametrize("words", [4, 5, 9])
def test_states_are_those_of_numpys_seed_sequence(words: int) -> None:
    entropy = np.random.default_rng(words).integers(2**32, size=(words, 50), dtype=np.uint32)
    expected = [np.random.SeedSequence(column).generate_state(4, np.uint64) for column in entropy.T]
    np.testing.assert_array_equal(_mixed(entropy), expected)


def test_runs_whose_numbers_differ_in_length_are_refused() -> None:
    with pytest.raises(ValueError, match="inhomogeneous"):
        streams(0, "highway", range(2**32 - 1, 2**32 + 40), "radar")
