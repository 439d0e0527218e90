"""Equations of models and sensors that are not the package's own: which they are, and when they are asked again."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.engine.constants import SourceFingerprint
from trackbench.engine.equations import Equations, Values, by_numpy_alone
from trackbench.engine.symbols import Symbol

#: Of the time of a run, how much comparisons may take.
SHARE = 0.02
#: How far machine code of a user's function may be from NumPy, as a share of the largest number of the same component.
AGREEMENT = 1e-9
#: A difference is rounding where it is no larger than what NumPy makes of inputs that differ by so much, times so much.
ROUNDING, AMPLIFIED = 1e-14, 100.0
#: How many members are compared at once, and by what was just made.
MEMBERS, MEMBERS_AT_FIRST = 64, 256


def is_user_type(kind: type) -> bool:
    """Whether a class is none of the bench's own."""
    return not kind.__module__.startswith("trackbench.")


def is_traced(values: Values) -> bool:
    """Whether a function is called with symbols."""
    return any(isinstance(value, Symbol) for value in values.values())


def user_sources(key: Hashable) -> Iterator[SourceFingerprint]:
    """Of equations of such a key, what they read of models and sensors that are none of the bench's own."""
    if isinstance(key, SourceFingerprint):
        yield key
    elif isinstance(key, tuple):
        for part in key:
            yield from user_sources(part)


def changes_itself(sources: Iterable[SourceFingerprint]) -> str:
    """Of sources that set what later calls read, what the first one sets; else empty."""
    return next((item.refusal for item in sources if item.refusal.startswith(("it sets ", "it deletes "))), "")


class Comparisons:
    """Draws when equations of users are computed a second way in a run, and of which members.

    The first, fourth, sixteenth, ... call of each kind is compared, however long it takes: at the start of a track all
    members may be alike. Others are as far as all take at most ``SHARE`` of the time.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self._calls: Counter[Hashable] = Counter()
        self._next = 0.0

    def due(self, call: Hashable) -> bool:
        """Whether this call is to be compared; ``call``: what tells kinds of calls apart."""
        self._calls[call] += 1
        number = self._calls[call]
        is_power_of_four = number & (number - 1) == 0 and number.bit_length() % 2 == 1
        return is_power_of_four or time.perf_counter() >= self._next

    def drawn(self, members: Indices, count: int) -> Indices:
        """So many of the members, or all, in order."""
        return members if len(members) <= count else np.sort(self.random.choice(members, count, replace=False))

    def took(self, seconds: float) -> None:
        """Wait after a comparison, so long as it took and by chance longer."""
        self._next = time.perf_counter() + seconds / SHARE * (1.0 + self.random.uniform())

    def agree(
        self,
        equations: Equations,
        batch: tuple[int, ...],
        values: Values,
        outputs: Mapping[str, Array],
        expected: Mapping[str, Array],
        places: Indices,
        compared: Indices,
    ) -> bool:
        """Whether outputs are what NumPy gives, to rounding.

        Args:
            equations, batch, values, outputs: as of :func:`trackbench.engine.equations.by_numpy_alone`.
            expected: what that gave of ``places``.
            places, compared: the members that were asked for, and those of them that are compared.
        """
        if not len(compared):
            return True
        columns = np.searchsorted(places, compared)
        pairs = {
            name: (outputs[name].reshape(*value.shape[:-1], -1)[..., compared], value[..., columns].astype(float))
            for name, value in expected.items()
            if name in outputs
        }
        if all(_close(*pair) for pair in pairs.values()):
            return True
        # An ill-conditioned step amplifies rounding: then it does so in NumPy too.
        spread = dict.fromkeys(pairs, 0.0)
        for _ in range(3):
            noisy = {
                name: value * (1.0 + ROUNDING * self.random.standard_normal(np.shape(value)))
                if np.asarray(value).dtype == float
                else value
                for name, value in values.items()
            }
            other = by_numpy_alone(equations, batch, noisy, outputs, places)
            spread |= {name: np.fmax(spread[name], abs(other[name][..., columns] - pairs[name][1])) for name in pairs}
        return all(_close(*pair, AMPLIFIED * spread[name]) for name, pair in pairs.items())


def _close(result: Array, expected: Array, more: Array | float = 0.0) -> bool:
    """Whether numbers ``(components..., members)`` are alike, or differ by at most ``more``."""
    scale = np.max(np.abs(expected), axis=-1, keepdims=True, initial=0.0, where=np.isfinite(expected))
    near = np.isclose(result, expected, 0.0, AGREEMENT * scale, equal_nan=True)
    return bool(np.all(near | (np.abs(result - expected) <= more)))
