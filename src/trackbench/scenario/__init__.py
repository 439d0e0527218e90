"""Scenario files, from YAML to a validated and frozen configuration.

A file or a text, with changes by ``--set``, comes in; a checked configuration, or errors with file, line and key, goes
out. Truths of its scenes are made from it in ``truth.py``. Read ``load.py`` first.
"""

from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.load import Scenario, load_scenario

__all__ = ["Scenario", "ScenarioConfig", "load_scenario"]
