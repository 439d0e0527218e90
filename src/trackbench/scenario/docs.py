"""The reference of the scenario file, made from its JSON Schema."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from trackbench.base.config.key_units import show, split_key
from trackbench.base.subjects import offered, resolve
from trackbench.metrics import Field
from trackbench.metrics.registry import METRICS, metric_paths
from trackbench.models.motion import MOTION_MODELS
from trackbench.models.sensors.effects import EFFECTS
from trackbench.models.sensors.presets import list_presets
from trackbench.scenario.schema import REFERENCE, Schema, json_schema
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.published import TRACKERS, options_of

_EXAMPLES = yaml.safe_load(Path(__file__).with_name("examples.yaml").read_text(encoding="utf-8"))
#: An example of each section; together they are a whole scenario.
EXAMPLES: dict[str, str] = _EXAMPLES["sections"]
#: An example of each other form that a section can have, by the class that describes it.
OTHER_EXAMPLES: dict[str, str] = _EXAMPLES["classes"]

#: The headings of the classes that describe a section, where its name, or the key that leads to it, would not do.
HEADINGS = {
    "HighwayTruth": "Simulated traffic",
    "FixedObserver": "`observer` of simulated traffic as a fixed point",
    "NearestTargets": "`targets` by distance",
    "IdTargets": "`targets` by name",
    "ScriptedTruth": "Scripted motion",
    "MovingObserver": "`observer` of scripted motion as a point",
    "ScriptedObserver": "`observer` of scripted motion as a vehicle",
    "RecordingTruth": "Recorded motion",
    "BoxesTruth": "Recorded boxes",
    "TrafficTruth": "Recorded traffic",
    "VehicleObserver": "`observer` of recorded traffic as a vehicle",
    "ObserverColumns": "`ego`",
    "ReferenceOptions": "`reference` of recorded boxes and motion",
    "Radar": "Radar",
    "Lidar": "Lidar",
    "FilterConfig": "A built-in filter",
    "ImmConfig": "`motion` with several models",
    "PluginConfig": "Your own tracker",
    "Command": "`use` of a program in any language",
    "TracksConfig": "Tracks made elsewhere",
}

INTRODUCTION = """\
# The scenario file

<!-- Made from the schema by `python -m trackbench.scenario.docs`. Change the field descriptions, not this page. -->

A scenario is one YAML file: the true motion, the sensors that see it, the trackers that follow it, and what is
expected of them. `trackbench check FILE` validates it, `trackbench schema` prints its JSON Schema for editors, and
`--set key.path=value` sets any key from the command line (`--set trackers.ekf_cv.acceleration_sigma_mps2=2`; the items
of a list count from 0).

The unit is the end of a key's name: `_m` metres, `_s` seconds, `_hz` Hz, `_deg` degrees, `_rad` radians, `_mps` m/s,
`_mps2` m/s^2, `_mps3` m/s^3, `_radps` rad/s, `_radps2` rad/s^2. Angles are counter-clockwise. YAML is read by the rules
of version 1.2: `on`, `yes` and `1:30` are text. `<<: *name` merges a mapping with an anchor.
"""


def scenario_markdown() -> str:
    """The whole page."""
    schema = json_schema()
    parts = schema["$defs"]
    blocks = [INTRODUCTION, "## The top level", _example("scenario"), _table(schema)]
    described: set[str] = set()
    for section in list(EXAMPLES)[1:]:
        blocks += [f"## {section}", _example(section), *_described(schema["properties"][section], "", parts, described)]
        if section == "sensors":
            blocks += [*_effects(), _presets()]
        if section == "trackers":
            blocks += [_motion_models(), _trackers()]
        if section == "expect":
            blocks.append(_metrics())
    for section, target in offered("blocks"):
        blocks += [f"## {section}", f"```yaml\n{resolve(target).EXAMPLE}```"]
        blocks += _described(schema["properties"][section], "", parts, described)
    return "\n\n".join(block.rstrip("\n") for block in blocks) + "\n"


def _described(field: Schema, key: str, parts: Schema, described: set[str]) -> Iterator[str]:
    """The classes that a key's value may have, and those within them, each once."""
    for name, several in _references(field):
        if name in described:
            continue
        described.add(name)
        part = parts[name]
        kind = next((f"{key} {field['const']}" for key, field in part["properties"].items() if "const" in field), None)
        usual = f"`{kind}`" if kind else f"Each of `{key}`" if several else f"`{key}`"
        if name in HEADINGS or key or kind:
            yield f"### {HEADINGS.get(name, usual)}"
        yield part["description"]
        if name in OTHER_EXAMPLES:
            yield f"```yaml\n{OTHER_EXAMPLES[name]}```"
        yield _table(part)
        for inner, value in part["properties"].items():
            yield from _described(value, inner, parts, described)


def _references(field: Schema, several: bool = False) -> Iterator[tuple[str, bool]]:
    """The classes that a schema refers to, and whether there may be several of each."""
    if "$ref" in field:
        yield field["$ref"].rpartition("/")[2], several
    for form in (*field.get("anyOf", ()), *field.get("oneOf", ())):
        yield from _references(form, several)
    for inner in (field.get("items"), field.get("additionalProperties"), *field.get("patternProperties", {}).values()):
        if isinstance(inner, dict):
            yield from _references(inner, True)


def _example(section: str) -> str:
    return f"```yaml\n{EXAMPLES[section]}```"


def _markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _table(part: Schema) -> str:
    rows = []
    required = {*part.get("required", ()), *part.get("then", {}).get("required", ())}
    for key, field in part["properties"].items():
        unit = split_key(key)[1]
        default = "required" if key in required else _value(field.get("default"))
        if key in part.get("then", {}).get("required", ()) and "preset" in part["properties"]:
            default = "required, or from the preset"
        cells = (f"`{key}`", _type(field), unit.words if unit else "", default, field.get("description", ""))
        rows.append([cell.replace("|", "\\|") for cell in cells])
    return _markdown(("key", "type", "unit", "default", "meaning"), rows)


def _type(field: Schema) -> str:
    options = list(_alternatives(field))
    if options != [field]:
        return " or ".join(dict.fromkeys(_type(option) for option in options if option != {"type": "null"}))
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


def _alternatives(field: Schema) -> Iterator[Schema]:
    """The forms that a value may have, however deep they are nested."""
    options = field.get("anyOf") or field.get("oneOf")
    if options is None:
        yield field
    else:
        for option in options:
            yield from _alternatives(option)


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


def _motion_models() -> str:
    rows = [
        (f"`{name}`", ", ".join(model.components), ", ".join(f"`{key}`" for key in model.model_fields))
        for name, model in MOTION_MODELS.loaded().items()
    ]
    usage = "The options of the model stand beside `motion:`, or with it in a mapping: `motion: {model: cv, ...}`."
    return f"### Motion models\n\n{usage}\n\n{_markdown(('motion', 'state', 'options'), rows)}"


def _trackers() -> str:
    rows = []
    for name, factory in TRACKERS.loaded().items():
        declared = options_of(factory)
        if declared is None:
            options = ""
        elif issubclass(declared, FilterConfig):
            options = f"as beside `filter: {name}`"
        else:
            options = ", ".join(f"`{key}`" for key in declared.model_fields)
        rows.append((f"`{name}`", options))
    return f"### Published trackers\n\n{_markdown(('use', 'options'), rows)}"


def _effects() -> Iterator[str]:
    yield "### `effects` of a sensor"
    yield "What they do, and which are typical: [sensor effects](sensor-effects.md)."
    for name, effect in EFFECTS.loaded().items():
        schema = effect.model_json_schema()
        del schema["properties"]["type"]
        yield f"#### `{name}`"
        yield inspect.cleandoc(schema["description"])
        yield _table(schema)


def _presets() -> str:
    rows = [
        (f"`{preset.name}`", preset.kind, preset.title, ", ".join(f"`{key}`" for key in preset.assumed))
        for preset in list_presets()
    ]
    table = _markdown(("preset", "type", "sensor", "assumed, where no figure is published"), rows)
    notes = (
        "A key that the scenario writes itself wins over the preset's. Every figure stands with its source in "
        "`trackbench/models/sensors/presets.yaml`. Where a maker does not say what accuracy means, the figure is taken "
        "as a standard deviation. A lidar's figure is that of a single point; the position of a whole vehicle is less "
        "certain: set `position_sigma_m` where that matters."
    )
    return f"### Presets\n\n{table}\n\n{notes}"


def _metrics() -> str:
    tables: dict[str, Iterable[Field]] = {
        "Metrics": metric_paths([*METRICS.loaded().values()], {"labels", "truth"}),
        **{
            heading: [field for metric in resolve(target)() for field in metric.entries()]
            for heading, target in offered("examples_of_metrics")
        },
        "Metrics with hidden identities": metric_paths((), {"tracks", "truth"}),
        "Metrics with hidden identities, of a recording without a truth": metric_paths((), {"tracks", "no truth"}),
    }
    note = "The metrics with a yes under `better_than` can be compared by it, run by run."
    return "\n\n".join([note, *(_table_of(title, [*metrics]) for title, metrics in tables.items())])


def _table_of(title: str, metrics: Sequence[Field]) -> str:
    rows = [
        (
            f"`{metric.name}`",
            " or ".join(f"`{word}`" for word in metric.words) or metric.unit,
            "yes" if metric.compared else "",
            metric.meaning,
        )
        for metric in metrics
    ]
    table = _markdown(("metric", "unit", "`better_than`", "meaning"), rows)
    return f"### {title}\n\n{table}"


if __name__ == "__main__":
    print(scenario_markdown(), end="")
