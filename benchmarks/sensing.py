"""What the effects of sensors cost: processor time of sensing with typical effects, beside that of ideal sensors.

``python -m benchmarks.sensing`` prints the table alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.table_cells import digits

from trackbench.runner.loop import keep_freed_memory
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import IdealSensor, ideal_sensors, sense_known

SCENARIO, RUNS, REPETITIONS = "highway", 100, 9
IDENTITIES: dict[str, Callable[[Sequence[IdealSensor], int, str, range], Any]] = {
    "known": sense_known,
    "hidden": sense_hidden,
}


def measure() -> list[dict[str, Any]]:
    """By identities, milliseconds per run with ideal sensors and with typical ones, which take turns."""
    keep_freed_memory()
    truth = truth_of(load_scenario(SCENARIO)).truth
    sensors = {}
    for effects in ("ideal", "typical"):
        of = load_scenario(SCENARIO, [f"sensors.{name}.effects={effects}" for name in ("front_radar", "roof_lidar")])
        sensors[effects] = ideal_sensors(truth, of.config.sensors)
    return [{"identities": name, **_milliseconds(call, sensors)} for name, call in IDENTITIES.items()]


def _milliseconds(call: Callable[..., Any], sensors: dict[str, list[IdealSensor]]) -> dict[str, float]:
    least = dict.fromkeys(sensors, float("inf"))
    for _ in range(REPETITIONS):
        for effects, of in sensors.items():
            begin = time.process_time()
            call(of, 7, SCENARIO, range(RUNS))
            least[effects] = min(least[effects], 1e3 * (time.process_time() - begin) / RUNS)
    return least


def section(found: list[dict[str, Any]]) -> str:
    """The figures as Markdown."""
    rows = [
        f"| {row['identities']} | {digits(row['ideal'])} | {digits(row['typical'])} | "
        f"{digits(row['typical'] / row['ideal'])} |"
        for row in found
    ]
    return "\n".join(
        [
            "## Sensing",
            "",
            f"Processor time of the measurements of a run of `{SCENARIO}` (20 s, 5 vehicles, radar and lidar), in "
            f"milliseconds: with ideal sensors and with typical effects, in the same process, {RUNS} runs at once, "
            f"best of {REPETITIONS} repetitions. Typical effects draw 2.5 times as many random numbers.",
            "",
            "| identities | ideal | typical | ratio |",
            "|---|---:|---:|---:|",
            *rows,
            "",
        ]
    )


if __name__ == "__main__":
    print(section(measure()))
