"""Registry of the trackers that a scenario can name with ``use:``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import BaseModel, ValidationError

from trackbench.base.config.messages import explain, keyed_fields
from trackbench.base.errors import InputError, InputErrors
from trackbench.base.plugins import Registry, one_line, searched
from trackbench.trackers.answers import Tracker

Factory = Callable[..., Tracker]


def _why_no_tracker(plugin: Any) -> str | None:
    tracker_type = plugin
    if inspect.isfunction(plugin):
        try:
            tracker_type = get_type_hints(plugin).get("return")
        except (NameError, TypeError):
            tracker_type = None
    if not isinstance(tracker_type, type):
        return "it is neither a class nor a function that says which tracker it returns (-> MyTracker)"
    if not callable(getattr(tracker_type, "step", None)):
        return f"{tracker_type.__qualname__} has no method step(state, scan)"
    options = getattr(plugin, "Options", None)
    if options is not None and not (isinstance(options, type) and issubclass(options, BaseModel)):
        return "its Options are no pydantic model"
    return None


#: Trackers by their names in scenarios.
TRACKERS: Registry[Factory] = Registry("trackbench.trackers", "tracker", _why_no_tracker)


def built_in(use: str) -> bool:
    """Return whether a value of ``use:`` names a tracker that is part of trackbench; nothing is imported."""
    return TRACKERS.home_of(use).startswith("trackbench.trackers.")


def options_of(factory: Factory) -> type[BaseModel] | None:
    """Return the pydantic model ``Options`` with which a tracker declares its options; None if it has none."""
    return getattr(factory, "Options", None)


def check_tracker_options(use: str, options: Mapping[str, Any], folder: Path | None = None) -> Factory:
    """Find a tracker and validate its options against its class ``Options`` or its signature, without starting it.

    Raises:
        InputError: the name does not resolve, or the options do not fit; with the option's key, if known.
    """
    factory = TRACKERS.get(use, folder)
    declared = options_of(factory)
    if declared is None:
        _check_signature(use, factory, options)
        return factory
    try:
        declared.model_validate(options, context={"folder": folder})
    except ValidationError as invalid:
        problems = explain(invalid, keyed_fields(declared))
        errors = [InputError(message, key=".".join(map(str, path)) or None) for path, message in problems]
        raise errors[0] if len(errors) == 1 else InputErrors(errors) from None
    except Exception as error:
        raise InputError(f"{use!r} does not take these options: {one_line(error)}") from None
    return factory


def _check_signature(use: str, factory: Factory, options: Mapping[str, Any]) -> None:
    try:
        signature = inspect.signature(factory)
    except ValueError:
        return
    try:
        signature.bind(**options)
    except TypeError as error:
        takes = ", ".join(signature.parameters) or "none"
        raise InputError(f"{use!r} does not start with these options: {error} (it takes: {takes})") from None


def create(use: str, options: dict[str, Any], folder: Path | None = None) -> Callable[[], Tracker]:
    """Return a function that makes a fresh tracker with the given options, after making one as a check.

    Raises:
        InputError: the name does not resolve, or the options do not fit.
    """
    factory = check_tracker_options(use, options, folder)

    def make() -> Tracker:
        # A tracker may import modules named in its options while it starts.
        with searched(folder):
            return factory(**options)

    try:
        make()
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"{use!r} does not start with these options: {one_line(error)}") from error
    return make
