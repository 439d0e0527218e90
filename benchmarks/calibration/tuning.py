"""Tuning on truth of the filter's own model"""

from __future__ import annotations

from collections.abc import Iterator

import trackbench as tb
from trackbench.api.plan import Listener
from trackbench.base.execution import Executor
from trackbench.subjects.tuning.api import TunePlan, tune_trackers
from trackbench.subjects.tuning.objectives import OBJECTIVES
from trackbench.subjects.tuning.tune import Tuning

from .claim import Claim, rate

SEEDS, RUNS, TRIALS = 200, 40, 34
TRUE, WRONG = 2.0, 3.3
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
    """The interval of the optimum has the true sigma; a start that is right is not called worse than what is found."""
    for objective in ("likelihood", "position_rmse"):
        ends = [_tuned(objective, seed, WRONG).responses[0].optimum95 for seed in range(SEEDS)]
        covers = [(low is None or low <= TRUE) and (high is None or high >= TRUE) for low, high in ends]
        yield rate(f"{objective}, {RUNS} runs: the 95 % interval of the optimum has the true sigma", covers, 0.92, 0.98)
        found = [_tuned(objective, seed, TRUE) for seed in range(SEEDS)]
        gains = [one.verdict == "better" for item in found for one in item.held_out.of(item.objective.measure)]
        yield rate(f"{objective}, {RUNS} runs: tuned values called better than the true ones", gains, 0.0, 0.05)


def _tuned(objective: str, seed: int, start: float) -> Tuning:
    """Seeds are two apart, since the noise that is tuned on has the next one."""
    scenario = tb.load(SCENARIO, {"trackers.kf.acceleration_sigma_mps2": start}, runs=RUNS, seed=2 * seed)
    plan = TunePlan(OBJECTIVES[objective], ("acceleration_sigma_mps2=0.3:20",), TRIALS)
    (found,) = tune_trackers([scenario], ["kf"], plan, Executor(), Listener())
    return found
