"""JSON Schema of a scenario file, for editors."""

from __future__ import annotations

from typing import Any

from trackbench.base.config.plugin import OptionsBeside, beside
from trackbench.base.subjects import offered
from trackbench.models.motion import MOTION_MODELS
from trackbench.models.sensors.presets import list_presets
from trackbench.scenario.config import ScenarioConfig
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.published import TRACKERS, options_of
from trackbench.truth.config.scripted import WhiteMotion
from trackbench.truth.config.traffic import AUTO, TracksConfig

Schema = dict[str, Any]

#: A class of the user's own, whose options no schema knows.
REFERENCE = {"type": "string", "pattern": ":"}


def json_schema() -> Schema:
    """The schema (draft 2020-12): keys, types, bounds, defaults and descriptions.

    What lies between sections (a tracker's sensors, rates that divide) is left to ``trackbench check``.
    """
    schema = ScenarioConfig.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    sensors = schema["properties"]["sensors"]["patternProperties"]
    kinds = [_lift(form, "type", parts) for entry in sensors.values() for form in entry["oneOf"]]
    named = [schema["properties"][name] for name, _ in offered("blocks")]
    for entry in (entry for block in named for entry in block.get("patternProperties", {}).values()):
        for form in entry["oneOf"]:
            _lift(form, "use", parts)
    for form in schema["properties"]["truth"]["oneOf"]:
        _lift(form, "source", parts)
    _options(parts)
    _metrics(parts["Score"]["properties"]["metrics"]["items"]["anyOf"])
    for part in parts.values():
        _untitle(part)
    for kind, part in filter(None, kinds):
        _sensor(part, kind)
    for model in (FilterConfig, WhiteMotion, TracksConfig):
        _beside(parts[model.__name__], model, parts)
    _filed(parts["TracksConfig"])
    _filter(parts["FilterConfig"])
    parts["Expectation"]["oneOf"] = [{"required": [key]} for key in ("below", "above", "is", "better_than")]
    word = {"enum": parts["InitialConfig"]["properties"]["from"]["enum"]}
    initial = parts["FilterConfig"]["properties"]["initial"]
    parts["FilterConfig"]["properties"]["initial"] = {
        "anyOf": [word, {"$ref": initial["$ref"]}],
        "description": initial["description"],
    }
    _untitle(schema)
    for section in schema["properties"].values():
        if "patternProperties" in section:
            section["additionalProperties"] = False
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:trackbench:scenario",
        "title": "trackbench scenario",
        **schema,
    }


def _lift(form: Schema, key: str, parts: Schema) -> tuple[str, Schema] | None:
    """Move one form of a section to the parts, under the name of its class; None for a class that is not known."""
    if "title" not in form:
        return None
    kind = form["properties"][key]["const"]
    title = form["title"] if form["title"] not in parts else f"{form['title']}.{kind}"
    parts[title] = dict(form)
    form.clear()
    form["$ref"] = f"#/$defs/{title}"
    return kind, parts[title]


def _untitle(part: Schema) -> None:
    """Drop the titles that pydantic makes up from names: they only repeat the key."""
    part.pop("title", None)
    for field in part.get("properties", {}).values():
        field.pop("title", None)


def _sensor(part: Schema, kind: str) -> None:
    """A preset stands in for the keys that are required without one; a radar that measures less needs fewer."""
    names = [preset.name for preset in list_presets() if preset.kind == kind]
    if not names:
        part["properties"].pop("preset")
        return
    needed = [key for key in part["required"] if key != "type"]
    part["required"] = ["type"]
    part["properties"]["preset"] = {"enum": names, "description": part["properties"]["preset"]["description"]}
    instead = [{"required": [key]} for key in ("preset", "measures") if key in part["properties"]]
    part["if"] = {"not": {"anyOf": instead}}
    part["then"] = {"required": needed}


def _beside(part: Schema, model: type[OptionsBeside], parts: Schema) -> None:
    """The options that each plug-in needs beside the word that names it."""
    key, plugin = beside(model)
    part["allOf"] = []
    used: dict[str, list[str]] = {}
    for name, result in plugin.registry.loaded().items():
        for option in result.model_fields:
            used.setdefault(option, []).append(name)
        own = result.model_json_schema(by_alias=True)
        for title, inner in own.pop("$defs", {}).items():
            _untitle(inner)
            parts.setdefault(title, inner)
        _untitle(own)
        part["properties"] = {**own["properties"], **part["properties"]}
        stated: list[Schema] = [{"required": ["sweep"]}]
        if model is FilterConfig:
            stated.append({"required": ["process_noise_diag"]})
        rule = {"properties": {key: {"const": name}}, "required": [key], "not": {"anyOf": stated}}
        part["allOf"].append({"if": rule, "then": {"required": own.get("required", [])}})
    part["properties"] = dict(sorted(part["properties"].items(), key=lambda item: item[0] not in model.model_fields))
    for option, names in used.items():
        if option not in model.model_fields:
            part["properties"][option]["description"] += (
                f" Used, and required where it has no default, by {key} {' and '.join(names)}."
            )
    part.pop("additionalProperties")
    part["unevaluatedProperties"] = False
    free = {"if": {"properties": {key: REFERENCE}, "required": [key]}, "then": {"additionalProperties": True}}
    part["allOf"].append(free)


def _filed(part: Schema) -> None:
    """The format may be left to the ending of the file."""
    part["required"].remove("format")
    part["properties"]["format"]["anyOf"].insert(0, {"const": AUTO})


def _filter(part: Schema) -> None:
    """The motion models that a linear filter takes."""
    # A sweep may give any key.
    part["if"] = {"not": {"required": ["sweep"]}}
    part["then"] = {"required": part.pop("required")}
    curved = [name for name, model in MOTION_MODELS.loaded().items() if not model.linear]
    part["allOf"].append(
        {
            "if": {"properties": {"filter": {"const": "kf"}}, "required": ["filter"]},
            "then": {"properties": {"motion": {"not": {"enum": curved}}}},
        }
    )


def _metrics(forms: list[Schema]) -> None:
    for form in forms:
        if "properties" in form:
            _untitle(form["properties"]["options"])


def _options(parts: Schema) -> None:
    """The options that published trackers declare; those of the built-in filters are the keys of ``FilterConfig``."""
    rules = []
    for name, factory in TRACKERS.loaded().items():
        declared = options_of(factory)
        if declared is None or issubclass(declared, FilterConfig):
            continue
        own = declared.model_json_schema(by_alias=True)
        parts.update(own.pop("$defs", {}))
        _untitle(own)
        rule = {"properties": {"use": {"const": name}}, "required": ["use"], "not": {"required": ["sweep"]}}
        then = {"properties": {"options": own}, "required": ["options"] if own.get("required") else []}
        rules.append({"if": rule, "then": then})
    if rules:
        parts["PluginConfig"]["allOf"] = rules
