"""The motion models that a scenario can name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from trackbench.models.motion.base import ACCELERATION, POSITION, VELOCITY, YAW, YAW_RATE, MotionModel
from trackbench.plugins import Registry, lacks_class

KNOWN = (*POSITION, *VELOCITY, *ACCELERATION, *YAW, *YAW_RATE)


def _lacks(found: Any) -> str | None:
    lacking = lacks_class(MotionModel)(found)
    if lacking is not None:
        return lacking
    unsaid = [name for name in found.components if name not in KNOWN and name not in found.first_sigmas]
    if unsaid:
        return f"its first_sigmas do not say how uncertain {' and '.join(unsaid)} is at a track's start"
    unknown = [name for name in found.driving_noise if name not in found.model_fields]
    return f"its driving_noise names {unknown[0]!r}, which is no option of it" if unknown else None


#: The motion models by the names that scenarios use.
MOTION_MODELS: Registry[type[MotionModel]] = Registry("trackbench.motion_models", "motion model", _lacks)


def with_component(names: Iterable[str]) -> list[str]:
    """The published models whose state has one of these components."""
    wanted = set(names)
    return [name for name, model in MOTION_MODELS.loaded().items() if wanted & set(model.components)]
