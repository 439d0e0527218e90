"""Factors that no motion model should have: that count, draw, ask the time or read a file, or look at the whole batch.

Each is made anew for each engine, so that it begins as it was.
"""

from __future__ import annotations

import array
import contextvars
import ctypes
import datetime
import enum
import functools
import itertools
import operator
import os
import random
import secrets
import threading
import time
import types
import uuid
import weakref
from collections import Counter, UserDict, UserList, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from tests.engine.parameter_places import Plain, Slots, SlotsData

#: Of the state ``(4, members)`` and the time step.
Factor = Callable[[Any, Any], Any]
#: So many calls a counter stays without effect.
AFTER = 25
COUNT = 0


def of_count(count: float) -> float:
    return 1.0 if count < AFTER else 1.2


def counts_item(holder: Any, key: Any = 0) -> Factor:
    def factor(x: Any, dt: Any) -> float:
        holder[key] += 1
        return of_count(holder[key])

    return factor


def counts_attribute(holder: Any, name: str = "gain") -> Factor:
    """By the attribute ``gain``."""

    def factor(x: Any, dt: Any) -> float:
        holder.gain += 1
        return of_count(holder.gain)

    return factor


def counts_by_setattr(holder: Any) -> Factor:
    def factor(x: Any, dt: Any) -> float:
        object.__setattr__(holder, "gain", holder.gain + 1)
        return of_count(holder.gain)

    return factor


def counts_length(holder: Any, add: str) -> Factor:
    """By the number of entries; ``add`` names the method that makes one more."""
    method = getattr(holder, add)

    def factor(x: Any, dt: Any) -> float:
        method(len(holder))
        return of_count(len(holder))

    return factor


def counts_entries(holder: list[int]) -> Factor:
    def factor(x: Any, dt: Any) -> float:
        holder.append(1)
        return of_count(len(holder))

    return factor


def counts_keys(holder: dict[int, int]) -> Factor:
    def factor(x: Any, dt: Any) -> float:
        holder.setdefault(len(holder), 1)
        return of_count(len(holder))

    return factor


def counts_in_an_alias(holder: Any) -> Factor:
    def more(numbers: Any) -> Any:
        numbers += 1
        return numbers

    return lambda x, dt: of_count(float(more(holder)[0]))


def counts_in_a_default() -> Factor:
    def factor(x: Any, dt: Any, calls: list[int] = []) -> float:  # noqa: B006
        calls += [1]
        return of_count(len(calls))

    return factor


def counts_in_a_global() -> Factor:
    globals()["COUNT"] = 0

    def factor(x: Any, dt: Any) -> float:
        global COUNT
        COUNT += 1
        return of_count(COUNT)

    return factor


def counts_in_a_cell() -> Factor:
    count = 0

    def factor(x: Any, dt: Any) -> float:
        nonlocal count
        count += 1
        return of_count(count)

    return factor


def counts_in_the_function() -> Factor:
    def factor(x: Any, dt: Any) -> float:
        factor.calls += 1  # type: ignore[attr-defined]
        return of_count(factor.calls)  # type: ignore[attr-defined]

    factor.calls = 0  # type: ignore[attr-defined]
    return factor


def counts_in_a_class() -> Factor:
    class Holder:
        gain = 0

    return counts_attribute(Holder)


def counts_in_a_metaclass() -> Factor:
    class Meta(type):
        gain = 0

    class Holder(metaclass=Meta):
        pass

    return counts_attribute(Holder)


def counts_in_a_property() -> Factor:
    class Holder:
        def __init__(self) -> None:
            self.calls: list[int] = []

        @property
        def gain(self) -> float:
            self.calls.append(1)
            return of_count(len(self.calls))

    holder = Holder()
    return lambda x, dt: holder.gain


def counts_in_a_descriptor() -> Factor:
    class Counting:
        calls = 0

        def __get__(self, instance: object, owner: type) -> float:
            self.calls += 1
            return of_count(self.calls)

    class Holder:
        gain = Counting()

    holder = Holder()
    return lambda x, dt: holder.gain


def counts_in_an_operator() -> Factor:
    class Number:
        def __init__(self) -> None:
            self.calls = [0]

        def __float__(self) -> float:
            self.calls[0] += 1
            return of_count(self.calls[0])

    number = Number()
    return lambda x, dt: float(number)


def counts_in_a_number() -> Factor:
    class Number(float):
        calls: ClassVar[list[int]] = []

        def __rmul__(self, other: Any) -> Any:
            self.calls.append(1)
            return other * of_count(len(self.calls))

    number = Number(1.0)
    return lambda x, dt: 1.0 * number


def counts_in_an_enum() -> Factor:
    class Calls(enum.Enum):
        OURS: ClassVar[Any] = [0]

    Calls.store = [0]  # type: ignore[attr-defined]
    return lambda x, dt: of_count(operator.iadd(Calls.store, [1]).__len__())  # type: ignore[attr-defined]


def counts_in_an_iterator(numbers: Iterator[int]) -> Factor:
    return lambda x, dt: of_count(next(numbers))


def generator() -> Iterator[int]:
    yield from range(10_000)


def counts_in_a_cache() -> Factor:
    calls: list[int] = []

    @functools.lru_cache
    def number(of: int) -> int:
        calls.append(of)
        return len(calls)

    return lambda x, dt: of_count(number(len(calls)))


def counts_in_a_context() -> Factor:
    variable = contextvars.ContextVar("calls", default=0)

    def factor(x: Any, dt: Any) -> float:
        variable.set(variable.get() + 1)
        return of_count(variable.get())

    return factor


def counts_in_a_thread() -> Factor:
    local = threading.local()
    local.gain = 0
    return counts_attribute(local)


def counts_by_reference() -> Factor:
    holder = Slots_with_reference()
    reference = weakref.ref(holder)

    def factor(x: Any, dt: Any, kept: Any = holder) -> float:
        reference().calls.append(1)  # type: ignore[union-attr]
        return of_count(len(kept.calls))

    return factor


class Slots_with_reference:
    def __init__(self) -> None:
        self.calls: list[int] = []


def counts_by_an_array_function() -> Factor:
    calls = np.zeros(1)

    def factor(x: Any, dt: Any) -> float:
        np.add.at(calls, 0, 1.0)
        return of_count(calls[0])

    return factor


def counts_by_out() -> Factor:
    calls = np.zeros(1)

    def factor(x: Any, dt: Any) -> float:
        np.add(calls, 1.0, out=calls)
        return of_count(calls[0])

    return factor


def counts_behind(wrap: Callable[[Callable[..., float]], Any]) -> Factor:
    """In a function that a library's decorator made."""
    count = itertools.count()
    wrapped = wrap(lambda *_: of_count(next(count)))
    return lambda x, dt: float(wrapped(1.0))


def counts_in_a_list_behind(wrap: Callable[[Callable[..., float]], Any]) -> Factor:
    calls = [0]

    def counted(*_: Any) -> float:
        calls[0] += 1
        return of_count(calls[0])

    wrapped = wrap(counted)
    return lambda x, dt: float(wrapped(1.0))


def counts_in_a_module_named_as_one_of_python() -> Factor:
    scope: dict[str, Any] = {"__name__": "_math", "count": itertools.count()}
    exec("def gain():\n    return next(count)", scope)
    gain = scope["gain"]
    return lambda x, dt: of_count(gain())


def counts_as_text(text: Callable[[Any], str]) -> Factor:
    class Gain:
        count = itertools.count()

        def __str__(self) -> str:
            return "1.0" if next(self.count) < AFTER else "1.2"

    gain = Gain()
    return lambda x, dt: float(text(gain))


def counts_rarely(holder: Any) -> Factor:
    """Only where an object has come far enough, which is not so at first."""

    def factor(x: Any, dt: Any) -> float:
        if np.any(x[0] > 45.0):
            holder[0] += 1
        return 1.0 + 0.01 * holder[0]

    return factor


def remembers_the_last() -> Factor:
    last = [0.0]

    def factor(x: Any, dt: Any) -> Any:
        before, last[0] = last[0], x[0]
        return 1.0 + 1e-3 * np.tanh(before)

    return factor


DECORATORS: dict[str, Callable[[Callable[..., float]], Any]] = {
    "errstate": np.errstate(divide="ignore"),
    "singledispatch": functools.singledispatch,
    "frompyfunc": lambda function: np.frompyfunc(function, 1, 1),
}
COUNTERS: dict[str, Callable[[], Factor]] = {
    **{name: partial(counts_behind, wrap) for name, wrap in DECORATORS.items()},
    **{f"{name}, in a list": partial(counts_in_a_list_behind, wrap) for name, wrap in DECORATORS.items()},
    "a module named _math": counts_in_a_module_named_as_one_of_python,
    "f-string": lambda: counts_as_text(lambda gain: f"{gain}"),
    "%s": lambda: counts_as_text(lambda gain: "%s" % gain),  # noqa: UP031
    "list entry": lambda: counts_item([0]),
    "dict entry": lambda: counts_item({"n": 0}, "n"),
    "array": lambda: counts_item(np.zeros(2)),
    "integer array": lambda: counts_item(np.zeros(2, dtype=int)),
    "record array": lambda: counts_item(np.zeros(1, dtype=[("n", float)])["n"]),
    "view of an array": lambda: counts_item(np.zeros(9)[::2]),
    "alias of an array": lambda: counts_in_an_alias(np.zeros(1)),
    "ufunc.at": counts_by_an_array_function,
    "out": counts_by_out,
    "deque entry": lambda: counts_item(deque([0])),
    "Counter": lambda: counts_item(Counter(), "n"),
    "UserDict": lambda: counts_item(UserDict(n=0), "n"),
    "UserList": lambda: counts_item(UserList([0])),
    "array.array": lambda: counts_item(array.array("d", [0.0])),
    "bytearray": lambda: counts_item(bytearray(1)),
    "memoryview": lambda: counts_item(memoryview(array.array("d", [0.0]))),
    "ctypes": lambda: counts_item((ctypes.c_long * 1)()),
    "Series": lambda: counts_item(pd.Series({"n": 0}), "n"),
    "list": lambda: counts_entries([]),
    "dict": lambda: counts_keys({}),
    "set": lambda: counts_length(set(), "add"),
    "method of a list": lambda: counts_length([], "append"),
    "plain object": lambda: counts_attribute(Plain()),
    "setattr": lambda: counts_by_setattr(Plain()),
    "slots": lambda: counts_attribute(Slots()),
    "slots dataclass": lambda: counts_attribute(SlotsData()),
    "SimpleNamespace": lambda: counts_attribute(types.SimpleNamespace(gain=0)),
    "class": counts_in_a_class,
    "metaclass": counts_in_a_metaclass,
    "property": counts_in_a_property,
    "descriptor": counts_in_a_descriptor,
    "float()": counts_in_an_operator,
    "subclass of float": counts_in_a_number,
    "Enum": counts_in_an_enum,
    "default argument": counts_in_a_default,
    "global": counts_in_a_global,
    "closure cell": counts_in_a_cell,
    "function attribute": counts_in_the_function,
    "itertools.count": lambda: counts_in_an_iterator(itertools.count()),
    "generator": lambda: counts_in_an_iterator(generator()),
    "lru_cache": counts_in_a_cache,
    "ContextVar": counts_in_a_context,
    "threading.local": counts_in_a_thread,
    "weakref": counts_by_reference,
    "rarely, list": lambda: counts_rarely([0]),
    "rarely, array": lambda: counts_rarely(np.zeros(1)),
    "the last state": remembers_the_last,
}


def rarely(draw: Callable[[], float]) -> Factor:
    return lambda x, dt: 1.2 if draw() < 0.02 else 1.0


def of_a_generator() -> Factor:
    rng = np.random.default_rng(3)
    return rarely(rng.random)


def of_its_own_generator() -> Factor:
    return lambda x, dt: 1.2 if np.random.default_rng().random() < 0.02 else 1.0


@dataclass(frozen=True)
class WithGenerator:
    rng: Any


def of_a_field() -> Factor:
    holder = WithGenerator(np.random.default_rng(3))
    return lambda x, dt: 1.2 if holder.rng.random() < 0.02 else 1.0


def imported() -> Factor:
    def factor(x: Any, dt: Any) -> float:
        import random as dice

        return 1.2 if dice.random() < 0.02 else 1.0

    return factor


def read_file(read: Callable[[Path], float]) -> Factor:
    path = Path(os.environ["TRACKBENCH_CACHE"], "number.txt")
    path.write_text("1.0")
    return lambda x, dt: read(path)


def counted_in_a_file() -> Factor:
    path = Path(os.environ["TRACKBENCH_CACHE"], "count.txt")
    path.write_text("0")

    def factor(x: Any, dt: Any) -> float:
        count = int(path.read_text()) + 1
        path.write_text(str(count))
        return of_count(count)

    return factor


def counted_in_the_environment() -> Factor:
    os.environ["CALLS_OF_A_USER"] = "0"

    def factor(x: Any, dt: Any) -> float:
        os.environ["CALLS_OF_A_USER"] = str(int(os.environ["CALLS_OF_A_USER"]) + 1)
        return of_count(int(os.environ["CALLS_OF_A_USER"]))

    return factor


def printing() -> Factor:
    def factor(x: Any, dt: Any) -> float:
        print("called")
        return 1.0

    return factor


#: Of these no two runs are alike.
RANDOM: dict[str, Callable[[], Factor]] = {
    "numpy.random": lambda: lambda x, dt: 1.2 if np.random.uniform() < 0.02 else 1.0,  # noqa: NPY002
    "Generator": of_a_generator,
    "Generator of its own": of_its_own_generator,
    "Generator in a field": of_a_field,
    "random": lambda: rarely(random.random),
    "Random": lambda: rarely(random.Random(3).random),
    "imported": imported,
    "secrets": lambda: lambda x, dt: 1.2 if secrets.randbelow(50) == 0 else 1.0,
    "uuid": lambda: lambda x, dt: 1.2 if uuid.uuid4().int % 50 == 0 else 1.0,
    "urandom": lambda: lambda x, dt: 1.2 if os.urandom(1)[0] < 5 else 1.0,
    "address": lambda: lambda x, dt: 1.2 if id(object()) % 800 < 16 else 1.0,
    "time": lambda: lambda x, dt: 1.0 + 1e-3 * (time.time() % 1.0),
    "perf_counter": lambda: lambda x, dt: 1.0 + 1e-3 * (time.perf_counter() % 1.0),
    "datetime": lambda: lambda x, dt: 1.0 + 1e-9 * datetime.datetime.now().microsecond,
}
INPUT: dict[str, Callable[[], Factor]] = {
    "read_text": lambda: read_file(lambda path: float(path.read_text())),
    "fromfile": lambda: read_file(lambda path: float(np.fromfile(path, sep=" ")[0])),
    "loadtxt": lambda: read_file(lambda path: float(np.loadtxt(path))),
    "exists": lambda: read_file(lambda path: 1.0 if path.exists() else 2.0),
    "size of a file": lambda: read_file(lambda path: os.path.getsize(path) / 3.0),
    "file that counts": counted_in_a_file,
    "environment that counts": counted_in_the_environment,
    "print": printing,
}

LIMIT = 30.0


def slowed_inside(x: Any, part: Any) -> Any:
    result = np.ones_like(x[0])
    result[part] = 0.9
    return result


#: What is said of a member depends on the others.
OF_THE_BATCH: dict[str, Factor] = {
    "shape[-1]": lambda x, dt: 1.2 if x.shape[-1] > 10 else 1.0,
    "shape[1]": lambda x, dt: 1.2 if x.shape[1] % 2 == 0 else 1.0,
    "a share of the shape": lambda x, dt: 1.0 + 1.0 / (1 + x.shape[-1]),
    "len": lambda x, dt: 1.2 if len(x[0]) > 10 else 1.0,
    "size": lambda x, dt: 1.2 if x.size > 40 else 1.0,
    "np.size": lambda x, dt: 1.2 if np.size(x) > 40 else 1.0,
    "np.shape": lambda x, dt: 1.2 if np.shape(x)[1] > 10 else 1.0,
    "middle members": lambda x, dt: slowed_inside(x, slice(1, -1)),
    "some members": lambda x, dt: slowed_inside(x, slice(3, 5)),
    "the middle member": lambda x, dt: slowed_inside(x, [x.shape[-1] // 2]),
    "the first member": lambda x, dt: 1.0 + 0.01 * x[2, :1],
    "the next member": lambda x, dt: 1.0 + 0.01 * x[2, ..., ::-1],
    "rolled": lambda x, dt: 1.0 + 0.01 * np.roll(x[2], 1),
    "sum of members": lambda x, dt: 1.0 + 1e-3 * np.sum(x[2], axis=-1)[..., None],
    "mean of members": lambda x, dt: 1.0 + 1e-3 * x[2].mean(axis=-1)[..., None],
    "largest of members": lambda x, dt: 1.0 + 1e-3 * np.max(x[2], axis=-1, keepdims=True),
    "largest of all": lambda x, dt: 1.0 + 1e-3 * np.max(x[2]),
    "cumulative": lambda x, dt: 1.0 + 1e-3 * np.cumsum(x[2], axis=-1),
    "sorted": lambda x, dt: 1.0 + 1e-3 * np.sort(x[2]),
    "median": lambda x, dt: 1.0 + 1e-3 * np.median(x[2]),
    "if all": lambda x, dt: 1.2 if np.all(x[0] > LIMIT) else 1.0,
    "if any": lambda x, dt: 1.2 if np.any(x[0] > LIMIT) else 1.0,
    "if not any": lambda x, dt: 1.0 if not np.any(x[0] < LIMIT) else 1.2,
    "method all": lambda x, dt: 1.2 if (x[0] > LIMIT).all() else 1.0,
    "if the largest": lambda x, dt: 1.2 if np.max(x[0]) > LIMIT else 1.0,
    "built-in all": lambda x, dt: 1.2 if all((x[0] > LIMIT).reshape(-1)) else 1.0,
    "all of both": lambda x, dt: 1.2 if np.all(x[0] > LIMIT) and np.all(x[1] > 0) else 1.0,
    "all along members": lambda x, dt: np.where(np.all(x[0] > LIMIT, axis=-1)[..., None], 1.2, 1.0),
}


def by_try(x: Any, dt: Any) -> float:
    try:
        return 1.0 if float(dt) > 0.05 else 1.1
    except TypeError:
        return 1.2


def by_rounding(x: Any, dt: Any) -> float:
    try:
        return 1.0 + 0.1 * round(dt, 1)
    except TypeError:
        return 1.2


def by_a_method(x: Any, dt: Any) -> Any:
    try:
        return 1.0 + 1e-3 * x[0].clip(0.0, LIMIT)
    except AttributeError:
        return 1.2


#: Each member by itself, but by another way for arrays than for symbols; or as it should be.
BRANCHES: dict[str, Factor] = {
    "where": lambda x, dt: np.where(x[0] > LIMIT, 1.2, 1.0),
    "all, with the same outcome": lambda x, dt: 1.0 if np.all(x[0] > LIMIT) else np.where(x[0] > LIMIT, 1.0, 1.0),
    "any, with the same outcome": lambda x, dt: np.where(x[0] > LIMIT, 1.2, 1.0) if np.any(x[0] > LIMIT) else 1.0,
    "all of components": lambda x, dt: np.where(np.all(x[:2] > LIMIT / 2, axis=0), 1.2, 1.0),
    "largest of components": lambda x, dt: 1.0 + 1e-3 * np.max(x[2:], axis=0),
    "isinstance": lambda x, dt: 1.0 if isinstance(x, np.ndarray) else 1.2,
    "type": lambda x, dt: 1.0 if type(x) is np.ndarray else 1.2,
    "isscalar": lambda x, dt: 1.0 if np.isscalar(dt) else 1.2,
    "hasattr": lambda x, dt: 1.0 if hasattr(x, "strides") else 1.2,
    "try": by_try,
    "try to round": by_rounding,
    "try a method": by_a_method,
    "class": lambda x, dt: 1.0 if x.__class__ is np.ndarray else 1.2,
    "type of the time step": lambda x, dt: 1.0 if type(dt) is float else 1.2,
    "a key of a dict": lambda x, dt: {0.1: 1.2}.get(dt, 1.0),
    "text": lambda x, dt: 1.2 if f"{dt}" == "0.1" else 1.0,
    "if on the time step": lambda x, dt: 1.2 if dt > 0.05 else 1.0,
    "callable": lambda x, dt: 1.0 if callable(x.tobytes) else 1.2,
}
STATELESS = {**OF_THE_BATCH, **BRANCHES}
