"""Equations of models and sensors that are not the package's own, and all that they depend on.

What is traced is called once, and stands for all calls. So such a function is traced only if a second call gives the
same and leaves everything as it was.
"""

from __future__ import annotations

import hashlib
import sys
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from copy import deepcopy
from functools import cached_property, partial
from types import CellType, CodeType, FunctionType, MethodType, ModuleType, SimpleNamespace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from trackbench.engine.equations import Values
from trackbench.engine.graph import Untraceable
from trackbench.engine.symbols import Symbol

#: Packages whose source does not change, and whose objects are not looked through.
LIBRARIES = frozenset({"trackbench", "pydantic", "pydantic_core", "numpy", "scipy", *sys.stdlib_module_names})

#: What wraps a function, and the attributes under which each has it.
WRAPPERS = cached_property, partial, property, staticmethod, classmethod, MethodType
WRAPPED = ("func", "args", "keywords", "fget", "__func__", "__self__", "__wrapped__")
#: Of a function that refers to a name that is not yet bound.
EMPTY = CellType()


class SourceFingerprint:
    """All that the equations of a model or of a class depend on: what it keeps, its source, and the names in that.

    Two that are equal are the same to them. What cannot be looked through is equal to itself alone.
    """

    def __init__(self, value: Any) -> None:
        try:
            self._parts = _Reader().read(value)
        # An object may do anything when it is asked for its attributes.
        except Exception:
            self._parts = _Itself(value)
        # A kernel is looked up at every step.
        self._hash = hash(self._parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SourceFingerprint) and self._parts == other._parts

    def __hash__(self) -> int:
        return self._hash


class _Itself(NamedTuple):
    """Something that is equal to itself alone; it is kept, so that nothing else takes its place."""

    of: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and self.of is other.of

    def __hash__(self) -> int:
        return id(self.of)


class _Reader:
    """Looks through an object, and comes to each part once."""

    def __init__(self) -> None:
        self._seen: dict[int, int] = {}
        self._kept: list[Any] = []

    def read(self, value: Any) -> Hashable:
        if value is None or isinstance(value, str | bytes | int | float | complex | np.generic | CodeType):
            # A NaN is not equal to itself.
            return type(value), value if value == value else repr(value)
        number = self._seen.setdefault(id(value), len(self._seen))
        if number < len(self._kept):
            return "as before", number
        self._kept.append(value)
        if isinstance(value, np.ndarray) and value.dtype != object:
            return value.shape, value.dtype.str, hashlib.sha256(value.tobytes()).digest()
        if isinstance(value, dict):
            return type(value), self._all(value.keys()), self._all(value.values())
        if isinstance(value, list | tuple | set | frozenset | deque | np.ndarray):
            return type(value), self._all(value)
        if isinstance(value, np.random.Generator):
            return self.read(value.bit_generator.state)
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, type):
            own = [vars(kind).items() for kind in value.__mro__ if not _of_library(kind)]
            # What begins with two lines, pydantic and Python make of the rest.
            attributes = [[item for item in items if not item[0].startswith(("__", "_abc"))] for items in own]
            return _Itself(value), self._all(attributes)
        if isinstance(value, WRAPPERS) or hasattr(value, "__wrapped__"):
            return self._all(getattr(value, name, None) for name in WRAPPED)
        if isinstance(value, SimpleNamespace):
            return self.read(vars(value))
        if isinstance(value, ModuleType) or _of_library(type(value)) or not hasattr(value, "__dict__"):
            return _Itself(value)
        return self._all((type(value), vars(value), getattr(value, "__pydantic_private__", None)))

    def _all(self, values: Iterable[Any]) -> Hashable:
        return tuple([self.read(value) for value in values])

    def _function(self, function: FunctionType) -> Hashable:
        """Its code, and what the names in it stand for."""
        if _of_library(function):
            return _Itself(function)
        code, cells = function.__code__, [cell.cell_contents for cell in function.__closure__ or () if cell != EMPTY]
        names = sorted(_names(code))
        values = [_named(function.__globals__.get(name), names, set()) for name in names]
        return self._all([code, function.__defaults__, function.__kwdefaults__, vars(function), cells, *values])


def _names(code: CodeType) -> set[str]:
    """The names in a function and in those within it."""
    return set(code.co_names).union(*(_names(part) for part in code.co_consts if isinstance(part, CodeType)))


def _named(value: Any, names: list[str], modules: set[str]) -> Any:
    """What a name stands for: of a user's module, what the names in it stand for."""
    if not isinstance(value, ModuleType) or value.__name__.partition(".")[0] in LIBRARIES:
        return value
    if value.__name__ in modules:
        return None
    return [_named(vars(value).get(name), names, modules | {value.__name__}) for name in names]


def _of_library(kind: Any) -> bool:
    return str(getattr(kind, "__module__", "builtins")).partition(".")[0] in LIBRARIES


T = TypeVar("T")


def is_user_type(kind: type) -> bool:
    """Whether a class is none of the bench's own."""
    return not kind.__module__.startswith("trackbench.")


def has_user_equations(key: Hashable) -> bool:
    """Whether equations of such a key call a function that is none of the bench's own."""
    return isinstance(key, SourceFingerprint) or (isinstance(key, tuple) and any(map(has_user_equations, key)))


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
    pure = not any(map(is_user_type, kinds))

    def of_values(values: Values) -> Values:
        if pure or not is_traced(values):
            return function(with_values(own, values), values)
        # Trace a copy, so that the model is not changed.
        apart = with_values(deepcopy(own), values)
        keepers = [*models(apart), *kinds]
        first = function(apart, values)
        # What is computed at the first call and kept, such as a cached property, is there at the second.
        before = SourceFingerprint(keepers)
        again = function(apart, values)
        if first.keys() != again.keys() or not all(_alike(first[name], again[name]) for name in again):
            raise Untraceable("a second call gives something else: it draws random numbers, or counts")
        if SourceFingerprint(keepers) != before:
            raise Untraceable("a model or sensor keeps something from call to call")
        return again

    return of_values


def _alike(first: Any, again: Any) -> bool:
    if isinstance(first, Symbol) and isinstance(again, Symbol):
        return np.array_equal(first.nodes, again.nodes)
    if isinstance(first, Symbol) or isinstance(again, Symbol) or first is None or again is None:
        return first is again
    return np.array_equal(first, again, equal_nan=True)
