"""What perception costs a driver: one driver by rules on the truth, on tracks and on detections; results/gym.

Run as ``python -m benchmarks.gym``. Every arm drives the same episodes: traffic and noise are drawn by the seed.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import trackbench.gym
from trackbench.metrics.contrasts import Contrast, paired
from trackbench.metrics.intervals import Interval

OUT = Path(__file__).parents[1] / "results" / "gym"
EPISODES = 30
RADAR = {"type": "radar", "rate_hz": 10, "range_sigma_m": 0.5, "azimuth_sigma_deg": 1.5, "range_rate_sigma_mps": 0.2,
         "fov_deg": 120, "detection_probability": 0.7, "occlusion": True, "clutter": {"per_scan": 20}}  # fmt: skip
SENSORS = {
    "front_radar": {**RADAR, "mount": {"x_m": 2.5}, "max_range_m": 150},
    "rear_radar": {**RADAR, "mount": {"x_m": -2.5, "yaw_deg": 180}, "max_range_m": 100},
    "roof_lidar": {"type": "lidar", "rate_hz": 5, "position_sigma_m": 0.3, "max_range_m": 60,
                   "detection_probability": 0.7, "occlusion": True, "clutter": {"per_scan": 2}},
}  # fmt: skip
CONFIG = {
    "action": {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15, 20, 25, 30]},
    "lanes_count": 4,
    "vehicles_count": 15,
    "vehicles_density": 1.5,
    "duration": 15,
    "policy_frequency": 2,
    "simulation_frequency": 10,
}
CONFIRM = {"confirm": [3, 5]}
EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}
#: By name, what the driver sees; the first is the reference.
ARMS: dict[str, Any] = {
    "truth": "truth",
    "gnn": {**EKF, "associate": {"method": "gnn", **CONFIRM}},
    "jipda": {**EKF, "associate": {"method": "jipda", **CONFIRM}},
    "gnn, sluggish": {**EKF, "acceleration_sigma_mps2": 0.2, "associate": {"method": "gnn", **CONFIRM}},
    "detections": "detections",
}
#: Of an episode, how each is read from what the environment says of it.
MEASURES: dict[str, Callable[[Any], float]] = {
    "crashed": lambda drive: float(drive["crashed"]),
    "reward": lambda drive: drive["reward"],
    "smallest time gap": lambda drive: min(drive["min_time_gap_s"], LARGEST_GAP),
    "speed": lambda drive: drive["mean_speed_mps"],
}
#: In place of a larger smallest time gap, or of none, s.
LARGEST_GAP = 3.0


def environment(arm: str) -> Any:
    """In which the driver sees what an arm says."""
    return gymnasium.make(
        trackbench.gym.ID, env="highway-fast-v0", config=CONFIG, sensors=SENSORS, tracker=ARMS[arm], rows=40
    )


def drive(env: Any, seed: int) -> dict[str, float]:
    """The measures of one episode."""
    driver = trackbench.gym.IdmMobil(env)
    observation, info = env.reset(seed=seed)
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(driver.act(observation))
        ended = terminated or truncated
    return {name: read(info["drive"]) for name, read in MEASURES.items()}


def mean(values: np.ndarray[Any, Any]) -> Interval:
    """Over episodes, which are independent."""
    value = float(values.mean())
    return Interval(value, values - value, scenes=True)


def shown(difference: Contrast, places: int) -> str:
    """With its 95 % interval."""
    if difference.ci95 is None:
        return f"{difference.value:+.{places}f}"
    low, high = difference.ci95
    text = f"{difference.value:+.{places}f} ({low:+.{places}f} to {high:+.{places}f})"
    return f"**{text}**" if low > 0 or high < 0 else text


def compared(own: np.ndarray[Any, Any], reference: np.ndarray[Any, Any]) -> str:
    """In how many episodes only one of the two crashed, and how likely a split as uneven is if neither does it more.

    Source: McNemar (1947), "Note on the sampling error of the difference between correlated proportions"; exact.
    """
    more, fewer = int((own > reference).sum()), int((own < reference).sum())
    tail = sum(math.comb(more + fewer, k) for k in range(min(more, fewer) + 1)) / 2 ** (more + fewer)
    text = f"{more} more, {fewer} fewer (p = {min(1.0, 2 * tail):.2g})"
    return f"**{text}**" if 2 * tail < 0.05 else text


def page(episodes: dict[str, list[dict[str, float]]]) -> str:
    """The two tables."""
    count = len(episodes["truth"])
    columns = {arm: {name: np.array([item[name] for item in of]) for name in MEASURES} for arm, of in episodes.items()}
    text = INTRODUCTION.format(count=count, largest=LARGEST_GAP)
    text += f"| seen | crashed, of {count} |{HEADER}"
    for arm, of in columns.items():
        cells = [f"{of[name].mean():.{places}f}" for name, places in PLACES.items()]
        text += f"| {arm} | {int(of['crashed'].sum())} | {' | '.join(cells)} |\n"
    text += f"{DIFFERENCES}| seen | crashed |{HEADER}"
    reference = columns.pop("truth")
    for arm, of in columns.items():
        cells = [compared(of["crashed"], reference["crashed"])]
        cells += [shown(paired(mean(of[name]), mean(reference[name])), places) for name, places in PLACES.items()]
        text += f"| {arm} | {' | '.join(cells)} |\n"
    return text


#: Digits after the point of the means.
PLACES = {"reward": 2, "smallest time gap": 2, "speed": 2}
HEADER = " reward | smallest time gap, s | speed, m/s |\n| :-- | --: | --: | --: | --: |\n"
INTRODUCTION = """\
# What perception costs a driver

Made by `make gym`. One driver by rules (IDM and MOBIL, [`IdmMobil`](../../docs/gym.md#a-driver-by-rules)) drives
{count} episodes of 15 s on `highway-fast-v0` among 15 other cars, on each kind of what it sees: the truth; the tracks
of an EKF (constant velocity, acceleration of 3 m/s^2; `sluggish`: 0.2) with some methods of association; and the
detections of the latest scans as they are. Episodes are paired: traffic and noise are those of the seed. Two radars
look ahead and back, each with 20 false alarms in a scan, and a lidar around, with 2; each detects a car with
probability 0.7. The reward is highway-env's, of 30 decisions at most 1 each. The smallest time gap is that to the car
ahead on the own lane, over the episode, at most {largest:g} s.

"""
DIFFERENCES = """
## Against the truth

The mean over episodes of the difference to the same episode driven on the truth, with its 95 % interval by a paired t
test; of crashes, in how many episodes one of the two alone crashed, and the p-value of McNemar's exact test. In bold:
shown to differ, each for itself; of these 16 comparisons one is in bold by chance.

"""


def main() -> None:
    environments, episodes = {arm: environment(arm) for arm in ARMS}, {arm: [] for arm in ARMS}
    OUT.mkdir(parents=True, exist_ok=True)
    for seed in range(1, EPISODES + 1):
        for arm, env in environments.items():
            episodes[arm].append(drive(env, seed))
        print(f"{seed} of {EPISODES}: {time.process_time():.0f} s", file=sys.stderr, flush=True)
        (OUT / "episodes.json").write_text(json.dumps(episodes, indent=1) + "\n", encoding="utf-8")
    (OUT / "README.md").write_text(page(episodes), encoding="utf-8")


if __name__ == "__main__":
    main()
