"""The engines that are compared, each from the same beliefs through the same measurements."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests import peers

from scene import DT, SENSORS, weaving
from trackbench.metrics import Scorer, Target, score_together
from trackbench.metrics.conditions import conditions
from trackbench.models.motion import Kinematics
from trackbench.runner.allocation import keep_freed_memory
from trackbench.sensing.scans import ideal_sensors, sense
from trackbench.stepping.steppers import Direct
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.types import Array, Scan, Truth

NOISE = {"acceleration_sigma_mps2": peers.ACCELERATION_SIGMA}
YAW_NOISE = {"yaw_acceleration_sigma_radps2": peers.YAW_ACCELERATION_SIGMA}
START = {"from": "truth", "position_sigma_m": 0.3, "velocity_sigma_mps": 0.5}
TURNING_START = {**START, "yaw_sigma_rad": 0.1, "yaw_rate_sigma_radps": 0.1}
CTRV = {"motion": "ctrv", **NOISE, **YAW_NOISE, "initial": TURNING_START}
IMM = {"imm": [{"model": "cv", **NOISE}, {"model": "ctrv", **NOISE, **YAW_NOISE}], "stay_s": [5.0, 2.0]}

TRACKERS = {
    "EKF, CV": {"filter": "ekf", "motion": "cv", **NOISE, "initial": START},
    "UKF, CTRV": {"filter": "ukf", "augmented": False, **CTRV},
    "UKF, CTRV, augmented": {"filter": "ukf", **CTRV},
    "EKF, CTRV": {"filter": "ekf", **CTRV},
    "IMM of EKFs, CV and CTRV": {"filter": "ekf", "motion": IMM, "initial": TURNING_START},
}
PEERS: dict[str, dict[str, peers.Peer]] = {
    "EKF, CV": {"FilterPy": peers.filterpy_ekf_cv, "Stone Soup": peers.stonesoup_ekf_cv},
    "UKF, CTRV": {"FilterPy": peers.filterpy_ukf_ctrv, "Stone Soup": peers.stonesoup_ukf_ctrv},
}


@dataclass(frozen=True)
class Problem:
    """The measurements of all runs."""

    truth: Truth
    scans: list[Scan]
    runs: int

    @property
    def steps(self) -> int:
        return len(self.scans)


def problem(runs: int, steps: int) -> Problem:
    """Measurements made by trackbench's own sensing."""
    # As the runner does for every block.
    keep_freed_memory()
    truth = weaving(steps)
    return Problem(truth, sense(ideal_sensors(truth, SENSORS), 1, "benchmark", range(runs)).scans, runs)


def prepared(of: Problem, name: str) -> FilterTracker:
    """A tracker that starts every run from its own draw around the truth."""
    truth, runs = of.truth, of.runs
    tracker = build(FilterConfig.model_validate(TRACKERS[name]))
    fields = (truth.px, truth.py, truth.speed, truth.course, truth.acceleration, truth.yaw_rate)
    motion = Kinematics(*(np.full(runs, values[0, 0, 0]) for values in fields))
    return tracker.with_prior(np.zeros(runs), motion, np.random.default_rng(2).standard_normal((6, runs)))


def estimates(of: Problem, name: str, runs: int) -> Array:
    """``(runs, steps, n)`` trackbench's states of the first runs."""
    stepper = Direct(prepared(of, name))
    return np.stack([stepper.step(scan).state[:, :runs].T for scan in of.scans], axis=1)


def filtering(of: Problem, name: str) -> float:
    """Seconds that trackbench takes for all runs."""
    stepper = Direct(prepared(of, name))
    begin = time.perf_counter()
    for scan in of.scans:
        stepper.step(scan)
    return time.perf_counter() - begin


def filtering_and_scoring(of: Problem, name: str) -> float:
    """The same, with every estimate and innovation scored as a block of the runner does it."""
    truth = of.truth
    target = Target(
        time=truth.time,
        state=np.stack([truth.px, truth.py, truth.vx, truth.vy]),
        alive=truth.alive,
        due=np.ones((of.steps, 1, of.runs), dtype=bool),
        divergence=20.0,
        reference=np.zeros((2, of.steps, 1, 1)),
    )
    counts = {sensor: sum(scan.sensor == sensor for scan in of.scans) for sensor in SENSORS}
    classes = conditions(truth, np.arange(of.steps), ideal_sensors(truth, SENSORS), range(of.runs))
    stepper, scorer = Direct(prepared(of, name)), Scorer(target, classes, counts)
    begin = time.perf_counter()
    for instant, scan in enumerate(of.scans):
        estimate = stepper.step(scan)
        scorer.scan(instant, scan, estimate)
        scorer.estimate(estimate)
        if scorer.full or instant == of.steps - 1:
            score_together([scorer])
    scorer.close()
    return time.perf_counter() - begin


@dataclass(frozen=True)
class PeerTask:
    """What a peer is given: the beliefs of some runs and the measurements of each, taken apart beforehand."""

    means: list[Array]
    covariance: Array
    scans: list[list[Scan]]


def task(of: Problem, name: str, runs: int) -> PeerTask:
    """The first runs of the problem for a peer."""
    prior = prepared(of, name).prior
    assert prior is not None
    batch = [
        [scan._replace(measurement=scan.measurement[:, run].copy(), valid=scan.valid[run]) for scan in of.scans]
        for run in range(runs)
    ]
    return PeerTask([prior.mean[:, run] for run in range(runs)], prior.covariance, batch)


def peer_estimates(peer: peers.Peer, given: PeerTask) -> Array:
    """``(runs, steps, n)``"""
    return np.stack(
        [peer(mean, given.covariance, scans, DT) for mean, scans in zip(given.means, given.scans, strict=True)]
    )


def timed(call: Callable[[], object]) -> float:
    """Seconds that a call takes."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
