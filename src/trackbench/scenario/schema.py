"""JSON Schema of a scenario file, for editors."""

from __future__ import annotations

from typing import Any, get_args

from trackbench.scenario.config import Scenario
from trackbench.sensing.config import Sensor
from trackbench.sensing.presets import list_presets
from trackbench.trackers.config import LINEAR_MOTION, MOTION_NOISE

Schema = dict[str, Any]


def json_schema() -> Schema:
    """The schema (draft 2020-12): keys, types, bounds, defaults and descriptions.

    What lies between sections (a tracker's sensors, rates that divide) is left to ``trackbench check``.
    """
    schema = Scenario.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    for part in parts.values():
        _untitle(part)
    for sensor in get_args(Sensor):
        _sensor(parts[sensor.__name__], sensor.model_fields["type"].default)
    _tracker(parts["FilterConfig"])
    parts["Expectation"]["oneOf"] = [{"required": [key]} for key in ("below", "above", "is", "better_than")]
    word = {"enum": parts["InitialConfig"]["properties"]["from"]["enum"]}
    initial = parts["FilterConfig"]["properties"]["initial"]
    parts["FilterConfig"]["properties"]["initial"] = {
        "anyOf": [word, {"$ref": initial["$ref"]}],
        "description": initial["description"],
    }
    _untitle(schema)
    for section in ("sensors", "trackers"):
        named = schema["properties"][section]
        named["additionalProperties"] = False
        for entry in named["patternProperties"].values():
            entry.pop("discriminator", None)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:trackbench:scenario",
        "title": "trackbench scenario",
        **schema,
    }


def _untitle(part: Schema) -> None:
    """Drop the titles that pydantic makes up from names: they only repeat the key."""
    part.pop("title", None)
    for field in part.get("properties", {}).values():
        field.pop("title", None)


def _sensor(part: Schema, kind: str) -> None:
    """A preset stands in for the keys that are required without one."""
    needed = part["required"]
    part["required"] = ["type"]
    part["properties"]["type"].pop("default")
    names = [preset.name for preset in list_presets() if preset.kind == kind]
    if not names:
        part["properties"].pop("preset")
        part["required"] += needed
        return
    part["properties"]["preset"] = {"enum": names, "description": part["properties"]["preset"]["description"]}
    part["if"] = {"not": {"required": ["preset"]}}
    part["then"] = {"required": needed}


def _tracker(part: Schema) -> None:
    """The noise that each motion model needs, and the motion models that a linear filter takes."""
    # A sweep may give any key.
    part["if"] = {"not": {"required": ["sweep"]}}
    part["then"] = {"required": part.pop("required")}
    stated = {"anyOf": [{"required": ["process_noise_diag"]}, {"required": ["sweep"]}]}
    part["allOf"] = [
        {
            "if": {"properties": {"motion": {"const": motion}}, "required": ["motion"], "not": stated},
            "then": {"required": list(noise)},
        }
        for motion, noise in MOTION_NOISE.items()
    ]
    part["allOf"].append(
        {
            "if": {"properties": {"filter": {"const": "kf"}}, "required": ["filter"]},
            "then": {"properties": {"motion": {"enum": list(LINEAR_MOTION)}}},
        }
    )
