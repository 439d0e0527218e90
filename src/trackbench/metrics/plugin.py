"""Metrics of other packages, and those beside a scenario."""

from __future__ import annotations

import re
from typing import Any

from trackbench.base.plugins import Registry
from trackbench.metrics.builtin import BUILT_IN
from trackbench.metrics.protocol import Field, Metric

NAME = re.compile(r"[a-z][a-z0-9_]*")


def unfit_name(name: str) -> str | None:
    """Why no metric of one's own can have this name; None if one can."""
    if not NAME.fullmatch(name):
        return f"its name {name!r} may have a to z, 0 to 9 and _ alone"
    if name in {metric.name.partition(".")[0] for metric in BUILT_IN} | {"health"}:
        return f"its name {name!r} is that of a built-in one"
    return None


def _lacks(found: Any) -> str | None:
    if not isinstance(found, type) or not issubclass(found, Metric):
        return "it must be a subclass of trackbench.metrics.OwnMetric"
    missing = [name for name in ("name", "unit", "meaning") if not hasattr(found, name)]
    missing += sorted(getattr(found, "__abstractmethods__", ()))
    if missing:
        return f"it lacks {' and '.join(missing)}"
    texts = {name: getattr(found, name) for name in ("name", "unit", "meaning", "value_name")}
    for name, value in texts.items():
        if not isinstance(value, str):
            return f"its {name} must be text, not {value!r}"
    for name in ("compared", "per_sensor"):
        if not isinstance(getattr(found, name), bool):
            return f"its {name} must be True or False, not {getattr(found, name)!r}"
    if not isinstance(found.fields, tuple) or not all(isinstance(field, Field) for field in found.fields):
        return f"its fields must be a tuple of trackbench.metrics.Field, not {found.fields!r}"
    if unfit := unfit_name(found.name):
        return unfit
    if found.better not in ("smaller", "larger", None):
        return f'better must be "smaller", "larger" or None, not {found.better!r}'
    return None


#: The metrics beside the built-in ones, by the names that scenarios use.
METRICS: Registry[type[Metric]] = Registry("trackbench.metrics", "metric", _lacks)
