"""A tracker in a few words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import PurePath
from typing import Any

from trackbench.base.config.key_units import in_words
from trackbench.scenario.config import TrackerEntry
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.initial import InitialConfig
from trackbench.truth.config.traffic import TracksConfig


def describe_tracker(tracker: TrackerEntry, late: Collection[str]) -> str:
    """A tracker in a few words; ``late``: names of the sensors whose scans are."""
    if isinstance(tracker, TracksConfig):
        moved = f", time offset {tracker.time_offset_s:g} s" if tracker.time_offset_s else ""
        return f"made elsewhere, {PurePath(tracker.path).name}{moved}"
    if isinstance(tracker, PluginConfig):
        options = ", ".join(f"{key} {value}" for key, value in tracker.options.items())
        parts = [str(tracker.use), options]
    else:
        parts = [tracker.filter, *([f"{tracker.smoother} smoother"] if tracker.smoother else [])]
        parts += tracker.motion_in_words
        if tracker.process_noise_diag is not None:
            parts.append(f"constant Q {_diagonal(tracker.process_noise_diag)}")
        parts += [f"{sensor} taken for a {kind}" for sensor, kind in tracker.sensor_models.items()]
        for sensor, sigmas in tracker.measurement_noise.items():
            parts += [f"{sensor} with {in_words(key, value)}" for key, value in sigmas.items()]
        for sensor, effects in tracker.assume.items():
            parts.append(f"{sensor} with {' and '.join(effects.names)} assumed")
        parts += [_initial(tracker), _late(tracker, late)]
    parts.append("all sensors" if tracker.sensors is None else " + ".join(tracker.sensors))
    return ", ".join(part for part in parts if part)


def _initial(tracker: FilterConfig) -> str:
    """How its tracks start: "initial: two_measurements with skip 3"; empty where it is as unless given."""
    initial, usual = tracker.initial, InitialConfig()
    other = {name: value for name, value in initial if value != getattr(usual, name)}
    if not other:
        return ""
    other.pop("source", None)
    words = [_option(name, value) for name, value in other.items()]
    return f"initial: {initial.source}" + (f" with {' and '.join(words)}" if words else "")


def _late(tracker: FilterConfig, late: Collection[str]) -> str:
    """What becomes of late scans: "late: replay"; empty where there are none."""
    read = late if tracker.sensors_used is None else set(late) & set(tracker.sensors_used)
    if not read or tracker.smoother is not None:
        return ""
    lag = f" within {tracker.lag_s:g} s" if "lag_s" in tracker.model_fields_set else ""
    return f"late: {tracker.late}{lag}"


def _option(name: str, value: Any) -> str:
    if name == "covariance_diag":
        return f"covariance {_diagonal(value)}"
    return in_words(name, " + ".join(value) if name == "sensors" else value)


def _diagonal(variances: Sequence[float]) -> str:
    return f"diag({', '.join(f'{variance:g}' for variance in variances)})"
