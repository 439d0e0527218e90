"""Where the scenario itself lies on the axes of its map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from trackbench.scenario import Scenario
from trackbench.subjects.envelope.axes import MapAxis, Value


def base_point(loaded: Scenario, axes: Sequence[MapAxis]) -> list[Value | None]:
    """By axis the scenario's own value; None where it has none, or keys that are linked contradict each other.

    Of the worlds it is the first one where the scenario states none.
    """
    return [_own_value(loaded, axis) for axis in axes]


def _own_value(loaded: Scenario, axis: MapAxis) -> Value | None:
    config = axis.config
    if config.form == "choices":
        first = axis.values[0] if config.key == "world" and loaded.config.world is None else None
        return next((value for value in axis.values if _is_set(loaded, axis.changes(value))), first)
    links = {key: (link.factor, link.offset) for key, link in config.keys.items() if link.factor}
    if config.key is not None:
        links = {config.key: (1.0, 0.0)}
    numbers = []
    for key, (factor, offset) in links.items():
        number = value_at(loaded, key)
        if isinstance(number, bool) or not isinstance(number, int | float):
            return None
        numbers.append((number - offset) / factor)
    alike = bool(numbers) and max(numbers) - min(numbers) <= 1e-9 * max(map(abs, numbers))
    # Without the rounding of what the keys are linked by.
    return float(f"{numbers[0]:.12g}") if alike else None


def _is_set(loaded: Scenario, changes: Mapping[str, Any]) -> bool:
    return all(value_at(loaded, key) == value for key, value in changes.items())


def value_at(loaded: Scenario, key: str) -> Any:
    """What stands at a dotted key: what was written, else the default; None where there is neither."""
    parts = key.split(".")
    written = _walk(loaded.document.value, parts)
    return _walk(loaded.config, parts) if written is None else written


def _walk(node: Any, parts: Sequence[str]) -> Any:
    for part in parts:
        if isinstance(node, Mapping):
            node = node.get(part)
        elif isinstance(node, list):
            node = node[int(part)] if part.isdecimal() and int(part) < len(node) else None
        elif isinstance(node, BaseModel):
            fields = type(node).model_fields
            name = next((name for name, field in fields.items() if part in (name, field.alias)), part)
            node = getattr(node, name, None)
        else:
            return None
    return node
