"""Real sensors: their published figures as defaults of a sensor's keys, each with its source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import yaml


@dataclass(frozen=True)
class Preset:
    """The figures of one sensor model."""

    name: str
    kind: str
    """The type of sensor whose keys it gives."""
    title: str
    """Maker and model."""
    source: str
    """Where the published figures are from."""
    values: Mapping[str, float]
    """Defaults for the keys of the sensor's configuration."""
    sources: Mapping[str, str]
    """For each published value: the place in the source, and how it was converted."""
    assumed: Mapping[str, str]
    """For each value for which the maker gives no figure: the reason for the one used."""


@cache
def presets() -> Mapping[str, Preset]:
    """All presets by name, in the order of ``presets.yaml``."""
    text = files("trackbench.models.sensors").joinpath("presets.yaml").read_text(encoding="utf-8")
    return {name: _preset(name, entry) for name, entry in yaml.safe_load(text).items()}


def list_presets() -> tuple[Preset, ...]:
    """All presets, in the order of ``presets.yaml``."""
    return tuple(presets().values())


def _preset(name: str, entry: dict[str, Any]) -> Preset:
    values = entry["values"]
    return Preset(
        name=name,
        kind=entry["kind"],
        title=entry["title"],
        source=entry["source"],
        values={key: value["value"] for key, value in values.items()},
        sources={key: value["source"] for key, value in values.items() if "source" in value},
        assumed={key: value["assumed"] for key, value in values.items() if "assumed" in value},
    )
