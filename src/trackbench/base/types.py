"""Values that travel between the layers.

Arrays put component axes first and batch axes last: a state is ``(n, ...)``, a covariance ``(n, n, ...)``, a
measurement ``(m, ...)``. The trailing axes are whatever runs in parallel (Monte-Carlo runs, objects) or nothing. SI
units and radians throughout; angles are counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T", bound=np.generic)
Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
#: Function that is often called with the amount of work that is done and the whole amount.
Progress = Callable[[float, float], None]


class NotedProgress(Protocol):
    """Progress function with an optional note on the work, such as "best 0.12"."""

    def __call__(self, done: float, total: float, note: str = "") -> None: ...


def no_progress(done: float, total: float, note: str = "") -> None:
    """Ignore the progress: a progress function that shows nothing."""


def of_runs(values: npt.NDArray[T], runs: range) -> npt.NDArray[T]:
    """Select runs on an array's last axis, the runs; an axis of length 1, for runs that are alike, stays as it is."""
    return values if values.shape[-1] == 1 else values[..., runs.start : runs.stop]


#: Largest difference between equal times, s: times are sums of periods, with rounding errors.
SAME_TIME = 1e-9
#: Status of an object at an instant: not in the scene; in the scene, a track is optional; a track is required.
ABSENT, OPTIONAL, DUE = 0, 1, 2
#: Object number of a false alarm.
FALSE_ALARM = -1
#: Object number of a recorded detection whose cause is unknown.
UNKNOWN_ORIGIN = -3

#: State in the fixed frame by which trackers with different states are compared.
COMMON_STATE = ("px", "py", "vx", "vy")


def indices(where: npt.NDArray[Any]) -> Indices:
    """Return the indices ``(K,)`` at which a mask ``(batch,)`` is True, fast for short masks."""
    return where.nonzero()[0]


class Gaussian(NamedTuple):
    """Mean ``(n, ...)`` and covariance ``(n, n, ...)`` of a Gaussian distribution, or of a batch of them."""

    mean: Array
    covariance: Array

    def where(self, mask: Mask, other: Gaussian) -> Gaussian:
        """Return this Gaussian where the mask ``(...)`` is True, and ``other`` elsewhere."""
        return Gaussian(np.where(mask, self.mean, other.mean), np.where(mask, self.covariance, other.covariance))


class FieldOfView(NamedTuple):
    """Region in which a sensor can detect anything, in the sensor's frame."""

    half_angle: float
    """Largest angle to either side of the boresight, rad."""
    max_range: float
    """Largest range, m; infinite without a limit."""
    volume: float | None = None
    """Volume of this region in the measurement space, in units of a measurement; None if infinite. The expected number
    of false alarms in a scan is the clutter density times this volume."""


class Scan(NamedTuple):
    """One sensor's measurements at one instant, with nothing of the ground truth.

    With known identities the trailing axes of ``measurement`` and ``valid`` are the objects. With hidden identities
    there is one trailing axis, of the D detections, in arbitrary order; D may be 0. A batch of runs adds a last axis. D
    is then the largest number of detections of a run; shorter runs end in columns of NaN that are not valid.
    """

    time: float
    """Time at which the measurement was taken, s."""
    sensor: str
    """Name of the sensor in the scenario."""
    kind: str
    """Type of the sensor: "radar", "lidar" or a plug-in's name; "radar(range, azimuth)" if it measures only these."""
    measurement: Array
    """Measured values ``(m, ...)``, NaN where not valid. Radar: range m, azimuth rad in the sensor's frame, range rate
    m/s relative to the moving sensor (speed radar: target's speed over ground). Lidar: x, y in the sensor's frame,
    m."""
    valid: Mask
    """Mask ``(...)``; False where the sensor did not detect the object."""
    noise_covariance: Array
    """Covariance ``(m, m)`` of the measurement noise, as stated by the sensor."""
    sensor_pose: Array
    """Pose ``(3,)`` x m, y m, yaw rad of the sensor in the fixed frame; ``(3, runs)`` where a built-in tracker of
    several objects takes runs of several scenes at once."""
    sensor_velocity: Array
    """Velocity ``(2,)`` vx, vy of the sensor in the fixed frame, m/s; ``(2, runs)`` with a pose ``(3, runs)``."""
    arrival_time: float
    """Time at which the measurement reaches the tracker (``time`` plus the sensor's latency), s."""
    detection_probability: float | None = None
    """P_D of an object in the field of view as the sensor states it; None with known identities."""
    clutter_density: float | None = None
    """Expected false alarms per scan and unit volume of the measurement space; None with known identities."""
    field_of_view: FieldOfView | None = None
    """Region in which the sensor can detect anything; None with known identities."""
    asked: bool = False
    """True if this scan brings no measurement and only asks for the estimate at ``time``. The tracker must not keep
    this prediction: measurements still on their way were taken earlier."""
    place: int = 0
    """Index of the sensor in the scenario, from 0; it orders scans of one time if none arrives late."""
    half_range_m: float | None = None
    """Range at which P_D has fallen to half of ``detection_probability``, m; None if P_D is constant over range."""

    def __repr__(self) -> str:
        valid = np.asarray(self.valid)
        late = f", arrived at {self.arrival_time:g} s" if self.arrival_time != self.time else ""
        seen = f"measurement {np.shape(self.measurement)}, {int(valid.sum())} of {valid.size} valid"
        return f"<scan of {self.sensor} ({self.kind}) at {self.time:g} s{late}: {seen}>"

    def prompt(self) -> Scan:
        """Return this scan with its arrival time set to the time of its measurement."""
        return self._replace(arrival_time=self.time)


def scan_of_member(scan: Scan, member: int) -> Scan:
    """Return the scan of one object of a batch with known identities, with ``measurement`` ``(m,)``."""
    return scan._replace(measurement=scan.measurement[:, member], valid=scan.valid[member])


def scan_of_run(scan: Scan, run: int) -> Scan:
    """Return the scan of one run of a batch with hidden identities, without padding: ``measurement`` ``(m, D)``."""
    is_detection = scan.valid[:, run]
    measurement, valid = scan.measurement[:, is_detection, run], is_detection[is_detection]
    for values in (measurement, valid):
        # Several trackers read one scan, so none may change it.
        values.setflags(write=scan.measurement.flags.writeable)
    return with_sensor_of(scan, run, measurement=measurement, valid=valid)


def with_sensor_of(scan: Scan, run: Indices | int, **values: Any) -> Scan:
    """Return the scan with the sensor's pose and velocity in the given runs, and the fields ``values`` replaced."""
    if scan.sensor_pose.ndim > 1:
        values["sensor_pose"] = scan.sensor_pose.take(run, axis=1)
        values["sensor_velocity"] = scan.sensor_velocity.take(run, axis=1)
    return scan._replace(**values) if values else scan


class Tracks(NamedTuple):
    """K confirmed tracks of a multi-object tracker after a scan."""

    ids: Indices
    """Track numbers ``(K,)``; a number is never used again for another track."""
    mean: Array
    """Estimated px, py, vx, vy ``(4, K)`` in the fixed frame."""
    covariance: Array
    """Covariance ``(4, 4, K)`` of the estimated px, py, vx, vy."""
    existence: Array | None = None
    """Probability ``(K,)`` that the track's object exists; None if the tracker computes none."""
    used: Indices | None = None
    """Column ``(K,)`` of the scan's detection that updated the track; -1 for no detection. None where not stated."""

    def __repr__(self) -> str:
        shown = np.array2string(np.asarray(self.ids), threshold=12, separator=", ", max_line_width=1000)
        stated = [name for name in ("existence", "used") if getattr(self, name) is not None]
        return f"<tracks {shown}{''.join(f', {name}' for name in stated)}>"


class Estimate(NamedTuple):
    """Estimate of a single-object tracker after a scan; only ``mean`` and ``covariance`` are required."""

    mean: Array
    """Estimated px, py, vx, vy ``(4, ...)`` in the fixed frame."""
    covariance: Array
    """Covariance ``(4, 4, ...)`` of the estimated px, py, vx, vy."""
    state: Array | None = None
    """Estimated state ``(n, ...)`` in the tracker's own state space."""
    state_covariance: Array | None = None
    """Covariance ``(n, n, ...)`` of ``state``."""
    innovation: Array | None = None
    """Innovation ``(m, ...)``: measurement minus its prediction; ignored where the scan is not valid."""
    innovation_covariance: Array | None = None
    """Covariance ``(m, m, ...)`` of the innovation."""
    whitened_innovation: Array | None = None
    """Innovation ``(m, ...)`` times ``L^-1``, where its covariance is ``L L^T``; it saves factoring the covariance."""
    repaired: Mask | None = None
    """Mask ``(...)``, True where a covariance at this scan was not positive definite and was repaired."""
    mode_probabilities: Array | None = None
    """Probabilities ``(M, ...)`` of the tracker's M motion models; None for a single model."""
    log_likelihood: Array | None = None
    """Logarithm ``(...)`` of the measurement's density given all earlier arrivals; NaN without a prediction. Stated
    where that density is not the Gaussian of the innovation."""

    def __repr__(self) -> str:
        mean = np.asarray(self.mean)
        if mean.shape != (len(COMMON_STATE),):
            return f"<estimate: mean {mean.shape}, covariance {np.shape(self.covariance)}>"
        sigma = np.sqrt(np.diagonal(self.covariance))
        parts = (f"{n} {m:.4g} ±{s:.2g}" for n, m, s in zip(COMMON_STATE, mean, sigma, strict=True))
        return f"<estimate: {', '.join(parts)}>"


class RecordedAlarms(NamedTuple):
    """Detections of one sensor that a recording marks as false alarms, over all its scans."""

    scan: Indices
    """Index ``(detections,)`` of the scan that contains each detection."""
    measurement: Array
    """Measured values ``(m, detections)`` of each detection."""


class RecordedMeasurements(NamedTuple):
    """Recorded measurements of one sensor, each with the object that caused it."""

    steps: Indices
    """Index ``(scans,)`` of each scan's time among the times of the ground truth; a scan may be empty."""
    measurement: Array
    """Measured values ``(m, scans, objects)``, NaN where not valid."""
    valid: Mask
    """Mask ``(scans, objects)``; False where the sensor did not detect the object."""
    cycle: Indices | None = None
    """Number ``(scans,)`` of the sensor's cycle that contains each scan; None if each scan is a cycle of its own."""
    alarms: RecordedAlarms | None = None
    """Detections that the recording marks as false alarms; None if it marks none."""


class RecordedDetections(NamedTuple):
    """Recorded detections of one sensor whose objects are unknown."""

    steps: Indices
    """Index ``(scans,)`` of each scan's time among the times of the ground truth; a scan may be empty."""
    scan: Indices
    """Index ``(detections,)`` of the scan that contains each detection."""
    measurement: Array
    """Measured values ``(m, detections)`` of each detection."""
    own_track: Indices
    """Number ``(detections,)`` of the sensor's own track to which it assigns each detection; -1 for none."""
    own_tracks: tuple[str, ...]


@dataclass(frozen=True)
class Observer:
    """Body that carries the sensors (the ego), at each step of the ground truth."""

    px: Array
    """Position ``(steps,)`` along x in the fixed frame, m."""
    py: Array
    """Position ``(steps,)`` along y in the fixed frame, m."""
    yaw: Array
    """Heading ``(steps,)``, rad, counter-clockwise from the fixed x axis."""
    vx: Array
    """Velocity ``(steps,)`` along x in the fixed frame, m/s."""
    vy: Array
    """Velocity ``(steps,)`` along y in the fixed frame, m/s."""
    yaw_rate: Array
    """Rate of change ``(steps,)`` of the heading, rad/s."""
    length: float = 0.0
    """Length of the body, m; 0 for a fixed point."""
    width: float = 0.0
    """Width of the body, m; 0 for a fixed point."""


class RecordedNoise(NamedTuple):
    """Standard deviations, along each axis, of the unknown errors of recorded positions and velocities."""

    position_m: float
    velocity_mps: float


EXACT = RecordedNoise(0.0, 0.0)


class Unscored(NamedTuple):
    """Regions where neither objects nor tracks are scored: beyond a range, and on boxes marked "don't care"."""

    range_m: float
    """Distance from the observer up to which objects and tracks are scored; infinite without a limit."""
    boxes: Array
    """Unscored boxes ``(7, boxes)``: start and end, s; centre x, y, m; heading, rad; half length and half width, m."""
    others: bool = False
    """Whether tracks that match no object are never scored, because objects without ground truth are present."""


#: Fields of a truth that are ``(steps, objects, runs)``.
KINEMATICS = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate")


@dataclass(frozen=True)
class Truth:
    """Motion of every object and of the observer, on a grid of times that is regular unless it was recorded.

    With known identities every object is a target. With hidden ones all objects cause detections and hide each other.
    Kinematic arrays are ``(steps, objects, runs)``, where the last axis has length 1 if the motion is the same in every
    run. Values where ``alive`` is False are finite but mean nothing.
    """

    time: Array
    """Times ``(steps,)`` of the grid, s, from 0."""
    ids: tuple[str, ...]
    px: Array
    """Position ``(steps, objects, runs or 1)`` of each object along x in the fixed frame, m."""
    py: Array
    """Position ``(steps, objects, runs or 1)`` of each object along y in the fixed frame, m."""
    heading: Array
    """Direction ``(steps, objects, runs or 1)`` in which each body points, rad, counter-clockwise from fixed x."""
    course: Array
    """Direction of motion ``(steps, objects, runs or 1)``, heading plus slip, rad, counter-clockwise from fixed x."""
    speed: Array
    """Speed ``(steps, objects, runs or 1)`` of each object along its direction of motion, m/s."""
    acceleration: Array
    """Rate of change ``(steps, objects, runs or 1)`` of each object's speed, m/s^2."""
    yaw_rate: Array
    """Rate of change ``(steps, objects, runs or 1)`` of each object's heading, rad/s."""
    alive: Mask
    """Mask ``(steps, objects)``, True while the object is in the scene."""
    length: Array
    """Length ``(objects,)`` of each body, m."""
    width: Array
    """Width ``(objects,)`` of each body, m."""
    observer: Observer
    roads: tuple[Array, ...] = ()
    """Lane edges to draw, each a line of x, y ``(points, 2)``, m."""
    source: dict[str, Any] = field(default_factory=dict)
    """Description of where the ground truth comes from, stored in the result (JSON values only)."""
    audit: dict[str, Any] = field(default_factory=dict)
    """Findings and corrections of the audit of a recording, stored in the result (JSON values only)."""
    target: Mask = field(default_factory=lambda: np.ones(0, dtype=bool))
    """Mask ``(objects,)``, True for an object that is to be tracked; default: all objects."""
    hiders: Truth | None = None
    """Objects, with known identities, that are not tracked but hide targets from sensors with ``occlusion``."""
    known: bool = True
    """Whether the true objects are known; False for a recording that has measurements but no objects."""
    recorded_noise: RecordedNoise = EXACT
    """Standard deviation of the error of recorded motion; 0 where the motion is exact."""
    unscored: Unscored | None = None
    """Regions where nothing is scored; None where objects and tracks are scored everywhere."""
    beside: Mask | None = None
    """Mask ``(steps, objects)``, True shortly before and after an object's recorded time: its motion is unknown there,
    and a track of it is neither right nor false."""
    start: Decimal = Decimal(0)
    """Reading of the recording's clock at time 0, s; other files may state times of this clock."""

    def __repr__(self) -> str:
        names = ", ".join(self.ids[:6]) + (", ..." if len(self.ids) > 6 else "")
        over = f"{len(self.time)} steps over {self.time[-1]:g} s" if len(self.time) else "no steps"
        return f"<truth: {len(self.ids)} objects ({names}), {over}>"

    def __post_init__(self) -> None:
        if len(self.target) != len(self.ids):
            object.__setattr__(self, "target", np.ones(len(self.ids), dtype=bool))

    def with_hiders(self) -> Truth:
        """Return the truth of the targets alone, with all other objects as ``hiders``."""
        rest = ~self.target
        return replace(self._select(self.target), hiders=self._select(rest)) if rest.any() else self

    def _select(self, chosen: Mask) -> Truth:
        return replace(
            self,
            ids=tuple(name for name, is_chosen in zip(self.ids, chosen, strict=True) if is_chosen),
            **{name: getattr(self, name)[:, chosen] for name in (*KINEMATICS, "alive")},
            beside=None if self.beside is None else self.beside[:, chosen],
            **{name: getattr(self, name)[chosen] for name in ("length", "width", "target")},
        )

    @property
    def vx(self) -> Array:
        """Velocity ``(steps, objects, runs)`` along x in the fixed frame, m/s."""
        return self.speed * np.cos(self.course)

    @property
    def vy(self) -> Array:
        """Velocity ``(steps, objects, runs)`` along y in the fixed frame, m/s."""
        return self.speed * np.sin(self.course)

    @property
    def state(self) -> Array:
        """True px, py, vx, vy ``(4, steps, objects, runs)``."""
        return np.stack([self.px, self.py, self.vx, self.vy])

    def state_of_run(self, run: int) -> Array:
        """Return the true px, py, vx, vy ``(4, steps, objects)`` in one run."""
        return np.stack([of_runs(each, range(run, run + 1))[..., 0] for each in (self.px, self.py, self.vx, self.vy)])
