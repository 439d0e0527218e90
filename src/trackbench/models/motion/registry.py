"""The motion models that a scenario can name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from trackbench.base.plugins import Registry, lacks_class
from trackbench.models.motion.base import ACCELERATION, POSITION, VELOCITY, YAW, YAW_RATE, MotionModel

KNOWN = (*POSITION, *VELOCITY, *ACCELERATION, *YAW, *YAW_RATE)


def _lacks(found: Any) -> str | None:
    lacking = lacks_class(MotionModel)(found)
    if lacking is not None:
        return lacking
    for name in ("components", "driving_noise"):
        if not _names(getattr(found, name)):
            return f"its {name} must be a tuple of names, not {getattr(found, name)!r}"
    if not isinstance(found.angular, tuple) or not set(found.angular) <= set(range(len(found.components))):
        return f"its angular must be a tuple of places in its components, not {found.angular!r}"
    if not isinstance(found.linear, bool):
        return f"its linear must be True or False, not {found.linear!r}"
    if not isinstance(found.first_sigmas, Mapping):
        return f"its first_sigmas must be a mapping of components to standard deviations, not {found.first_sigmas!r}"
    for name, sigma in found.first_sigmas.items():
        if not isinstance(sigma, int | float) or not 0 < sigma < math.inf:
            return f"its first_sigmas say {sigma!r} of {name}, where a positive number is needed"
    unsaid = [name for name in found.components if name not in KNOWN and name not in found.first_sigmas]
    if unsaid:
        return f"its first_sigmas do not say how uncertain {' and '.join(unsaid)} is at a track's start"
    unknown = [name for name in found.driving_noise if name not in found.model_fields]
    return f"its driving_noise names {unknown[0]!r}, which is no option of it" if unknown else None


def _names(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(name, str) for name in value)


#: The motion models by the names that scenarios use.
MOTION_MODELS: Registry[type[MotionModel]] = Registry("trackbench.motion_models", "motion model", _lacks)


def with_component(names: Iterable[str]) -> list[str]:
    """The published models whose state has one of these components."""
    wanted = set(names)
    return [name for name, model in MOTION_MODELS.loaded().items() if wanted & set(model.components)]
