"""Truths, scans and trackers made by hand, for the tests."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackbench.base.types import Array, Observer, Scan, Truth
from trackbench.metrics import BUILT_IN, BlockScores, evaluate
from trackbench.metrics.estimates import ESTIMATES
from trackbench.models.sensors import Lidar, Radar
from trackbench.results import MetricValue
from trackbench.runner.block import Block
from trackbench.runner.loop import run_block
from trackbench.runner.work import BlockRuns, ReferenceMotion, Scene, Work
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker

#: The metrics that are made of the sums they share.
SHARED = [metric for metric in BUILT_IN if metric.accumulator is ESTIMATES]
#: The driving noise of each motion model, as a scenario states it.
NOISE = {
    "cv": {"acceleration_sigma_mps2": 2.0},
    "ca": {"jerk_sigma_mps3": 3.0},
    "ctrv": {"acceleration_sigma_mps2": 2.0, "yaw_acceleration_sigma_radps2": 0.4},
    "ctra": {"jerk_sigma_mps3": 3.0, "yaw_acceleration_sigma_radps2": 0.4},
    "singer": {"acceleration_sigma_mps2": 2.0, "time_constant_s": 3.0},
    "ct": {"acceleration_sigma_mps2": 2.0, "yaw_acceleration_sigma_radps2": 0.4},
    "cv_continuous": {"acceleration_density_mps1p5": 1.5},
}
#: Those that every filter is tried with; the others each with one or two.
MOTIONS = ("cv", "ca", "ctrv", "ctra")

#: Every filter with every motion model it takes, and the variants of the unscented filter.
TRACKERS: dict[str, dict[str, object]] = {
    f"{name}-{motion}": {"filter": name.split("_")[0], "motion": motion, **options, **NOISE[motion]}
    for name, options in {
        "kf": {},
        "ekf": {},
        "ukf": {},
        "ukf_additive": {"augmented": False},
        "ukf_classic": {"sigma_points": "classic", "kappa": 0.5},
        "ckf": {},
    }.items()
    for motion in MOTIONS
    if name != "kf" or motion in ("cv", "ca")
}

RADAR_NOISE = np.diag(np.square([0.3, 0.02, 0.2]))
LIDAR_NOISE = np.diag(np.square([0.15, 0.15]))


def tracker(**keys: object) -> FilterTracker:
    """A built-in tracker from the keys of a scenario."""
    return build(FilterConfig.model_validate(keys)).tracker


def scan(
    kind: str,
    time: float,
    measurement: Array,
    valid: Array | bool = True,
    noise: Array | None = None,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: tuple[float, float] = (0.0, 0.0),
) -> Scan:
    """A scan whose ``measurement`` ``(m, ...)`` is made NaN where it is not valid."""
    measurement = np.asarray(measurement, dtype=float)
    valid = np.broadcast_to(np.asarray(valid), measurement.shape[1:]).copy()
    default = RADAR_NOISE if kind == "radar" else LIDAR_NOISE
    return Scan(
        time=time,
        sensor=kind,
        kind=kind,
        measurement=np.where(valid, measurement, np.nan),
        valid=valid,
        noise_covariance=default if noise is None else noise,
        sensor_pose=np.array(pose),
        sensor_velocity=np.array(velocity),
        arrival_time=time,
    )


def member(of: Scan, index: int) -> Scan:
    """The scan of one member, without a batch axis."""
    return of._replace(measurement=of.measurement[:, index].copy(), valid=of.valid[index])


def fixed_observer(steps: int, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Observer:
    """An observer at rest."""
    zero = np.zeros(steps)
    return Observer(zero + x, zero + y, zero + yaw, zero, zero, zero)


def truth(
    time: Array,
    px: Array,
    py: Array,
    vx: Array,
    vy: Array,
    *,
    observer: Observer | None = None,
    alive: Array | None = None,
    acceleration: Array | float = 0.0,
    yaw_rate: Array | float = 0.0,
) -> Truth:
    """A truth from kinematics that broadcast to ``(steps, objects, runs)``."""
    px, py, vx, vy, acceleration, yaw_rate = np.broadcast_arrays(px, py, vx, vy, acceleration, yaw_rate)
    steps, objects = px.shape[:2]
    course = np.arctan2(vy, vx)
    return Truth(
        time=time,
        ids=tuple(f"v{i + 1}" for i in range(objects)),
        px=px,
        py=py,
        heading=course,
        course=course,
        speed=np.hypot(vx, vy),
        acceleration=acceleration,
        yaw_rate=yaw_rate,
        alive=np.ones((steps, objects), dtype=bool) if alive is None else alive,
        length=np.full(objects, 4.5),
        width=np.full(objects, 1.8),
        observer=fixed_observer(steps) if observer is None else observer,
    )


def random_walk(runs: int, steps: int, dt: float, acceleration_sigma: float, seed: int, start: Array) -> Truth:
    """A truth that the constant velocity model draws, another in each run, from the state ``start`` ``(4,)``."""
    noise = np.random.default_rng(seed).normal(0.0, acceleration_sigma, (steps, 2, runs))
    position, velocity = np.empty((steps, 2, runs)), np.empty((steps, 2, runs))
    position[0], velocity[0] = start[:2, None], start[2:, None]
    for k in range(1, steps):
        position[k] = position[k - 1] + dt * velocity[k - 1] + dt**2 / 2 * noise[k]
        velocity[k] = velocity[k - 1] + dt * noise[k]
    p, v = position[:, :, None], velocity[:, :, None]
    return truth(np.arange(steps) * dt, p[:, 0], p[:, 1], v[:, 0], v[:, 1])


def work(
    of: Truth,
    sensors: Mapping[str, Radar | Lidar],
    trackers: Mapping[str, FilterConfig | PluginConfig],
    runs: int,
    *,
    seed: int = 1,
    settle: float = 0.0,
    divergence: float = 1e9,
    acceleration: float = 2.0,
    velocity_sigma: float = 20.0,
) -> Work:
    """What ``run_block`` takes."""
    scene = Scene(of, ideal_sensors(of, sensors))
    reference = ReferenceMotion(acceleration, velocity_sigma, as_drawn=False)
    return Work("test", seed, runs, [scene], trackers, None, settle, divergence, 5.0, 0, 0, reference)


def block_of(whole: Work, runs: range) -> Block:
    """Some runs of a single scene."""
    return run_block(whole, BlockRuns(0, runs))


def values(scores: BlockScores) -> dict[str, MetricValue]:
    """The metrics of runs of a single scene, by path."""
    return evaluate({ESTIMATES.name: scores}, np.zeros(len(scores.due), dtype=np.intp), SHARED).values
