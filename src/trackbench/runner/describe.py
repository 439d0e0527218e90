"""A tracker in a few words."""

from __future__ import annotations

from trackbench.trackers.config import FilterConfig, PluginConfig


def describe(tracker: FilterConfig | PluginConfig) -> str:
    """A tracker in a few words."""
    if isinstance(tracker, PluginConfig):
        options = ", ".join(f"{key} {value}" for key, value in tracker.options.items())
        parts = [tracker.use, options]
    else:
        parts = [tracker.filter, *tracker.motion_in_words]
        if tracker.process_noise_diag is not None:
            parts.append(f"constant Q diag({', '.join(f'{v:g}' for v in tracker.process_noise_diag)})")
        parts += [f"{sensor} taken for a {kind}" for sensor, kind in tracker.sensor_models.items()]
    parts.append("all sensors" if tracker.sensors is None else " + ".join(tracker.sensors))
    return ", ".join(part for part in parts if part)
