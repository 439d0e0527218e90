"""Sensor models, by kind."""

from trackbench.models.sensors.base import SensorModel
from trackbench.models.sensors.lidar import Lidar
from trackbench.models.sensors.radar import Radar

SENSOR_MODELS: dict[str, SensorModel] = {"radar": Radar(), "lidar": Lidar()}

__all__ = ["SENSOR_MODELS", "Lidar", "Radar", "SensorModel"]
