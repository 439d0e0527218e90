"""Documentation pages on the scenario file, one for each key of its top level, made from its JSON Schema."""

from __future__ import annotations

import inspect
import re
import sys
from collections import Counter
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
#: Rows that an earlier table of the page has too are replaced by a link, if there are at least this many.
FEWEST_REPEATED = 2
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
    sections = [key for key in schema["properties"] if key in EXAMPLES]
    rows = _table(_rows({**schema, "$defs": {}}, {key: f"[`{key}`](scenario-file/{key}.md)" for key in sections}))
    tree = "\n".join(f"scenario-file/{key}" for key in sections)
    pages = {"scenario-file.md": [INTRODUCTION, rows, f"```{{toctree}}\n:hidden:\n\n{tree}\n```"]}
    described: set[str] = set()
    for key in sections:
        field = schema["properties"][key]
        head = [f"# `{key}`", NOTE, field["description"], _yaml(EXAMPLES[key])]
        pages[f"scenario-file/{key}.md"] = [*head, *_described(field, "", schema["$defs"], described, key, {})]
    return {path: "\n\n".join(block.strip("\n") for block in blocks) + "\n" for path, blocks in pages.items()}


def _described(
    field: Schema, key: str, parts: Schema, described: set[str], page: str, listed: dict[Row, str]
) -> Iterator[str]:
    """Yield Markdown on the classes that a key's value may have and on the classes inside them, each class once.

    ``described`` gains the names of these classes; ``listed`` gains the rows of their tables, with the table's heading.
    """
    for name, several in _references(field):
        if name in described:
            continue
        described.add(name)
        part = parts[name]
        named = [
            (key if "$comment" in item else name, item) for name, item in part["properties"].items() if "const" in item
        ]
        kind = next((f"{name}: {item['const']}" for name, item in named), None)
        heading = HEADINGS.get(name, f"`{kind}`" if kind else f"Each of `{key}`" if several else f"`{key}`")
        if name in HEADINGS or key or kind:
            yield f"## {heading}"
        yield inspect.cleandoc(part["description"])
        if name in OTHER_EXAMPLES:
            yield _yaml(OTHER_EXAMPLES[name])
        # A heading such as `type: bias` says what the row of that key would say.
        rows = [row for row in _rows(part) if heading != f"`{row[0].strip('`')}: {row[1].strip('`')}`"]
        repeated = _repeated(rows, listed)
        new = [row for row in rows if row not in repeated]
        yield _table(new)
        for earlier in dict.fromkeys(repeated.values()):
            keys = ", ".join(row[0] for row, place in repeated.items() if place == earlier)
            yield f"{'Further keys' if new else 'Keys'}, as in [{earlier}](#{_anchor(earlier)}): {keys}."
        listed |= {row: heading for row in rows if row not in listed}
        for inner, value in part["properties"].items():
            if "$comment" not in value and HOMES.get(inner, page) == page:
                yield from _described(value, inner, parts, described, page, listed)


def _references(field: Schema, several: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield each class that a schema refers to, and whether a value may hold several of it."""
    if "$ref" in field:
        yield field["$ref"].rpartition("/")[2], several
    for form in (*field.get("anyOf", ()), *field.get("oneOf", ())):
        yield from _references(form, several)
    for inner in (field.get("items"), field.get("additionalProperties"), *field.get("patternProperties", {}).values()):
        if isinstance(inner, dict):
            yield from _references(inner, True)


def _yaml(text: str) -> str:
    return f"```yaml\n{text}```"


def _rows(part: Schema, shown: dict[str, str] = {}) -> list[Row]:  # noqa: B006
    """Return the table rows of a class, one per key, but for options of plug-ins; ``shown``: key as printed, by key."""
    rows = []
    choices = [set(form.get("required", ())) for form in part.get("anyOf", ())]
    for key, field in part["properties"].items():
        if "$comment" in field:
            continue
        default = "required" if key in part.get("required", ()) else _value(field.get("default"))
        if {"preset"} in choices and key in choices[0]:
            default = "required, or from the preset"
        rows.append((shown.get(key, f"`{key}`"), _type(field), default, field.get("description", "")))
    return rows


def _repeated(rows: list[Row], listed: dict[Row, str]) -> dict[Row, str]:
    """Return the rows that an earlier table has too, by row its heading; empty if fewer than ``FEWEST_REPEATED``."""
    headings = Counter(listed[row] for row in rows if row in listed)
    return {row: listed[row] for row in rows if headings[listed.get(row, "")] >= FEWEST_REPEATED}


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-")


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
