"""trackbench: a test bench for radar and lidar vehicle trackers."""

from importlib.metadata import version

__version__ = version("trackbench")
