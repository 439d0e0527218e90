"""What drivers who vary cost in simulation: time of the processor, beside steady ones in the same process."""

from __future__ import annotations

import time
from collections.abc import Iterator

from trackbench.scenario import load_scenario
from trackbench.truth import highway
from trackbench.truth.environment import Recorder
from trackbench.truth.sources import HighwayTruth

SCENARIOS = ("highway", "highway_dense", "merge", "exit", "roundabout", "intersection")
SCENES, LONGEST_S = 3, 8


def measured() -> Iterator[tuple[str, float, float]]:
    """Scenario, and microseconds per vehicle and step with steady and with human drivers."""
    for name in SCENARIOS:
        cost = {"steady": [0.0, 0], "human": [0.0, 0]}
        for seed in range(1, SCENES + 1):
            for drivers, total in cost.items():
                seconds, steps = _driven(name, drivers, seed)
                total[0] += seconds
                total[1] += steps
        yield name, *(1e6 * seconds / steps for seconds, steps in cost.values())


def _driven(name: str, drivers: str, seed: int) -> tuple[float, int]:
    """Seconds, and how many steps of a vehicle these were."""
    stated = load_scenario(name).config.truth.model_dump()
    config = HighwayTruth.model_validate({**stated, "drivers": drivers, "seed": seed, "targets": "all"})
    with highway.isolated():
        env = highway.prepare_env(config)
        recorder = Recorder(env, highway.control_of(env, config))
        action = highway._neutral_action(env.action_type)
        begin = time.process_time()
        for _ in range(int(min(config.duration_s, LONGEST_S) * env.config["policy_frequency"])):
            env.step(action)
        return time.process_time() - begin, sum(map(len, recorder.frames))
