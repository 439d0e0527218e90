"""Speed of the trackers of several objects beside Stone Soup's, on the same scans.

20 vehicles, a radar and a lidar of 20 Hz, 10 false alarms a scan, EKF with constant velocity. Nothing is timed before
the estimates agree. CPU time of one thread; ``times_real_time`` is the simulated time of all runs over it.
"""

from __future__ import annotations

import os

# Before NumPy is imported: its linear algebra would take every core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.peers import ACCELERATION_SIGMA
from tests.traffic_peers import stonesoup_tracks
from tests.traffic_scans import Traffic, traffic, vehicles

from trackbench.multi import MultiObjectTracker, build_multi
from trackbench.trackers.config import FilterConfig
from trackbench.types import scan_of_run

VEHICLES, RATE, CLUTTER, DETECTION = 20, 20.0, 10.0, 0.95
BATCH, STEPS, PEER_STEPS, REPETITIONS = 100, 200, 5, 3
#: Times real time that is asked, by method and number of runs.
REQUIRED = {("gnn", 1): 100.0, ("gnn", BATCH): 200.0, ("jpda", BATCH): 60.0, ("pmb", BATCH): 60.0}
#: Largest difference of any component of an estimate that counts as agreement, m and m/s.
AGREEMENT = 1e-6


def measure() -> list[dict[str, Any]]:
    """One row for each tracker and number of runs: milliseconds of a scan of one run, and times real time."""
    rows = []
    for method in ("gnn", "jpda"):
        apart, seconds, count = beside_stonesoup(method)
        if apart > AGREEMENT:
            raise SystemExit(f"{method}: the estimates differ by up to {apart:.2g}; nothing is compared")
        rows.append({**row("Stone Soup", method, 1, count, seconds), "largest_difference": apart})
    many = scans(STEPS // 4, BATCH)
    one = scans(STEPS, 1)
    for method in ("gnn", "jpda", "jipda", "pmb", "oracle", "naive"):
        for runs, seen in ((1, one), (BATCH, many)):
            seconds = min(cpu_seconds(lambda m=method, s=seen: follow(tracker(m), s)) for _ in range(REPETITIONS))
            rows.append(row("trackbench", method, runs, len(seen.scans), seconds))
    return rows


def row(engine: str, method: str, runs: int, count: int, seconds: float) -> dict[str, Any]:
    """``count`` scans, half of them of each sensor."""
    simulated = count / 2 / RATE * runs
    return {
        "engine": engine,
        "method": method,
        "runs": runs,
        "ms_per_scan": 1e3 * seconds / count / runs,
        "times_real_time": simulated / seconds,
        "required": REQUIRED.get((method, runs)) if engine == "trackbench" else None,
    }


def scans(steps: int, runs: int) -> Traffic:
    """The problem."""
    return traffic(vehicles(VEHICLES), steps, runs, detection=DETECTION, clutter=CLUTTER, dt=1 / RATE)


def tracker(method: str, **keys: object) -> MultiObjectTracker:
    """With the options of this problem."""
    associate = {"method": method, **keys}
    given = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA, "associate": associate}
    return build_multi(FilterConfig.model_validate(given))


def follow(of: MultiObjectTracker, seen: Traffic) -> None:
    """All scans, one after the other."""
    state = None
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        state, _ = of.step(state, scan, *((origins,) if of.wants_origins else ()))


def beside_stonesoup(method: str) -> tuple[float, float, int]:
    """Largest difference of estimates of the same association, Stone Soup's CPU seconds, and how many scans.

    Both follow tracks that start from one scan of all vehicles; Stone Soup starts and ends none.
    """
    gate = 0.9999
    first = traffic(vehicles(VEHICLES), 1, detection=1.0, clutter=0.0, sensors=("lidar",)).scans[0]
    seen = scans(PEER_STEPS, 1)
    later = [scan_of_run(scan, 0)._replace(time=scan.time + 1 / RATE) for scan in seen.scans]
    keys = {"confirm": [1, 1], "delete_after_s": 9.0, "gate": gate}
    given = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA}
    initial = {"from": "first_reading", "sensors": ["start"], "velocity_sigma_mps": 4.0}
    config = {**given, "initial": initial, "associate": {"method": method, **keys}}
    of = build_multi(FilterConfig.model_validate(config))
    state, begun = of.step(None, scan_of_run(first._replace(sensor="start"), 0))
    own = []
    for scan in later:
        state, tracks = of.step(state, scan)
        own.append(tracks)
    peers: list[Any] = []
    name = {"jpda": "jpda by belief propagation"}.get(method, method)
    peer = stonesoup_tracks(begun.mean, begun.covariance, first.time, later, name, gate)
    seconds = cpu_seconds(lambda: peers.extend(peer))
    same, apart = np.ones(VEHICLES, dtype=bool), 0.0
    for tracks, (mean, _, used) in zip(own, peers, strict=True):
        # An association that differs once makes all later estimates differ.
        same &= tracks.used == used
        apart = max(apart, float(np.abs(tracks.mean - mean)[:, same].max(initial=0.0)))
    if same.mean() < 0.8:
        raise SystemExit(f"{method}: only {same.sum()} of {VEHICLES} tracks hold the same associations")
    return apart, seconds, len(later)


def cpu_seconds(call: Callable[[], Any]) -> float:
    """Of one call."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


if __name__ == "__main__":
    for found in measure():
        print(found)
