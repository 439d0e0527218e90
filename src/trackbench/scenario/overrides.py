"""Changes of a scenario: values by ``--set``, trackers by ``sweep``, and relative paths for another folder."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, product
from pathlib import Path
from typing import Any

from trackbench.base.config import KeyPath
from trackbench.base.errors import InputError, nearest_choices
from trackbench.scenario.source import YamlDocument, dotted, parse_yaml


def apply_overrides(document: YamlDocument, overrides: Sequence[str]) -> YamlDocument:
    """Return a copy of ``document`` with each ``key.path=value`` set; values are YAML, list indices count from 0.

    A key that does not exist is found later, by the validation.

    Raises:
        InputError: no ``=``, a value that is not YAML, an index outside its list, or a key below a plain value.
    """
    value, settings = copy.deepcopy(document.value), dict(document.settings)
    for override in overrides:
        option = f"--set {override}"
        key, equals, text = override.partition("=")
        key = key.strip()
        if not equals or not all(key.split(".")):
            raise InputError("write --set key.path=value, such as --set monte_carlo.runs=10", file=option)
        try:
            _require_entry(value, key.split("."))
            path = set_value(value, key, parse_yaml(text, option).value)
        except InputError as error:
            raise InputError(error.message, key=error.key, file=option) from None
        settings = {key: place for key, place in settings.items() if key[: len(path)] != path}
        settings[path] = option
    return replace(document, value=value, settings=settings)


#: Sections with named entries, and the keys of which one must be the first that is set in a new entry.
NAMED = {"sensors": ("type", "preset"), "trackers": ("use", "filter")}


def _require_entry(root: Any, parts: Sequence[str]) -> None:
    """Raise an error if a key is of a sensor or tracker that does not exist; the message has the nearest name."""
    entries = root.get(parts[0]) if isinstance(root, dict) and parts[0] in NAMED and len(parts) > 2 else None
    if isinstance(entries, dict) and parts[1] not in entries and parts[2] not in NAMED[parts[0]]:
        hint = nearest_choices(parts[1], entries)
        raise InputError(f"there is no {parts[1]!r} in {parts[0]}; {hint}", key=dotted((parts[0], parts[1])))


def set_value(root: Any, dotted_key: str, new: Any) -> KeyPath:
    """Set the value at a dotted key; return the path of the outermost mapping made for it, or of the key itself.

    Raises:
        InputError: an index is outside its list, or a key is below a plain value.
    """
    node = root
    path: KeyPath = ()
    changed: KeyPath | None = None
    *parts, last = dotted_key.split(".")
    for part in (*parts, last):
        key: Any = part
        if isinstance(node, list):
            if not part.isdecimal() or int(part) >= len(node):
                choices = f"choose from 0 to {len(node) - 1}" if node else "it is empty"
                raise InputError(f"{part!r} is not an index of this list; {choices}", key=dotted(path))
            key = int(part)
        elif not isinstance(node, dict):
            at = dotted(path)
            message = f"it is {node!r}, which has no key {part!r}; set it as a whole: --set '{at}={{...}}'"
            raise InputError(message, key=at)
        path = (*path, key)
        if len(path) > len(parts):
            node[key] = new
        elif isinstance(node, dict) and node.get(key) is None:
            node[key] = {}
            changed = changed or path
        node = node[key]
    return changed or path


#: Largest number of points of a sweep; more must be a mistake.
MAX_POINTS = 10_000
FORM = "write option: [values] (all combinations), or a list of mappings, each a point"
#: Point of a sweep: the value of each option, with the path at which it was written.
Point = dict[str, tuple[Any, KeyPath]]


def expand_sweeps(document: YamlDocument) -> tuple[YamlDocument, dict[str, tuple[str, ...]]]:
    """Replace each tracker with a sweep by a tracker for each point; return the document and, by sweep, their names.

    Later errors in such a tracker name the line of the swept value or of the option.

    Raises:
        InputError: a sweep has neither of the two forms, no points, too many, or two points with one name.
    """
    trackers = document.value.get("trackers")
    if not isinstance(trackers, dict):
        return document, {}
    swept = {name for name, entry in trackers.items() if isinstance(entry, dict) and "sweep" in entry}
    expanded = {name: entry for name, entry in trackers.items() if name not in swept}
    written: dict[KeyPath, KeyPath] = {}
    sweeps: dict[str, tuple[str, ...]] = {}
    for name in (name for name in trackers if name in swept):
        at = ("trackers", name, "sweep")
        points = list(islice(_points(document, trackers[name]["sweep"], at), MAX_POINTS + 1))
        if len(points) > MAX_POINTS:
            raise document.error(at, f"more than {MAX_POINTS} points")
        names = ["_".join([name, *(_name_part(value) for value, _ in point.values())]) for point in points]
        for full, point in zip(names, points, strict=True):
            if full in expanded:
                _, place = next(iter(point.values()))
                raise document.error(place, f"there is another tracker {full!r}; remove one of them")
            entry = expanded[full] = copy.deepcopy({k: v for k, v in trackers[name].items() if k != "sweep"})
            written["trackers", full] = ("trackers", name)
            for option, (value, place) in point.items():
                if option.partition(".")[0] == "sweep":
                    raise document.error(place, f"{option!r} is not an option of a tracker")
                try:
                    set_value(entry, option, copy.deepcopy(value))
                except InputError as error:
                    raise document.error(place, error.message.partition(";")[0]) from None
                written["trackers", full, *option.split(".")] = place
        sweeps[name] = tuple(names)
    order = [point for name in trackers for point in sweeps.get(name, (name,))]
    value = {**document.value, "trackers": {name: expanded[name] for name in order}}
    return replace(document, value=value, written=written), sweeps


def _points(document: YamlDocument, sweep: Any, at: KeyPath) -> Iterator[Point]:
    if not isinstance(sweep, dict | list) or not sweep:
        raise document.error(at, f"not a sweep: {FORM}")
    if isinstance(sweep, list):
        for index, point in enumerate(sweep):
            if not isinstance(point, dict) or not point:
                raise document.error((*at, index), f"a mapping of options to values is needed: {FORM}")
            yield {option: (value, (*at, index, option)) for option, value in point.items()}
        return
    for option, values in sweep.items():
        if not isinstance(values, list) or not values:
            raise document.error((*at, option), f"a list of values is needed: {FORM}")
    placed = ([(value, (*at, option, index)) for index, value in enumerate(values)] for option, values in sweep.items())
    yield from (dict(zip(sweep, point, strict=True)) for point in product(*placed))


def _name_part(value: Any) -> str:
    if isinstance(value, dict | list):
        return "-".join(_name_part(item) for item in (value.values() if isinstance(value, dict) else value))
    if isinstance(value, bool) or value is None:
        return "none" if value is None else str(value).lower()
    if isinstance(value, float):
        return f"{value:.10g}".replace("+", "").replace(".", "p")
    return re.sub(r"[^A-Za-z0-9_-]+", "-", str(value))


def with_moved_paths(node: Any, folder: Path, new_folder: Path, is_path: bool = False) -> Any:
    """Return a part of a scenario with each value of a key ``path`` as seen from another folder.

    A path that is absolute, has a variable or leads nowhere is left unchanged.

    Args:
        node: the part of the scenario: mapping, list or plain value.
        folder: folder in which relative paths start now, before the working directory.
        new_folder: folder in which they are to start.
        is_path: whether ``node`` is itself the value of a ``path``.
    """
    if isinstance(node, dict):
        return {key: with_moved_paths(value, folder, new_folder, key == "path") for key, value in node.items()}
    if is_path and isinstance(node, list):
        return [with_moved_paths(item, folder, new_folder, True) for item in node]
    if not is_path or not isinstance(node, str) or "$" in node or Path(node).expanduser().is_absolute():
        return node
    file = next((place for place in (folder / node, Path(node)) if place.exists()), None)
    return node if file is None else os.path.relpath(file.resolve(), new_folder.resolve())
