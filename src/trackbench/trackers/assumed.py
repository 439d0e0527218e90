"""What a tracker assumes of its sensors, where that is not what they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trackbench.base.types import Scan
from trackbench.models.sensors import SENSOR_MODELS


@dataclass(frozen=True)
class AssumedSensors:
    """The equations and the noise that a tracker takes in place of a sensor's own, by the sensor's name."""

    models: Mapping[str, str] = field(default_factory=dict)
    """The kind of sensor that it is taken for."""
    noise: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Standard deviations by the option that states them."""

    def read(self, scan: Scan) -> Scan:
        """The scan as the tracker takes it."""
        kind = self.models.get(scan.sensor, scan.kind)
        sigmas = self.noise.get(scan.sensor)
        if sigmas is None:
            return scan if kind == scan.kind else scan._replace(kind=kind)
        return scan._replace(kind=kind, noise_covariance=SENSOR_MODELS[kind].other_noise(scan.noise_covariance, sigmas))
