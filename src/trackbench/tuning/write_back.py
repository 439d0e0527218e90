"""The scenario with the values that were found: the text as it was, and the tracker's entry twice."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from trackbench.scenario import Scenario
from trackbench.tuning.entry import plain
from trackbench.tuning.parameters import Values

START, TUNED = "_start", "_tuned"
#: Columns of a line.
WIDTH = 120


def written(loaded: Scenario, found: Mapping[str, Values], folder: Path) -> str:
    """The text of the scenario, each tuned tracker with its new values under its name, and as it was under NAME_start.

    Comments, anchors and the other trackers stay as they are. A scenario that the command line changed is written anew,
    and a point of a sweep gets an entry of its own, NAME_tuned.

    Args:
        loaded: the scenario.
        found: by tracker the values of its options.
        folder: where it is written; a relative path of a recording is as seen from there.
    """
    text = loaded.text
    if loaded.overrides:
        text = _anew(loaded)
    text = _with_path(text, loaded, folder)
    for tracker, values in found.items():
        text = _with(text, loaded, tracker, values)
    return text


def _with(text: str, loaded: Scenario, tracker: str, values: Values) -> str:
    """The text with the tracker's entry under another name, and the new one before it."""
    trackers = _value(yaml.compose(text, Loader=yaml.SafeLoader), "trackers")
    keys = {key.value: key for key, _ in trackers.value}
    entry = plain(loaded, tracker, values)
    if tracker in keys:
        key = keys[tracker]
        text = text[: key.start_mark.index] + tracker + START + text[key.end_mark.index :]
        return _inserted(text, key.start_mark, tracker, entry)
    # A point of a sweep has no entry of its own.
    sweep = next(name for name, points in loaded.sweeps.items() if tracker in points)
    return _inserted(text, keys[sweep].start_mark, tracker + TUNED, entry)


def _with_path(text: str, loaded: Scenario, folder: Path) -> str:
    """The text with the path of a recording as seen from another folder."""
    given = loaded.document.value["truth"].get("path")
    if not isinstance(given, str) or given.startswith("$") or Path(given).is_absolute():
        return text
    seen = os.path.relpath(loaded.path.resolve().parent / given, folder.resolve())
    node = _value(_value(yaml.compose(text, Loader=yaml.SafeLoader), "truth"), "path")
    return f"{text[: node.start_mark.index]}{json.dumps(seen)}{text[node.end_mark.index :]}"


def _inserted(text: str, mark: yaml.Mark, name: str, entry: dict[str, Any]) -> str:
    """The text with an entry of a mapping before the one that begins at the mark."""
    before, after = text[: mark.index], text[mark.index :]
    line = f"{name}: {_shown(entry)}"
    if before.rpartition("\n")[2].strip():
        # A mapping in braces.
        return f"{before}{line}, {after}"
    margin = " " * mark.column
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
    return f"{value:.10g}" if isinstance(value, float) else json.dumps(value)


_WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")


def _anew(loaded: Scenario) -> str:
    """The text of a scenario that the command line changed: its values, without comments."""
    return yaml.safe_dump(loaded.document.value, sort_keys=False, width=WIDTH, allow_unicode=True)


def _value(node: Any, key: str) -> Any:
    return next(value for name, value in node.value if name.value == key)
