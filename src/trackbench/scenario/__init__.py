"""Scenario files: YAML in, validated and frozen configuration out."""

from trackbench.scenario.config import Scenario
from trackbench.scenario.load import LoadedScenario, load_scenario

__all__ = ["LoadedScenario", "Scenario", "load_scenario"]
