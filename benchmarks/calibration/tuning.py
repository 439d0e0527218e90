"""Tuning on truth of the filter's own model"""

from __future__ import annotations

from collections.abc import Iterator

import trackbench as tb
from trackbench.api.plan import Listener
from trackbench.base.execution import Executor
from trackbench.subjects.tuning.api import TunePlan, tune_trackers
from trackbench.subjects.tuning.objectives import objective_of
from trackbench.subjects.tuning.tune import Tuning

from .claim import Claim, rate

SEEDS, RUNS, TRIALS = 200, 40, 34
TRUE = 2.0
SCENARIO = {
    "name": "own",
    "truth": {
        "source": "scripted",
        "duration_s": 5,
        "rate_hz": 10,
        "objects": {
            "car": {
                "start": {"x": 60, "y": 0, "speed_mps": 5, "course_deg": 90},
                "pieces": [{"white": {"motion": "cv", "acceleration_sigma_mps2": TRUE}}],
            }
        },
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15}},
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": TRUE}},
}


def claims() -> Iterator[Claim]:
    """Tuned values are seldom called better than a start that is right."""
    for objective in ("likelihood", "position_rmse"):
        found = [_tuned(objective, seed) for seed in range(SEEDS)]
        gains = [one.verdict == "better" for item in found for one in item.held_out.of(item.objective.measure)]
        yield rate(f"{objective}, {RUNS} runs: tuned values called better than the true ones", gains, 0.0, 0.05)


def _tuned(objective: str, seed: int) -> Tuning:
    """Seeds are two apart, since the noise that is tuned on has the next one."""
    scenario = tb.load(SCENARIO, runs=RUNS, seed=2 * seed)
    plan = TunePlan(objective_of(objective, [scenario]), ("acceleration_sigma_mps2=0.3:20",), TRIALS)
    (found,) = tune_trackers([scenario], ["kf"], plan, Executor(), Listener())
    return found
