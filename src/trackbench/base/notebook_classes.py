"""Classes and functions of a notebook or a script, which cloudpickle sends to other processes."""

from __future__ import annotations

import pickle
import sys
from typing import Any

from trackbench.base.errors import InputError, printable

#: Module in the references to classes of a notebook or a script.
NOTEBOOK = "__main__"
_classes: dict[str, Any] = {}


def reference_to(plugin: Any) -> str:
    """Return the text by which a scenario names a class or function that may be defined in a notebook.

    A class of a notebook that is defined a second time gets a second name; scenarios keep the class that they loaded.

    Raises:
        InputError: other processes can neither import nor unpickle it.
    """
    imported: Any = sys.modules.get(plugin.__module__) if plugin.__module__ != NOTEBOOK else None
    for part in plugin.__qualname__.split("."):
        imported = getattr(imported, part, None)
    if imported is plugin:
        return f"{plugin.__module__}:{plugin.__qualname__}"
    # The import is slow, and most programs do not need it.
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
    """Return the class or function of a notebook that a reference names; None for other references."""
    return _classes.get(reference)


def dumps(value: Any) -> bytes:
    """Pickle a value and the classes of the notebook, for ``loads`` in another process."""
    if not _classes:
        return pickle.dumps(({}, value))
    import cloudpickle

    content: bytes = cloudpickle.dumps((_classes, value))
    return content


def loads(content: bytes) -> Any:
    """Unpickle a value from another process, and register the classes of its notebook here."""
    classes, value = pickle.loads(content)
    _classes.update(classes)
    return value
