"""From a tracker's name in a scenario to the class that it means."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import ValidationError

from trackbench.errors import InputError, nearest
from trackbench.trackers.base import Tracker

GROUP = "trackbench.trackers"

Factory = Callable[..., Tracker]


def published() -> dict[str, EntryPoint]:
    """The trackers that installed packages publish, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def resolve(use: str, folder: Path | None = None) -> Factory:
    """The class (or function) behind a published name or a ``"module:Attr"``.

    Args:
        use: what the scenario's ``use:`` says.
        folder: the scenario's folder, searched for modules before the working directory.

    Raises:
        InputError: there is no such name, or it cannot be imported; says why.
    """
    with searched(folder), explained(use, folder):
        found = attribute(use, classes) if ":" in use else _published(use)
    if not callable(found):
        raise InputError(f"{use!r} is not a class")
    return found


def create(use: str, options: dict[str, Any], folder: Path | None = None) -> Callable[[], Tracker]:
    """A function of no arguments that makes a fresh tracker with the given options.

    Raises:
        InputError: the name does not resolve, the options do not fit, or what is made has no ``step``.
    """
    factory = resolve(use, folder)

    def make() -> Tracker:
        # A tracker may load what its options name while it starts.
        with searched(folder):
            return factory(**options)

    try:
        tracker = make()
    except InputError:
        raise
    except ValidationError as invalid:
        problems = [f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in invalid.errors()]
        raise InputError(f"{use!r} does not start with these options: {'; '.join(problems)}") from invalid
    except (Exception, SystemExit) as error:
        raise InputError(f"{use!r} does not start with these options: {_one_line(error)}") from error
    if not callable(getattr(tracker, "step", None)):
        raise InputError(f"{use!r} has no method step(state, scan)")
    return make


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
    module, _, attribute = reference.partition(":")
    _require_unambiguous(module)
    found: Any = importlib.import_module(module)
    for name in attribute.split("."):
        if not hasattr(found, name):
            raise InputError(f"module {module!r} has no {name!r}: {nearest(name, choices(found))}")
        found = getattr(found, name)
    return found


@contextmanager
def explained(use: str, folder: Path | None) -> Iterator[None]:
    """What goes wrong while ``use`` is imported, as an ``InputError``."""
    try:
        yield
    except InputError:
        raise
    except ModuleNotFoundError as error:
        first = folder or "the scenario's folder"
        where = f" (looked in {first}, the working directory and the installed packages)"
        raise InputError(f"cannot import {use!r}: no module named {error.name!r}{where}") from error
    except (Exception, SystemExit) as error:
        raise InputError(f"cannot import {use!r}: {_one_line(error)}") from error


def _require_unambiguous(module: str) -> None:
    """Python loads one module of a name: the tracker.py of a second scenario's folder would be that of the first."""
    top = module.partition(".")[0]
    spec = PathFinder.find_spec(top)
    loaded = getattr(sys.modules.get(top), "__file__", None)
    if spec is None or spec.origin is None or loaded is None:
        return
    if os.path.realpath(spec.origin) != os.path.realpath(loaded):
        raise InputError(f"{spec.origin} cannot be loaded beside {loaded}, which has the same name: rename one")


def _published(name: str) -> Factory:
    known = published()
    if name not in known:
        hint = nearest(name, known)
        raise InputError(f'no tracker is published as {name!r}: {hint} (a class is named "module:Class")')
    return known[name].load()  # type: ignore[no-any-return]


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def classes(module: Any) -> list[str]:
    """The names of the classes of a module."""
    return [name for name, value in vars(module).items() if isinstance(value, type) and not name.startswith("_")]


def _public(module: Any) -> list[str]:
    names = [name for name, value in vars(module).items() if not isinstance(value, ModuleType)]
    return [name for name in names if not name.startswith("_")]


@contextmanager
def searched(folder: Path | None) -> Iterator[None]:
    """With the scenario's folder and the working directory on the module path."""
    before = list(sys.path)
    sys.path[:0] = [str(place) for place in (folder, Path.cwd()) if place is not None]
    try:
        yield
    finally:
        sys.path[:] = before
