"""Plug-ins: motion models, sensors, truth sources, trackers and metrics that a scenario names."""

from trackbench.plugins.imports import named, one_line, searched
from trackbench.plugins.registry import Registry, lacks_class

__all__ = ["Registry", "lacks_class", "named", "one_line", "searched"]
