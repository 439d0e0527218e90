"""Plug-ins: motion models, sensors, truth sources, trackers and metrics that a scenario names.

Those of one kind are published by installed packages, or named ``"module:Class"``.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from trackbench.base.errors import InputError, nearest_choices, printable
from trackbench.base.notebook_classes import NOTEBOOK, notebook_class


def attribute(reference: str) -> Any:
    """Import a module and return the attribute of it that ``"module:attribute"`` names.

    Raises:
        InputError: the module has no such attribute, a module of the same name is loaded, or it is no module's name.
    """
    module, _, path = reference.partition(":")
    if module == NOTEBOOK:
        problem = "a class of a script or notebook has no module that others can import"
        raise InputError(f"{problem}: put it into a file, or give tb.load the class itself")
    if module.endswith(".py") or "/" in module:
        dotted = module.removesuffix(".py").strip("./").replace("/", ".")
        raise InputError(f"{module!r} is no module; did you mean {dotted + ':' + path!r}?")
    _require_unambiguous(module)
    plugin: Any = importlib.import_module(module)
    for name in path.split("."):
        if not hasattr(plugin, name):
            classes = [other for other, value in vars(plugin).items() if isinstance(value, type) and other[0] != "_"]
            raise InputError(f"module {module!r} has no {name!r}: {nearest_choices(name, classes)}")
        plugin = getattr(plugin, name)
    return plugin


@contextmanager
def searched(*folders: Path | None) -> Iterator[None]:
    """With some folders, such as a scenario's, and the working directory first on the module path."""
    before = list(sys.path)
    sys.path[:0] = [str(place) for place in (*folders, Path.cwd()) if place is not None]
    try:
        yield
    finally:
        sys.path[:] = before


def one_line(error: BaseException) -> str:
    """An error's type and text in one line."""
    text = printable(str(error))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _require_unambiguous(module: str) -> None:
    """Python loads one module of a name: the tracker.py of a second scenario's folder would be that of the first."""
    top = module.partition(".")[0]
    spec = PathFinder.find_spec(top)
    loaded = getattr(sys.modules.get(top), "__file__", None)
    if spec is None or spec.origin is None or loaded is None:
        return
    if os.path.realpath(spec.origin) != os.path.realpath(loaded):
        raise InputError(f"{spec.origin} cannot be loaded beside {loaded}, which has the same name: rename one")


T = TypeVar("T")


class Registry(Generic[T]):
    """Looks plug-ins of one kind up. What is found is looked at, and never called.

    ``registry[reference]`` is as ``get``, remembered: for code that runs often, once a scenario has named the plug-in.

    Args:
        group: the entry-point group under which packages publish them.
        what: one of them, as a message says it: "motion model".
        lacks: what something lacks to be one, as the end of a sentence; None where it is one.
    """

    def __init__(self, group: str, what: str, lacks: Callable[[Any], str | None]) -> None:
        self.group = group
        self.what = what
        self.lacks = lacks
        self.found: dict[str, T] = {}
        """What has been looked up, by reference."""

    def names(self) -> list[str]:
        """The published names, whether or not they can be imported."""
        return sorted(self._published())

    def get(self, reference: str, folder: Path | None = None) -> T:
        """What a published name or a ``"module:Class"`` stands for.

        Args:
            reference: the name.
            folder: a scenario's, searched for modules before the working directory and the installed packages.

        Raises:
            InputError: there is no such name, it cannot be imported, or it is something else; says why.
        """
        own = not self.home_of(reference).startswith("trackbench.")
        try:
            with searched(folder):
                plugin = notebook_class(reference)
                if plugin is None:
                    plugin = attribute(reference) if ":" in reference else self._entry(reference).load()
        except InputError:
            raise
        except ModuleNotFoundError as error:
            where = f"{folder or 'the folder of the scenario'}, the working directory and the installed packages"
            problem = f"cannot import {reference!r}: no module named {error.name!r} (looked in {where})"
            raise InputError(problem) from error
        except (Exception, SystemExit) as error:
            raise InputError(f"cannot import {reference!r}: {one_line(error)}") from error
        if own:
            _loaded[repr(reference)] = None
        try:
            lacking = self.lacks(plugin)
        except Exception as error:
            lacking = one_line(error)
        if lacking is not None:
            raise InputError(f"{reference!r} is no {self.what}: {lacking}")
        self.found[reference] = cast(T, plugin)
        return self.found[reference]

    def __getitem__(self, reference: str) -> T:
        return self.found.get(reference) or self.get(reference)

    def loaded(self) -> dict[str, T]:
        """Every published one that can be imported, by name."""
        return {name: result for name, result in self._tried().items() if not isinstance(result, InputError)}

    def failures(self) -> dict[str, str]:
        """Why the others cannot, by name."""
        return {name: result.message for name, result in self._tried().items() if isinstance(result, InputError)}

    def home_of(self, reference: str) -> str:
        """The module in which a name is found, which is not imported; empty where the name is not published once."""
        if ":" not in reference:
            entries = self._published().get(reference, [])
            reference = entries[0].value if len(entries) == 1 else ""
        return reference.partition(":")[0]

    def name_of(self, plugin: Any) -> str:
        """The name under which a scenario can ask for a plug-in that is at hand."""
        looked_up = next((name for name, other in self.found.items() if other is plugin), None)
        if looked_up is not None:
            return looked_up
        reference = f"{plugin.__module__}:{plugin.__qualname__}"
        published = self._published().items()
        return next((name for name, entries in published if entries[0].value == reference), reference)

    def _tried(self) -> dict[str, T | InputError]:
        plugin: dict[str, T | InputError] = {}
        for name in self.names():
            try:
                plugin[name] = self.get(name)
            except InputError as error:
                plugin[name] = error
        return plugin

    def _entry(self, name: str) -> EntryPoint:
        published = self._published()
        if name not in published:
            hint = f'{nearest_choices(name, published)} (a class is named "module:Class")'
            raise InputError(f"no {self.what} is published as {name!r}: {hint}")
        values = sorted({entry.value for entry in published[name]})
        if len(values) > 1:
            places = " and as ".join(values)
            raise InputError(f"{name!r} is published {len(values)} times, as {places}: name one of them")
        return published[name][0]

    def _published(self) -> dict[str, list[EntryPoint]]:
        return _entries(self.group, tuple(sys.path))


def with_plugins() -> str:
    """Return "with the plug-ins 'a:A', 'b:B'": those that were loaded in this process; empty where none was."""
    return f"with the plug-in{'s' if len(_loaded) > 1 else ''} {', '.join(_loaded)}" if _loaded else ""


#: References of the plug-ins that were loaded in this process, in their order.
_loaded: dict[str, None] = {}


@cache
def _entries(group: str, places: tuple[str, ...]) -> dict[str, list[EntryPoint]]:
    published: dict[str, list[EntryPoint]] = {}
    for entry in _of_all_groups(places).select(group=group):
        published.setdefault(entry.name, []).append(entry)
    return published


@cache
def _of_all_groups(_places: tuple[str, ...]) -> Any:
    """All entry points. To read the metadata of all packages takes as long as to read a scenario."""
    return entry_points()


def lacks_class(base: type) -> Callable[[Any], str | None]:
    """For a registry of classes: what something lacks to be a whole subclass of ``base``."""

    def lacks(result: Any) -> str | None:
        wanted = f"{base.__module__}.{base.__qualname__}"
        if not isinstance(result, type) or not issubclass(result, base):
            return f"it must be a subclass of {wanted}"
        missing = sorted(getattr(result, "__abstractmethods__", ()))
        # Class variables without a value.
        stated = [name for name, kind in inspect.get_annotations(base).items() if str(kind).startswith("ClassVar")]
        unset = [name for name in stated if not hasattr(base, name) and not hasattr(result, name)]
        if missing or unset:
            return f"it lacks {' and '.join([*unset, *missing])}"
        return None

    return lacks
