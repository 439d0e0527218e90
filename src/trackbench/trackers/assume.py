"""What a tracker takes in place of what a sensor states, and what it assumes of a sensor's effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Config, Problem
from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.effects.signal import SignalRange


class AssumedEffects(Config):
    """Effects of a sensor that a tracker assumes."""

    signal_to_noise: SignalRange | None = Field(
        None,
        description="The noise of each measurement by its range, as the effect of this name has it on average over the "
        "fluctuating cross-section.",
    )

    @property
    def names(self) -> list[str]:
        """Of the effects, as sentences have them."""
        return [name.replace("_", " ") for name in type(self).model_fields if getattr(self, name) is not None]

    def problems(self) -> Iterator[Problem]:
        if not self.names:
            yield Problem((), f"says nothing; add {' or '.join(type(self).model_fields)}")


@dataclass(frozen=True)
class AssumedSensors:
    """The equations and the noise that a tracker takes in place of a sensor's own, by the sensor's name."""

    models: Mapping[str, str] = field(default_factory=dict)
    """The kind of sensor that it is taken for."""
    noise: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Standard deviations by the option that states them."""
    effects: Mapping[str, AssumedEffects] = field(default_factory=dict)

    def read(self, scan: Scan) -> Scan:
        """The scan as the tracker takes it."""
        kind = self.models.get(scan.sensor, scan.kind)
        if kind != scan.kind:
            scan = scan._replace(kind=kind)
        sigmas, effects = self.noise.get(scan.sensor), self.effects.get(scan.sensor)
        if sigmas is not None:
            scan = scan._replace(noise_covariance=SENSOR_MODELS[kind].other_noise(scan.noise_covariance, sigmas))
        if effects is not None and effects.signal_to_noise is not None:
            factor = np.where(scan.valid, effects.signal_to_noise.mean_variance_factor(_distance(scan)), 1.0)
            noise = linalg.expand(scan.noise_covariance, scan.measurement[None]) * factor
            scan = scan._replace(noise_covariance=noise)
        return scan


def _distance(scan: Scan) -> Array:
    """``(...)`` the distance that each measurement states, m; one where there is no measurement."""
    model = SENSOR_MODELS[scan.kind]
    if "range" in model.components:
        distance = scan.measurement[model.components.index("range")]
    else:
        x, y = model.position(scan).mean - linalg.expand(scan.sensor_pose[:2], scan.measurement)
        distance = np.hypot(x, y)
    # A measured range of nothing or less has the noise of one metre.
    return np.where(scan.valid, np.maximum(distance, 1.0), 1.0)
