"""The environment's own configuration: what the user gives, checked against its defaults."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from typing import Any

from trackbench.base.errors import InputError, nearest

#: For ``action`` and ``observation``: the keys that each of their types takes.
Variants = Mapping[str, Mapping[str, Collection[str]]]

WHOLE_NUMBERS = ("_count", "vehicles", "_lanes", "_frequency")
#: Of lanes and vehicles: each is simulated.
MOST = 1000
NULLABLE = {"destination"}


def complete(
    given: Mapping[str, Any], defaults: Mapping[str, Any], variants: Variants, at: str = "truth.config"
) -> dict[str, Any]:
    """``given`` with what it leaves out of a nested mapping filled in from ``defaults``.

    Raises:
        InputError: an unknown key, a value of another type than its default, a count that is negative.
    """
    result: dict[str, Any] = {}
    for key, value in given.items():
        path = f"{at}.{key}"
        if key not in defaults:
            raise InputError(f"unknown key; {nearest(str(key), defaults)}", key=path)
        if key in variants:
            result[key] = _variant(value, defaults[key], key, variants, path)
        else:
            _check(key, value, defaults[key], path)
            result[key] = value
    return result


def _variant(value: Any, default: Mapping[str, Any], name: str, variants: Variants, at: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"must be a mapping, not {value!r}", key=at)
    kind = value.get("type", default.get("type"))
    if kind not in variants[name]:
        raise InputError(f"unknown {name} type {kind!r}; {nearest(str(kind), variants[name])}", key=f"{at}.type")
    known = default if kind == default.get("type") else {}
    accepted = {"type", *variants[name][kind], *known}
    for key, inner in value.items():
        if key not in accepted:
            raise InputError(f"unknown key; {nearest(str(key), accepted)}", key=f"{at}.{key}")
        if known.get(key) is not None:
            _check(key, inner, known[key], f"{at}.{key}")
    merged = {**known, **value}
    part = f"{name}_config"
    if part in value:
        merged[part] = _variant(value[part], known.get(part, {}), name, variants, f"{at}.{part}")
    return merged


def _check(key: str, value: Any, default: Any, at: str) -> None:
    wanted = _kind(default)
    if (value is None and key in NULLABLE) or default is None:
        return
    if _kind(value) != wanted:
        raise InputError(f"must be {wanted}, not {value!r} (the default is {default!r})", key=at)
    if wanted == "a number" and not _finite(value):
        raise InputError("must be finite, and such a number is not", key=at)
    if isinstance(default, int) and wanted == "a number" and key.endswith(WHOLE_NUMBERS):
        least = 1 if key.endswith("_frequency") else 0
        if not isinstance(value, int) or not least <= value <= MOST:
            raise InputError(f"must be a whole number from {least} to {MOST}, not {value!r}", key=at)
    if wanted == "a list" and default and all(_kind(item) == "a number" for item in default):
        if len(value) != len(default) and key != "target_speeds":
            raise InputError(f"must have {len(default)} numbers, not {len(value)}", key=at)
        for item in value:
            if _kind(item) != "a number" or not _finite(item):
                raise InputError(f"must be a list of numbers, not {value!r}", key=at)


def _finite(value: float) -> bool:
    """Whether it can be reckoned with: a whole number may be too large for that."""
    return abs(value) <= sys.float_info.max


def _kind(value: Any) -> str:
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, int | float):
        return "a number"
    if isinstance(value, str):
        return "text"
    if isinstance(value, Mapping):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else type(value).__name__
