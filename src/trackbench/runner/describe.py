"""A tracker in a few words."""

from __future__ import annotations

from trackbench.config.key_units import in_words
from trackbench.trackers.config import FilterConfig, PluginConfig


def describe(tracker: FilterConfig | PluginConfig) -> str:
    """A tracker in a few words."""
    if isinstance(tracker, PluginConfig):
        options = ", ".join(f"{key} {value}" for key, value in tracker.options.items())
        parts = [tracker.use, options]
    else:
        parts = [tracker.filter, *([f"{tracker.smoother} smoother"] if tracker.smoother else [])]
        parts += tracker.motion_in_words
        if tracker.process_noise_diag is not None:
            parts.append(f"constant Q diag({', '.join(f'{v:g}' for v in tracker.process_noise_diag)})")
        parts += [f"{sensor} taken for a {kind}" for sensor, kind in tracker.sensor_models.items()]
        for sensor, sigmas in tracker.measurement_noise.items():
            parts += [f"{sensor} with {in_words(key, value)}" for key, value in sigmas.items()]
    parts.append("all sensors" if tracker.sensors is None else " + ".join(tracker.sensors))
    return ", ".join(part for part in parts if part)
