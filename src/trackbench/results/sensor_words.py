"""What a sensor is, in a few words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.base.config.key_units import in_words
from trackbench.results.scenario_summary import SensorSummary


def noise_in_words(sensor: SensorSummary) -> str:
    """The standard deviation of each component, such as "range 0.3 m, azimuth 0.5 deg"."""
    return ", ".join(f"{name.replace('_', ' ')} {of.sigma:.4g} {of.unit}" for name, of in sensor.noise.items())


def range_in_words(sensor: SensorSummary) -> str:
    """The largest range, such as "150 m"."""
    return "no limit" if sensor.max_range_m is None else f"{sensor.max_range_m:g} m"


def mount(sensor: SensorSummary) -> str:
    """The pose on the observer, such as "x 3.6 m, y 0 m, yaw 0 deg"."""
    return f"x {sensor.mount.x_m:g} m, y {sensor.mount.y_m:g} m, yaw {sensor.mount.yaw_deg:g} deg"


def latency(sensor: SensorSummary) -> str:
    """Of its scans, s, such as "0.1" or, drawn, "0.05 to 0.2"."""
    return " to ".join(dict.fromkeys(f"{end:g}" for end in sensor.latency_s))


def effects(sensor: SensorSummary) -> str:
    """How it differs from an ideal one, such as "reflection, correlated errors"."""
    return ", ".join(str(effect["type"]).replace("_", " ") for effect in sensor.effects) or "none"


def effects_with_options(sensors: Mapping[str, SensorSummary]) -> Iterator[str]:
    """Of each that is not ideal, such as "Effects of lidar: faces (share 0.2); bias (azimuth 0.1 deg)."."""
    for name, sensor in sensors.items():
        if sensor.effects:
            each = (f"{str(of['type']).replace('_', ' ')} ({', '.join(_options(of))})" for of in sensor.effects)
            yield f"Effects of {name}: {'; '.join(each)}."


def _options(of: Mapping[str, object]) -> Iterator[str]:
    for key, value in of.items():
        if isinstance(value, Mapping):
            yield from _options(value)
        elif key != "type" and value is not None:
            yield in_words(key, value)
