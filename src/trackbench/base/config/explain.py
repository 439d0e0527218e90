"""pydantic's errors in the words of the scenario file."""

from __future__ import annotations

import math
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from trackbench.base.config.base import PROBLEM, KeyPath
from trackbench.base.config.key_units import convert, read_number, show, split_key, unit_of
from trackbench.base.config.places import Place, find, keyed_fields, longest, marked, members, models, words
from trackbench.base.config.unknown_keys import advise, advise_beside
from trackbench.base.errors import nearest

_LIMITS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def explain(errors: list[ErrorDetails], root: type[BaseModel]) -> list[tuple[KeyPath, str]]:
    """For each error the key path and what is wrong, with the nearest valid choice."""
    result = []
    advised: set[KeyPath] = set()
    for error in errors:
        place = find(root, error["loc"])
        if error["type"] == "extra_forbidden" and place.model is not None:
            key, value = str(place.path[-1]), error["input"]
            if place.beside is not None:
                advice = advise_beside(key, value, place.beside, root)
            else:
                advice = advise(key, value, place.model, root)
            result.append((place.path, advice.message))
            if advice.key is not None:
                advised.add((*place.path[:-1], advice.key))
    for error in errors:
        place = find(root, error["loc"])
        # A key under a wrong name is one mistake: that the right one is missing follows from it.
        if error["type"] != "extra_forbidden" and not (error["type"] == "missing" and place.path in advised):
            result.append(_explain(error, place))
    return result


def _explain(error: ErrorDetails, place: Place) -> tuple[KeyPath, str]:
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    path = place.path
    match kind:
        case _ if place.is_key:
            return path, "a name starts with a letter and has only letters, digits, _ and -, at most 64"
        case "union_tag_not_found":
            return (*path, _discriminator(context)), f"missing; choose from: {', '.join(members(place.annotation))}"
        case "union_tag_invalid":
            hint = nearest(context["tag"], members(place.annotation))
            return (*path, _discriminator(context)), f"{context['tag']!r} is not known; {hint}"
        case "missing" if marked(place.annotation) is not None and place.model is None:
            return path, f"missing; choose from: {', '.join(words(place.annotation))}"
        case "missing" if place.beside is not None and place.model is not None:
            plugged = place.beside
            needed = [name for name, field in keyed_fields(place.model).items() if field.is_required()]
            return path, f"missing: {plugged.key} {plugged.name} needs {' and '.join(needed)}"
        case "missing":
            return path, f"missing; {_meaning(place)}"
        case "literal_error":
            choices = words(place.annotation)
            if isinstance(value, str):
                return path, f"{value!r} is not known; {nearest(value, choices)}"
            return path, f"must be a word, not {_show(value)}; choose from: {', '.join(choices)}"
        case "extra_forbidden":
            return path, "unknown key"
        case "value_error" | "assertion_error":
            return path, " ".join(str(context["error"]).split()) or f"{_show(value)} is not possible"
        case "float_type" | "float_parsing" | "finite_number":
            return path, _number(value, str(path[-1]), whole=False)
        case "int_type" | "int_parsing" | "int_from_float":
            return path, _number(value, str(path[-1]), whole=True)
        case "bool_type" | "bool_parsing":
            return path, f"true or false is needed, not {_show(value)}"
        case "string_type":
            hint = f'; write "{value}"' if isinstance(value, int | float) else ""
            return path, f"text is needed, not {_show(value)}{hint}"
        case "list_type":
            hint = f"; write [{value}]" if isinstance(value, str) and value.isidentifier() else ""
            return path, f"a list is needed, not {_show(value)}{hint}"
        case "dict_type" | "model_type" | "model_attributes_type":
            return path, _mapping(value, place)
        case "string_pattern_mismatch":
            return path, f"{value!r} is not possible: only a to z, 0 to 9, _ and -"
        case "too_short" | "too_long" if context.get("min_length", 1) > 1 or kind == "too_long":
            wanted = context.get("min_length") or context["max_length"]
            least = "at least " if kind == "too_short" and longest(place.annotation) is None else ""
            return path, f"{least}{wanted} entries are needed, not {context['actual_length']}"
        case "too_short" | "string_too_short":
            return path, "must not be empty"
        case "string_too_long":
            return path, f"too long: at most {context['max_length']} characters"
        case _ if kind in _LIMITS:
            return path, _limit(value, kind, context, path)
        case _ if kind == PROBLEM:
            return path, error["msg"]
        case _:
            return path, error["msg"][0].lower() + error["msg"][1:]


def _discriminator(context: dict[str, Any]) -> str:
    """The key that tells the members of a union apart."""
    return str(context["discriminator"]).strip("'")


def _meaning(place: Place) -> str:
    """The field's description, as the reason to write it."""
    if place.model is None:
        return "it is required"
    field = keyed_fields(place.model).get(str(place.path[-1]))
    description = (field.description if field is not None else None) or "it is required"
    return description[0].lower() + description[1:].rstrip(".")


def _number(value: Any, key: str, *, whole: bool) -> str:
    unit = split_key(key)[1]
    wanted = "a whole number" if whole else "a number"
    needed = f"{wanted} in {unit.words} is needed" if unit else f"{wanted} is needed"
    if isinstance(value, float):
        if not math.isfinite(value):
            return f"{needed}, not {value}"
        near = sorted({math.floor(value), math.ceil(value)})
        return f"{needed}, not {value}; write {' or '.join(str(number) for number in near)}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{needed}, and this one is too large"
    read = read_number(value) if isinstance(value, str) else None
    if read is None:
        return f"{needed}, not {_show(value)}"
    number, given = read
    given_unit = unit_of(given)
    if given == "%":
        number /= 100
    elif given_unit is not None and unit is not None:
        converted = convert(number, given_unit, unit)
        if converted is None:
            return f"{needed}, not {given_unit.words}"
        number = converted
    elif given:
        return f"{needed}, not {_show(value)}"
    return f"{needed}, not {_show(value)}; write {show(number)}"


def _mapping(value: Any, place: Place) -> str:
    inside = models(place.annotation)
    keys = f" (keys: {', '.join(keyed_fields(inside[0]))})" if len(inside) == 1 else ""
    return f"a mapping of keys to values is needed, not {_show(value)}{keys}"


def _limit(value: Any, kind: str, context: dict[str, Any], path: KeyPath) -> str:
    name, word = _LIMITS[kind]
    message = f"{_show(value)} is not possible: it must be {word} {show(context[name])}"
    if "probability" in str(path[-1]) and 1 < value <= 100:
        return f"{message}; write {show(value / 100)}"
    if kind.startswith("greater") and value == -abs(value) and value and "sigma" in str(path[-1]):
        return f"{message}; write {show(-value)}"
    return message


def _show(value: Any) -> str:
    """A value as it is named in a message."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case str():
            return repr(value if len(value) <= 40 else f"{value[:37]}...")
        case int() | float():
            return f"{value:g}" if abs(value) < 1e15 else "so large a number"
        case list():
            return "a list"
        case dict():
            return "a mapping"
    return type(value).__name__
