"""The effects that are typical of a kind of sensor: ``typical.yaml``, each figure with its source."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

import yaml
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from trackbench.base.config import problem_error
from trackbench.base.errors import nearest

#: What may stand in place of a list of effects.
WORDS = ("ideal", "typical")


class Words:
    """A list for which a word may stand; the sensor's class puts the list in its place."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(_known, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(WORDS)}, handler(schema)]}


def _known(value: Any) -> Any:
    if isinstance(value, str):
        message = f"{value!r} is not known; {nearest(value, WORDS)}, or a list of effects"
        raise problem_error(message)
    return value


@cache
def _entries() -> dict[str, list[dict[str, Any]]]:
    text = files("trackbench.models.sensors.effects").joinpath("typical.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))


def typical(kind: str) -> list[dict[str, Any]]:
    """The typical effects of a kind of sensor; none of one that is not built in."""
    return [entry["options"] for entry in _entries().get(kind, [])]
