"""Compare the drivers with recorded traffic, and find the sizes that would meet it (results/drivers/); see how trackers
do with them, and what they cost.

python -m benchmarks.drivers fit|reversal|cost
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np

from trackbench.base.types import no_progress
from trackbench.document.drawing import svg_file
from trackbench.scenario import load_scenario
from trackbench.truth import simulated as cache
from trackbench.truth.drivers import HUMAN, STEERING_RATE_DEGPS
from trackbench.truth.sources import HighwayTruth

from . import cost, page, recorded, reversal, statistics
from .fit import (
    FEWER_SEEDS,
    OTHER_FULL_MPS,
    OTHER_TIMES,
    SEEDS,
    SPEEDS_MPS,
    Lanes,
    full_size_trial,
    range_of,
    simulated,
    sizes,
    trials,
    with_full_size_at,
)
from .simulated import congested

ROOT = Path(__file__).parents[2]
OUT = ROOT / "results" / "drivers"
FIGURE = ROOT / "docs" / "images" / "drivers.svg"


def speeds_of(windows: list[recorded.Window]) -> list[float]:
    """Five leaders' speeds, m/s."""
    return [float(v) for v in np.percentile([window.speed.mean() for window in windows], [10, 30, 50, 70, 90])]


def fitted() -> None:
    """Write how ``human`` is beside the recordings, the sizes that would meet them, the tables and the figure."""
    half, held_back, us101 = recorded.i80(0), recorded.i80(1), recorded.us101()
    leaders = speeds_of(half)
    lanes = simulated(1.0, leaders, SEEDS)
    alike = {"I-80, fitted": half, "I-80, held back": held_back, "I-80, all": half + held_back}
    found = {name: sizes(windows, lanes, len(leaders)) for name, windows in alike.items()}
    tried = {1.0: trials(1.0, half, lanes)}
    print(json.dumps(page.rounded({"sizes": found, "trials": tried[1.0]})), flush=True)
    full = {HUMAN.acceleration_full_mps: full_size_trial(HUMAN, half, lanes)}
    for drivers in map(with_full_size_at, OTHER_FULL_MPS):
        tried_lanes = simulated(1.0, leaders, FEWER_SEEDS, drivers)
        full[drivers.acceleration_full_mps] = full_size_trial(drivers, half, tried_lanes)
    print(json.dumps(page.rounded({"full": list(full.values())})), flush=True)
    tried |= {slower: trials(slower, half, simulated(slower, leaders, FEWER_SEEDS)) for slower in OTHER_TIMES}
    # The first of the lanes are those of ``human`` as it is.
    simulations = {
        "human": lanes[0],
        "steady": congested(None, leaders, [1]),
        "human, US-101": congested(HUMAN, speeds_of(us101), range(1, FEWER_SEEDS + 1)),
    }
    human, steady, human_us101 = ([window for lane in of for window in lane] for of in simulations.values())
    columns = {
        "I-80, fitted": half,
        "I-80, held back": held_back,
        "human": human,
        "steady": steady,
        "US-101": us101,
        "human, US-101": human_us101,
        "human, highway": highway("human"),
        "steady, highway": highway("steady"),
    }
    table: dict[str, Any] = {
        "drivers": asdict(HUMAN) | {"steering_rate_degps": STEERING_RATE_DEGPS},
        "sizes": found,
        "trials": [list(each) for each in zip(*(tried[slower] for slower in sorted(tried)), strict=True)],
        "full_size": [list(full[speed]) for speed in sorted(full)],
        "statistics": {name: statistics.of(windows) for name, windows in columns.items()},
        "rms_of_seeds": rms_of_seeds(lanes[0], len(leaders)),
        "by_speed": {name: by_speed(of) for name, of in (("I-80", half + held_back), ("human", human))},
        "overlaps": recorded.overlaps(),
        "gaps_s": np.percentile(recorded.us101_gaps(), [10, 50, 90]).tolist(),
    }
    write("fit", table)
    shown = {name: columns[name] for name in ("I-80, held back", "human", "steady")}
    FIGURE.write_text(svg_file(page.figure(shown)), encoding="utf-8")


def rms_of_seeds(lanes: Lanes, leaders: int) -> list[float]:
    """RMS of the acceleration of all leaders of one seed, m/s^2, for each seed."""
    seeds = [lanes[first : first + leaders] for first in range(0, len(lanes), leaders)]
    return [statistics.of([window for lane in of for window in lane])["rms"] for of in seeds]


def by_speed(windows: list[recorded.Window]) -> list[dict[str, float]]:
    """How many windows are in each range of ``SPEEDS_MPS``, and the statistics of these."""
    ranges = [[window for window in windows if range_of(window) == i] for i in range(len(SPEEDS_MPS) - 1)]
    return [{"windows": len(of), **statistics.of(of)} for of in ranges]


def highway(drivers: str) -> list[recorded.Window]:
    """The targets of three scenes of the shipped motorway, 10 s each."""
    windows = []
    for seed in range(1, 4):
        config = load_scenario("highway").config.truth
        truth = cache.load_simulated(
            HighwayTruth.model_validate({**config.model_dump(), "seed": seed, "drivers": drivers, "targets": "all"}),
            cache=True,
            progress=no_progress,
        ).truth
        every = round(recorded.DT / float(truth.time[1]))
        for first in (0, recorded.SAMPLES * every):
            part = slice(first, first + recorded.SAMPLES * every, every)
            for body in np.flatnonzero(truth.alive[part].all(axis=0)):
                speed, side = truth.speed[part, body, 0], truth.py[part, body, 0]
                if len(speed) == recorded.SAMPLES:
                    windows.append(recorded.Window(speed, side if np.ptp(side) < recorded.SAME_LANE_M else None))
    return windows


def write(name: str, values: dict[str, Any]) -> None:
    """Keep the numbers, and the page of all that are kept."""
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / f"{name}.json").write_text(json.dumps(page.rounded(values), indent=1) + "\n", encoding="utf-8")
    kept = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(OUT.glob("*.json"))}
    (OUT / "drivers.md").write_text(page.page(kept), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drivers", description=__doc__)
    parser.add_argument("what", choices=("fit", "reversal", "cost"))
    what = parser.parse_args().what
    if what == "fit":
        fitted()
    elif what == "reversal":
        write("reversal", reversal.measured())
    else:
        for name, steady, human in cost.measured():
            print(
                f"{name:14} {steady:.0f} and {human:.0f} us per vehicle and step: {human / steady - 1:+.0%}", flush=True
            )
