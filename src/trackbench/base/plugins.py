"""Plug-ins: motion models, sensors, truth sources, trackers and metrics that a scenario names.

An installed package publishes plug-ins under names; any other is named ``"module:Class"``.
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
    """Import and return the object that ``reference``, ``"module:attribute"``, names.

    Raises:
        InputError: the module has no such attribute, is given as a path or is a notebook, or another module of its name
            is loaded.
        ModuleNotFoundError: there is no such module.

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
            classes = [key for key, value in vars(plugin).items() if isinstance(value, type) and key[0] != "_"]
            raise InputError(f"module {module!r} has no {name!r}: {nearest_choices(name, classes)}")
        plugin = getattr(plugin, name)
    return plugin


@contextmanager
def searched(*folders: Path | None) -> Iterator[None]:
    """Put folders and the working directory first on Python's module path while the context lasts."""
    before = list(sys.path)
    sys.path[:0] = [str(place) for place in (*folders, Path.cwd()) if place is not None]
    try:
        yield
    finally:
        sys.path[:] = before


def one_line(error: BaseException) -> str:
    """Return an error's type and message in one line."""
    text = printable(str(error))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _require_unambiguous(module: str) -> None:
    # Python loads one module of each name.
    top = module.partition(".")[0]
    spec = PathFinder.find_spec(top)
    loaded = getattr(sys.modules.get(top), "__file__", None)
    if spec is None or spec.origin is None or loaded is None:
        return
    if os.path.realpath(spec.origin) != os.path.realpath(loaded):
        raise InputError(f"{spec.origin} cannot be loaded beside {loaded}, which has the same name: rename one")


T = TypeVar("T")


class Registry(Generic[T]):
    """Registry of the plug-ins of one kind, such as sensors, which imports and checks plug-ins but never calls them.

    ``registry[reference]`` is ``get(reference)``, but looks each plug-in up only once.

    Args:
        group: entry-point group under which packages publish plug-ins of this kind.
        what: noun for such a plug-in in messages, such as "motion model".
        lacks: function that says what an object lacks to be such a plug-in, as the end of a sentence; None if nothing.
    """

    def __init__(self, group: str, what: str, lacks: Callable[[Any], str | None]) -> None:
        self.group = group
        self.what = what
        self.lacks = lacks
        self.plugins: dict[str, T] = {}
        """Plug-ins that have been imported and checked, by reference."""

    def names(self) -> list[str]:
        """Return the published names of plug-ins of this kind, whether or not the plug-ins can be imported."""
        return sorted(self._published())

    def get(self, reference: str, folder: Path | None = None) -> T:
        """Import and return the plug-in of a published name or of a ``"module:Class"``.

        Args:
            reference: published name or ``"module:Class"``.
            folder: folder of a scenario, searched for modules before the working directory and the installed packages.

        Raises:
            InputError: there is no such name, it cannot be imported, or it is no plug-in of this kind.
        """
        is_foreign = not self.home_of(reference).startswith("trackbench.")
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
        if is_foreign:
            _loaded[repr(reference)] = None
        try:
            lacking = self.lacks(plugin)
        except Exception as error:
            lacking = one_line(error)
        if lacking is not None:
            raise InputError(f"{reference!r} is no {self.what}: {lacking}")
        self.plugins[reference] = cast(T, plugin)
        return self.plugins[reference]

    def __getitem__(self, reference: str) -> T:
        return self.plugins.get(reference) or self.get(reference)

    def loaded(self) -> dict[str, T]:
        """Return every published plug-in that can be imported, by name."""
        return {name: result for name, result in self._tried().items() if not isinstance(result, InputError)}

    def failures(self) -> dict[str, str]:
        """Return the error message of each published plug-in that cannot be imported, by name."""
        return {name: result.message for name, result in self._tried().items() if isinstance(result, InputError)}

    def home_of(self, reference: str) -> str:
        """Return the module of a reference without importing it; empty text unless exactly one package publishes it."""
        if ":" not in reference:
            entries = self._published().get(reference, [])
            reference = entries[0].value if len(entries) == 1 else ""
        return reference.partition(":")[0]

    def name_of(self, plugin: Any) -> str:
        """Return the name or ``"module:Class"`` by which a scenario can name a class that is already loaded."""
        looked_up = next((name for name, known in self.plugins.items() if known is plugin), None)
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
    """Return words on the loaded plug-ins, such as "with the plug-ins 'a:A', 'b:B'"; empty text without any."""
    return f"with the plug-in{'s' if len(_loaded) > 1 else ''} {', '.join(_loaded)}" if _loaded else ""


#: References of the plug-ins from outside trackbench that this process has loaded, in their order.
_loaded: dict[str, None] = {}


@cache
def _entries(group: str, places: tuple[str, ...]) -> dict[str, list[EntryPoint]]:
    published: dict[str, list[EntryPoint]] = {}
    for entry in _entries_of_all_groups(places).select(group=group):
        published.setdefault(entry.name, []).append(entry)
    return published


@cache
def _entries_of_all_groups(_places: tuple[str, ...]) -> Any:
    # Cached: the metadata of all packages takes as long to read as a scenario.
    return entry_points()


def lacks_class(base: type) -> Callable[[Any], str | None]:
    """Return a check for a :class:`Registry`, which says what an object lacks to be a concrete subclass of ``base``."""

    def lacks(result: Any) -> str | None:
        wanted = f"{base.__module__}.{base.__qualname__}"
        if not isinstance(result, type) or not issubclass(result, base):
            return f"it must be a subclass of {wanted}"
        missing = sorted(getattr(result, "__abstractmethods__", ()))
        # Class variables that the base class declares without a value.
        stated = [name for name, kind in inspect.get_annotations(base).items() if str(kind).startswith("ClassVar")]
        unset = [name for name in stated if not hasattr(base, name) and not hasattr(result, name)]
        if missing or unset:
            return f"it lacks {' and '.join([*unset, *missing])}"
        return None

    return lacks
