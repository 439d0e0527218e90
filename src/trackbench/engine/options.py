"""Options of motion models as inputs of a kernel, so that one kernel serves all values of them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from trackbench.engine.equations import Values
from trackbench.engine.user_types import is_user_type
from trackbench.filters import Filter, InteractingMultipleModel
from trackbench.models.motion import MotionModel

M = TypeVar("M", bound=MotionModel)


def options(filter: Filter[Any]) -> dict[str, Any]:
    """Return the numeric options of a filter's motion models by name, each one number or one per batch member."""
    motions = enumerate(filter.motions)
    return {name: value for number, motion in motions for name, value in numbers(motion, str(number)).items()}


def with_options(filter: Any, values: Values) -> Any:
    """Return the filter with the named options of its motion models replaced; the same object if none changes."""
    singles = filter.filters if isinstance(filter, InteractingMultipleModel) else (filter,)
    motions = [with_numbers(single.motion, str(number), values) for number, single in enumerate(singles)]
    if all(motion is single.motion for motion, single in zip(motions, singles, strict=True)):
        return filter
    filters = tuple(replace(single, motion=motion) for single, motion in zip(singles, motions, strict=True))
    return replace(filter, filters=filters) if isinstance(filter, InteractingMultipleModel) else filters[0]


def numbers(model: MotionModel, at: str) -> dict[str, Any]:
    """Return the numeric options of a motion model of trackbench by name; ``at`` is put before each name."""
    if is_user_type(type(model)):
        # Values that the model derives from its options would not follow other options.
        return {}
    parts = [_numbers(value, f"{at} {name}") for name, value in _fields(model).items()]
    return {name: value for part in parts for name, value in part.items()}


def with_numbers(model: M, at: str, values: Values) -> M:
    """Return the model with options replaced by the values named "<at> <option>"; the same object if none changes."""
    update: dict[str, Any] = {}
    for name, value in _fields(model).items():
        result = _replaced(value, f"{at} {name}", values)
        if result is not value:
            update[name] = result
    return model.model_copy(update=update) if update else model


def form(value: Any) -> Hashable:
    """Return a hashable key of all that a kernel depends on in a filter or model, except the numeric options."""
    if isinstance(value, InteractingMultipleModel):
        # The Markov chain of the modes is an input.
        return tuple(map(form, value.filters))
    if isinstance(value, MotionModel):
        form_of_item = _constant if is_user_type(type(value)) else _form
        return type(value), tuple((name, form_of_item(item)) for name, item in _fields(value).items())
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), tuple((item.name, form(getattr(value, item.name))) for item in fields(value))
    return _constant(value)


def _constant(value: Any) -> Hashable:
    try:
        hash(value)
    except TypeError:
        return repr(value.tolist() if isinstance(value, np.ndarray) else value)
    constant: Hashable = value
    return constant


def _fields(model: MotionModel) -> Mapping[str, Any]:
    return {name: getattr(model, name) for name in type(model).model_fields}


def _numbers(value: Any, at: str) -> dict[str, Any]:
    if isinstance(value, MotionModel):
        return numbers(value, at)
    if isinstance(value, tuple | list):
        parts = [_numbers(item, f"{at} {i}") for i, item in enumerate(value)]
        return {name: item for part in parts for name, item in part.items()}
    return {at: value} if _is_numeric(value) else {}


def _is_numeric(value: Any) -> bool:
    return isinstance(value, int | float | np.ndarray) and not isinstance(value, bool)


def _replaced(value: Any, at: str, values: Values) -> Any:
    if isinstance(value, MotionModel):
        return with_numbers(value, at, values)
    if isinstance(value, tuple | list):
        parts = [_replaced(item, f"{at} {i}", values) for i, item in enumerate(value)]
        return type(value)(parts) if any(a is not b for a, b in zip(parts, value, strict=True)) else value
    return values.get(at, value)


def _form(value: Any) -> Hashable:
    if isinstance(value, tuple | list):
        return tuple(map(_form, value))
    return None if _is_numeric(value) else form(value)
