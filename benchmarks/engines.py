"""Both engines of trackbench and other packages, each from the same beliefs through the same measurements."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.scene import DT, SENSORS, weaving
from tests.support import peers

from trackbench.base.types import Array, Gaussian, Scan, Truth
from trackbench.engine.choice import Engine
from trackbench.models.motion import Kinematics
from trackbench.runner.loop import keep_freed_memory
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker

NOISE = {"acceleration_sigma_mps2": peers.ACCELERATION_SIGMA}
YAW_NOISE = {"yaw_acceleration_sigma_radps2": peers.YAW_ACCELERATION_SIGMA}
START = {"from": "truth", "position_sigma_m": 0.3, "velocity_sigma_mps": 0.5}
TURNING_START = {**START, "yaw_rate_sigma_radps": 0.1}
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
    return Problem(truth, sense_known(ideal_sensors(truth, SENSORS), 1, "benchmark", range(runs)).scans, runs)


def prepared(of: Problem, name: str, engine: Engine) -> FilterTracker:
    """A tracker that starts every run from its own draw around the truth."""
    truth, runs = of.truth, of.runs
    tracker = replace(build(FilterConfig.model_validate(TRACKERS[name])).tracker, engine=engine)
    fields = (truth.px, truth.py, truth.speed, truth.course, truth.acceleration, truth.yaw_rate)
    motion = Kinematics(*(np.full(runs, values[0, 0, 0]) for values in fields))
    return tracker.with_prior(np.zeros(runs), motion, np.random.default_rng(2).standard_normal((6, runs)))


def estimates(of: Problem, name: str) -> Array:
    """``(runs, steps, n)`` the states by NumPy."""
    tracker, state, states = prepared(of, name, "numpy"), None, []
    for scan in of.scans:
        state, estimate = tracker.step(state, scan)
        states.append(estimate.state.T)
    return np.stack(states, axis=1)


def estimates_apart(of: Problem, name: str) -> float:
    """Largest difference of the engines' estimates: of a component in its standard deviations, of a covariance in those
    of both.

    Raises:
        SystemExit: the fused engine did not compute the tracker.
    """
    reference, fused = prepared(of, name, "numpy"), prepared(of, name, "fused")
    apart, one, other = 0.0, None, None
    for scan in of.scans:
        (one, expected), (other, found) = reference.step(one, scan), fused.step(other, scan)
        sigma = np.sqrt(np.einsum("ii...->i...", expected.covariance))
        means = (found.mean - expected.mean) / sigma
        covariances = (found.covariance - expected.covariance) / (sigma * sigma[:, None])
        apart = max(apart, float(np.abs(means).max()), float(np.abs(covariances).max()))
    if fused.engine_used.engine == "numpy":
        raise SystemExit(f"{name}: the fused engine left it to NumPy: {fused.engine_used.why_numpy}")
    return apart


def filtering(of: Problem, name: str, engine: Engine) -> float:
    """Seconds that trackbench takes for all runs."""
    tracker, state = prepared(of, name, engine), None
    begin = time.perf_counter()
    for scan in of.scans:
        state, _ = tracker.step(state, scan)
    return time.perf_counter() - begin


@dataclass(frozen=True)
class PeerTask:
    """What a peer is given: the beliefs of some runs and the measurements of each, taken apart beforehand."""

    means: list[Array]
    covariance: Array
    scans: list[list[Scan]]


def task(of: Problem, name: str, runs: int) -> PeerTask:
    """The first runs of the problem for a peer."""
    belief = first_belief(of, name)
    batch = [
        [scan._replace(measurement=scan.measurement[:, run].copy(), valid=scan.valid[run]) for scan in of.scans]
        for run in range(runs)
    ]
    return PeerTask([belief.mean[:, run] for run in range(runs)], belief.covariance, batch)


def first_belief(of: Problem, name: str) -> Gaussian:
    """From which trackbench starts: a mean of every run, and the covariance of all."""
    prior = prepared(of, name, "numpy").prior
    assert prior is not None
    return Gaussian(prior.belief.mean, prior.belief.covariance[..., 0])


def peer_estimates(peer: peers.Peer, given: PeerTask) -> Array:
    """``(runs, steps, n)``"""
    return np.stack(
        [peer(mean, given.covariance, scans, DT) for mean, scans in zip(given.means, given.scans, strict=True)]
    )


def seconds_of_peer(peer: peers.Peer, given: PeerTask) -> float:
    """Seconds that a peer takes."""
    begin = time.perf_counter()
    peer_estimates(peer, given)
    return time.perf_counter() - begin
