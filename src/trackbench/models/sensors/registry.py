"""The sensors that a scenario can name."""

from __future__ import annotations

from typing import Any

from trackbench.models.sensors.base import Sensor
from trackbench.plugins import Registry, lacks_class


def _lacks(found: Any) -> str | None:
    lacking = lacks_class(Sensor)(found)
    if lacking is None and len(found.units) != len(found.components):
        return f"it has {len(found.components)} components and {len(found.units)} units"
    return lacking


#: The sensors by the names that scenarios use; ``SENSOR_MODELS[scan.kind]`` has the equations of a scan.
SENSOR_MODELS: Registry[type[Sensor]] = Registry("trackbench.sensors", "sensor", _lacks)
