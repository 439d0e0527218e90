"""Places where a parameter of a motion model can live: each a function that reads it, and one that changes it."""

from __future__ import annotations

import argparse
import array
import contextvars
import ctypes
import enum
import functools
import os
import sys
import threading
import types
import weakref
from collections import UserDict, deque, namedtuple
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

#: Reads the parameter, of the state and the time step; and changes it.
Place = tuple[Callable[[Any, Any], Any], Callable[[float], None]]
GAIN = 1.0
OTHER_GAIN = 1.0
THIS = sys.modules[__name__]


class Plain:
    def __init__(self) -> None:
        self.gain = 1.0


class Slots:
    __slots__ = ("gain",)

    def __init__(self) -> None:
        self.gain = 1.0


@dataclass
class Data:
    gain: float = 1.0


@dataclass(slots=True)
class SlotsData:
    gain: float = 1.0


@dataclass(frozen=True)
class FrozenData:
    gain: float = 1.0


Named = namedtuple("Named", "gain")


class Descriptor:
    def __init__(self) -> None:
        self.value = 1.0

    def __get__(self, instance: object, owner: type) -> float:
        return self.value


class Computed:
    """Its attributes are computed when they are asked for."""

    store: ClassVar[dict[str, float]] = {}

    def __getattr__(self, name: str) -> float:
        return self.store[name]


def setter(holder: Any, name: str = "gain") -> Callable[[float], None]:
    return lambda value: object.__setattr__(holder, name, value)


def attribute_of(holder: Any) -> Place:
    return (lambda x, dt: holder.gain), setter(holder)


def item_of(holder: Any, key: Any = 0, scale: float = 1.0) -> Place:
    return (lambda x, dt: holder[key] / scale), lambda value: holder.__setitem__(key, type(holder[key])(value * scale))


def module_global() -> Place:
    return (lambda x, dt: GAIN), lambda value: setattr(THIS, "GAIN", value)


def module_attribute() -> Place:
    module = types.ModuleType("parameters_of_a_user")
    module.gain = 1.0  # type: ignore[attr-defined]
    scope = {"parameters": module}
    exec("def factor(x, dt):\n    return parameters.gain", scope)
    return scope["factor"], lambda value: setattr(module, "gain", value)


def by_getattr() -> Place:
    return (lambda x, dt: getattr(THIS, "OTHER_" + "GAIN")), lambda value: setattr(THIS, "OTHER_GAIN", value)


def by_globals() -> Place:
    return (lambda x, dt: globals()["OTHER_GAIN"]), lambda value: setattr(THIS, "OTHER_GAIN", value)


def closure_cell() -> Place:
    gain = 1.0

    def change(value: float) -> None:
        nonlocal gain
        gain = value

    return (lambda x, dt: gain), change


def default_argument() -> Place:
    def factor(x: Any, dt: Any, gain: float = 1.0) -> float:
        return gain

    return factor, lambda value: setattr(factor, "__defaults__", (value,))


def keyword_default() -> Place:
    def factor(x: Any, dt: Any, *, gain: float = 1.0) -> float:
        return gain

    return factor, lambda value: factor.__kwdefaults__.update(gain=value)


def function_attribute() -> Place:
    def factor(x: Any, dt: Any) -> Any:
        return factor.gain  # type: ignore[attr-defined]

    factor.gain = 1.0  # type: ignore[attr-defined]
    return factor, lambda value: setattr(factor, "gain", value)


def environment() -> Place:
    os.environ["GAIN_OF_A_USER"] = "1.0"
    return (
        lambda x, dt: float(os.environ["GAIN_OF_A_USER"]),
        lambda value: os.environ.__setitem__("GAIN_OF_A_USER", str(value)),
    )


def file() -> Place:
    path = Path(os.environ["TRACKBENCH_CACHE"], "gain_of_a_user.txt")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("1.0")
    return (lambda x, dt: float(path.read_text())), lambda value: path.write_text(str(value)) and None


def opened_file() -> Place:
    path = Path(os.environ["TRACKBENCH_CACHE"], "other_gain_of_a_user.txt")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("1.0")

    def factor(x: Any, dt: Any) -> float:
        with open(path) as text:
            return float(text.read())

    return factor, lambda value: path.write_text(str(value)) and None


def property_of_a_class() -> Place:
    class Holder:
        def __init__(self) -> None:
            self._gain = 1.0

        @property
        def gain(self) -> float:
            return self._gain

    holder = Holder()
    return (lambda x, dt: holder.gain), setter(holder, "_gain")


def cached_property_of_a_class() -> Place:
    class Holder:
        base = 1.0

        @functools.cached_property
        def gain(self) -> float:
            return self.base

    holder = Holder()
    return (lambda x, dt: holder.gain), setter(holder, "gain")


def descriptor() -> Place:
    class Holder:
        gain = Descriptor()

    holder = Holder()
    return (lambda x, dt: holder.gain), setter(vars(Holder)["gain"], "value")


def class_attribute() -> Place:
    class Holder:
        gain = 1.0

    return (lambda x, dt: Holder.gain), lambda value: setattr(Holder, "gain", value)


def metaclass_attribute() -> Place:
    class Meta(type):
        gain = 1.0

    class Holder(metaclass=Meta):
        pass

    return (lambda x, dt: Holder.gain), lambda value: setattr(Meta, "gain", value)


def nested_objects() -> Place:
    outer, middle, inner = Plain(), Data(), Plain()
    outer.parts = (middle,)  # type: ignore[attr-defined]
    middle.inner = {"of": inner}  # type: ignore[attr-defined]
    return (lambda x, dt: outer.parts[0].inner["of"].gain), setter(inner)  # type: ignore[attr-defined]


def partial_keyword() -> Place:
    factor = functools.partial(lambda x, dt, gain: gain, gain=1.0)
    return factor, lambda value: factor.keywords.update(gain=value)


def bound_method() -> Place:
    class Holder(Plain):
        def factor(self, x: Any, dt: Any) -> float:
            return self.gain

    holder = Holder()
    return holder.factor, setter(holder)


def ctypes_number() -> Place:
    number = ctypes.c_double(1.0)
    return (lambda x, dt: number.value), lambda value: setattr(number, "value", value)


def memory_view() -> Place:
    view = memoryview(array.array("d", [1.0]))
    return item_of(view)


def view_of_a_buffer() -> Place:
    """An array of NumPy whose numbers are another's."""
    numbers = array.array("d", [1.0])
    shared = np.frombuffer(numbers)
    return (lambda x, dt: shared[0]), lambda value: numbers.__setitem__(0, value)


def context_variable() -> Place:
    variable = contextvars.ContextVar("gain", default=1.0)
    return (lambda x, dt: variable.get()), lambda value: variable.set(value) and None


def thread_local() -> Place:
    local = threading.local()
    local.gain = 1.0
    return attribute_of(local)[0], lambda value: setattr(local, "gain", value)


def weak_reference() -> Place:
    holder = Plain()
    reference = weakref.ref(holder)
    return (lambda x, dt, kept=holder: reference().gain), setter(holder)  # type: ignore[union-attr]


def lru_cached() -> Place:
    holder = Plain()
    cached = functools.lru_cache(lambda: holder.gain)

    def change(value: float) -> None:
        holder.gain = value
        cached.cache_clear()

    return (lambda x, dt: cached()), change


def enumeration() -> Place:
    class Gains(enum.Enum):
        OURS = 1.0

    return (lambda x, dt: Gains.OURS.value), lambda value: setattr(Gains.OURS, "_value_", value)


def set_of_numbers() -> Place:
    numbers = {1.0}

    def change(value: float) -> None:
        numbers.clear()
        numbers.add(value)

    return (lambda x, dt: max(numbers)), change


def mapping_proxy() -> Place:
    numbers = {"gain": 1.0}
    proxy = types.MappingProxyType(numbers)
    return (lambda x, dt: proxy["gain"]), lambda value: numbers.update(gain=value)


def named_tuple() -> Place:
    holder = Plain()
    holder.named = Named(1.0)  # type: ignore[attr-defined]
    return (lambda x, dt: holder.named.gain), lambda value: setattr(holder, "named", Named(value))  # type: ignore[attr-defined]


def iterator() -> Place:
    numbers = [1.0]

    def forever() -> Iterator[float]:
        while True:
            yield numbers[0]

    gains = forever()
    return (lambda x, dt: next(gains)), lambda value: numbers.__setitem__(0, value)


def computed_attribute() -> Place:
    Computed.store["gain"] = 1.0
    holder = Computed()
    return (lambda x, dt: holder.gain), lambda value: Computed.store.update(gain=value)


def array_without_axes() -> Place:
    gain = np.array(1.0)
    return (lambda x, dt: gain[()]), gain.fill


class Shown(Plain):
    def __str__(self) -> str:
        return str(self.gain)


def by_str() -> Place:
    holder = Shown()
    return (lambda x, dt: float(str(holder))), setter(holder)


def by_format() -> Place:
    holder = Plain()
    return (lambda x, dt: float("{0.gain}".format(holder))), setter(holder)  # noqa: UP030, UP032


def own_builtins() -> Place:
    names = {"gain": 1.0}
    scope: dict[str, Any] = {"__builtins__": names}
    exec("factor = lambda x, dt: gain", scope)
    return scope["factor"], lambda value: names.update(gain=value)


class ComputedModule(types.ModuleType):
    value = 1.0

    @property
    def gain(self) -> float:
        return self.value


def computed_module() -> Place:
    module = ComputedModule("parameters_of_a_user")
    vars(module)["gain"] = 1.0
    scope = {"parameters": module}
    exec("factor = lambda x, dt: parameters.gain", scope)
    return scope["factor"], setter(module, "value")  # type: ignore[return-value]


PLACES: dict[str, Callable[[], Place]] = {
    "global": module_global,
    "closure cell": closure_cell,
    "default argument": default_argument,
    "keyword default": keyword_default,
    "function attribute": function_attribute,
    "plain object": lambda: attribute_of(Plain()),
    "slots": lambda: attribute_of(Slots()),
    "dataclass": lambda: attribute_of(Data()),
    "slots dataclass": lambda: attribute_of(SlotsData()),
    "frozen dataclass": lambda: attribute_of(FrozenData()),
    "SimpleNamespace": lambda: attribute_of(types.SimpleNamespace(gain=1.0)),
    "argparse.Namespace": lambda: attribute_of(argparse.Namespace(gain=1.0)),
    "UserDict": lambda: item_of(UserDict(gain=1.0), "gain"),
    "dict": lambda: item_of({"gain": 1.0}, "gain"),
    "list": lambda: item_of([1.0]),
    "set": set_of_numbers,
    "deque": lambda: item_of(deque([1.0])),
    "array": lambda: item_of(np.ones(3)),
    "array without axes": array_without_axes,
    "view of a buffer": view_of_a_buffer,
    "array.array": lambda: item_of(array.array("d", [1.0])),
    "bytearray": lambda: item_of(bytearray([100]), scale=100.0),
    "memoryview": memory_view,
    "MappingProxyType": mapping_proxy,
    "descriptor": descriptor,
    "property": property_of_a_class,
    "cached property": cached_property_of_a_class,
    "class attribute": class_attribute,
    "metaclass attribute": metaclass_attribute,
    "module attribute": module_attribute,
    "getattr": by_getattr,
    "globals()": by_globals,
    "environment": environment,
    "file": file,
    "opened file": opened_file,
    "Series": lambda: item_of(pd.Series({"gain": 1.0}), "gain"),
    "nested objects": nested_objects,
    "partial": partial_keyword,
    "bound method": bound_method,
    "ctypes": ctypes_number,
    "ContextVar": context_variable,
    "threading.local": thread_local,
    "weakref": weak_reference,
    "lru_cache": lru_cached,
    "Enum": enumeration,
    "namedtuple": named_tuple,
    "generator": iterator,
    "__getattr__": computed_attribute,
    "str()": by_str,
    "format": by_format,
    "__builtins__": own_builtins,
    "computed module": computed_module,
}
