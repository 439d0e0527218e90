"""The plug-ins of one kind: published by installed packages, or named ``"module:Class"``."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from trackbench.base.errors import InputError, nearest
from trackbench.base.plugins.imports import attribute, classes, explained, one_line, searched

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
        with searched(folder), explained(reference, folder):
            found = attribute(reference, classes) if ":" in reference else self._entry(reference).load()
        try:
            lacking = self.lacks(found)
        except (Exception, SystemExit) as error:
            lacking = one_line(error)
        if lacking is not None:
            raise InputError(f"{reference!r} is no {self.what}: {lacking}")
        self.found[reference] = cast(T, found)
        return self.found[reference]

    def __getitem__(self, reference: str) -> T:
        try:
            return self.found[reference]
        except KeyError:
            return self.get(reference)

    def loaded(self) -> dict[str, T]:
        """Every published one that can be imported, by name."""
        return {name: found for name, found in self._tried().items() if not isinstance(found, InputError)}

    def failures(self) -> dict[str, str]:
        """Why the others cannot, by name."""
        return {name: found.message for name, found in self._tried().items() if isinstance(found, InputError)}

    def home_of(self, reference: str) -> str:
        """The module in which a name is found, which is not imported; empty where the name is not published once."""
        if ":" not in reference:
            entries = self._published().get(reference, [])
            reference = entries[0].value if len(entries) == 1 else ""
        return reference.partition(":")[0]

    def name_of(self, found: Any) -> str:
        """The name under which a scenario can ask for a plug-in that is at hand."""
        known = next((name for name, other in self.found.items() if other is found), None)
        if known is not None:
            return known
        reference = f"{found.__module__}:{found.__qualname__}"
        published = self._published().items()
        return next((name for name, entries in published if entries[0].value == reference), reference)

    def _tried(self) -> dict[str, T | InputError]:
        found: dict[str, T | InputError] = {}
        for name in self.names():
            try:
                found[name] = self.get(name)
            except InputError as error:
                found[name] = error
        return found

    def _entry(self, name: str) -> EntryPoint:
        published = self._published()
        if name not in published:
            hint = nearest(name, published)
            raise InputError(f'no {self.what} is published as {name!r}: {hint} (a class is named "module:Class")')
        values = sorted({entry.value for entry in published[name]})
        if len(values) > 1:
            places = " and as ".join(values)
            raise InputError(f"{name!r} is published {len(values)} times, as {places}: name one of them")
        return published[name][0]

    def _published(self) -> dict[str, list[EntryPoint]]:
        return _entries(self.group, tuple(sys.path))


@cache
def _entries(group: str, _places: tuple[str, ...]) -> dict[str, list[EntryPoint]]:
    """The entry points of a group by name. To read the metadata of all packages takes as long as to read a scenario."""
    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=group):
        found.setdefault(entry.name, []).append(entry)
    return found


def lacks_class(base: type) -> Callable[[Any], str | None]:
    """For a registry of classes: what something lacks to be a whole subclass of ``base``."""

    def lacks(found: Any) -> str | None:
        wanted = f"{base.__module__}.{base.__qualname__}"
        if not isinstance(found, type) or not issubclass(found, base):
            return f"it must be a subclass of {wanted}"
        missing = sorted(getattr(found, "__abstractmethods__", ()))
        unset = [name for name in inspect.get_annotations(base) if _stated(base, name) and not hasattr(found, name)]
        if missing or unset:
            return f"it lacks {' and '.join([*unset, *missing])}"
        return None

    return lacks


def _stated(base: type, name: str) -> bool:
    """Whether each subclass has to state a class variable: it is annotated as one, and has no value."""
    return str(inspect.get_annotations(base)[name]).startswith("ClassVar") and not hasattr(base, name)
