"""Start of a track of a built-in filter: from its first measurement, from two, or from the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from trackbench.base import linalg
from trackbench.base.config import Config, Problem, Sigma, Variance
from trackbench.base.types import Array, Gaussian, Mask, Scan
from trackbench.filters import AnyBelief, Filter, MotionWithErrors, choose
from trackbench.models.motion import InitialSigmas, Kinematics, MotionModel
from trackbench.models.motion.base import ACCELERATION, POSITION, VELOCITY, YAW, YAW_RATE
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.radar import MIN_RANGE

InitialSource = Literal["first_measurement", "two_measurements", "truth"]

#: Sources with which each key of the initial state is used, for keys that not all sources use.
INITIAL_SOURCES: dict[str, tuple[str, ...]] = {
    "sensors": ("first_measurement", "two_measurements"),
    "skip": ("first_measurement", "two_measurements"),
    "waiting": ("first_measurement", "two_measurements"),
    "unbiased": ("first_measurement", "two_measurements"),
    "velocity": ("first_measurement",),
    "least_time_s": ("two_measurements",),
    "position_sigma_m": ("truth",),
    "velocity_sigma_mps": ("first_measurement", "truth"),
}


class InitialConfig(Config):
    """How a track starts, and how uncertain its first state is stated to be."""

    source: InitialSource = Field(
        "first_measurement",
        alias="from",
        description="first_measurement: position of the first measurement, and what it tells of the velocity. "
        "two_measurements: velocity from the displacement between two. truth: drawn from the truth with the standard "
        "deviations below, for consistency tests.",
    )
    sensors: list[str] | None = Field(
        None,
        min_length=1,
        description="Names of the sensors whose measurements start a track; those that the tracker reads unless given. "
        "Not from truth.",
    )
    skip: int = Field(
        0,
        ge=0,
        le=1000,
        description="How many measurements of an object are passed over before those that start its track.",
    )
    waiting: Literal["nothing", "at_rest"] = Field(
        "nothing",
        description="Estimate that is given and scored before an object's track starts. at_rest: the object stands at "
        "its latest measurement; the velocity is as uncertain as from first_measurement.",
    )
    unbiased: bool = Field(
        True,
        description="Whether the position that a radar's measurement gives is corrected for the bias of range times "
        "cosine and sine of the azimuth. false: not, as in most published programs. Not from truth.",
    )
    least_time_s: float = Field(
        0.2, ge=0, le=60, description="Least time between the two measurements, s; from two_measurements only."
    )
    velocity: Literal["zero", "radial", "range_rate"] = Field(
        "range_rate",
        description="First velocity, from first_measurement only. zero: zero. radial: the third component of a radar's "
        "measurement, along the line of sight. range_rate: the same, and along the line of sight as certain as the "
        "range rate is; velocity_sigma_mps holds across it, and all around where the sensor has no range rate or the "
        "state no vx, vy.",
    )
    position_sigma_m: Sigma = Field(1, description="Standard deviation of each position component, m; from truth only.")
    velocity_sigma_mps: Sigma = Field(
        20, description="Standard deviation of each velocity component, m/s; not from two_measurements."
    )
    acceleration_sigma_mps2: Sigma = Field(
        3, description="Standard deviation of the acceleration, m/s^2, where the state has it."
    )
    yaw_rate_sigma_radps: Sigma = Field(
        0.3, description="Standard deviation of the yaw rate, rad/s, where the state has it."
    )

    @model_validator(mode="before")
    @classmethod
    def _word(cls, data: Any) -> Any:
        return {"from": data} if isinstance(data, str) else data

    covariance_diag: list[Variance] | None = Field(
        None,
        description="Diagonal of the covariance that the first state is said to have, one variance for each component "
        "of the state. Unless given, it is what the measurement and the standard deviations above give.",
    )

    def problems(self) -> Iterator[Problem]:
        for key in (name for name in type(self).model_fields if name in self.model_fields_set):
            sources = INITIAL_SOURCES.get(key, (self.source,))
            if self.source not in sources:
                allowed = " or ".join(sources)
                yield Problem((key,), f"not used with from: {self.source}; remove it, or use from: {allowed}")
            elif "sigma" in key and self.covariance_diag is not None and self.source != "truth":
                yield Problem((key,), "not used with covariance_diag, which replaces it; remove one of them")


#: Standard deviation of a yaw drawn from the truth, rad.
TRUE_YAW_SIGMA = 0.1
#: Tolerance for equal times, s: times are sums of periods, which are not exact.
SAME_TIME = 1e-6


class Prior(NamedTuple):
    """First state of each track, for a tracker whose tracks start from the ground truth, not from measurements."""

    time: Array
    """Start of each track ``(...)``, s."""
    belief: AnyBelief
    """Belief whose mean is the truth plus a drawn error, with the covariance of that error."""

    def begin(self, time: float, belief: AnyBelief, started: Mask, filter: Filter[Any]) -> tuple[AnyBelief, Mask]:
        """Return the belief and the mask of started tracks ``(...)``, after the start of all tracks due by ``time``."""
        is_new = (time >= self.time) & ~started
        if not np.any(is_new):
            return belief, started
        # A prediction over no time computes sigma points, which an update may reuse.
        return choose(is_new, filter.predict(self.belief, 0.0), belief), started | is_new


class TentativeTrack(NamedTuple):
    """Measurements so far of the objects whose tracks have not started; arrays end with the batch axes."""

    measurements: Array
    """Number of measurements of each object so far."""
    time: Array
    """Time of each object's first measurement that is not skipped, s; NaN before it."""
    position: Gaussian
    """Position of each object's first measurement that is not skipped."""
    latest: Gaussian
    """Position of each object's latest measurement; NaN before the first."""


class Start(NamedTuple):
    """Tracks that can start at a scan, with their first states."""

    ready: Mask
    state_of: Callable[[MotionModel], Gaussian]
    """Function that returns the tracks' first state for a motion model."""
    waiting: TentativeTrack


def placeholder(motion: MotionModel, batch: tuple[int, ...]) -> Gaussian:
    """Return a state of a motion model that stands in for tracks that have not started."""
    mean = np.ones((len(motion.components), *batch))
    return Gaussian(mean, np.zeros((len(mean), *mean.shape)) + linalg.expand(np.eye(len(mean)), mean[None]))


def sigmas(config: InitialConfig) -> InitialSigmas:
    """Return the standard deviations assumed at a track's start for acceleration and yaw rate."""
    return InitialSigmas(config.acceleration_sigma_mps2, config.yaw_rate_sigma_radps)


def start_tracks(config: InitialConfig, scan: Scan, waiting: TentativeTrack | None) -> Start:
    """Return which tracks start with a scan, from its measurements alone or together with earlier ones.

    Measurements of a sensor that measures no position do not count.

    Args:
        config: how tracks start.
        scan: the measurements.
        waiting: earlier measurements of objects without a track; None at the first scan.
    """
    if not SENSOR_MODELS[scan.kind].measures_position():
        scan = scan._replace(valid=np.zeros_like(scan.valid))
    position = _position(scan, config)
    if waiting is None:
        batch = scan.valid.shape
        nowhere = Gaussian(np.full((2, *batch), np.nan), np.full((2, 2, *batch), np.nan))
        nothing = Gaussian(np.zeros((2, *batch)), np.zeros((2, 2, *batch)))
        waiting = TentativeTrack(np.zeros(batch), np.full(batch, np.nan), nothing, nowhere)
    is_counted = scan.valid & (waiting.measurements >= config.skip)
    is_first = is_counted & np.isnan(waiting.time)
    after = TentativeTrack(
        waiting.measurements + scan.valid,
        np.where(is_first, scan.time, waiting.time),
        position.where(is_first, waiting.position),
        position.where(scan.valid, waiting.latest),
    )
    if config.source == "first_measurement":
        return Start(is_counted, partial(first_measurement, config=config, scan=scan, position=position), after)
    elapsed = scan.time - waiting.time
    is_ready = is_counted & (elapsed > 0.0) & (elapsed > config.least_time_s - SAME_TIME)
    with np.errstate(divide="ignore", invalid="ignore"):
        belief = two_measurements(waiting.position, position, np.where(is_ready, elapsed, 1.0))
    return Start(is_ready, partial(_state_from_cartesian, config=config, belief=belief), after)


def first_measurement(
    motion: MotionModel, config: InitialConfig, scan: Scan, position: Gaussian | None = None
) -> Gaussian:
    """Return the first state of a motion model that each single measurement of a scan implies.

    The velocity is zero, or the range rate along the line of sight, with the configured standard deviation. With
    ``velocity: range_rate`` the velocity along the line of sight has the variance of the range rate.

    Args:
        motion: motion model of n components.
        config: assumptions on components that the measurement leaves open.
        scan: measurements ``(m, ...)``.
        position: positions ``(2, ...)`` of the measurements, if already computed.

    Returns:
        state ``(n, ...)`` with its covariance; meaningless for invalid measurements.
    """
    if isinstance(motion, MotionWithErrors):
        return motion.started(scan, lambda own_motion, own_scan: first_measurement(own_motion, config, own_scan))
    velocity = np.zeros((2, *scan.valid.shape))
    if config.velocity != "zero":
        velocity = SENSOR_MODELS[scan.kind].radial_velocity(scan)
    belief = _at_position(position or _position(scan, config), velocity, config.velocity_sigma_mps)
    if config.velocity == "range_rate" and "vx" in motion.components:
        belief = _with_range_rate(belief, scan)
    return _state_from_cartesian(motion, config, belief)


def two_measurements(first: Gaussian, second: Gaussian, dt: Array) -> Gaussian:
    """Return px, py, vx, vy ``(4, ...)`` at the second of two measured positions ``(2, ...)``, ``dt`` s apart.

    Source: two-point differencing, Bar-Shalom, Li and Kirubarajan (2001), section 5.5.3.
    """
    velocity = (second.mean - first.mean) / dt
    covariance = np.empty((4, 4, *dt.shape))
    covariance[:2, :2] = second.covariance
    covariance[:2, 2:] = covariance[2:, :2] = second.covariance / dt
    covariance[2:, 2:] = (first.covariance + second.covariance) / dt**2
    return Gaussian(np.concatenate([second.mean, velocity]), linalg.rounded_up(covariance))


def at_rest(waiting: TentativeTrack, config: InitialConfig) -> Gaussian:
    """Return px, py, vx, vy of each object at rest at its latest measurement; NaN for an object without one."""
    belief = _at_position(waiting.latest, np.zeros_like(waiting.latest.mean), config.velocity_sigma_mps)
    return Gaussian(*(np.where(waiting.measurements > 0, part, np.nan) for part in belief))


def from_truth(motion: MotionModel, config: InitialConfig, truth: Kinematics, normal: Array) -> Gaussian:
    """Return a state ``(n, ...)`` that is the truth plus a drawn error, with the covariance of that error.

    ``normal`` ``(n or more, ...)`` are draws from a standard normal.
    """
    if isinstance(motion, MotionWithErrors):
        # The errors belong to later measurements, so none are drawn.
        return motion.padded(from_truth(motion.motion, config, truth, normal))
    sigmas = {
        **motion.first_sigmas,
        **dict.fromkeys(POSITION, config.position_sigma_m),
        **dict.fromkeys(VELOCITY, config.velocity_sigma_mps),
        **dict.fromkeys(ACCELERATION, config.acceleration_sigma_mps2),
        **dict.fromkeys(YAW, TRUE_YAW_SIGMA),
        **dict.fromkeys(YAW_RATE, config.yaw_rate_sigma_radps),
    }
    exact = motion.from_kinematics(truth)
    sigma = linalg.expand(np.array([sigmas[name] for name in motion.components]), exact)
    covariance = linalg.expand(np.diag(config.covariance_diag or np.ravel(sigma) ** 2), exact[None])
    return Gaussian(exact + sigma * normal[: len(sigma)], np.broadcast_to(covariance, (len(sigma), *exact.shape)))


def _position(scan: Scan, config: InitialConfig) -> Gaussian:
    model = SENSOR_MODELS[scan.kind]
    mean, covariance = model.position(scan)
    if not config.unbiased:
        # The conversion of a measurement without noise has no bias to correct.
        mean = model.position(scan._replace(noise_covariance=np.zeros_like(scan.noise_covariance))).mean
    return Gaussian(mean, np.broadcast_to(linalg.expand(covariance, mean[None]), (2, *mean.shape)))


def _at_position(position: Gaussian, velocity: Array, velocity_sigma: float) -> Gaussian:
    batch = position.mean.shape[1:]
    covariance = np.zeros_like(position.covariance, shape=(4, 4, *batch))
    covariance[:2, :2] = position.covariance
    covariance[2, 2] = covariance[3, 3] = velocity_sigma**2
    return Gaussian(np.concatenate([position.mean, velocity]), covariance)


def _with_range_rate(belief: Gaussian, scan: Scan) -> Gaussian:
    """Return the belief with a velocity along the line of sight as certain as the range rate, if measured.

    The azimuth's error turns the line, so that some of the unknown velocity across it adds to the variance along it.
    """
    components = SENSOR_MODELS[scan.kind].components
    if "range_rate" not in components:
        return belief
    i = components.index("range_rate")
    sight = belief.mean[:2] - linalg.expand(scan.sensor_pose[:2], belief.mean)
    distance = np.hypot(*sight)
    # A target on the sensor has no line of sight; any direction serves.
    is_apart = distance > 0.0
    ahead = linalg.expand(np.array([1.0, 0.0]), sight)
    sight = np.where(is_apart, sight / np.where(is_apart, distance, 1.0), ahead)
    normal = linalg.vector([-sight[1], sight[0]])
    aside = normal / np.maximum(distance, MIN_RANGE)
    turned = np.einsum("i...,ij...,j...->...", aside, belief.covariance[:2, :2], aside)
    covariance, across = belief.covariance.copy(), belief.covariance[2, 2]
    # At most the variance across: the line of sight to a very near target is unknown.
    along = across * np.minimum(1.0, turned) + scan.noise_covariance[i, i]
    covariance[2:, 2:] = along * sight[:, None] * sight[None] + across * normal[:, None] * normal[None]
    return Gaussian(belief.mean, linalg.rounded_up(covariance))


def _state_from_cartesian(motion: MotionModel, config: InitialConfig, belief: Gaussian) -> Gaussian:
    with np.errstate(divide="ignore", invalid="ignore"):
        state = motion.from_cartesian(belief, sigmas(config))
    if config.covariance_diag is None:
        return state
    covariance = linalg.expand(np.diag(config.covariance_diag), state.mean[None])
    return Gaussian(state.mean, np.broadcast_to(covariance, state.covariance.shape))
