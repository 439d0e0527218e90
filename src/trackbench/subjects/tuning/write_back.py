"""The scenario with the values that were found: the text as it was, and the tracker's entry twice."""

from __future__ import annotations

import copy
import itertools
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from trackbench.base.errors import InputError
from trackbench.scenario import Scenario
from trackbench.scenario.source import parse
from trackbench.scenario.sweep import expand_sweeps
from trackbench.subjects.tuning.entry import plain
from trackbench.subjects.tuning.parameters import Values
from trackbench.truth.recorded.rows import find

START, TUNED = "_start", "_tuned"
#: Columns of a line.
WIDTH = 120


def written(loaded: Scenario, found: Mapping[str, Values], folder: Path) -> str:
    """The text of the scenario, each tuned tracker with its new values under its name, and as it was under NAME_start.

    Comments, anchors and the other trackers stay as they are. A scenario that the command line changed is written anew,
    and so is one whose text cannot be changed in place. A point of a sweep gets an entry of its own, NAME_tuned.

    Args:
        loaded: the scenario.
        found: by tracker the values of its options.
        folder: where it is written; a relative path of a recording is as seen from there.
    """
    names = _second_names(loaded, found)
    entries = {name: plain(loaded, name, values) for name, values in found.items()}

    def seen(path: str) -> str:
        return _seen_from(folder, path, loaded)

    wanted = {
        **loaded.document.value,
        "truth": _with_paths(loaded.document.value["truth"], seen),
        "trackers": _with_entries(loaded, entries, names),
    }
    if not loaded.overrides:
        try:
            text = _changed(loaded, entries, names, seen)
            if expand_sweeps(parse(text, str(loaded.path)))[0].value == wanted:
                return text
        except (InputError, KeyError):
            # Such as an entry that a merge key brings in, or a key after a question mark.
            pass
    return yaml.safe_dump(wanted, sort_keys=False, width=WIDTH, allow_unicode=True)


def _second_names(loaded: Scenario, found: Mapping[str, Values]) -> dict[str, str]:
    """By tuned tracker the name of its second entry: as it was; of a point of a sweep, as it is tuned."""
    taken = {*loaded.document.value["trackers"]}
    names = {}
    for tracker in found:
        plain_name = tracker + (TUNED if _sweep(loaded, tracker) else START)
        numbered = (f"{plain_name}_{number}" for number in itertools.count(2))
        names[tracker] = next(name for name in itertools.chain([plain_name], numbered) if name not in taken)
        taken.add(names[tracker])
    return names


def _sweep(loaded: Scenario, tracker: str) -> str | None:
    """The name of the sweep that a tracker is a point of."""
    return next((name for name, points in loaded.sweeps.items() if tracker in points), None)


def _with_entries(loaded: Scenario, entries: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """All trackers, the tuned ones twice."""
    trackers = {}
    for name, entry in loaded.document.value["trackers"].items():
        if name not in entries:
            trackers[name] = entry
        elif _sweep(loaded, name):
            trackers |= {name: entry, names[name]: entries[name]}
        else:
            trackers |= {name: entries[name], names[name]: copy.deepcopy(entry)}
    return trackers


def _seen_from(folder: Path, path: str, loaded: Scenario) -> str:
    """A path of a recording as seen from another folder."""
    if "$" in path or Path(path).expanduser().is_absolute():
        return path
    return os.path.relpath(find(path, loaded.path.resolve().parent, "truth").resolve(), folder.resolve())


def _with_paths(truth: Any, seen: Callable[[str], str]) -> Any:
    """The truth with other paths, where it is a recording: of its own file, the observer's and each sensor's."""
    if not isinstance(truth, dict) or truth.get("source") != "recording":
        return truth
    return _replaced(truth, seen)


def _replaced(node: Any, seen: Callable[[str], str]) -> Any:
    if not isinstance(node, dict):
        return node
    return {
        key: seen(value) if key == "path" and isinstance(value, str) else _replaced(value, seen)
        for key, value in node.items()
    }


def _changed(
    loaded: Scenario, entries: Mapping[str, dict[str, Any]], names: Mapping[str, str], seen: Callable[[str], str]
) -> str:
    """The text of the file, changed in place.

    Raises:
        KeyError: something does not stand where it does in most scenarios.
    """
    text = loaded.text
    if loaded.document.value["truth"].get("source") == "recording":
        nodes = {node.start_mark.index: node for node in _path_nodes(_entry(_composed(text), "truth")[1])}
        for start, node in sorted(nodes.items(), reverse=True):
            text = f"{text[:start]}{json.dumps(seen(node.value))}{text[node.end_mark.index :]}"
    for tracker, entry in entries.items():
        trackers = _entry(_composed(text), "trackers")[1]
        sweep = _sweep(loaded, tracker)
        key = _entry(trackers, sweep or tracker)[0]
        if sweep:
            text = _inserted(text, key.start_mark, names[tracker], entry, trackers.flow_style)
        else:
            text = text[: key.start_mark.index] + names[tracker] + text[key.end_mark.index :]
            text = _inserted(text, key.start_mark, tracker, entry, trackers.flow_style)
    return text


def _composed(text: str) -> Any:
    return yaml.compose(text, Loader=yaml.SafeLoader)


def _entry(node: Any, name: str) -> tuple[Any, Any]:
    """The nodes of a key and of its value."""
    return {key.value: (key, value) for key, value in node.value}[name]


def _path_nodes(node: Any) -> Iterator[Any]:
    """The nodes of all paths of a recording."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == "path" and isinstance(value, yaml.ScalarNode):
                yield value
            else:
                yield from _path_nodes(value)


def _inserted(text: str, mark: yaml.Mark, name: str, entry: dict[str, Any], in_braces: bool) -> str:
    """The text with an entry of a mapping before the one that begins at the mark."""
    before, after = text[: mark.index], text[mark.index :]
    line, margin = f"{name}: {_shown(entry)}", " " * mark.column
    if in_braces:
        between = " " if before.rpartition("\n")[2].strip() else f"\n{margin}"
        return f"{before}{line},{between}{after}"
    if mark.column + len(line) > WIDTH:
        rows = [f"{key}: {_shown(value)}" for key, value in entry.items()]
        line = f"\n{margin}  ".join([f"{name}:", *rows])
    return f"{before}{line}\n{margin}{after}"


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_shown(key)}: {_shown(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", value) and value.lower() not in _WORDS:
        return value
    if isinstance(value, float) and float(f"{value:.10g}") == value:
        return f"{value:.10g}"
    return json.dumps(value)


_WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")
