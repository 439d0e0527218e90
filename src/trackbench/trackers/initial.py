"""How a track of a built-in filter starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Mask, Scan
from trackbench.engine.equations import Compute, by_numpy
from trackbench.filters import AnyBelief, Filter, choose
from trackbench.models.motion import InitialSigmas, Kinematics, MotionModel
from trackbench.models.motion.base import ACCELERATION, POSITION, VELOCITY, YAW, YAW_RATE
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.batch_fit import BatchPrior
from trackbench.trackers.batch_start import start_state
from trackbench.trackers.cartesian_fallback import course_known, has_yaw
from trackbench.trackers.first_line import first_line
from trackbench.trackers.initial_config import ALONG_SIGHT, InitialConfig

#: Standard deviation of the yaw where it is drawn from the truth and the scenario does not say, rad.
TRUE_YAW_SIGMA = 0.1
#: Time after which a batch starts a track though the measurements leave two motions, s.
LONGEST = 1.0
#: Two times that differ by less are the same, s: times are sums of periods, which are not exact.
SAME_TIME = 1e-6


class Prior(NamedTuple):
    """Where each track starts, for a tracker that is given its first state rather than finding it."""

    time: Array
    """``(...)`` s."""
    belief: AnyBelief
    """Its mean drawn from the truth, with the covariance of the draw."""

    def begin(self, time: float, belief: AnyBelief, started: Mask, filter: Filter[Any]) -> tuple[AnyBelief, Mask]:
        """The belief and the started tracks ``(...)``, with those that start by this time, ready for an update."""
        fresh = (time >= self.time) & ~started
        if not np.any(fresh):
            return belief, started
        # A prediction over no time gives the sigma points that an update may reuse.
        return choose(fresh, filter.predict(self.belief, 0.0), belief), started | fresh


class TentativeTrack(NamedTuple):
    """What is known of the objects whose tracks have not started, each ``(..., batch)``."""

    measurements: Array
    """How many there were."""
    time: Array
    """Of the first measurement that counts, s; NaN where there was none yet."""
    position: Gaussian
    """Of the first measurement that counts."""
    latest: Gaussian
    """Position of the latest measurement; NaN where there was none yet."""
    scans: tuple[Scan, ...] = ()
    """Those with measurements that count, where a batch of them starts a track."""
    counted: tuple[Mask, ...] = ()
    """For each of them, which do."""


class Start(NamedTuple):
    """Tracks that can start now."""

    ready: Mask
    state_of: Callable[[MotionModel], Gaussian]
    """Where they start, in the state of a motion model."""
    waiting: TentativeTrack
    without_course: Mask | None = None
    """Those of them whose course is not known, where the state has a yaw."""


def placeholder(motion: MotionModel, batch: tuple[int, ...]) -> Gaussian:
    """A state for tracks that have not started."""
    mean = np.ones((len(motion.components), *batch))
    return Gaussian(mean, np.zeros((len(mean), *mean.shape)) + linalg.expand(np.eye(len(mean)), mean[None]))


def sigmas(config: InitialConfig) -> InitialSigmas:
    """What is assumed of the components that position and velocity leave open."""
    known = InitialSigmas(config.acceleration_sigma_mps2, config.yaw_rate_sigma_radps)
    return known if config.yaw_sigma_rad is None else known._replace(yaw=config.yaw_sigma_rad)


def start(
    config: InitialConfig,
    scan: Scan,
    waiting: TentativeTrack | None,
    motions: Sequence[MotionModel],
    wanted: Mask | None = None,
    compute: Compute = by_numpy,
) -> Start:
    """Start the tracks that a scan allows to start, from its measurement alone or with earlier ones.

    Args:
        config: how.
        scan: the measurements.
        waiting: what the start of the scan before left; None at first.
        motions: the motion models in whose states they start.
        wanted: of which objects; of all unless given.
        compute: how equations are computed.
    """
    position = _position(scan)
    waiting = waiting or _none_yet(scan)
    counts = scan.valid & (waiting.measurements >= config.skip)
    after = _taken_in(waiting, scan, position, counts)
    if config.source == "first_reading":
        return Start(counts, partial(from_first, config=config, scan=scan, position=position), after)
    elapsed = scan.time - waiting.time
    ready = counts & (elapsed > 0.0) & (elapsed > config.least_time(has_yaw(motions)) - SAME_TIME)
    if config.source == "batch":
        wanted = counts if wanted is None else counts & wanted
        return _from_batch(config, scan, after, wanted, ready, motions, compute)
    with np.errstate(divide="ignore", invalid="ignore"):
        belief = _from_two(waiting.position, position, np.where(ready, elapsed, 1.0))
    return Start(ready, partial(_of_cartesian, config=config, belief=belief), after)


def from_first(motion: MotionModel, config: InitialConfig, scan: Scan, position: Gaussian | None = None) -> Gaussian:
    """The state ``(n, ...)`` that each measurement of a scan says by itself; ``position`` is its position, if known."""
    velocity = np.zeros((2, *scan.valid.shape))
    if config.velocity != "zero":
        velocity = SENSOR_MODELS[scan.kind].radial_velocity(scan)
    known = _from_one(position or _position(scan), velocity, config.velocity_sigma_mps)
    if config.velocity == "range_rate" and "vx" in motion.components:
        known = _with_range_rate(known, scan)
    return _of_cartesian(motion, config, known)


def _from_batch(
    config: InitialConfig,
    scan: Scan,
    after: TentativeTrack,
    counts: Mask,
    ready: Mask,
    motions: Sequence[MotionModel],
    compute: Compute,
) -> Start:
    scans, counted = (*after.scans, scan), (*after.counted, counts)
    prior = BatchPrior(config.velocity_sigma_mps, sigmas(config))
    ready = ready & counts & (after.measurements - config.skip >= config.measurements)
    without_course: Mask | None = None
    if np.any(ready):
        measurements, line = first_line(scans, counted, ready, prior, compute)
        elapsed = scan.time - after.time[ready]
        waits = line.ambiguous & (elapsed < LONGEST - SAME_TIME)
        if config.least_time_s is None:
            waits |= measurements.by_range_rate & (elapsed < ALONG_SIGHT - SAME_TIME)
        begin = ~waits
        measurements, line = measurements.part(begin), line.part(begin)
        ready = np.array(ready)
        ready[ready] = begin
        if has_yaw(motions):
            without_course = np.zeros_like(ready)
            without_course[ready] = ~course_known(line.latest) | line.ambiguous

    def state_of(motion: MotionModel) -> Gaussian:
        mean, covariance = placeholder(motion, ready.shape)
        mean[:, ready], covariance[..., ready] = start_state(motion.part(ready), measurements, prior, line, compute)
        return _stated(Gaussian(mean, covariance), config)

    left_over = [(one, mask & ~ready) for one, mask in zip(scans, counted, strict=True)]
    kept = [(one, mask) for one, mask in left_over if mask.any()]
    left = after._replace(scans=tuple(one for one, _ in kept), counted=tuple(mask for _, mask in kept))
    return Start(ready, state_of, left, without_course)


def at_rest(waiting: TentativeTrack, config: InitialConfig) -> Gaussian:
    """px, py, vx, vy of objects that stand where their latest measurement says; NaN where there was none."""
    belief = _from_one(waiting.latest, np.zeros_like(waiting.latest.mean), config.velocity_sigma_mps)
    return Gaussian(*(np.where(waiting.measurements > 0, part, np.nan) for part in belief))


def from_truth(motion: MotionModel, config: InitialConfig, truth: Kinematics, normal: Array) -> Gaussian:
    """A state ``(n, ...)`` drawn from the truth, with the covariance of the draw.

    ``normal`` is ``(n or more, ...)`` standard normal numbers.
    """
    exact = motion.from_kinematics(truth)
    sigma = linalg.expand(_prior_sigma(motion, config), exact)
    covariance = linalg.expand(np.diag(config.covariance_diag or np.ravel(sigma) ** 2), exact[None])
    return Gaussian(exact + sigma * normal[: len(sigma)], np.broadcast_to(covariance, (len(sigma), *exact.shape)))


def _prior_sigma(motion: MotionModel, config: InitialConfig) -> Array:
    """``(n,)`` standard deviations of a state drawn from the truth."""
    yaw = TRUE_YAW_SIGMA if config.yaw_sigma_rad is None else config.yaw_sigma_rad
    sigmas = {
        **motion.first_sigmas,
        **dict.fromkeys(POSITION, config.position_sigma_m),
        **dict.fromkeys(VELOCITY, config.velocity_sigma_mps),
        **dict.fromkeys(ACCELERATION, config.acceleration_sigma_mps2),
        **dict.fromkeys(YAW, yaw),
        **dict.fromkeys(YAW_RATE, config.yaw_rate_sigma_radps),
    }
    return np.array([sigmas[name] for name in motion.components])


def _position(scan: Scan) -> Gaussian:
    mean, covariance = SENSOR_MODELS[scan.kind].position(scan)
    return Gaussian(mean, np.broadcast_to(linalg.expand(covariance, mean[None]), (2, *mean.shape)))


def _from_one(position: Gaussian, velocity: Array, velocity_sigma: float) -> Gaussian:
    batch = position.mean.shape[1:]
    covariance = np.zeros_like(position.covariance, shape=(4, 4, *batch))
    covariance[:2, :2] = position.covariance
    covariance[2, 2] = covariance[3, 3] = velocity_sigma**2
    return Gaussian(np.concatenate([position.mean, velocity]), covariance)


def _with_range_rate(belief: Gaussian, scan: Scan) -> Gaussian:
    """The belief with the variance of the range rate along the line of sight, if the sensor measures it.

    The line is known only to within the azimuth's error, which turns the unknown velocity across into it.
    """
    components = SENSOR_MODELS[scan.kind].components
    if "range_rate" not in components:
        return belief
    i = components.index("range_rate")
    sight = belief.mean[:2] - linalg.expand(scan.sensor_pose[:2], belief.mean)
    distance = np.hypot(*sight)
    sight = sight / distance
    aside = linalg.vector([-sight[1], sight[0]]) / distance
    turned = np.einsum("i...,ij...,j...->...", aside, belief.covariance[:2, :2], aside)
    # Never more than is unknown across: the line of sight to what is very near is not known at all.
    loss = belief.covariance[2, 2] * np.maximum(0.0, 1.0 - turned) - scan.noise_covariance[i, i]
    covariance = belief.covariance.copy()
    covariance[2:, 2:] -= loss * sight[:, None] * sight[None]
    return Gaussian(belief.mean, covariance)


def _from_two(first: Gaussian, second: Gaussian, dt: Array) -> Gaussian:
    """Two-point differencing. Source: Bar-Shalom, Li and Kirubarajan (2001), section 5.5.3."""
    velocity = (second.mean - first.mean) / dt
    covariance = np.empty((4, 4, *dt.shape))
    covariance[:2, :2] = second.covariance
    covariance[:2, 2:] = covariance[2:, :2] = second.covariance / dt
    covariance[2:, 2:] = (first.covariance + second.covariance) / dt**2
    return Gaussian(np.concatenate([second.mean, velocity]), covariance)


def _of_cartesian(motion: MotionModel, config: InitialConfig, belief: Gaussian) -> Gaussian:
    with np.errstate(divide="ignore", invalid="ignore"):
        return _stated(motion.from_cartesian(belief, sigmas(config)), config)


def _stated(belief: Gaussian, config: InitialConfig) -> Gaussian:
    """The belief with the covariance that the scenario states, if it states one."""
    if config.covariance_diag is None:
        return belief
    covariance = linalg.expand(np.diag(config.covariance_diag), belief.mean[None])
    return Gaussian(belief.mean, np.broadcast_to(covariance, belief.covariance.shape))


def _none_yet(scan: Scan) -> TentativeTrack:
    batch = scan.valid.shape
    nowhere = Gaussian(np.full((2, *batch), np.nan), np.full((2, 2, *batch), np.nan))
    nothing = Gaussian(np.zeros((2, *batch)), np.zeros((2, 2, *batch)))
    return TentativeTrack(np.zeros(batch), np.full(batch, np.nan), nothing, nowhere)


def _taken_in(waiting: TentativeTrack, scan: Scan, position: Gaussian, counts: Mask) -> TentativeTrack:
    first = counts & np.isnan(waiting.time)
    return TentativeTrack(
        waiting.measurements + scan.valid,
        np.where(first, scan.time, waiting.time),
        position.where(first, waiting.position),
        position.where(scan.valid, waiting.latest),
        waiting.scans,
        waiting.counted,
    )
