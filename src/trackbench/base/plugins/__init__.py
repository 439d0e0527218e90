"""Plug-ins: motion models, sensors, truth sources, trackers and metrics that a scenario names."""

from trackbench.base.plugins.imports import named, one_line, searched
from trackbench.base.plugins.registry import Registry, lacks_class

__all__ = ["Registry", "lacks_class", "named", "one_line", "searched"]
