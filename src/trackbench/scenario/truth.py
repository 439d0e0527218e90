"""The truth that a scenario is about."""

from __future__ import annotations

from trackbench.errors import InputError
from trackbench.scenario.load import Scenario
from trackbench.truth import Draw, LoadedTruth
from trackbench.types import Progress, no_progress


def truth_of(loaded: Scenario, progress: Progress = no_progress) -> LoadedTruth:
    """Simulate, draw or read the truth of a scenario, with what its other sections say of it.

    Args:
        loaded: the scenario.
        progress: called with the number of steps simulated and of all.

    Raises:
        InputError: it cannot be had; with file and line.
    """
    config = loaded.config
    draw = Draw(config.monte_carlo.seed, config.name, config.monte_carlo.runs)
    kinds = {name: sensor.type for name, sensor in config.sensors.items()}
    try:
        return config.truth.load(draw, folder=loaded.path.resolve().parent, sensors=kinds, progress=progress)
    except InputError as error:
        raise loaded.locate(error) from None
