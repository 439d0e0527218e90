"""From a reference such as ``"module:Class"`` to what it names."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from trackbench.base.errors import InputError, nearest


def named(reference: str) -> Any:
    """What an option's ``"module:attribute"`` names, for a tracker that loads it while it starts.

    Raises:
        InputError: it cannot be imported; says why.
    """
    if ":" not in reference:
        raise InputError(f'{reference!r} is no name in a module: write "module:name"')
    with explained(reference, None):
        return attribute(reference, _public)


def attribute(reference: str, choices: Callable[[Any], list[str]]) -> Any:
    """Import a module and take an attribute of it; ``choices`` gives the names that a message may suggest."""
    module, _, path = reference.partition(":")
    if module == "__main__":
        raise InputError("a class of a script or notebook has no module that others can import: put it into a file")
    if module.endswith(".py") or "/" in module:
        dotted = module.removesuffix(".py").strip("./").replace("/", ".")
        raise InputError(f"{module!r} is no module; did you mean {dotted + ':' + path!r}?")
    _require_unambiguous(module)
    found: Any = importlib.import_module(module)
    for name in path.split("."):
        if not hasattr(found, name):
            raise InputError(f"module {module!r} has no {name!r}: {nearest(name, choices(found))}")
        found = getattr(found, name)
    return found


def classes(module: Any) -> list[str]:
    """The names of the classes of a module."""
    return [name for name, value in vars(module).items() if isinstance(value, type) and not name.startswith("_")]


@contextmanager
def searched(folder: Path | None) -> Iterator[None]:
    """With a scenario's folder and the working directory first on the module path."""
    before = list(sys.path)
    sys.path[:0] = [str(place) for place in (folder, Path.cwd()) if place is not None]
    try:
        yield
    finally:
        sys.path[:] = before


@contextmanager
def explained(reference: str, folder: Path | None) -> Iterator[None]:
    """What goes wrong while ``reference`` is imported, as an ``InputError``."""
    try:
        yield
    except InputError:
        raise
    except ModuleNotFoundError as error:
        first = folder or "the scenario's folder"
        where = f" (looked in {first}, the working directory and the installed packages)"
        raise InputError(f"cannot import {reference!r}: no module named {error.name!r}{where}") from error
    except (Exception, SystemExit) as error:
        raise InputError(f"cannot import {reference!r}: {one_line(error)}") from error


def one_line(error: BaseException) -> str:
    """An error's type and text in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def _require_unambiguous(module: str) -> None:
    """Python loads one module of a name: the tracker.py of a second scenario's folder would be that of the first."""
    top = module.partition(".")[0]
    spec = PathFinder.find_spec(top)
    loaded = getattr(sys.modules.get(top), "__file__", None)
    if spec is None or spec.origin is None or loaded is None:
        return
    if os.path.realpath(spec.origin) != os.path.realpath(loaded):
        raise InputError(f"{spec.origin} cannot be loaded beside {loaded}, which has the same name: rename one")


def _public(module: Any) -> list[str]:
    names = [name for name, value in vars(module).items() if not isinstance(value, ModuleType)]
    return [name for name in names if not name.startswith("_")]
