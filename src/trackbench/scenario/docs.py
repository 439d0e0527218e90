"""Documentation pages on the scenario file, one for each key of its top level, made from its JSON Schema."""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from trackbench.base.config.key_units import show
from trackbench.base.config.plugin import REFERENCE
from trackbench.base.subjects import offered, resolve
from trackbench.scenario.schema import Schema, json_schema

_EXAMPLES = yaml.safe_load(Path(__file__).with_name("examples.yaml").read_text(encoding="utf-8"))
#: An example of each key of the top level; together they are a whole scenario.
EXAMPLES: dict[str, str] = {
    **_EXAMPLES["sections"],
    **{key: resolve(target).EXAMPLE for key, target in offered("blocks")},
}
#: An example of each further form of a section, by the class that describes the form.
OTHER_EXAMPLES: dict[str, str] = _EXAMPLES["classes"]
#: Headings of classes for which neither their key nor their name in a file is a good heading.
HEADINGS: dict[str, str] = _EXAMPLES["headings"]

#: Key, type, default and meaning of a key.
Row = tuple[str, str, str, str]
#: Rows that the page has above are listed by key alone if there are at least this many.
FEWEST_REPEATED = 3
#: Bounds beyond this number or below its inverse only refuse nonsense, and are not shown.
VAST = 1e4
#: Page on which the classes of a key are described, where it is the page of another key.
HOMES = {"motion": "trackers"}
NOTE = "<!-- Made from the schema by `python -m trackbench.scenario.docs docs`. Change the field descriptions. -->"
INTRODUCTION = f"""\
# The scenario file

{NOTE}

A scenario is one YAML file: the true motion, the sensors that see it, the trackers that follow it, and what is
expected of them. `trackbench check FILE` validates it, `trackbench schema` prints its JSON Schema for editors, and
`--set key.path=value` sets any key from the command line (`--set trackers.ekf_cv.acceleration_sigma_mps2=2`; the items
of a list count from 0).

The unit is the end of a key's name: `_m` metres, `_s` seconds, `_hz` Hz, `_deg` degrees, `_rad` radians, `_mps` m/s,
`_mps2` m/s^2, `_mps3` m/s^3, `_radps` rad/s, `_radps2` rad/s^2. Angles are counter-clockwise. YAML is read by the rules
of version 1.2: `on`, `yes` and `1:30` are text. `<<: *name` merges a mapping with an anchor.

A relative path starts in the scenario's folder, or in the working directory. Environment variables in it, such as
`$TRACKBENCH_DATA`, are filled in.
"""


def scenario_pages() -> dict[str, str]:
    """Return the text of each page on the scenario file, by its path in the folder of the documentation."""
    schema = json_schema()
    fields, parts = schema["properties"], schema["$defs"]
    rows = _table(_rows(schema, "[`{0}`](scenario-file/{0}.md)"))
    tree = "\n".join(f"scenario-file/{key}" for key in fields)
    pages = {"scenario-file.md": [INTRODUCTION, rows, f"```{{toctree}}\n:hidden:\n\n{tree}\n```"]}
    described: set[str] = set()
    for key, field in fields.items():
        head = [f"# `{key}`", NOTE, field["description"], _yaml(EXAMPLES[key])]
        pages[f"scenario-file/{key}.md"] = [*head, *_described(field, key, parts, described, set(), key)]
    return {path: "\n\n".join(block.strip("\n") for block in blocks if block) + "\n" for path, blocks in pages.items()}


def _described(
    field: Schema, key: str, parts: Schema, described: set[str], listed: set[Row], page: str
) -> Iterator[str]:
    """Yield Markdown on the classes that a key's value may have and on the classes inside them, each class once.

    ``described`` gains the names of these classes, and ``listed`` the rows of their tables.
    """
    for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(field)):
        if name in described:
            continue
        described.add(name)
        part = parts[name]
        fixed = [(inner, item) for inner, item in part["properties"].items() if "const" in item]
        kinds = (f"`{key if '$comment' in item else inner}: {item['const']}`" for inner, item in fixed)
        heading = HEADINGS.get(name) or next(kinds, f"`{key}`")
        yield "" if heading == f"`{page}`" else f"## {heading}"
        yield inspect.cleandoc(part["description"])
        if name in OTHER_EXAMPLES:
            yield _yaml(OTHER_EXAMPLES[name])
        rows = _rows(part)
        repeated = [row for row in rows if row in listed]
        is_whole = len(repeated) < FEWEST_REPEATED
        yield _table([row for row in rows if is_whole or row not in listed])
        yield "" if is_whole else f"Further keys, explained above: {', '.join(row[0] for row in repeated)}."
        listed.update(rows)
        for inner, value in part["properties"].items():
            if "$comment" not in value and HOMES.get(inner, page) == page:
                yield from _described(value, inner, parts, described, listed, page)


def _yaml(text: str) -> str:
    return f"```yaml\n{text}```"


def _rows(part: Schema, shown: str = "`{0}`") -> list[Row]:
    """Return the table rows of a class: a key as ``shown``, or none if a heading has its only possible value."""
    required = {*part.get("required", ())}
    if "preset" in part["properties"]:
        required |= {*part["anyOf"][0]["required"]}
    return [
        (
            shown.format(key),
            _type(field),
            "required" if key in required else _value(field.get("default")),
            field.get("description", ""),
        )
        for key, field in part["properties"].items()
        if "$comment" not in field and "const" not in field
    ]


def _table(rows: list[Row]) -> str:
    lines = [("key", "type", "default", "meaning"), ("---",) * 4, *rows]
    text = ["| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |" for cells in lines]
    return "\n".join(text) if rows else ""


def _type(field: Schema) -> str:
    if options := field.get("anyOf") or field.get("oneOf"):
        if REFERENCE in options:
            # The names have headings of their own.
            options = [{"type": "string"}, *(option for option in options if "enum" not in option)]
        types = [each for option in options if option != {"type": "null"} for each in _type(option).split(" or ")]
        return " or ".join(dict.fromkeys(types))
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{word}`" for word in field["enum"])
    if field == REFERENCE:
        return "`module:Class`"
    if "$ref" in field or field["type"] == "object":
        return "mapping"
    if field["type"] == "array":
        return f"list of {_type(field['items'])}".replace("mapping", "mappings")
    names = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}
    return names[field["type"]] + _bounds(field)


def _bounds(field: Schema) -> str:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    values = {sign: field[name] for name, sign in signs.items() if name in field}
    bounds = [f"{sign} {show(bound)}" for sign, bound in values.items() if not bound or 1 / VAST < abs(bound) < VAST]
    return ", " + ", ".join(bounds) if bounds else ""


def _value(value: Any) -> str:
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{show(value)}`" if isinstance(value, int | float) else f"`{value}`"


if __name__ == "__main__":
    for path, text in scenario_pages().items():
        file = Path(sys.argv[1], path)
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
