"""Metrics of other packages: from a name in a scenario to a class."""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from trackbench.errors import InputError, nearest
from trackbench.metrics.builtin import BUILT_IN
from trackbench.metrics.protocol import Metric
from trackbench.plugins import attribute, classes, explained, searched

GROUP = "trackbench.metrics"
NAME = re.compile(r"[a-z][a-z0-9_]*")


def published() -> dict[str, EntryPoint]:
    """The metrics that installed packages publish, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def find(use: str, folder: Path | None = None) -> type[Metric]:
    """The class behind a published name or a ``"module:Class"``.

    Args:
        use: what a scenario says.
        folder: the scenario's folder, searched for modules before the working directory.

    Raises:
        InputError: there is no such name, it cannot be imported, or it is no metric; says why.
    """
    with searched(folder), explained(use, folder):
        found = attribute(use, classes) if ":" in use else _published(use).load()
    lacking = _lacks(found)
    if lacking is not None:
        raise InputError(f"{use!r} is no metric: {lacking}")
    return found  # type: ignore[no-any-return]


def _published(name: str) -> EntryPoint:
    known = published()
    if name not in known:
        hint = nearest(name, known)
        raise InputError(f'no metric is published as {name!r}: {hint} (a class is named "module:Class")')
    return known[name]


def _lacks(found: Any) -> str | None:
    """What something lacks to be a metric, as the end of a sentence."""
    if not isinstance(found, type) or not issubclass(found, Metric):
        return "it must be a subclass of trackbench.metrics.OwnMetric"
    missing = [name for name in ("name", "unit", "meaning") if not hasattr(found, name)]
    missing += sorted(getattr(found, "__abstractmethods__", ()))
    if missing:
        return f"it lacks {' and '.join(missing)}"
    if not NAME.fullmatch(found.name):
        return f"its name {found.name!r} may have a to z, 0 to 9 and _ alone"
    if found.name in {metric.name.partition(".")[0] for metric in BUILT_IN} | {"health"}:
        return f"its name {found.name!r} is that of a built-in one"
    if found.better not in ("smaller", "larger", None):
        return f'better must be "smaller", "larger" or None, not {found.better!r}'
    return None
