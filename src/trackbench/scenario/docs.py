"""The pages on the scenario file, one for each key of its top level, made from its JSON Schema."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from trackbench.base.config.key_units import show, split_key
from trackbench.base.config.plugin import REFERENCE
from trackbench.base.subjects import offered, resolve
from trackbench.scenario.schema import Schema, json_schema

_EXAMPLES = yaml.safe_load(Path(__file__).with_name("examples.yaml").read_text(encoding="utf-8"))
#: An example of each key of the top level; together they are a whole scenario.
EXAMPLES: dict[str, str] = {
    **_EXAMPLES["sections"],
    **{key: resolve(target).EXAMPLE for key, target in offered("blocks")},
}
#: An example of each other form that a section can have, by the class that describes it.
OTHER_EXAMPLES: dict[str, str] = _EXAMPLES["classes"]
#: The headings of classes where neither the key that leads to them nor their name in a file would do.
HEADINGS: dict[str, str] = _EXAMPLES["headings"]

#: Keys whose classes stand on the page of another key, by that key.
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
"""


def scenario_pages() -> dict[str, str]:
    """Return the text of each page by its path in the folder of the documentation."""
    schema = json_schema()
    sections = [key for key in schema["properties"] if key in EXAMPLES]
    rows = _rows({**schema, "$defs": {}}, {key: f"[`{key}`](scenario-file/{key}.md)" for key in sections})
    tree = "\n".join(f"scenario-file/{key}" for key in sections)
    pages = {"scenario-file.md": [INTRODUCTION, rows, f"```{{toctree}}\n:hidden:\n\n{tree}\n```"]}
    described: set[str] = set()
    for key in sections:
        field = schema["properties"][key]
        head = [f"# `{key}`", NOTE, field["description"], _yaml(EXAMPLES[key])]
        pages[f"scenario-file/{key}.md"] = [*head, *_described(field, "", schema["$defs"], described, key)]
    return {path: "\n\n".join(block.strip("\n") for block in blocks) + "\n" for path, blocks in pages.items()}


def _described(field: Schema, key: str, parts: Schema, described: set[str], page: str) -> Iterator[str]:
    """Yield the classes that a key's value may have, and those within them, each once."""
    for name, several in _references(field):
        if name in described:
            continue
        described.add(name)
        part = parts[name]
        named = [
            (key if "$comment" in item else own, item) for own, item in part["properties"].items() if "const" in item
        ]
        kind = next((f"{own}: {item['const']}" for own, item in named), None)
        usual = f"`{kind}`" if kind else f"Each of `{key}`" if several else f"`{key}`"
        if name in HEADINGS or key or kind:
            yield f"## {HEADINGS.get(name, usual)}"
        yield inspect.cleandoc(part["description"])
        if name in OTHER_EXAMPLES:
            yield _yaml(OTHER_EXAMPLES[name])
        yield _rows(part)
        for inner, value in part["properties"].items():
            if "$comment" not in value and HOMES.get(inner, page) == page:
                yield from _described(value, inner, parts, described, page)


def _references(field: Schema, several: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield the classes that a schema refers to, and whether there may be several of each."""
    if "$ref" in field:
        yield field["$ref"].rpartition("/")[2], several
    for form in (*field.get("anyOf", ()), *field.get("oneOf", ())):
        yield from _references(form, several)
    for inner in (field.get("items"), field.get("additionalProperties"), *field.get("patternProperties", {}).values()):
        if isinstance(inner, dict):
            yield from _references(inner, True)


def _yaml(text: str) -> str:
    return f"```yaml\n{text}```"


def _rows(part: Schema, shown: dict[str, str] = {}) -> str:  # noqa: B006
    """Return the table of a class; ``shown``: keys that are written otherwise. Options of a plug-in have their own."""
    rows = []
    choices = [set(form.get("required", ())) for form in part.get("anyOf", ())]
    for key, field in part["properties"].items():
        if "$comment" in field:
            continue
        unit = split_key(key)[1]
        default = "required" if key in part.get("required", ()) else _value(field.get("default"))
        if {"preset"} in choices and key in choices[0]:
            default = "required, or from the preset"
        name = shown.get(key, f"`{key}`")
        rows.append((name, _type(field), unit.words if unit else "", default, field.get("description", "")))
    lines = [("key", "type", "unit", "default", "meaning"), ("---",) * 5, *rows]
    text = ["| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |" for cells in lines]
    return "\n".join(text) if rows else ""


def _type(field: Schema) -> str:
    if options := field.get("anyOf") or field.get("oneOf"):
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
    bounds = [f"{sign} {show(field[name])}" for name, sign in signs.items() if name in field]
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
