"""Scenario files: YAML in, validated and frozen configuration out."""

from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.load import Scenario, load_scenario

__all__ = ["Scenario", "ScenarioConfig", "load_scenario"]
