"""Peak memory of a large run: prints one line of JSON.

Run as ``python -m benchmarks.memory [runs]``; the memory of a process is only its own in a process of its own.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

from benchmarks.scene import DT, SENSORS, weaving

from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.source import parse_yaml
from trackbench.truth import LoadedTruth

STEPS = 400
CV = {"motion": "cv", "acceleration_sigma_mps2": 2.0}
CTRV = {"motion": "ctrv", "acceleration_sigma_mps2": 2.0, "yaw_acceleration_sigma_radps2": 0.4}
TRACKERS = {
    "kf_cv": {"filter": "kf", **CV},
    "ekf_cv": {"filter": "ekf", **CV},
    "ekf_ctrv": {"filter": "ekf", **CTRV},
    "ukf_ctrv": {"filter": "ukf", **CTRV},
    "ckf_ctrv": {"filter": "ckf", **CTRV},
}


def main(runs: int) -> None:
    scenario = ScenarioConfig.model_validate(
        {
            "name": "memory",
            # Replaced by the scripted truth below: only its rate is read, to check those of the sensors.
            "truth": {"source": "highway-env", "env": "highway-v0", "duration_s": STEPS * DT, "rate_hz": 20, "seed": 0},
            "sensors": SENSORS,
            "trackers": TRACKERS,
            "monte_carlo": {"runs": runs},
        }
    )
    loaded = Scenario(scenario, Path("memory.yaml"), "", (), parse_yaml("", "memory.yaml"))
    begin = time.perf_counter()
    result = run_scenario(loaded, [LoadedTruth(weaving(STEPS), False)])
    seconds = time.perf_counter() - begin
    assert all(entry["failed"] is None for entry in result.json()["trackers"])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"runs": runs, "steps": STEPS, "trackers": len(TRACKERS), "seconds": seconds, "peak_bytes": peak}))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
