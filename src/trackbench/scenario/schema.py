"""JSON Schema of a scenario file, for editors."""

from __future__ import annotations

from typing import Any

from trackbench.models.sensors.presets import list_presets
from trackbench.scenario.config import ScenarioConfig
from trackbench.truth.config.traffic import AUTO

Schema = dict[str, Any]


def json_schema() -> Schema:
    """Return the schema (draft 2020-12): keys, types, bounds, defaults and descriptions.

    Rules between keys, such as the options of a motion model or rates that divide, are not in the schema:
    ``trackbench check`` has them.
    """
    schema = ScenarioConfig.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    for part in (schema, *parts.values()):
        part.pop("title", None)
        for field in part.get("properties", {}).values():
            field.pop("title", None)
            if "patternProperties" in field:
                field["additionalProperties"] = False
        if "preset" in part.get("properties", {}):
            _preset(part)
    # A sweep may give the required keys of a filter, and the ending of a file gives its format.
    parts["FilterConfig"]["required"] = ["filter"]
    parts["TracksConfig"]["required"].remove("format")
    parts["TracksConfig"]["properties"]["format"]["anyOf"].insert(0, {"const": AUTO})
    initial = parts["FilterConfig"]["properties"]["initial"]
    word = {"enum": parts["InitialConfig"]["properties"]["from"]["enum"]}
    initial["anyOf"] = [word, {"$ref": initial.pop("$ref")}]
    parts["Expectation"]["oneOf"] = [{"required": [key]} for key in ("below", "above", "is", "better_than")]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:trackbench:scenario"}
    return {**head, "title": "trackbench scenario", **schema}


def _preset(part: Schema) -> None:
    """Make the required keys of a sensor optional where it has a preset, or a radar the key ``measures``."""
    kind = part["properties"]["type"]["const"]
    names = [preset.name for preset in list_presets() if preset.kind == kind]
    if not names:
        part["properties"].pop("preset")
        return
    part["properties"]["preset"] = {"enum": names, "description": part["properties"]["preset"]["description"]}
    needed = [key for key in part["required"] if key != "type"]
    part["required"] = ["type"]
    instead = [[key] for key in ("preset", "measures") if key in part["properties"]]
    part["anyOf"] = [{"required": keys} for keys in (needed, *instead)]
