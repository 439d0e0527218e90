"""Classes and functions of a notebook or a script, which no other process can import: cloudpickle sends them there."""

from __future__ import annotations

import pickle
import sys
from typing import Any

from trackbench.base.errors import InputError, printable

#: Module that references to these classes name.
NOTEBOOK = "__main__"
_classes: dict[str, Any] = {}


def reference_to(plugin: Any) -> str:
    """Return the text by which a scenario names a class or a function: its module, or the notebook.

    A class that is defined anew gets a name of its own, so that scenarios which were loaded before keep theirs.

    Raises:
        InputError: others can neither import nor unpickle it.
    """
    imported: Any = sys.modules.get(plugin.__module__) if plugin.__module__ != NOTEBOOK else None
    for part in plugin.__qualname__.split("."):
        imported = getattr(imported, part, None)
    if imported is plugin:
        return f"{plugin.__module__}:{plugin.__qualname__}"
    # Takes its time to import, which most programs need not wait for.
    import cloudpickle

    try:
        cloudpickle.dumps(plugin)
    except Exception as error:
        problem = f"{type(error).__name__}: {printable(str(error))}"
        raise InputError(f"{plugin.__name__} cannot be sent to another process: {problem}") from error
    reference, number = f"{NOTEBOOK}:{plugin.__name__}", 1
    while _classes.setdefault(reference, plugin) is not plugin:
        number += 1
        reference = f"{NOTEBOOK}:{plugin.__name__}_{number}"
    return reference


def notebook_class(reference: str) -> Any | None:
    """Return the class of a notebook that a reference names; None where it names no such class."""
    return _classes.get(reference)


def dumps(value: Any) -> bytes:
    """Return a value and the classes of the notebook, pickled for ``loads`` in another process."""
    if not _classes:
        return pickle.dumps(({}, value))
    import cloudpickle

    content: bytes = cloudpickle.dumps((_classes, value))
    return content


def loads(content: bytes) -> Any:
    """Return a value that another process pickled, and take the classes of its notebook."""
    classes, value = pickle.loads(content)
    _classes.update(classes)
    return value
