"""Presets of real sensors, whose published figures are defaults of a sensor's keys, and typical effects by type."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import yaml
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from trackbench.base.config import problem_error
from trackbench.base.config.key_units import split_key
from trackbench.base.errors import nearest_choices


@dataclass(frozen=True)
class Preset:
    """Published figures of one sensor on the market."""

    name: str
    kind: str
    title: str
    """Maker and name of the sensor."""
    source: str
    """Title or address of the document in which the maker published the figures."""
    values: Mapping[str, Any]
    """Values that the preset sets for keys of the sensor's configuration."""
    assumed: Mapping[str, str]
    """Reason for each value for which the maker publishes no figure, by key."""


@cache
def presets() -> Mapping[str, Preset]:
    """Return all presets by name, in the order of ``presets.yaml``."""
    text = files("trackbench.models.sensors").joinpath("presets.yaml").read_text(encoding="utf-8")
    return {name: _preset(name, entry) for name, entry in yaml.safe_load(text).items()}


def list_presets() -> tuple[Preset, ...]:
    """Return all presets, in the order of ``presets.yaml``."""
    return tuple(presets().values())


def _preset(name: str, entry: dict[str, Any]) -> Preset:
    values = entry["values"]
    return Preset(
        name=name,
        kind=entry["kind"],
        title=entry["title"],
        source=entry["source"],
        values={key: value["value"] for key, value in values.items()},
        assumed={key: value["assumed"] for key, value in values.items() if "assumed" in value},
    )


#: Words that may stand in place of a list of effects.
WORDS = ("ideal", "typical")


class Words:
    """Mark of a configuration field whose value is a list of effects, or a word for a list, such as "typical"."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(_require_word, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(WORDS)}, handler(schema)]}


def _require_word(value: Any) -> Any:
    if isinstance(value, str):
        message = f"{value!r} is not known; {nearest_choices(value, WORDS)}, or a list of effects"
        raise problem_error(message)
    return value


@cache
def _entries() -> dict[str, list[dict[str, Any]]]:
    text = files("trackbench.models.sensors.effects").joinpath("typical.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))


def typical(kind: str, components: Collection[str]) -> list[dict[str, Any]]:
    """Return the typical effects of a built-in sensor type on its measured components; none for other types."""
    every = [
        {key: _keep_measured_sizes(value, components) for key, value in entry["options"].items()}
        for entry in _entries().get(kind, [])
    ]
    stated = [{key: value for key, value in options.items() if value != {}} for options in every]
    return [options for options in stated if set(options) != {"type"}]


def _keep_measured_sizes(value: Any, components: Collection[str]) -> Any:
    is_sizes = isinstance(value, dict)
    return {key: size for key, size in value.items() if split_key(key)[0] in components} if is_sizes else value
