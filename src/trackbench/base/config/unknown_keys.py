"""What to say about a key that does not exist: most often its unit is wrong or missing."""

from __future__ import annotations

import json
from difflib import get_close_matches
from typing import Any, NamedTuple

from pydantic import BaseModel

from trackbench.base.config.key_units import Unit, convert, show, split_key
from trackbench.base.config.places import Beside, forms, keyed_fields, whole
from trackbench.base.config.plugin import plugin_options
from trackbench.base.errors import nearest


class Advice(NamedTuple):
    """What to write instead."""

    message: str
    key: str | None
    """The key that was meant, where that is clear."""


def advise(key: str, value: Any, model: type[BaseModel], root: type[BaseModel]) -> Advice:
    """Advice on the unknown ``key`` of ``model``, in a file whose whole is described by ``root``."""
    keys = list(keyed_fields(model))
    if key in keys:
        return Advice("unknown key here: it belongs into the mapping that names the plug-in", None)
    if {"use", "options"} <= set(keys):
        return _option(key, value, keys)
    return _advise(key, value, keys, model, root)


def _option(key: str, value: Any, keys: list[str]) -> Advice:
    """Advice on a key beside ``use``: most often it is an option of the class named there."""
    close = get_close_matches(key, [known for known in keys if known != "use"], n=1, cutoff=0.8)
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
    slip = get_close_matches(key, keys, n=1, cutoff=0.85)
    if slip and split_key(slip[0])[1] is None:
        return Advice(f"unknown key; did you mean {slip[0]!r}?", slip[0])
    homes = _homes(key, model, root, ())[:2]
    if homes:
        return Advice(f"unknown key here; it belongs to {' or '.join(homes)}", None)
    if split_key(key)[1] is not None:
        # No key measures this quantity, so one that is spelt alike would mislead.
        return Advice(f"unknown key; choose from: {', '.join(keys)}", None)
    close = get_close_matches(key, keys, n=1)
    if close and split_key(close[0])[1] is not None:
        return Advice(f"unknown key; {_use(close[0], None, value)}", close[0])
    return Advice(f"unknown key; {nearest(key, keys)}", close[0] if close else None)


def _same_quantity(key: str, keys: list[str]) -> str | None:
    """The key with the same name but for its unit, or a misspelt one of the same quantity."""
    stem, unit = split_key(key)
    if unit is not None and stem in keys:
        return stem
    stems: dict[str, str] = {}
    for known in keys:
        known_stem, known_unit = split_key(known)
        if known_unit is not None and (unit is None or unit.quantity == known_unit.quantity):
            stems[known_stem] = known
    close = get_close_matches(stem.lower(), stems, n=1, cutoff=0.8 if unit else 0.9)
    return stems[close[0]] if close else None


def _use(key: str, given: Unit | None, value: Any) -> str:
    unit = split_key(key)[1]
    words = f"use {key} ({unit.words})" if unit else f"use {key}"
    if unit is None or given is None or isinstance(value, bool) or not isinstance(value, int | float):
        return words
    converted = convert(value, given, unit)
    return words if converted is None else f"{words}: {show(converted)}"


def _homes(key: str, found_in: type[BaseModel], model: type[BaseModel], path: tuple[str, ...]) -> list[str]:
    """The sections of ``model`` in which ``key`` is known, by their dotted names.

    Where ``found_in`` is another form of the same section, the name says which form knows the key; a form that no
    key tells from the others is left out.
    """
    homes = []
    for name, field in keyed_fields(model).items():
        found = forms(whole(field))
        section = ".".join((*path, name))
        here = found_in in [form for form, _ in found]
        for form, told in found:
            if key in keyed_fields(form) and not (here and told is None):
                homes.append(f"{section} with {': '.join(told)}" if here and told else section)
            homes += _homes(key, found_in, form, (*path, name))
    return list(dict.fromkeys(homes))
