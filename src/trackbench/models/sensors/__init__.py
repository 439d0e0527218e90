"""Sensor models; ``SENSOR_MODELS`` holds the sensors that a scenario can name."""

from trackbench.models.sensors.base import SENSOR_MODELS, Dropout, Sensor, sensor_type
from trackbench.models.sensors.lidar import Lidar
from trackbench.models.sensors.model import Mount
from trackbench.models.sensors.radar import Radar

__all__ = ["SENSOR_MODELS", "Dropout", "Lidar", "Mount", "Radar", "Sensor", "sensor_type"]
