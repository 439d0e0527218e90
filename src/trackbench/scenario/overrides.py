"""``--set key.path=value``: values of the command line put into a document before it is validated."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from trackbench.base.config import KeyPath
from trackbench.base.errors import InputError, nearest
from trackbench.scenario.source import Origin, YamlDocument, dotted, parse


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
    alike = [known for known, entry in entries.items() if isinstance(entry, dict) and name in entry.values()]
    hint = f"did you mean {' or '.join(map(repr, alike))}?" if alike else nearest(name, map(str, entries))
    raise InputError(f"there is no {name!r} in {section}; {hint}", key=dotted((section, name)), file=origin.file)


def _read(text: str, origin: Origin) -> Any:
    try:
        return parse(text, origin.file).value
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
        key: Any = _index(node, part, path, origin) if isinstance(node, list) else part
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


def _index(items: list[Any], part: str, path: KeyPath, origin: Origin) -> int:
    if part.isdecimal() and int(part) < len(items):
        return int(part)
    choices = f"choose from 0 to {len(items) - 1}" if items else "it is empty"
    raise InputError(
        f"{part!r} is not an index of this list; {choices}", key=dotted(path), file=origin.file, line=origin.line
    )
