"""Wording of the messages about an invalid configuration: what is wrong, and the nearest valid choice."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from trackbench.base.config.key_units import convert, show, split_key
from trackbench.base.config.problems import PROBLEM, KeyPath, Problem
from trackbench.base.errors import did_you_mean, nearest_choices, similar_names

Fields = Mapping[str, FieldInfo | None]
_TAG = re.compile(r"<.+>")
#: Part of a pydantic location that blames the key of a mapping instead of its value.
_KEY = "[key]"

#: Needed kind of value, by the type of pydantic's error.
_NEEDED = {
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "text",
    "list_type": "a list",
}
#: Name of a limit in the context of pydantic's error, and its wording, by the type of the error.
_LIMITS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


#: Number of errors of one file that are explained; more are not printed.
ADVISED = 100


def keyed_fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a configuration class, by their keys in the file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def explain(invalid: ValidationError, fields: Fields) -> list[Problem]:
    """Return the problems of invalid data, each with its key path and the nearest valid choice.

    Args:
        invalid: pydantic's error about the data; errors of a :class:`Config` within the data are explained already.
        fields: fields that the data may have, by their keys.
    """
    errors = invalid.errors(include_url=False)
    unknown = [error for error in errors if error["type"] == "extra_forbidden" and len(error["loc"]) == 1]
    meant = {_nearest_key(str(error["loc"][0]), fields) for error in unknown[:ADVISED]}
    problems = []
    for number, error in enumerate(errors):
        path = tuple(part for part in error["loc"] if not _TAG.fullmatch(str(part)) and part != _KEY)
        near = _fields_within(fields, path[:-1])
        # A misspelt key is one mistake: the right key is missing because of it.
        if error["type"] != "missing" or path not in {(key,) for key in meant}:
            problems.append(Problem(path, _message(error, path, near) if number < ADVISED else error["msg"]))
    return problems


def _fields_within(fields: Fields, path: KeyPath) -> Fields:
    for part in path:
        model = getattr(fields.get(str(part)), "annotation", None)
        fields = keyed_fields(model) if isinstance(model, type) and issubclass(model, BaseModel) else {}
    return fields


def advise(key: str, value: Any, fields: Fields) -> str:
    """Return advice for an unknown key: a key of the same quantity with ``value`` converted, else the nearest key."""
    unit, meant = split_key(key)[1], _nearest_key(key, fields)
    key_unit = split_key(meant)[1] if meant else None
    if meant and (key_unit or unit):
        use = f"unknown key; use {meant}" + (f" ({key_unit.words})" if key_unit else "")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        converted = convert(value, unit, key_unit) if is_number and unit and key_unit else None
        return use if converted is None else f"{use}: {show(converted)}"
    if {"use", "options"} <= {*fields} and not get_close_matches(key, fields, 1, 0.8):
        return "unknown key; options of a class go under options"
    # Where no key has the quantity of the unit, a key that is spelt alike would mislead.
    hint = f"choose from: {', '.join(fields)}" if unit else nearest_choices(key, fields)
    return f"unknown key; {hint}"


def _nearest_key(key: str, fields: Fields) -> str | None:
    stem, unit = split_key(key)
    if unit is not None and stem in fields:
        return stem
    units = {name: key_unit for name in fields if (key_unit := split_key(name)[1])}
    stems = {split_key(name)[0]: name for name, other in units.items() if not unit or unit.quantity == other.quantity}
    if same := get_close_matches(stem, stems, 1, 0.8 if unit else 0.9):
        return stems[same[0]]
    return next(iter(similar_names(key, fields, cutoff=0.7)), None) if unit is None else None


def _message(error: ErrorDetails, path: KeyPath, fields: Fields) -> str:
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    match kind:
        case _ if kind == PROBLEM:
            return error["msg"] + _spelling_hint(value, error["msg"])
        case _ if _KEY in error["loc"]:
            return "a name starts with a letter and has only letters, digits, _ and -, at most 64"
        case "extra_forbidden":
            return advise(str(path[-1]), value, fields)
        case "missing":
            field = fields.get(str(path[-1]))
            meaning = (field and field.description) or "it is required"
            return f"missing; {meaning[0].lower()}{meaning[1:].rstrip('.')}"
        case "literal_error" | "union_tag_invalid":
            choices = re.findall(r"'([^']*)'", context.get("expected") or context["expected_tags"])
            word = context.get("tag", value)
            return unknown_word(word, choices)
        case "value_error" | "assertion_error":
            return " ".join(str(context["error"]).split()) or f"{shown(value)} is not possible"
        case _ if kind in _NEEDED:
            unit = split_key(str(path[-1]))[1] if "number" in _NEEDED[kind] and path else None
            needed = f"{_NEEDED[kind]}{f' in {unit.words}' if unit else ''}"
            return f"{needed} is needed, not {value if isinstance(value, float) else shown(value)}"
        case "dict_type" | "model_type" | "model_attributes_type":
            return mapping_needed(value, _fields_within(fields, path[-1:]))
        case "string_pattern_mismatch":
            return f"{shown(value)} is not possible: only a to z, 0 to 9, _ and -"
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
            return f"{shown(value)} is not possible: it must be {word} {show(context[name])}"
        case _:
            return error["msg"][0].lower() + error["msg"][1:]


def _spelling_hint(value: Any, message: str) -> str:
    words = set(re.findall(r"\w+", message))
    unknown = [str(key) for key in value if key not in words] if isinstance(value, dict) else []
    near = [name for key in unknown for name in get_close_matches(key, words, 1, 0.8)]
    return f"; {did_you_mean(near[:1])}" if near else ""


def unknown_word(value: Any, choices: list[str]) -> str:
    """Return the message about a value that is none of the choices, with the nearest choice."""
    if isinstance(value, str):
        return f"{shown(value)} is not known; {nearest_choices(value, choices)}"
    return f"must be a word, not {shown(value)}; choose from: {', '.join(choices)}"


def mapping_needed(value: Any, keys: Iterable[str] = ()) -> str:
    """Return the message about a value that must be a mapping and is not, with the keys that it may have."""
    listed = f" (keys: {', '.join(keys)})" if keys else ""
    return f"a mapping of keys to values is needed, not {shown(value)}{listed}"


def shown(value: Any) -> str:
    """Return a short form of an invalid value, to be quoted in a message."""
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
