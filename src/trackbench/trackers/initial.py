"""How a track of a built-in filter starts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.models.motion import MotionModel, Spread
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.config import InitialConfig
from trackbench.types import Array, Gaussian, Mask, Scan

#: Standard deviation of the yaw where it is drawn from the truth and the scenario does not say, rad.
TRUE_YAW_SIGMA = 0.1


class FirstReading(NamedTuple):
    """The first position of each track that still waits for its second, each ``(..., lanes)``."""

    time: Array
    """NaN where there was none yet."""
    position: Gaussian


class Start(NamedTuple):
    """Tracks that can start now."""

    ready: Mask
    belief: Gaussian
    waiting: FirstReading | None


def spread(config: InitialConfig) -> Spread:
    """What is assumed of the components that position and velocity leave open."""
    known = Spread(config.acceleration_sigma_mps2, config.yaw_rate_sigma_radps)
    return known if config.yaw_sigma_rad is None else known._replace(yaw=config.yaw_sigma_rad)


def start(motion: MotionModel, config: InitialConfig, scan: Scan, waiting: FirstReading | None) -> Start:
    """Start the tracks that a scan allows to start, from its reading alone or with an earlier one."""
    position = _position(scan)
    if config.source == "first_reading":
        velocity = SENSOR_MODELS[scan.kind].radial_velocity(scan)
        velocity = velocity if config.velocity == "radial" else np.zeros_like(velocity)
        belief = motion.from_cartesian(_from_one(position, velocity, config.velocity_sigma_mps), spread(config))
        return Start(scan.valid, _stated(belief, config), None)
    if waiting is None:
        return Start(np.zeros_like(scan.valid), _nothing(motion, scan), _first(scan, position))
    elapsed = scan.time - waiting.time
    ready = scan.valid & (elapsed > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        belief = _from_two(waiting.position, position, np.where(ready, elapsed, 1.0))
        begun = motion.from_cartesian(belief, spread(config))
    return Start(ready, _stated(begun, config), _fill(waiting, _first(scan, position)))


def prior_sigma(motion: MotionModel, config: InitialConfig) -> Array:
    """``(n,)`` standard deviations of a state drawn from the truth."""
    yaw = TRUE_YAW_SIGMA if config.yaw_sigma_rad is None else config.yaw_sigma_rad
    sigmas = {
        **dict.fromkeys(("px", "py"), config.position_sigma_m),
        **dict.fromkeys(("vx", "vy", "v"), config.velocity_sigma_mps),
        **dict.fromkeys(("ax", "ay", "a"), config.acceleration_sigma_mps2),
        "yaw": yaw,
        "yaw_rate": config.yaw_rate_sigma_radps,
    }
    return np.array([sigmas[name] for name in motion.components])


def _position(scan: Scan) -> Gaussian:
    mean, covariance = SENSOR_MODELS[scan.kind].position(scan)
    return Gaussian(mean, np.broadcast_to(linalg.expand(covariance, mean[None]), (2, *mean.shape)))


def _from_one(position: Gaussian, velocity: Array, velocity_sigma: float) -> Gaussian:
    batch = position.mean.shape[1:]
    covariance = np.zeros((4, 4, *batch))
    covariance[:2, :2] = position.covariance
    covariance[2, 2] = covariance[3, 3] = velocity_sigma**2
    return Gaussian(np.concatenate([position.mean, velocity]), covariance)


def _from_two(first: Gaussian, second: Gaussian, dt: Array) -> Gaussian:
    """Two-point differencing. Source: Bar-Shalom, Li and Kirubarajan (2001), section 5.5.3."""
    velocity = (second.mean - first.mean) / dt
    covariance = np.empty((4, 4, *dt.shape))
    covariance[:2, :2] = second.covariance
    covariance[:2, 2:] = covariance[2:, :2] = second.covariance / dt
    covariance[2:, 2:] = (first.covariance + second.covariance) / dt**2
    return Gaussian(np.concatenate([second.mean, velocity]), covariance)


def _stated(belief: Gaussian, config: InitialConfig) -> Gaussian:
    """The belief with the covariance that the scenario states, if it states one."""
    if config.covariance_diag is None:
        return belief
    covariance = linalg.expand(np.diag(config.covariance_diag), belief.mean[None])
    return Gaussian(belief.mean, np.broadcast_to(covariance, belief.covariance.shape))


def _first(scan: Scan, position: Gaussian) -> FirstReading:
    return FirstReading(np.where(scan.valid, scan.time, np.nan), position)


def _fill(waiting: FirstReading, new: FirstReading) -> FirstReading:
    held = ~np.isnan(waiting.time)
    return FirstReading(
        np.where(held, waiting.time, new.time),
        Gaussian(*(np.where(held, a, b) for a, b in zip(waiting.position, new.position, strict=True))),
    )


def _nothing(motion: MotionModel, scan: Scan) -> Gaussian:
    size, batch = len(motion.components), scan.valid.shape
    return Gaussian(np.zeros((size, *batch)), np.zeros((size, size, *batch)))
