"""What a user's equations read, where all of it is known to be constant.

What is traced is called once, and stands for all calls. So a user's function is compiled only if all that its code
reads, and that of every function it calls, is of a kind that stays as it is. Its contents are read before every run.
"""

from __future__ import annotations

import hashlib
import sys
from collections import ChainMap, namedtuple
from collections.abc import Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from enum import Enum
from functools import cache, cached_property, partial
from types import (
    BuiltinFunctionType,
    CellType,
    FunctionType,
    MemberDescriptorType,
    MethodDescriptorType,
    MethodType,
    ModuleType,
    NotImplementedType,
    SimpleNamespace,
    WrapperDescriptorType,
)
from typing import Any

import numpy as np
from pydantic import BaseModel

from trackbench.base.user_code import Frame, last_of_user
from trackbench.engine.code_reads import CONSTRUCTORS, OF_SELF, code_reads, untraceable_at
from trackbench.engine.graph import Untraceable
from trackbench.models.motion import MotionModel
from trackbench.models.sensors import Sensor

#: Kinds of which the text says all.
PLAIN = {type(None), bool, int, float, complex, str, bytes, range, slice, type(...), NotImplementedType}
#: Kinds that stand for others, and the attributes that have them.
WRAPPERS: dict[type, tuple[str, ...]] = {
    MethodType: ("__func__", "__self__"),
    partial: ("func", "args", "keywords"),
    property: ("fget",),
    cached_property: ("func",),
    staticmethod: ("__func__",),
    classmethod: ("__func__",),
}
#: Python's own functions that give the same for the same.
BUILTINS = {
    *(abs, all, any, bool, bytes, callable, complex, dict, divmod, enumerate, filter, float, frozenset, int),
    *(issubclass, iter, len, list, map, max, min, next, object, pow, property, range, reversed, round),
    *(set, slice, sorted, sum, super, tuple, zip),
}
#: Packages whose functions do, and the names in them of those that do not.
PURE = {
    **dict.fromkeys(("math", "cmath", "itertools", "functools", "dataclasses", "typing", "enum"), ""),
    "operator": "attrgetter methodcaller",
    "numpy": "random load loadtxt genfromtxt fromfile fromregex save savez savez_compressed savetxt memmap vectorize "
    "isscalar iterable",
    **dict.fromkeys(("scipy.linalg", "scipy.special", "scipy.constants"), ""),
    **dict.fromkeys((f"trackbench.{name}" for name in ("base.linalg", "base.units", "base.types")), ""),
    **dict.fromkeys(("trackbench.models", "trackbench.filters"), ""),
}
LIBRARIES = {name.partition(".")[0] for name in PURE}
#: Where the classes may come from that the user's are made of; and theirs.
BASES = {"trackbench", "pydantic", "abc", "typing"}
METACLASSES = BASES | {"builtins", "enum"}
#: Methods that equations do not call without their name.
NAMED = CONSTRUCTORS | {"__repr__", "__str__", "__setattr__", "__delattr__", "__hash__", "__init_subclass__"}
NAMED |= {"__annotate__", "__annotate_func__"}
#: How a class has the attributes that its objects keep in themselves.
SLOTS = MemberDescriptorType, type(vars(namedtuple("_", "of"))["of"])
#: What the bench reads of models and sensors.
PUBLIC = frozenset(
    name for kind in (MotionModel, Sensor) for name in vars(kind) if not name.startswith(("__", "_abc", "model_"))
)
CHANGES = "it changes what it reads"
#: Of a function that refers to a name that is not yet bound.
EMPTY = CellType()


class SourceFingerprint:
    """All that a user's model or class reads; equations with two that are equal give the same.

    ``refusal`` says what of it is not known to be constant; it is empty where all is.
    """

    def __init__(self, value: Any) -> None:
        self._value, self._names, self.refusal = value, PUBLIC, ""
        self._visited: list[Any] = []
        try:
            self._parts, self._names, self._visited = _read(value, PUBLIC)
        # An object may do anything when it is asked for its attributes.
        except Exception as reason:
            self._parts = self.refusal = str(reason) or type(reason).__name__
        # A kernel is looked up at every step.
        self._hash = hash(self._parts)
        self._before = _copies(self._visited)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, SourceFingerprint) and self._parts == other._parts)

    def __hash__(self) -> int:
        return self._hash

    @property
    def changed(self) -> bool:
        """Whether something is no longer what it was."""
        try:
            return not self.refusal and _read(self._value, self._names)[0] != self._parts
        except Exception:
            return True

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Put back what a call changes.

        Raises:
            Untraceable: it changed something.
        """
        before = _copies(self._visited)
        try:
            yield
            if self.changed:
                raise Untraceable(CHANGES)
        finally:
            _put_back(before)

    def put_back(self) -> None:
        """Make what was read again what it was."""
        _put_back(self._before)


#: Kinds of which the contents can be changed.
Holder = np.ndarray | list[Any] | dict[Any, Any]


def _copies(items: Iterable[Any]) -> list[tuple[Holder, Any]]:
    return [(item, item.copy()) for item in items if type(item) in (np.ndarray, list, dict)]


def _put_back(copies: Iterable[tuple[Holder, Any]]) -> None:
    for item, copy in copies:
        if isinstance(item, dict):
            item.clear()
            item.update(copy)
        elif isinstance(item, list):
            item[:] = copy
        elif item.flags.writeable:
            item[...] = copy


def _read(value: Any, names: frozenset[str]) -> tuple[Hashable, frozenset[str], list[Any]]:
    """The parts of a value, the attributes that its code reads, and the objects that it is made of."""
    reader = _Reader(set(names))
    parts = reader.read(value, getattr(value, "__name__", type(value).__name__))
    # What was read may read further attributes.
    return _read(value, frozenset(reader.names)) if reader.names > names else (parts, names, reader.visited)


class _Reader:
    """Looks through an object, and comes to each part once."""

    def __init__(self, names: set[str]) -> None:
        self.names = names
        """Attributes that some code takes, of whatever."""
        self.visited: list[Any] = []
        self._seen: dict[int, int] = {}

    def read(self, value: Any, at: str) -> Hashable:
        """The parts of a value, which is reached as ``at``.

        Raises:
            Untraceable: it is not known to be constant.
        """
        kind = type(value)
        if kind in PLAIN:
            return kind, repr(value)
        if isinstance(value, np.generic):
            return kind, value.dtype.str, value.tobytes()
        number = self._seen.setdefault(id(value), len(self._seen))
        if number < len(self.visited):
            return "as before", number
        self.visited.append(value)
        if kind is np.ndarray and not value.dtype.hasobject:
            return value.shape, value.dtype.str, hashlib.sha256(value.tobytes()).digest()
        if kind in (tuple, list, frozenset):
            return kind, self._all(value, at)
        if kind is dict:
            return kind, self._all(value, at), self._all(value.values(), at)
        if kind in WRAPPERS:
            return kind, self._all([getattr(value, name) for name in WRAPPERS[kind]], at)
        if _of_library(value):
            return kind, value
        if kind is FunctionType:
            return self._function(value, at)
        if isinstance(value, type):
            # It may be called.
            self.names |= CONSTRUCTORS
            return self._class(value, at)
        return self._instance(value, at)

    def _all(self, values: Iterable[Any], at: str) -> Hashable:
        return tuple([self.read(value, at) for value in values])

    def _attributes(self, values: Mapping[str, Any], at: str, whole: bool) -> Hashable:
        chosen = [name for name in values if not name.startswith("__") and (whole or name in self.names)]
        return tuple([(name, self.read(values[name], f"{at}.{name}")) for name in chosen])

    def _function(self, function: FunctionType, at: str) -> Hashable:
        """Its code, and what the names in it stand for."""
        code, scope = function.__code__, ChainMap(function.__globals__, function.__builtins__)  # type: ignore[attr-defined,unused-ignore]
        reads = code_reads(code)
        self.names |= reads.attributes
        parts = [code, self._all(function.__defaults__ or (), at), self.read(function.__kwdefaults__, at)]
        parts.append(self._attributes(vars(function), at, whole=False))
        cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
        for name, content in [(name, cell.cell_contents) for name, cell in cells if cell != EMPTY]:
            # By this name super() finds the class.
            parts.append(self._class(content, at) if name == "__class__" else self.read(content, name))
        for chain, line in zip(reads.names, reads.lines, strict=True):
            try:
                parts.append(self._name(scope, chain))
            except Untraceable as reason:
                raise reason if str(reason).endswith(")") else untraceable_at(str(reason), code, line) from None
        return tuple(parts)

    def _name(self, scope: Mapping[str, Any], chain: tuple[str, ...]) -> Hashable:
        """What a global name stands for; of a module, the attributes that are taken of it."""
        at = chain[0]
        if at not in scope:
            return "unbound"
        value = scope[at]
        if value is type and chain[1:] == (OF_SELF,):
            return value
        if value is type or value is isinstance:
            raise Untraceable("it asks for a type")
        for attribute in chain[1:]:
            if type(value) is ModuleType:
                at = f"{at}.{attribute}"
                if attribute not in vars(value) and _top(value.__name__) not in LIBRARIES:
                    raise Untraceable(f"{at} is computed")
                value = getattr(value, attribute, None)
        return self.read(value, at)

    def _class(self, kind: type, at: str) -> Hashable:
        """What those of its bases that are the user's have under the names that are read."""
        parts: list[Hashable] = []
        for base in kind.__mro__:
            if base in (object, tuple, Enum, SimpleNamespace) or _top(base.__module__) in BASES:
                parts.append(base)
                continue
            items = vars(base).items()
            library = _top(base.__module__) in {*sys.stdlib_module_names, *LIBRARIES}
            # What is not written in Python keeps its state where it cannot be read.
            compiled = any(isinstance(item, MethodDescriptorType | WrapperDescriptorType) for _, item in items)
            compiled |= not base.__dictoffset__ and "__slots__" not in vars(base)
            computed = {"__getattr__", "__getattribute__"} & vars(base).keys()
            if library or compiled or computed or _top(type(base).__module__) not in METACLASSES:
                if {"function", "method"} & {*kind.__name__.split("_")}:
                    raise Untraceable(f"{at} is a function that is not known to give the same for the same")
                raise Untraceable(f"{at} is of type {kind.__name__}, which is not known to be constant")
            for name, value in items:
                implicit = name.startswith("__") and name not in NAMED and isinstance(value, FunctionType)
                if (implicit or name in self.names) and not isinstance(value, SLOTS):
                    parts.append((name, self.read(value, f"{base.__name__}.{name}")))
        return tuple(parts)

    def _instance(self, value: Any, at: str) -> Hashable:
        """The attributes of an object that has them as Python's objects do."""
        kind = type(value)
        parts, slots = [self._class(kind, at)], {}
        whole = is_dataclass(kind) or isinstance(value, BaseModel | Enum)
        for name, attribute in [item for base in kind.__mro__ for item in vars(base).items()]:
            if isinstance(attribute, MemberDescriptorType):
                slots[name] = getattr(value, name, None)
            elif isinstance(attribute, cached_property) and name in self.names:
                # What is computed once is computed now, so that it does not appear later.
                getattr(value, name)
        if isinstance(value, tuple):
            parts.append(self._all(tuple(value), at))
        state = {**slots, **getattr(value, "__dict__", {})}
        private = getattr(value, "__pydantic_private__", None) if isinstance(value, BaseModel) else None
        parts += [self._attributes(state, at, whole), self._attributes(private or {}, at, whole=False)]
        return tuple(parts)


def _of_library(value: Any) -> bool:
    """Whether a function or class is of a library, and gives the same for the same."""
    if isinstance(value, np.ufunc):
        # np.frompyfunc makes others, of any function.
        spaces = (sys.modules.get(name) for name in ("numpy", "scipy.special"))
        return any(getattr(space, value.__name__, None) is value for space in spaces)
    if isinstance(value, BuiltinFunctionType) and not isinstance(value.__self__, ModuleType):
        # Named tuples are made by it.
        return bool(value == tuple.__new__)
    if not (isinstance(value, FunctionType | BuiltinFunctionType | type) or type(value) is type(np.sum)):
        return False
    path = str(value.__globals__.get("__name__") if isinstance(value, FunctionType) else value.__module__)
    if path == "builtins":
        return value in BUILTINS or (isinstance(value, type) and issubclass(value, BaseException))
    module = sys.modules.get(path)
    if _is_file_of_user(getattr(module, "__file__", None)) or not _is_where_it_says(value, module):
        return False
    # Of what is written in C.
    path = path.removeprefix("_") if path in sys.stdlib_module_names else path
    others = [PURE[name] for name in PURE if f"{path}.".startswith(f"{name}.")]
    return bool(others) and not {*path.split("."), value.__name__} & {*others[0].split()}


def _is_where_it_says(value: Any, at: Any) -> bool:
    """Whether a function is the one of its name in its module; what a decorator of a library makes is in none."""
    if not isinstance(value, FunctionType):
        return True
    for part in value.__qualname__.split("."):
        at = getattr(at, part, None)
    return getattr(at, "__func__", at) is value


@cache
def _is_file_of_user(file: str | None) -> bool:
    return file is not None and last_of_user([Frame(file, 1, "")]) is not None


def _top(module: str) -> str:
    return module.partition(".")[0]
