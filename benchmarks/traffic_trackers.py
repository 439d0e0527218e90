"""Speed of the trackers of several objects by both engines, beside Stone Soup's, on the same scans.

20 vehicles, a radar and a lidar of 20 Hz, 10 false alarms a scan, EKF with constant velocity. Nothing is timed before
the estimates agree; the engines take turns. CPU time of one thread; ``times_real_time`` is the simulated time of all
runs over it.
"""

from __future__ import annotations

import os

# Before NumPy is imported: its linear algebra would take every core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from tests.support.peers import ACCELERATION_SIGMA
from tests.support.traffic_peers import stonesoup_tracks
from tests.support.traffic_scans import Traffic, traffic, vehicles

from trackbench.base.types import Tracks, scan_of_run
from trackbench.engine.choice import Engine
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

VEHICLES, RATE, CLUTTER, DETECTION = 20, 20.0, 10.0, 0.95
BATCH, STEPS, PEER_STEPS, REPETITIONS = 100, 200, 5, 3
METHODS = ("gnn", "jpda", "jipda", "pmb", "oracle", "naive")
ENGINES: tuple[Engine, ...] = ("fused", "numpy")
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
    for method in METHODS:
        for runs, seen in ((1, one), (BATCH, many)):
            apart = engines_apart(method, seen)
            seconds = best_seconds(method, seen)
            for engine in ENGINES:
                found = row(engine, method, runs, len(seen.scans), seconds[engine])
                rows.append({**found, "largest_difference": apart})
    return rows


def best_seconds(method: str, seen: Traffic) -> dict[Engine, float]:
    """CPU seconds of all scans by each engine."""
    best = dict.fromkeys(ENGINES, float("inf"))
    for _ in range(REPETITIONS):
        for engine in ENGINES:
            best[engine] = min(best[engine], cpu_seconds(partial(deque, tracks(method, engine, seen), maxlen=0)))
    return best


def row(engine: str, method: str, runs: int, count: int, seconds: float) -> dict[str, Any]:
    """``count`` scans, half of them of each sensor."""
    simulated = count / 2 / RATE * runs
    return {
        "engine": engine,
        "method": method,
        "runs": runs,
        "ms_per_scan": 1e3 * seconds / count / runs,
        "times_real_time": simulated / seconds,
    }


def scans(steps: int, runs: int) -> Traffic:
    """The problem."""
    return traffic(vehicles(VEHICLES), steps, runs, detection=DETECTION, clutter=CLUTTER, dt=1 / RATE)


def tracks(method: str, engine: Engine, seen: Traffic) -> Iterator[Tracks]:
    """By a tracker with the options of this problem, after each scan."""
    associate = {"method": method}
    given = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA, "associate": associate}
    # As in a run whose sensors have no latency: no past state is kept.
    tracker = replace(build_multi(FilterConfig.model_validate(given)).tracker, engine=engine)
    state = None
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        state, found = tracker.step(
            state, scan, *((np.stack([origins, np.full_like(origins, -1)]),) if tracker.wants_origins else ())
        )
        yield found


def engines_apart(method: str, seen: Traffic) -> float:
    """Largest difference of any component of the engines' tracks, m and m/s.

    Raises:
        SystemExit: they have other tracks, or differ too much.
    """
    apart = 0.0
    for found, expected in zip(*(tracks(method, engine, seen) for engine in ENGINES), strict=True):
        if not np.array_equal(found.ids, expected.ids):
            raise SystemExit(f"{method}: the engines have other tracks; nothing is compared")
        # NaN where a run has fewer tracks than another.
        apart = max(apart, float(np.nan_to_num(np.abs(found.mean - expected.mean)).max(initial=0.0)))
    if apart > AGREEMENT:
        raise SystemExit(f"{method}: the engines differ by up to {apart:.2g}; nothing is compared")
    return apart


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
    initial = {"from": "first_measurement", "sensors": ["start"], "velocity_sigma_mps": 4.0}
    config = {**given, "initial": initial, "associate": {"method": method, **keys}}
    of = build_multi(FilterConfig.model_validate(config)).tracker
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
