"""The text of a scenario with changed keys: in place, so that comments stay, wherever that can be."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from trackbench.base.errors import InputError
from trackbench.base.files import path_from
from trackbench.scenario.load import Scenario
from trackbench.scenario.overrides import apply_overrides
from trackbench.scenario.source import parse_yaml

#: Columns of a line.
WIDTH = 120


def written_with_changes(loaded: Scenario, folder: Path) -> str:
    """The text of a scenario in which its ``--set`` stand, for a file in another folder.

    Args:
        loaded: the scenario.
        folder: where the file will be; the path of a recorded truth is as seen from there.
    """
    truth = loaded.document.value["truth"]
    changes = [*loaded.overrides]
    if isinstance(truth, dict) and isinstance(truth.get("path"), str):
        changes.append(f"truth.path={json.dumps(path_from(truth['path'], loaded.path.resolve().parent, folder))}")
    return changed_text(loaded.text, changes)


def changed_text(text: str, changes: Sequence[str]) -> str:
    """The text of a scenario with some keys set; written anew, without comments, where it cannot be changed in place.

    Args:
        text: YAML, a mapping.
        changes: ``key.path=value`` each.

    Raises:
        InputError: a change is none, or cannot be made.
    """
    document = apply_overrides(parse_yaml(text, "scenario"), changes)
    try:
        new = text
        for change in changes:
            key, _, value = change.partition("=")
            new = _set(new, key.strip().split("."), json.dumps(parse_yaml(value, "scenario").value, ensure_ascii=False))
        if parse_yaml(new, "scenario").value == document.value:
            return new
    except (InputError, ValueError, yaml.YAMLError):
        # Such as a key that an anchor brings in, or a whole block that is replaced.
        pass
    return yaml.safe_dump(document.value, sort_keys=False, width=WIDTH, allow_unicode=True)


def _set(text: str, parts: Sequence[str], value: str) -> str:
    """One key.

    Raises:
        ValueError: it stands where no text can be put in its place.
    """
    node: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    for number, part in enumerate(parts):
        if isinstance(node, yaml.MappingNode):
            child = next((item for key, item in node.value if key.value == part), None)
            if child is None:
                return _inserted(text, node, parts[number:], value)
        elif isinstance(node, yaml.SequenceNode) and part.isdecimal() and int(part) < len(node.value):
            child = node.value[int(part)]
        else:
            raise ValueError(f"{part} is in a plain value")
        node = child
    if not isinstance(node, yaml.ScalarNode) and not node.flow_style:
        raise ValueError("a block takes no new text in its place")
    return text[: node.start_mark.index] + value + text[node.end_mark.index :]


def _inserted(text: str, mapping: yaml.MappingNode, parts: Sequence[str], value: str) -> str:
    """A key that a mapping does not have yet, with the mappings that it stands in."""
    inner = value
    for part in reversed(parts[1:]):
        inner = f"{{{part}: {inner}}}"
    start = mapping.start_mark.index
    if mapping.flow_style:
        return f"{text[: start + 1]}{parts[0]}: {inner}{', ' if mapping.value else ''}{text[start + 1 :]}"
    if mapping.start_mark.column == 0:
        return f"{text.rstrip()}\n\n{parts[0]}: {inner}\n"
    return f"{text[:start]}{parts[0]}: {inner}\n{' ' * mapping.start_mark.column}{text[start:]}"
