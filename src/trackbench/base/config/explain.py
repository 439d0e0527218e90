"""Messages about an invalid configuration."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from trackbench.base.config import PROBLEM, KeyPath
from trackbench.base.config.key_units import Unit, convert, show, split_key
from trackbench.base.config.places import (
    Place,
    config_classes,
    find_place,
    keyed_fields,
    marked,
    members,
    words,
)
from trackbench.base.config.plugin import plugin_options
from trackbench.base.errors import nearest_choices, similar_names


class Advice(NamedTuple):
    """What to write instead."""

    message: str
    key: str | None
    """The key that was meant, where that is clear."""


def advise(key: str, value: Any, place: Place) -> Advice:
    """Advice on an unknown key: the key of the same quantity in its own unit, else the nearest keys."""
    assert place.model is not None
    keys = list(keyed_fields(place.model))
    if place.beside is not None:
        others = plugin_options(place.beside.plugin)
        options = keyed_fields(place.beside.plugin.registry[place.beside.name])
        own = [name for name in keyed_fields(place.beside.model) if name not in others]
        keys = list(dict.fromkeys([*options, *own]))
        if key in others:
            uses = " and ".join(options) or "no option"
            return Advice(f"{place.beside.key} {place.beside.name} does not use this; it uses {uses}", None)
    if key in keys:
        return Advice("unknown key here: it belongs into the mapping of the model or class whose option it is", None)
    if {"use", "options"} <= set(keys) and not get_close_matches(key, keys, 1, 0.8):
        return Advice("unknown key; options of a class go under options", None)
    meant = _same_quantity(key, keys)
    if meant is not None:
        return Advice(f"unknown key; {_use(meant, split_key(key)[1], value)}", meant)
    if split_key(key)[1] is not None:
        # No key measures this quantity, so one that is spelt alike would mislead.
        return Advice(f"unknown key; choose from: {', '.join(keys)}", None)
    close = similar_names(key, keys, cutoff=0.7)
    return Advice(f"unknown key; {nearest_choices(key, keys)}", close[0] if close else None)


def _same_quantity(key: str, keys: list[str]) -> str | None:
    """The key with the same name but for its unit, or a misspelt one of the same quantity."""
    stem, unit = split_key(key)
    if unit is not None and stem in keys:
        return stem
    stems: dict[str, str] = {}
    for candidate in keys:
        known_stem, known_unit = split_key(candidate)
        if known_unit is not None and (unit is None or unit.quantity == known_unit.quantity):
            stems[known_stem] = candidate
    close = get_close_matches(stem, stems, 1, 0.8 if unit else 0.9)
    return stems[close[0]] if close else None


def _use(key: str, source: Unit | None, value: Any) -> str:
    unit = split_key(key)[1]
    words = f"use {key} ({unit.words})" if unit else f"use {key}"
    if unit is None or source is None or isinstance(value, bool) or not isinstance(value, int | float):
        return words
    converted = convert(value, source, unit)
    return words if converted is None else f"{words}: {show(converted)}"


#: By the type of an error of pydantic, the value that is needed.
_NEEDED = {
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "text",
    "list_type": "a list",
}
#: The name of a limit in the context of such an error, and how it is said.
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
    places = [find_place(root, error["loc"]) for error in errors]
    for error, place in zip(errors, places, strict=True):
        if error["type"] == "extra_forbidden" and place.model is not None:
            advice = advise(str(place.path[-1]), error["input"], place)
            result.append((place.path, advice.message))
            if advice.key is not None:
                advised.add((*place.path[:-1], advice.key))
    for error, place in zip(errors, places, strict=True):
        # A key under a wrong name is one mistake: that the right one is missing follows from it.
        if error["type"] != "extra_forbidden" and not (error["type"] == "missing" and place.path in advised):
            result.append((_path(error, place), _message(error, place)))
    return result


def _path(error: ErrorDetails, place: Place) -> KeyPath:
    """The keys and indices of an error, with the key that tells the members of a union apart."""
    if error["type"] in ("union_tag_not_found", "union_tag_invalid"):
        return (*place.path, str(error["ctx"]["discriminator"]).strip("'"))
    return place.path


def _message(error: ErrorDetails, place: Place) -> str:
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    match kind:
        case _ if place.is_key:
            return "a name starts with a letter and has only letters, digits, _ and -, at most 64"
        case "union_tag_not_found":
            return f"missing; choose from: {', '.join(members(place.annotation))}"
        case "union_tag_invalid":
            return f"{_show(context['tag'])} is not known; {nearest_choices(context['tag'], members(place.annotation))}"
        case "missing" if marked(place.annotation) is not None and place.model is None:
            return f"missing; choose from: {', '.join(words(place.annotation))}"
        case "missing" if place.beside is not None and place.model is not None:
            needed = [name for name, field in keyed_fields(place.model).items() if field.is_required()]
            return f"missing: {place.beside.key} {place.beside.name} needs {' and '.join(needed)}"
        case "missing":
            return f"missing; {_meaning(place)}"
        case "literal_error":
            choices = words(place.annotation)
            if isinstance(value, str):
                return f"{_show(value)} is not known; {nearest_choices(value, choices)}"
            return f"must be a word, not {_show(value)}; choose from: {', '.join(choices)}"
        case "value_error" | "assertion_error":
            return " ".join(str(context["error"]).split()) or f"{_show(value)} is not possible"
        case _ if kind in _NEEDED:
            shown = str(value) if isinstance(value, float) else _show(value)
            unit = split_key(str(place.path[-1]))[1] if "number" in _NEEDED[kind] and place.path else None
            return f"{_NEEDED[kind]}{f' in {unit.words}' if unit else ''} is needed, not {shown}"
        case "dict_type" | "model_type" | "model_attributes_type":
            inside = config_classes(place.annotation)
            keys = f" (keys: {', '.join(keyed_fields(inside[0]))})" if len(inside) == 1 else ""
            return f"a mapping of keys to values is needed, not {_show(value)}{keys}"
        case "string_pattern_mismatch":
            return f"{_show(value)} is not possible: only a to z, 0 to 9, _ and -"
        case "too_short" | "string_too_short" if context["min_length"] == 1:
            return "must not be empty"
        case "too_short" | "too_long":
            least, most = context.get("min_length"), context.get("max_length")
            limit = f"at least {least}" if most is None else f"at most {most}"
            return f"{limit} entries are needed, not {context['actual_length']}"
        case "string_too_long":
            return f"too long: at most {context['max_length']} characters"
        case _ if kind in _LIMITS:
            name, word = _LIMITS[kind]
            return f"{_show(value)} is not possible: it must be {word} {show(context[name])}"
        case _ if kind == PROBLEM:
            return error["msg"]
        case _:
            return error["msg"][0].lower() + error["msg"][1:]


def _meaning(place: Place) -> str:
    """The field's description, as the reason to write it."""
    field = None if place.model is None else keyed_fields(place.model).get(str(place.path[-1]))
    description = (field.description if field is not None else None) or "it is required"
    return description[0].lower() + description[1:].rstrip(".")


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
            return "so large a number" if abs(value) >= 1e15 else f"{value:g}"
        case list():
            return "a list"
        case dict():
            return "a mapping"
    return type(value).__name__
