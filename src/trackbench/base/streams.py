"""Random streams, each derived from a seed, a scenario, a run and a purpose alone.

The noise of run 17 does not depend on how many runs, workers, trackers or other sensors there are.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random.bit_generator import ISeedSequence

from trackbench.base.types import Array

_Words = npt.NDArray[np.uint32]
#: Largest number of generators that are made faster one by one than in one call.
FEW = 12


def stream(seed: int, scenario: str, run: int, purpose: str) -> np.random.Generator:
    """Return the random generator of one run for one purpose: a sensor's name, or the draw of the initial error."""
    words = (*_split_32_bits(seed), *_key(scenario), *_split_32_bits(run), *_key(purpose))
    # SeedSequence accepts a list of whole numbers too, but takes four times as long.
    entropy = np.array(words, dtype=np.uint32)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy)))


def streams(seed: int, scenario: str, runs: range, purpose: str) -> list[np.random.Generator]:
    """Return the generators of ``stream`` for all runs, five times faster.

    The numbers of all runs need equally many 32-bit words.
    """
    if len(runs) <= FEW:
        return [stream(seed, scenario, run, purpose) for run in runs]
    numbers = np.array([*map(_split_32_bits, runs)]).T
    entropy = np.broadcast_arrays(*_split_32_bits(seed), *_key(scenario), *numbers, *_key(purpose))
    states = _mixed(np.array(entropy, dtype=np.uint32))
    return [np.random.Generator(np.random.PCG64(_State(state))) for state in states]  # type: ignore[arg-type]


def fast_streams(seed: int, scenario: str, runs: range, purpose: str) -> list[np.random.Generator]:
    """Return a generator for each run that draws faster than one of ``streams``, and gives different numbers."""
    digests = (hashlib.sha256(repr((seed, scenario, run, purpose)).encode()).digest() for run in runs)
    states = (np.frombuffer(digest, np.uint64) for digest in digests)
    return [np.random.Generator(np.random.SFC64(_State(state))) for state in states]  # type: ignore[arg-type]


class _State(ISeedSequence):
    """Seed of a NumPy generator, as 64-bit words that are already mixed."""

    def __init__(self, words: npt.NDArray[np.uint64]) -> None:
        self._words = words

    def generate_state(self, n_words: int, dtype: Any = np.uint64) -> Any:
        return self._words[:n_words]


def _mixed(entropy: _Words) -> npt.NDArray[np.uint64]:
    """Compute seeds ``(runs, 4)`` from at least four ``(words, runs)``, as ``np.random.SeedSequence`` does.

    Source: O'Neill (2015), "Developing a seed_seq alternative", seed_seq_fe with a pool of four words.
    """
    powers = np.arange(4 * len(entropy) + 1, dtype=np.uint32)
    constants = 0x43B0D7E5 * 0x931E8875**powers
    pool, used = _hashed(entropy[:4], constants[:5]), 4
    for number, word in enumerate(entropy):
        targets = [place for place in range(4) if place != number]
        hashed = _hashed(pool[number] if number < 4 else word, constants[used : used + len(targets) + 1])
        mixed = 0xCA01F9DD * pool[targets] - 0x4973F715 * hashed
        pool[targets] = mixed ^ (mixed >> 16)
        used += len(targets)
    return _hashed(np.tile(pool, (2, 1)), 0x8B51F9DD * 0x58F38DED ** powers[:9]).T.copy().view(np.uint64)


def _hashed(words: _Words, constants: _Words) -> _Words:
    words = (words ^ constants[:-1, None]) * constants[1:, None]
    return words ^ (words >> np.uint32(16))


@lru_cache(maxsize=1024)
def _key(name: str) -> tuple[int, ...]:
    return _split_32_bits(int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little"))


def _split_32_bits(number: int) -> tuple[int, ...]:
    low, high = number & 0xFFFFFFFF, number >> 32
    return (low, *_split_32_bits(high)) if high else (low,)


class RunStreams:
    """Generators of several runs for one purpose; drawn arrays are ``(*shape, runs)``, each run contiguous."""

    def __init__(self, each: Sequence[np.random.Generator]) -> None:
        self.each = each
        """List of one random generator for each run."""

    def standard_normal(self, shape: int | tuple[int, ...] = ()) -> Array:
        """Draw numbers ``(*shape, runs)`` from a normal distribution of mean 0 and variance 1."""
        return self._drawn(np.random.Generator.standard_normal, shape)

    def random(self, shape: int | tuple[int, ...] = ()) -> Array:
        """Draw numbers ``(*shape, runs)`` from a uniform distribution from 0 to 1."""
        return self._drawn(np.random.Generator.random, shape)

    def _drawn(self, draw: Callable[..., Array], shape: int | tuple[int, ...]) -> Array:
        shape = (shape,) if isinstance(shape, int) else shape
        drawn = np.empty((len(self.each), math.prod(shape)))
        for random, numbers_of_run in zip(self.each, drawn, strict=True):
            draw(random, out=numbers_of_run)
        return np.moveaxis(drawn.reshape(len(drawn), *shape), 0, -1)
