"""Fit the drivers to recorded traffic and compare them with it (results/drivers/); see how trackers do with them, and
what they cost.

python -m benchmarks.drivers fit|reversal|cost
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np

from trackbench.base.types import no_progress
from trackbench.document.drawing import svg_file
from trackbench.scenario import load_scenario
from trackbench.truth import simulated as cache
from trackbench.truth.sources import HighwayTruth

from . import cost, page, recorded, reversal, statistics
from .fit import fit
from .simulated import congested

ROOT = Path(__file__).parents[2]
OUT = ROOT / "results" / "drivers"
FIGURE = ROOT / "docs" / "images" / "drivers.svg"
#: Simulated with other draws than those of the fit.
OTHER_SEED = 1000


def speeds_of(windows: list[recorded.Window]) -> list[float]:
    """Five leaders' speeds, m/s."""
    return [float(v) for v in np.percentile([window.speed.mean() for window in windows], [10, 30, 50, 70, 90])]


def fitted() -> None:
    """Write the fit, its table and figure."""
    half, held_back, us101 = recorded.i80(0), recorded.i80(1), recorded.us101()
    drivers, trials = fit(statistics.of(half), speeds_of(half))
    columns = {
        "I-80, fitted": half,
        "I-80, held back": held_back,
        "human": congested(drivers, speeds_of(held_back), OTHER_SEED),
        "steady": congested(None, speeds_of(held_back), OTHER_SEED),
        "US-101": us101,
        "human, US-101": congested(drivers, speeds_of(us101), OTHER_SEED),
        "human, highway": highway("human"),
        "steady, highway": highway("steady"),
    }
    table: dict[str, Any] = {
        "drivers": drivers.model_dump(mode="json"),
        "trials": trials,
        "statistics": {name: statistics.of(windows) for name, windows in columns.items()},
        "overlaps": recorded.overlaps(),
        "gaps_s": np.percentile(recorded.us101_gaps(), [10, 50, 90]).tolist(),
    }
    write("fit", table)
    shown = {name: columns[name] for name in ("I-80, held back", "human", "steady")}
    FIGURE.write_text(svg_file(page.figure(shown)), encoding="utf-8")


def highway(drivers: str) -> list[recorded.Window]:
    """The targets of three scenes of the shipped motorway, 10 s each."""
    windows = []
    for seed in range(1, 4):
        config = load_scenario("highway").config.truth
        truth = cache.load(
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
