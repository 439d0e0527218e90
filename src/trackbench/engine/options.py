"""Options of motion models as inputs of a kernel, so that other values of them need no other kernel."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from trackbench.engine.equations import Values
from trackbench.filters import Filter, InteractingMultipleModel
from trackbench.models.motion import MotionModel


def options(filter: Filter[Any]) -> dict[str, Any]:
    """The numbers among the options of a filter's motion models: each a number, one for each member, or a list."""
    found: dict[str, Any] = {}
    for number, motion in enumerate(filter.motions):
        found |= numbers(motion, str(number))
    return found


def rank(value: Any) -> int:
    """Number of component axes of an option: 1 of a list."""
    return 1 if isinstance(value, tuple | list) else 0


def with_options(filter: Any, values: Values) -> Any:
    """The filter with other options, named as ``options`` does."""
    if isinstance(filter, InteractingMultipleModel):
        motions = [with_numbers(motion, str(number), values) for number, motion in enumerate(filter.motions)]
        filters = (replace(one, motion=motion) for one, motion in zip(filter.filters, motions, strict=True))
        return replace(filter, filters=tuple(filters))
    return replace(filter, motion=with_numbers(filter.motion, "0", values))


def form(value: Any) -> Hashable:
    """What a kernel of a filter or motion model depends on beside those options."""
    return _form(value)


def numbers(model: MotionModel, at: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, MotionModel):
            found |= numbers(value, f"{at} {name}")
        elif _numeric(value):
            found[f"{at} {name}"] = value
    return found


def with_numbers(model: MotionModel, at: str, values: Values) -> MotionModel:
    update: dict[str, Any] = {}
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, MotionModel):
            update[name] = with_numbers(value, f"{at} {name}", values)
        elif f"{at} {name}" in values:
            update[name] = values[f"{at} {name}"]
    return model.model_copy(update=update)


def _numeric(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return bool(value) and all(map(_numeric, value))
    return isinstance(value, float | np.ndarray) or (isinstance(value, int) and not isinstance(value, bool))


def _form(value: Any) -> Hashable:
    if isinstance(value, MotionModel):
        own = type(value).__module__.startswith("trackbench.")
        kept = [
            (name, _form(item))
            for name, item in ((name, getattr(value, name)) for name in type(value).model_fields)
            # A model from elsewhere may have computed something of its options when it was made.
            if not own or not _numeric(item)
        ]
        return type(value), tuple(kept)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), tuple((item.name, _form(getattr(value, item.name))) for item in fields(value))
    if isinstance(value, tuple | list):
        return tuple(map(_form, value))
    return (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value
