"""Equations of models and sensors from elsewhere, of which nobody knows what else they do.

What is traced is called once, and stands for all calls. So such a function is traced only if a second call gives the
same and leaves everything as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from copy import deepcopy
from typing import Any, TypeVar

import numpy as np

from trackbench.engine.content import Content
from trackbench.engine.equations import Values
from trackbench.engine.graph import Untraceable
from trackbench.engine.symbols import Symbol

T = TypeVar("T")


def from_elsewhere(kind: type) -> bool:
    """Whether a class is none of the bench's own."""
    return not kind.__module__.startswith("trackbench.")


def form_of(kind: type) -> Hashable:
    """What equations of a class depend on: which it is; of one from elsewhere, its source too."""
    return Content(kind) if from_elsewhere(kind) else kind


def of_elsewhere(key: Hashable) -> bool:
    """Whether equations of such a key call a function that is none of the bench's own."""
    return isinstance(key, Content) or (isinstance(key, tuple) and any(map(of_elsewhere, key)))


def is_traced(values: Values) -> bool:
    """Whether a function is called with symbols."""
    return any(isinstance(value, Symbol) for value in values.values())


def settled(
    function: Callable[[T, Values], Values],
    own: T,
    with_values: Callable[[T, Values], T],
    models: Callable[[T], Iterable[Any]],
    sensors: Iterable[type] = (),
) -> Callable[[Values], Values]:
    """A function of a filter or motion model and of values, as one of values that can be traced.

    Args:
        function: of what ``with_values`` gives, and of the values.
        own: the filter or model.
        with_values: puts the options that are among the values in place of its own.
        models: the motion models of it.
        sensors: the kinds on which the function depends too.
    """
    kinds = [*map(type, models(own)), *sensors]
    known = not any(map(from_elsewhere, kinds))

    def of_values(values: Values) -> Values:
        if known or not is_traced(values):
            return function(with_values(own, values), values)
        # What a trace does to a model is not to be noticed.
        apart = with_values(deepcopy(own), values)
        keepers = [*models(apart), *kinds]
        first = function(apart, values)
        # What is computed at the first call and kept, such as a cached property, is there at the second.
        before = Content(keepers)
        again = function(apart, values)
        if not _same(first, again):
            raise Untraceable("a second call gives something else: it draws random numbers, or counts")
        if Content(keepers) != before:
            raise Untraceable("a model or sensor keeps something from call to call")
        return again

    return of_values


def _same(first: Values, again: Values) -> bool:
    return first.keys() == again.keys() and all(_alike(first[name], again[name]) for name in again)


def _alike(one: Any, other: Any) -> bool:
    if isinstance(one, Symbol) and isinstance(other, Symbol):
        return np.array_equal(one.nodes, other.nodes)
    if isinstance(one, Symbol) or isinstance(other, Symbol) or one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)
