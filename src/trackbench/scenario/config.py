"""Configuration of a whole scenario: built-in keys and keys that subjects add, checked against each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pydantic import Field, create_model

from trackbench.base.config import Problem
from trackbench.base.subjects import offered, resolve
from trackbench.scenario.keys import ScenarioKeys
from trackbench.scenario.validate import validate


class _CheckedKeys(ScenarioKeys):
    def problems(self) -> Iterator[Problem]:
        yield from validate(self)


def _with_subject_keys() -> type[ScenarioKeys]:
    blocks: dict[str, Any] = {}
    for name, target in offered("blocks"):
        block = resolve(target)
        of_class = (block | None, Field(None, description=block.__doc__)) if isinstance(block, type) else None
        blocks[name] = of_class or (block.type, block.field)
    return create_model(
        "ScenarioConfig", __base__=_CheckedKeys, __module__=__name__, __doc__=ScenarioKeys.__doc__, **blocks
    )


if TYPE_CHECKING:
    ScenarioConfig = ScenarioKeys
else:
    ScenarioConfig = _with_subject_keys()
