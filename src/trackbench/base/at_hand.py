"""Classes of a notebook or a script, which no other process can import: they are named here and sent there pickled."""

from __future__ import annotations

import dis
import hashlib
import inspect
import itertools
import pickle
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property, partial
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from trackbench.base.errors import InputError, printable, text_of

#: The module that their references name.
HOME = "__main__"
_pickled: dict[str, bytes] = {}
_classes: dict[str, Any] = {}
#: Files of text that was run, of which there are many.
UNNAMED = ("<string>", "<stdin>")
#: Where Pydantic keeps the options of a class.
FIELDS = "__pydantic_fields__"
#: What stands for functions, and where it has them.
WRAPPERS = (staticmethod, classmethod, property, cached_property, partial, MethodType)
INSIDE = ("__func__", "fget", "fset", "fdel", "func", "args", "keywords")
#: Values that say all of themselves.
_PLAIN = (bool, int, float, str, bytes, type(None))


def reference_to(plugin: Any) -> str:
    """The text by which a scenario names a class or a function: its module where others can import it from there.

    A class that is defined anew, or is given again with other values in it, gets a name of its own.

    Raises:
        InputError: others can neither import nor unpickle it.
    """
    if _importable(plugin):
        return f"{plugin.__module__}:{plugin.__qualname__}"
    # Takes its time to import, which most programs need not wait for.
    import cloudpickle

    try:
        content = cloudpickle.dumps(plugin)
    except Exception as error:
        problem = f"{type(error).__name__}: {printable(text_of(error))}"
        raise InputError(f"{plugin.__name__} cannot be sent to another process: {problem}") from error
    for reference in _names(plugin.__name__):
        if _pickled.setdefault(reference, content) == content:
            _classes[reference] = plugin
            return reference
    raise AssertionError


def _names(name: str) -> Iterator[str]:
    number = 1
    while True:
        yield f"{HOME}:{name}" + (f"_{number}" if number > 1 else "")
        number += 1


def _importable(plugin: Any) -> bool:
    found = sys.modules.get(plugin.__module__) if plugin.__module__ != HOME else None
    for part in plugin.__qualname__.split("."):
        found = getattr(found, part, None)
    return found is plugin


def dumps(value: Any) -> bytes:
    """A value pickled, with the classes among these by value."""
    if not _pickled:
        return pickle.dumps(value)
    import cloudpickle

    content: bytes = cloudpickle.dumps(value)
    return content


def pickled() -> dict[str, bytes]:
    """All of them by reference, for another process."""
    return dict(_pickled)


def receive_classes(classes: Mapping[str, bytes]) -> None:
    """Take those of another process."""
    _pickled.update(classes)


def class_at_hand(reference: str) -> Any | None:
    """What a reference stands for; None where it is none of these."""
    if reference in _pickled and reference not in _classes:
        import cloudpickle

        _classes[reference] = cloudpickle.loads(_pickled[reference])
    return _classes.get(reference)


def source_text(reference: str) -> str | None:
    """Return text that changes with the code of a class at hand; None where the reference names no such class.

    It holds the methods and values of the class, and whatever of these no other process can import: bases, functions
    and values of the notebook that methods use, defaults and closures.
    """
    plugin = class_at_hand(reference)
    return None if plugin is None else "\n".join(_described(plugin, {}))


def _described(value: Any, seen: dict[int, Any]) -> Iterator[str]:
    """Describe a value by its code and content; ``seen`` holds what was described before, and keeps it alive."""
    if isinstance(value, _PLAIN):
        yield repr(value)
        return
    if id(value) in seen or isinstance(value, ModuleType):
        return
    seen[id(value)] = value
    parts: Iterable[Any]
    if isinstance(value, type | FunctionType) and _importable(value):
        yield f"{value.__module__}:{value.__qualname__}"
        return
    if isinstance(value, type):
        # What Python itself writes into a class, such as the line, says nothing of what it does.
        own = {k: v for k, v in vars(value).items() if k == FIELDS or isinstance(v, FunctionType) or k[:2] != "__"}
        parts = [type(value), *value.__bases__, own]
    elif isinstance(value, FunctionType):
        yield from _code_text(value.__code__, seen)
        globals_used = [value.__globals__.get(name) for name in sorted({*_global_names(value.__code__)})]
        cells = [cell.cell_contents for cell in value.__closure__ or () if cell != CellType()]
        parts = [value.__defaults__, value.__kwdefaults__, *cells, *globals_used]
    elif isinstance(value, CodeType):
        parts = [value.co_code, value.co_names, value.co_consts]
    elif isinstance(value, dict | list | tuple):
        parts = itertools.chain(*value.items()) if isinstance(value, dict) else value
    elif isinstance(value, set | frozenset):
        parts = sorted("\n".join(_described(item, dict(seen))) for item in value)
    else:
        try:
            parts = [hashlib.sha256(pickle.dumps(value)).hexdigest(), type(value)]
        except Exception:
            inside = INSIDE if isinstance(value, WRAPPERS) else () if _importable(type(value)) else ("__dict__",)
            parts = [type(value), *(getattr(value, name) for name in inside if hasattr(value, name))]
    for part in parts:
        yield from _described(part, seen)


def _global_names(code: CodeType) -> Iterator[str]:
    """Names of the globals that a function reads, and those within it."""
    yield from (step.argval for step in dis.get_instructions(code) if step.opname == "LOAD_GLOBAL")
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _global_names(inner)


def _code_text(code: CodeType, seen: dict[int, Any]) -> Iterator[str]:
    """Source of a function where Python knows it, else its instructions: the file ``<string>`` may be any text."""
    try:
        if code.co_filename in UNNAMED:
            raise OSError
        yield inspect.getsource(code)
    except OSError:
        yield from _described(code, seen)
