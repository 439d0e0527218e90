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
    """Progress function that also takes a note on the work, such as "best 0.12"."""

    def __call__(self, done: float, total: float, note: str = "") -> None: ...


def no_progress(done: float, total: float, note: str = "") -> None:
    """Report no progress."""


def of_runs(values: npt.NDArray[T], runs: range) -> npt.NDArray[T]:
    """Take some runs of an array whose last axis is the runs, or has length 1 where all runs are alike."""
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
    """Return ``(K,)`` indices where a mask ``(batch,)`` holds, six times faster than ``np.flatnonzero`` for a few."""
    return where.nonzero()[0]


class Gaussian(NamedTuple):
    """Mean ``(n, ...)`` and its covariance ``(n, n, ...)``."""

    mean: Array
    covariance: Array

    def where(self, mask: Mask, other: Gaussian) -> Gaussian:
        """Take this Gaussian where the mask ``(...)`` holds, and the other one elsewhere."""
        return Gaussian(np.where(mask, self.mean, other.mean), np.where(mask, self.covariance, other.covariance))


class FieldOfView(NamedTuple):
    """Region in which a sensor can detect anything, in the sensor's frame."""

    half_angle: float
    """Largest angle to either side of the boresight, rad."""
    max_range: float
    """Largest range, m; infinite without a limit."""
    volume: float | None = None
    """Volume of the visible part of the measurement space, in units of a measurement; None if infinite. The expected
    number of false alarms in a scan is the clutter density times this volume."""


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
    """Type of the sensor: "radar", "lidar" or a plug-in's; "radar(range, azimuth)" if it measures only these."""
    measurement: Array
    """``(m, ...)``; NaN where not valid. Radar: range m, azimuth rad in the sensor's frame, range rate m/s relative to
    the moving sensor (speed radar: speed of the target over ground). Lidar: x, y in the sensor's frame, m."""
    valid: Mask
    """``(...)``: False where the sensor did not detect the object."""
    noise_covariance: Array
    """``(m, m)`` covariance of the measurement noise that the sensor states."""
    sensor_pose: Array
    """``(3,)`` x m, y m, yaw rad of the sensor in the fixed frame; ``(3, runs)`` where a built-in tracker of several
    objects takes runs of several scenes at once."""
    sensor_velocity: Array
    """``(2,)`` vx, vy of the sensor in the fixed frame, m/s; ``(2, runs)`` with a pose ``(3, runs)``."""
    arrival_time: float
    """Time at which the measurement reaches the tracker (``time`` plus the sensor's latency), s."""
    detection_probability: float | None = None
    """P_D of an object in the field of view as the sensor states it; None with known identities."""
    clutter_density: float | None = None
    """Expected false alarms per scan and unit volume of the measurement space; None with known identities."""
    field_of_view: FieldOfView | None = None
    """Region in which the sensor can detect anything; None with known identities."""
    asked: bool = False
    """True where no measurement has arrived and only the estimate at ``time`` is wanted. The tracker must not keep this
    prediction: measurements still on their way were taken earlier."""
    place: int = 0
    """Position of the sensor in the scenario, from 0; it orders scans of one time where none is late."""
    half_range_m: float | None = None
    """Range at which P_D is half of ``detection_probability``, m; None where P_D is constant over range."""

    def __repr__(self) -> str:
        valid = np.asarray(self.valid)
        late = f", arrived at {self.arrival_time:g} s" if self.arrival_time != self.time else ""
        seen = f"measurement {np.shape(self.measurement)}, {int(valid.sum())} of {valid.size} valid"
        return f"<scan of {self.sensor} ({self.kind}) at {self.time:g} s{late}: {seen}>"

    def prompt(self) -> Scan:
        """Return this scan with its arrival at the time of measurement."""
        return self._replace(arrival_time=self.time)


def scan_of_member(scan: Scan, member: int) -> Scan:
    """Return the scan of one member of a batch with known identities: ``measurement`` ``(m,)``."""
    return scan._replace(measurement=scan.measurement[:, member], valid=scan.valid[member])


def scan_of_run(scan: Scan, run: int) -> Scan:
    """Return the detections of one run of a batch with hidden identities, unpadded: ``measurement`` ``(m, D)``."""
    is_detection = scan.valid[:, run]
    measurement, valid = scan.measurement[:, is_detection, run], is_detection[is_detection]
    for values in (measurement, valid):
        # Several trackers read one scan, so none may change it.
        values.setflags(write=scan.measurement.flags.writeable)
    return with_sensor_of(scan, run, measurement=measurement, valid=valid)


def with_sensor_of(scan: Scan, run: Indices | int, **values: Any) -> Scan:
    """Return the scan with the sensor's pose and velocity in some runs ``(...)``, and other ``values`` replaced."""
    if scan.sensor_pose.ndim > 1:
        values["sensor_pose"] = scan.sensor_pose.take(run, axis=1)
        values["sensor_velocity"] = scan.sensor_velocity.take(run, axis=1)
    return scan._replace(**values) if values else scan


class Tracks(NamedTuple):
    """The K confirmed tracks of a multi-object tracker after a scan."""

    ids: Indices
    """``(K,)``; an id is never used again."""
    mean: Array
    """``(4, K)`` px, py, vx, vy in the fixed frame."""
    covariance: Array
    """``(4, 4, K)``."""
    existence: Array | None = None
    """``(K,)`` probability that the object exists."""
    used: Indices | None = None
    """``(K,)`` column of the detection that updated the track; -1 for a track without one."""

    def __repr__(self) -> str:
        shown = np.array2string(np.asarray(self.ids), threshold=12, separator=", ", max_line_width=1000)
        stated = [name for name in ("existence", "used") if getattr(self, name) is not None]
        return f"<tracks {shown}{''.join(f', {name}' for name in stated)}>"


class Estimate(NamedTuple):
    """Answer of a single-object tracker to a scan; only ``mean`` and ``covariance`` are required."""

    mean: Array
    """``(4, ...)`` px, py, vx, vy in the fixed frame."""
    covariance: Array
    """``(4, 4, ...)``."""
    state: Array | None = None
    """``(n, ...)`` state of the tracker, in its state space."""
    state_covariance: Array | None = None
    """``(n, n, ...)``."""
    innovation: Array | None = None
    """``(m, ...)`` measurement minus its prediction; ignored where the scan is not valid."""
    innovation_covariance: Array | None = None
    """``(m, m, ...)``."""
    whitened_innovation: Array | None = None
    """``(m, ...)`` ``L^-1`` times the innovation, where its covariance is ``L L^T``: saves the factorisation."""
    repaired: Mask | None = None
    """``(...)`` True where a covariance was not positive definite at this scan and was repaired."""
    mode_probabilities: Array | None = None
    """``(M, ...)`` probabilities of the motion models of a tracker with several."""
    log_likelihood: Array | None = None
    """``(...)`` logarithm of the measurement's density given all earlier arrivals; NaN without a prediction. Stated
    where that density is not the Gaussian of the innovation."""

    def __repr__(self) -> str:
        mean = np.asarray(self.mean)
        if mean.shape != (len(COMMON_STATE),):
            return f"<estimate: mean {mean.shape}, covariance {np.shape(self.covariance)}>"
        sigma = np.sqrt(np.diagonal(self.covariance))
        parts = (f"{n} {m:.4g} ±{s:.2g}" for n, m, s in zip(COMMON_STATE, mean, sigma, strict=True))
        return f"<estimate: {', '.join(parts)}>"


class RecordedAlarms(NamedTuple):
    """Detections of one sensor that a recording marks as false alarms."""

    scan: Indices
    """``(rows,)`` number of the scan of each detection."""
    measurement: Array
    """``(m, rows)`` measurement of each detection."""


class RecordedMeasurements(NamedTuple):
    """One sensor's recorded measurements, labelled with objects."""

    steps: Indices
    """``(scans,)`` indices into the times of the ground truth; a scan may be empty."""
    measurement: Array
    """``(m, scans, objects)``, NaN where not valid."""
    valid: Mask
    """``(scans, objects)``: False where the sensor did not detect the object."""
    cycle: Indices | None = None
    """``(scans,)`` number of the sensor's cycle, which may span several scans; None: each is one."""
    alarms: RecordedAlarms | None = None
    """Recorded false alarms of the sensor; None without any."""


class RecordedDetections(NamedTuple):
    """One sensor's recorded detections, not labelled with objects."""

    steps: Indices
    """``(scans,)`` indices into the times of the ground truth; a scan may be empty."""
    scan: Indices
    """``(rows,)`` number of the scan of each detection."""
    measurement: Array
    """``(m, rows)`` measurement of each detection."""
    own_track: Indices
    """``(rows,)`` number of the sensor's own track to which it assigns a detection; -1 for none."""
    own_tracks: tuple[str, ...]


@dataclass(frozen=True)
class Observer:
    """Body that carries the sensors (the ego), at each step of the ground truth."""

    px: Array
    """``(steps,)`` m."""
    py: Array
    """``(steps,)`` m."""
    yaw: Array
    """``(steps,)`` heading, rad."""
    vx: Array
    """``(steps,)`` m/s."""
    vy: Array
    """``(steps,)`` m/s."""
    yaw_rate: Array
    """``(steps,)`` rad/s."""
    length: float = 0.0
    """m; 0 for a fixed point."""
    width: float = 0.0
    """m; 0 for a fixed point."""


class RecordedNoise(NamedTuple):
    """Unknown error of recorded motion: standard deviation per axis."""

    position_m: float
    velocity_mps: float


EXACT = RecordedNoise(0.0, 0.0)


class Unscored(NamedTuple):
    """Regions where neither objects nor tracks are scored: out of range, and on don't-care boxes."""

    range_m: float
    """Distance from the observer up to which objects and tracks are scored; infinite without a limit."""
    boxes: Array
    """``(7, boxes)``: start and end, s; x, y, m; heading, rad; half length and half width, m."""
    others: bool = False
    """Whether tracks on no object are never scored, because objects without ground truth are present."""


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
    """``(steps,)`` s, from 0."""
    ids: tuple[str, ...]
    px: Array
    """Position along x in the fixed frame, m."""
    py: Array
    """Position along y in the fixed frame, m."""
    heading: Array
    """Direction in which the body points, rad."""
    course: Array
    """Direction of motion (heading plus slip angle), rad."""
    speed: Array
    """Speed along the course, m/s."""
    acceleration: Array
    """Rate of change of speed, m/s^2."""
    yaw_rate: Array
    """Rate of change of heading, rad/s."""
    alive: Mask
    """``(steps, objects)``: whether the object is in the scene."""
    length: Array
    """``(objects,)`` m."""
    width: Array
    """``(objects,)`` m."""
    observer: Observer
    roads: tuple[Array, ...] = ()
    """Lane edges to draw, each ``(points, 2)`` m."""
    source: dict[str, Any] = field(default_factory=dict)
    """Origin of the ground truth, for the result (JSON values only)."""
    audit: dict[str, Any] = field(default_factory=dict)
    """Findings and corrections of the audit, for the result (JSON values only)."""
    target: Mask = field(default_factory=lambda: np.ones(0, dtype=bool))
    """``(objects,)``: whether an object is to be tracked; default: all objects."""
    hiders: Truth | None = None
    """Objects, with known identities, that are no targets but hide targets from sensors with ``occlusion``."""
    known: bool = True
    """False where a recording has measurements but no objects."""
    recorded_noise: RecordedNoise = EXACT
    """Error of recorded motion; 0 where the motion is exact."""
    unscored: Unscored | None = None
    """Regions without scoring; None where objects and tracks are scored everywhere."""
    beside: Mask | None = None
    """``(steps, objects)`` True shortly before and after an object's recorded time: its motion is unknown there, and a
    track of it is neither right nor false."""
    start: Decimal = Decimal(0)
    """Time of the recording's clock at time 0, s; other files may state times of this clock."""

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
        """``(steps, objects, runs)`` m/s."""
        return self.speed * np.cos(self.course)

    @property
    def vy(self) -> Array:
        """``(steps, objects, runs)`` m/s."""
        return self.speed * np.sin(self.course)

    @property
    def state(self) -> Array:
        """``(4, steps, objects, runs)`` px, py, vx, vy."""
        return np.stack([self.px, self.py, self.vx, self.vy])

    def state_of_run(self, run: int) -> Array:
        """Return ``(4, steps, objects)`` px, py, vx, vy in one run."""
        return np.stack([of_runs(each, range(run, run + 1))[..., 0] for each in (self.px, self.py, self.vx, self.vy)])
