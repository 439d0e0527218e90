"""Sensor models, by kind."""

from trackbench.models.sensors.base import SensorModel
from trackbench.models.sensors.lidar import Lidar
from trackbench.models.sensors.radar import Radar
from trackbench.models.sensors.speed_radar import SpeedRadar

SENSOR_MODELS: dict[str, SensorModel] = {model.kind: model for model in (Radar(), SpeedRadar(), Lidar())}

__all__ = ["SENSOR_MODELS", "Lidar", "Radar", "SensorModel", "SpeedRadar"]
