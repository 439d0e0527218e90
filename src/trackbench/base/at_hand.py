"""Classes of a notebook or a script, which no other process can import: they are named here and sent there pickled."""

from __future__ import annotations

import inspect
import pickle
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from trackbench.base.errors import InputError, printable, text_of

#: The module that their references name.
HOME = "__main__"
_pickled: dict[str, bytes] = {}
_classes: dict[str, Any] = {}
#: Values of a class that say what it does.
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
    """The text of a class at hand: that of its definition, or of its methods and plain values; None of what is none."""
    plugin = class_at_hand(reference)
    if plugin is None:
        return None
    try:
        return inspect.getsource(plugin)
    except (OSError, TypeError):
        # Of a class of a cell Python knows the place of the methods alone.
        return "\n".join(_members(plugin))


def _members(plugin: Any) -> Iterator[str]:
    for name, value in vars(plugin).items():
        if inspect.isfunction(value):
            try:
                yield inspect.getsource(value)
            except OSError:
                yield f"{name} {value.__code__.co_code.hex()}"
        elif isinstance(value, _PLAIN) and name not in ("__module__", "__doc__", "__firstlineno__"):
            yield f"{name} = {value!r}"
