"""What it costs that a tracker which is not built in runs in a process of its own."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.types import Scan
from trackbench.driving.isolation import Isolation
from trackbench.driving.remote import start_stepper
from trackbench.trackers.config import PluginConfig

#: Members of a batch, and steps of which the median counts.
BATCHES, STEPS = (1, 400, 2000, 8000), 300


class Constant:
    """A batched tracker that does nothing, so that what is left is the cost of being asked."""

    batched = True

    def step(self, state: None, scan: Scan) -> tuple[None, tuple[np.ndarray, np.ndarray]]:
        """The same estimate for every member."""
        batch = scan.valid.size
        return None, (np.zeros((4, batch)), np.eye(4)[:, :, None] * np.ones(batch))


def measure() -> list[dict[str, Any]]:
    """For each size of batch: ms to start a tracker, and microseconds of a step here and in its own process."""
    rows = []
    for batch in (BATCHES[0], *BATCHES):
        here, own = (_timed(batch, Isolation(in_process=in_process)) for in_process in (True, False))
        rows.append({"batch": batch, "start_ms": own[0], "step_here_us": here[1], "step_us": own[1]})
    # The first of all starts the process that the others are copies of.
    rows[1]["first_start_ms"] = rows[0]["start_ms"]
    return rows[1:]


def _timed(batch: int, isolation: Isolation) -> tuple[float, float]:
    begin = time.perf_counter()
    config = PluginConfig(use="isolation:Constant")
    stepper = start_stepper(config, Path(__file__).parent, batch, lambda given: given, isolation)
    started = time.perf_counter() - begin
    ones = np.ones(batch)
    scan = Scan(0.0, "lidar", "lidar", np.ones((2, batch)), ones > 0, np.eye(2), np.zeros(3), np.zeros(2), 0.0)
    seconds = []
    for number in range(STEPS):
        begin = time.perf_counter()
        stepper.step(scan._replace(time=0.1 * number))
        seconds.append(time.perf_counter() - begin)
    stepper.close()
    return 1e3 * started, 1e6 * float(np.median(seconds))


if __name__ == "__main__":
    for row in measure():
        print(row)
