"""``--set``, ``sweep:`` of a tracker, and the text of a scenario with changed keys."""

from __future__ import annotations

import copy
import json
import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

from trackbench.base.config import KeyPath
from trackbench.base.errors import InputError, did_you_mean, nearest_choices
from trackbench.scenario.source import Origin, YamlDocument, dotted, parse_yaml


def apply_overrides(document: YamlDocument, overrides: Sequence[str]) -> YamlDocument:
    """A copy of ``document`` with each ``key.path=value`` set; values are read as YAML, list indices count from 0.

    Whether a key exists is left to the validation.

    Raises:
        InputError: no ``=``, a value that is not YAML, an index outside its list, a path through a plain value.
    """
    value, origins = copy.deepcopy(document.value), dict(document.origins)
    for override in overrides:
        origin = Origin(f"--set {override}")
        key, equals, text = override.partition("=")
        parts = key.strip().split(".")
        if not equals or not all(parts):
            raise InputError("write --set key.path=value, such as --set monte_carlo.runs=10", file=origin.file)
        _require_entry(value, parts, origin)
        path = set_value(value, parts, _read(text, origin), origin)
        origins = {at: place for at, place in origins.items() if at[: len(path)] != path}
        origins[path] = origin
    return replace(document, value=value, origins=origins)


def from_working_folder(override: str, folder: Path) -> str:
    """Return a ``key.path=value`` in which each file of the working folder that it names is a full path.

    Args:
        override: what is set over a scenario; of a ``path`` or a ``command``, files are looked for.
        folder: the scenario's, where the paths in its file start.
    """
    key, _, text = override.partition("=")
    parts = [part for part in key.strip().split(".") if not part.isdecimal()]
    if folder == Path.cwd() or "options" in parts or parts[-1:] not in (["path"], ["command"]):
        return override
    value = _read(text, Origin(f"--set {override}"))
    items = value if isinstance(value, list) else [value]
    # A program without a / is looked for on PATH.
    bare = 1 if parts[-1] == "command" and "/" not in str(items[:1]) else 0
    moved = [
        str(Path(item).absolute()) if isinstance(item, str) and number >= bare and os.path.isfile(item) else item
        for number, item in enumerate(items)
    ]
    if moved == items:
        return override
    return f"{key}={json.dumps(moved if isinstance(value, list) else moved[0], ensure_ascii=False)}"


#: Sections whose entries have names, and the keys that say what a new entry is: one of these comes first.
NAMED = {"sensors": ("type", "preset"), "trackers": ("use", "filter")}


def _require_entry(root: Any, parts: Sequence[str], origin: Origin) -> None:
    """Make sure that a key is not set of a sensor or tracker that is not there.

    Raises:
        InputError: it is; with the names of those of that type, or the nearest name.
    """
    if len(parts) < 3 or parts[0] not in NAMED or not isinstance(root, dict):
        return
    section, name, key = parts[:3]
    entries = root.get(section)
    if not isinstance(entries, dict) or name in entries or key in NAMED[section]:
        return
    of_type = [other for other, entry in entries.items() if isinstance(entry, dict) and name in entry.values()]
    hint = did_you_mean(of_type) or nearest_choices(name, map(str, entries))
    raise InputError(f"there is no {name!r} in {section}; {hint}", key=dotted((section, name)), file=origin.file)


def _read(text: str, origin: Origin) -> Any:
    try:
        return parse_yaml(text, origin.file).value
    except InputError as error:
        raise InputError(error.message, file=origin.file) from None


def set_value(root: Any, parts: Sequence[str], new: Any, origin: Origin) -> KeyPath:
    """Set the value at the keys ``parts``, and return the path of what changed: the outermost mapping made for it.

    Raises:
        InputError: an index outside its list, a path through a plain value; with the place ``origin`` of the value.
    """
    node = root
    path: KeyPath = ()
    changed: KeyPath | None = None
    for position, part in enumerate(parts):
        key: Any = part
        if isinstance(node, list):
            if not part.isdecimal() or int(part) >= len(node):
                choices = f"choose from 0 to {len(node) - 1}" if node else "it is empty"
                message = f"{part!r} is not an index of this list; {choices}"
                raise InputError(message, key=dotted(path), file=origin.file, line=origin.line)
            key = int(part)
        if not isinstance(node, dict | list):
            at = dotted(path)
            message = f"it is {node!r}, which has no key {part!r}; set it as a whole: --set '{at}={{...}}'"
            raise InputError(message, key=at, file=origin.file, line=origin.line)
        path = (*path, key)
        if position == len(parts) - 1:
            node[key] = new
        elif isinstance(node, dict) and node.get(key) is None:
            node[key] = {}
            changed = changed or path
        node = node[key]
    return changed or path


#: More trackers than this in one scenario are a slip of the pen.
MAX_POINTS = 10_000
MAX_NAME = 64

FORM = "write option: [values] (all combinations), or a list of mappings, each a point"


#: The value of each option of a point, and where it was written.
Point = dict[str, tuple[Any, KeyPath]]


def expand_sweeps(document: YamlDocument) -> tuple[YamlDocument, dict[str, tuple[str, ...]]]:
    """The document with a tracker for each point of each sweep, and the names of the points by their sweep's.

    Errors at a point lead back to the line where the value or the option was written.

    Raises:
        InputError: a sweep that is not one of the two forms, has no or too many points, or two of one name.
    """
    trackers = document.value.get("trackers")
    if not isinstance(trackers, dict) or not any(_has_sweep(entry) for entry in trackers.values()):
        return document, {}
    taken = {name for name, entry in trackers.items() if not _has_sweep(entry)}
    expanded: dict[str, Any] = {}
    written: dict[KeyPath, KeyPath] = {}
    sweeps: dict[str, tuple[str, ...]] = {}
    for name, entry in trackers.items():
        if not _has_sweep(entry):
            expanded[name] = entry
            continue
        base = {key: value for key, value in entry.items() if key != "sweep"}
        points = _named(document, name, _points(document, entry["sweep"], ("trackers", name, "sweep")), taken)
        for full, point in points.items():
            expanded[full] = copy.deepcopy(base)
            written["trackers", full] = ("trackers", name)
            for option, (value, place) in point.items():
                written["trackers", full, *_set(document, expanded[full], option, value, place)] = place
        sweeps[name] = tuple(points)
    return replace(document, value={**document.value, "trackers": expanded}, written=written), sweeps


def _named(document: YamlDocument, name: str, points: Sequence[Point], taken: set[str]) -> dict[str, Point]:
    """The points by the names of their trackers, which are then taken."""
    named = {}
    for point in points:
        full = "_".join([name, *(_word(value) for value, _ in point.values())])
        _, place = next(iter(point.values()))
        if len(full) > MAX_NAME:
            raise _error(document, place, f"the name {full!r} of this point has more than {MAX_NAME} characters")
        if full in taken:
            raise _error(document, place, f"there is another tracker {full!r}; remove one of them")
        taken.add(full)
        named[full] = point
    return named


def _set(document: YamlDocument, entry: dict[str, Any], option: str, value: Any, place: KeyPath) -> KeyPath:
    """Set an option of a point, and return its path in the tracker's entry."""
    parts = option.split(".")
    try:
        changed = set_value(entry, parts, copy.deepcopy(value), document.origin(place))
    except InputError as error:
        raise _error(document, place, error.message.partition(";")[0]) from None
    return (*changed, *parts[len(changed) :])


def _has_sweep(entry: Any) -> bool:
    return isinstance(entry, dict) and "sweep" in entry


def _points(document: YamlDocument, sweep: Any, at: KeyPath) -> list[Point]:
    if not isinstance(sweep, dict | list) or not sweep:
        raise _error(document, at, f"not a sweep: {FORM}")
    if isinstance(sweep, list):
        for index, point in enumerate(sweep):
            if not isinstance(point, dict) or not point:
                raise _error(document, (*at, index), f"a mapping of options to values is needed: {FORM}")
        points = [
            {option: (value, (*at, index, option)) for option, value in point.items()}
            for index, point in enumerate(sweep)
        ]
        count = len(points)
    else:
        for option, values in sweep.items():
            if not isinstance(values, list) or not values:
                raise _error(document, (*at, option), f"a list of values is needed: {FORM}")
        placed = [
            [(value, (*at, option, index)) for index, value in enumerate(values)] for option, values in sweep.items()
        ]
        count = math.prod(map(len, placed))
        points = [dict(zip(sweep, chosen, strict=True)) for chosen in islice(product(*placed), MAX_POINTS)]
    if count > MAX_POINTS:
        raise _error(document, at, f"{count} points are too many; at most {MAX_POINTS}")
    for option, (_, place) in chain.from_iterable(point.items() for point in points):
        if not all(option.split(".")) or option.split(".")[0] == "sweep":
            raise _error(
                document, place[: place.index(option, len(at)) + 1], f"{option!r} is not an option of a tracker"
            )
    return points


def _word(value: Any) -> str:
    """A value as it is part of a name."""
    if isinstance(value, dict | list):
        return "-".join(_word(item) for item in (value.values() if isinstance(value, dict) else value))
    if isinstance(value, bool) or value is None:
        return "none" if value is None else str(value).lower()
    if isinstance(value, float):
        return f"{value:.10g}".replace("+", "").replace(".", "p")
    return re.sub(r"[^A-Za-z0-9_-]+", "-", str(value))


def _error(document: YamlDocument, path: KeyPath, message: str) -> InputError:
    origin = document.origin(path)
    return InputError(message, key=dotted(path), file=origin.file, line=origin.line)


def with_moved_paths(node: Any, move: Callable[[str], str], is_path: bool = False) -> Any:
    """A part of a scenario in which every ``path``, one or a list, is another; what else stands there stays.

    Args:
        node: the part.
        move: the new path for an old one.
        is_path: whether it is itself the value of a ``path``.
    """
    if isinstance(node, dict):
        return {key: with_moved_paths(value, move, key == "path") for key, value in node.items()}
    if is_path and isinstance(node, list):
        return [with_moved_paths(item, move, True) for item in node]
    return move(node) if is_path and isinstance(node, str) else node
