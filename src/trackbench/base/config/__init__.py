"""What every configuration class shares, and what is said of one that is not valid."""

from trackbench.base.config.base import (
    MAPPING,
    PROBLEM,
    WORD,
    Angle,
    Config,
    KeyPath,
    Name,
    NonNegative,
    Positive,
    Probability,
    Problem,
    reject,
    shape,
)
from trackbench.base.config.plugin import OptionsBeside, Plugin, PluginName

__all__ = [
    "MAPPING",
    "PROBLEM",
    "WORD",
    "Angle",
    "Config",
    "KeyPath",
    "Name",
    "NonNegative",
    "OptionsBeside",
    "Plugin",
    "PluginName",
    "Positive",
    "Probability",
    "Problem",
    "reject",
    "shape",
]
