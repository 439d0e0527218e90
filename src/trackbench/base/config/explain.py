"""Messages about an invalid configuration."""

from __future__ import annotations

import json
import math
from difflib import get_close_matches
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from trackbench.base.config import PROBLEM, KeyPath
from trackbench.base.config.key_units import Unit, convert, find_unit, read_number, show, split_key
from trackbench.base.config.places import (
    Beside,
    Place,
    config_classes,
    find_place,
    forms,
    keyed_fields,
    longest,
    marked,
    members,
    whole,
    words,
)
from trackbench.base.config.plugin import plugin_options
from trackbench.base.errors import did_you_mean, nearest_choices, same_name, similar_names


class Advice(NamedTuple):
    """What to write instead."""

    message: str
    key: str | None
    """The key that was meant, where that is clear."""


def advise(key: str, value: Any, model: type[BaseModel], root: type[BaseModel]) -> Advice:
    """Advice on the unknown ``key`` of ``model``, in a file whose whole is described by ``root``."""
    keys = list(keyed_fields(model))
    if key in keys:
        return Advice("unknown key here: it belongs into the mapping of the model or class whose option it is", None)
    if {"use", "options"} <= set(keys):
        return _option(key, value, keys)
    return _advise(key, value, keys, model, root)


def _option(key: str, value: Any, keys: list[str]) -> Advice:
    """Advice on a key beside ``use``: most often it is an option of the class named there."""
    close = get_close_matches(key, [candidate for candidate in keys if candidate != "use"], n=1, cutoff=0.8)
    if close:
        return Advice(f"unknown key; did you mean {close[0]!r}?", close[0])
    shown = json.dumps(value, ensure_ascii=False, default=str)
    written = f"{{{key}: {shown if len(shown) <= 40 else '...'}}}"
    return Advice(f"unknown key; options of a class go under options: {written}", None)


def advise_beside(key: str, value: Any, plugged: Beside, root: type[BaseModel]) -> Advice:
    """Advice on a ``key`` that is neither an option of a plug-in nor of the class beside whose keys they may stand."""
    options = list(keyed_fields(plugged.plugin.registry[plugged.name]))
    if key in plugin_options(plugged.plugin):
        uses = " and ".join(options) or "no option"
        return Advice(f"{plugged.key} {plugged.name} does not use this; it uses {uses}", None)
    others = plugin_options(plugged.plugin)
    own = [name for name in keyed_fields(plugged.model) if name not in others]
    return _advise(key, value, list(dict.fromkeys([*options, *own])), plugged.model, root)


def _advise(key: str, value: Any, keys: list[str], model: type[BaseModel], root: type[BaseModel]) -> Advice:
    meant = _same_quantity(key, keys)
    if meant is not None:
        return Advice(f"unknown key; {_use(meant, split_key(key)[1], value)}", meant)
    plain = [candidate for candidate in keys if split_key(candidate)[1] is None]
    slip = same_name(key, plain) or get_close_matches(key, plain, n=1, cutoff=0.85)
    if slip:
        return Advice(f"unknown key; {did_you_mean(slip)}", slip[0])
    homes = _homes(key, model, root, ())[:2]
    if homes:
        return Advice(f"unknown key here; it belongs to {' or '.join(homes)}", None)
    if split_key(key)[1] is not None:
        # No key measures this quantity, so one that is spelt alike would mislead.
        return Advice(f"unknown key; choose from: {', '.join(keys)}", None)
    close = similar_names(key, keys, cutoff=0.7)
    if close and split_key(close[0])[1] is not None:
        return Advice(f"unknown key; {_use(close[0], None, value)}", close[0])
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
    close = (
        similar_names(stem, stems, 0.8) if unit else same_name(stem, stems) or get_close_matches(stem, stems, 1, 0.9)
    )
    return stems[close[0]] if close else None


def _use(key: str, source: Unit | None, value: Any) -> str:
    unit = split_key(key)[1]
    words = f"use {key} ({unit.words})" if unit else f"use {key}"
    if unit is None or source is None or isinstance(value, bool) or not isinstance(value, int | float):
        return words
    converted = convert(value, source, unit)
    return words if converted is None else f"{words}: {show(converted)}"


def _homes(key: str, found_in: type[BaseModel], model: type[BaseModel], path: tuple[str, ...]) -> list[str]:
    """The sections of ``model`` in which ``key`` is known, by their dotted names.

    Where ``found_in`` is another form of the same section, the name says which form knows the key; a form that no
    key tells from the others is left out.
    """
    homes = []
    for name, field in keyed_fields(model).items():
        result = forms(whole(field))
        section = ".".join((*path, name))
        here = found_in in [form for form, _ in result]
        for form, distinction in result:
            if key in keyed_fields(form) and not (here and distinction is None):
                homes.append(f"{section} with {': '.join(distinction)}" if here and distinction else section)
            homes += _homes(key, found_in, form, (*path, name))
    return list(dict.fromkeys(homes))


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
        place = find_place(root, error["loc"])
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
        place = find_place(root, error["loc"])
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
            hint = nearest_choices(context["tag"], members(place.annotation))
            return (*path, _discriminator(context)), f"{_show(context['tag'])} is not known; {hint}"
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
                return path, f"{_show(value)} is not known; {nearest_choices(value, choices)}"
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
            spelt = {"true": "yes on 1 true", "false": "no off 0 false"}
            meant = [word for word, others in spelt.items() if str(value).lower() in others.split()]
            return path, f"true or false is needed, not {_show(value)}{'; write '.join(['', *meant])}"
        case "string_type":
            hint = f'; write "{value}"' if isinstance(value, int | float) else ""
            return path, f"text is needed, not {_show(value)}{hint}"
        case "list_type":
            hint = f"; write [{value}]" if isinstance(value, str) and value.isidentifier() else ""
            return path, f"a list is needed, not {_show(value)}{hint}"
        case "dict_type" | "model_type" | "model_attributes_type":
            return path, _mapping(value, place)
        case "string_pattern_mismatch":
            return path, f"{_show(value)} is not possible: only a to z, 0 to 9, _ and -"
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


#: The largest whole number that a message writes.
_WRITTEN = 1e15


def _number(value: Any, key: str, *, whole: bool) -> str:
    unit = split_key(key)[1]
    wanted = "a whole number" if whole else "a number"
    needed = f"{wanted} in {unit.words} is needed" if unit else f"{wanted} is needed"
    if isinstance(value, float):
        if not math.isfinite(value):
            return f"{needed}, not {value}"
        if abs(value) > _WRITTEN:
            return f"{needed}, and this one is too large"
        near = sorted({math.floor(value), math.ceil(value)})
        return f"{needed}, not {value}; write {' or '.join(str(number) for number in near)}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{needed}, and this one is too large"
    read = read_number(value) if isinstance(value, str) else None
    if read is None:
        return f"{needed}, not {_show(value)}"
    number, given = read
    given_unit = find_unit(given)
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
    inside = config_classes(place.annotation)
    keys = f" (keys: {', '.join(keyed_fields(inside[0]))})" if len(inside) == 1 else ""
    return f"a mapping of keys to values is needed, not {_show(value)}{keys}"


def _limit(value: Any, kind: str, context: dict[str, Any], path: KeyPath) -> str:
    name, word = _LIMITS[kind]
    message = f"{_show(value)} is not possible: it must be {word} {show(context[name])}"
    if "probability" in str(path[-1]) and 1 < value <= 100:
        return f"{message}; write {show(value / 100)}"
    if kind.startswith("greater") and value == -abs(value) and value and "sigma" in str(path[-1]):
        return f"{message}; write {show(-value)}"
    if kind.endswith("equal") and ("sigma" in str(path[-1]) or "covariance_diag" in path):
        why = (
            "a smaller error is lost in rounding"
            if name == "ge"
            else "beside a larger error others are lost in rounding"
        )
        return f"{message}; {why}"
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
