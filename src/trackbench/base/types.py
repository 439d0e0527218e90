"""The values that travel between the layers.

Arrays put component axes first and batch axes last: a state is ``(n, ...)``, a covariance ``(n, n, ...)``, a
measurement ``(m, ...)``. The trailing axes are whatever runs in parallel (Monte-Carlo runs, objects) or nothing.
SI units and radians throughout; angles are counter-clockwise.
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
#: Called, often, with how much of some work is done and how much there is.
Progress = Callable[[float, float], None]


class NotedProgress(Protocol):
    """The same, which may say what was reached, such as "best 0.12"."""

    def __call__(self, done: float, total: float, note: str = "") -> None: ...


def no_progress(done: float, total: float, note: str = "") -> None:
    """Report no progress."""


def of_runs(values: npt.NDArray[T], runs: range) -> npt.NDArray[T]:
    """Some runs of an array whose last axis is the runs, or has length 1 where all are alike."""
    return values if values.shape[-1] == 1 else values[..., runs.start : runs.stop]


#: Two times that differ by less are the same, s: times are sums of periods, which are not exact.
SAME_TIME = 1e-9
#: Status of an object at an instant: not in the scene; there, but a tracker need not have it; a tracker has to have it.
ABSENT, OPTIONAL, DUE = 0, 1, 2
#: Object number of a false alarm.
FALSE_ALARM = -1
#: In place of an object's number: a recorded detection of which nothing says what caused it.
UNKNOWN_ORIGIN = -3

#: The space in which trackers of different state are compared, in the fixed frame.
COMMON_STATE = ("px", "py", "vx", "vy")


def indices(where: npt.NDArray[Any]) -> Indices:
    """``(K,)`` where a mask ``(batch,)`` holds: ``np.flatnonzero``, which takes six times as long for a few."""
    return where.nonzero()[0]


class Gaussian(NamedTuple):
    """A mean ``(n, ...)`` and its covariance ``(n, n, ...)``."""

    mean: Array
    covariance: Array

    def where(self, mask: Mask, other: Gaussian) -> Gaussian:
        """This one where the mask ``(...)`` holds, the other one elsewhere."""
        return Gaussian(np.where(mask, self.mean, other.mean), np.where(mask, self.covariance, other.covariance))


class FieldOfView(NamedTuple):
    """Where a sensor can detect anything, in its own frame."""

    half_angle: float
    """To either side of the boresight, rad."""
    max_range: float
    """m; infinite where there is no limit."""
    volume: float | None = None
    """Of the part of the measurement space that is in view, in the units of a measurement: the expected number of false
    alarms in a scan is the clutter density times this. None where it has no end."""


class Scan(NamedTuple):
    """One sensor's measurements at one instant: what a real tracker would know, and nothing of the truth.

    With known identities the trailing axes of ``measurement`` and ``valid`` are the objects. With hidden ones there is
    one trailing axis, of the D detections, whose order means nothing, and D may be 0; in a batch of runs a second one,
    where D is that of the run with most of them: in the others, columns of NaN that are not valid come last.
    """

    time: float
    """When the measurement was taken, s."""
    sensor: str
    """The sensor's name in the scenario."""
    kind: str
    """The type of the sensor, "radar", "lidar" or that of a plug-in; "radar(range, azimuth)" where it measures less."""
    measurement: Array
    """``(m, ...)``. Radar: range m, azimuth rad in the sensor's frame, range rate m/s relative to the moving
    sensor (speed radar: speed of the target over ground). Lidar: x, y in the sensor's frame, m. NaN where not valid."""
    valid: Mask
    """``(...)``: False where the sensor did not detect the object."""
    noise_covariance: Array
    """``(m, m)`` covariance of the measurement noise that the sensor states."""
    sensor_pose: Array
    """``(3,)`` x m, y m, yaw rad of the sensor in the fixed frame; ``(3, runs)`` where a built-in tracker of several
    objects takes runs of several scenes at once, and the velocity ``(2, runs)``."""
    sensor_velocity: Array
    """``(2,)`` vx, vy of the sensor in the fixed frame, m/s."""
    arrival_time: float
    """When the measurement reached the tracker (``time`` plus the sensor's latency), s."""
    detection_probability: float | None = None
    """Of an object in the field of view, as the sensor states it; None where identities are known, as the next two."""
    clutter_density: float | None = None
    """Detections that stem from no object, per unit volume of the measurement space and scan, as the sensor states."""
    field_of_view: FieldOfView | None = None
    """Where the sensor can detect anything."""
    asked: bool = False
    """True where no measurement has arrived and the estimate at ``time`` is asked for. What is predicted for it is not
    to be kept: measurements that are still on their way were taken earlier."""
    place: int = 0
    """Of the sensor in the scenario, from 0. Scans of one time are in this order where none is late."""
    half_range_m: float | None = None
    """Range at which half of ``detection_probability`` holds, m; None where it is the same at all ranges."""

    def __repr__(self) -> str:
        valid = np.asarray(self.valid)
        late = f", arrived at {self.arrival_time:g} s" if self.arrival_time != self.time else ""
        seen = f"measurement {np.shape(self.measurement)}, {int(valid.sum())} of {valid.size} valid"
        return f"<scan of {self.sensor} ({self.kind}) at {self.time:g} s{late}: {seen}>"

    def prompt(self) -> Scan:
        """The same scan, arrived when it was taken."""
        return self._replace(arrival_time=self.time)


def scan_of_member(scan: Scan, member: int) -> Scan:
    """With known identities the scan of one member of a batch: ``measurement`` ``(m,)``."""
    return scan._replace(measurement=scan.measurement[:, member], valid=scan.valid[member])


def scan_of_run(scan: Scan, run: int) -> Scan:
    """With hidden identities the detections of one run of a batch, without padding: ``measurement`` ``(m, D)``."""
    there = scan.valid[:, run]
    measurement, valid = scan.measurement[:, there, run], there[there]
    for values in (measurement, valid):
        # What one tracker must not change of what the next one reads.
        values.setflags(write=scan.measurement.flags.writeable)
    return with_sensor_of(scan, run, measurement=measurement, valid=valid)


def with_sensor_of(scan: Scan, run: Indices | int, **values: Any) -> Scan:
    """The scan with the sensor's pose ``(3, ...)`` and velocity ``(2, ...)`` in each of some runs ``(...)``; as it is
    where the sensor is the same in all. ``values``: what else of the scan is replaced."""
    if scan.sensor_pose.ndim > 1:
        values["sensor_pose"] = scan.sensor_pose.take(run, axis=1)
        values["sensor_velocity"] = scan.sensor_velocity.take(run, axis=1)
    return scan._replace(**values) if values else scan


class Tracks(NamedTuple):
    """What a tracker of several objects says after a scan: its K confirmed tracks."""

    ids: Indices
    """``(K,)``; an id is never used again."""
    mean: Array
    """``(4, K)`` px, py, vx, vy in the fixed frame."""
    covariance: Array
    """``(4, 4, K)``."""
    existence: Array | None = None
    """``(K,)`` probability that the object exists."""
    used: Indices | None = None
    """``(K,)`` the detection's column that the track took in; -1 where it took none."""

    def __repr__(self) -> str:
        shown = np.array2string(np.asarray(self.ids), threshold=12, separator=", ", max_line_width=1000)
        stated = [name for name in ("existence", "used") if getattr(self, name) is not None]
        return f"<tracks {shown}{''.join(f', {name}' for name in stated)}>"


class Estimate(NamedTuple):
    """What a tracker says after a scan. Only ``mean`` and ``covariance`` are required."""

    mean: Array
    """``(4, ...)`` px, py, vx, vy in the fixed frame."""
    covariance: Array
    """``(4, 4, ...)``."""
    state: Array | None = None
    """``(n, ...)`` the tracker's own state."""
    state_covariance: Array | None = None
    """``(n, n, ...)``."""
    innovation: Array | None = None
    """``(m, ...)`` measurement minus its prediction; ignored where the scan is not valid."""
    innovation_covariance: Array | None = None
    """``(m, m, ...)``."""
    whitened_innovation: Array | None = None
    """``(m, ...)`` ``L^-1`` times the innovation, where its covariance is ``L L^T``: saves computing it again."""
    repaired: Mask | None = None
    """``(...)`` True where a covariance had to be made positive definite again at this scan."""
    mode_probabilities: Array | None = None
    """``(M, ...)`` of each motion model of a tracker with several."""
    log_likelihood: Array | None = None
    """``(...)`` logarithm of the density of the measurement given all that arrived before it, where that is not the
    Gaussian of the innovation; NaN where there was no prediction."""

    def __repr__(self) -> str:
        mean = np.asarray(self.mean)
        if mean.shape != (len(COMMON_STATE),):
            return f"<estimate: mean {mean.shape}, covariance {np.shape(self.covariance)}>"
        sigma = np.sqrt(np.diagonal(self.covariance))
        parts = (f"{n} {m:.4g} ±{s:.2g}" for n, m, s in zip(COMMON_STATE, mean, sigma, strict=True))
        return f"<estimate: {', '.join(parts)}>"


class RecordedAlarms(NamedTuple):
    """Detections of one sensor of which a recording says that they are of no object."""

    scan: Indices
    """``(rows,)`` number of the scan of each."""
    measurement: Array
    """``(m, rows)``."""


class RecordedMeasurements(NamedTuple):
    """What one sensor read, where its measurements come from a recording instead of being synthesised."""

    steps: Indices
    """``(scans,)`` indices into the truth's times; a scan may have detected nothing."""
    measurement: Array
    """``(m, scans, objects)``, NaN where not valid."""
    valid: Mask
    """``(scans, objects)``: False where the sensor did not detect the object."""
    cycle: Indices | None = None
    """``(scans,)`` the number of the sensor's cycle, which may give its detections at several instants; each scan is a
    cycle of its own unless given."""
    alarms: RecordedAlarms | None = None
    """What it detected beside the objects."""


class RecordedDetections(NamedTuple):
    """What one sensor detected, where nothing says of which object a detection is."""

    steps: Indices
    """``(scans,)`` indices into the truth's times; a scan may have detected nothing."""
    scan: Indices
    """``(rows,)`` number of the scan of each detection."""
    measurement: Array
    """``(m, rows)``."""
    own_track: Indices
    """``(rows,)`` number of the sensor's own track that it says a detection is of; -1 where it says nothing."""
    own_tracks: tuple[str, ...]
    """A name for each."""


@dataclass(frozen=True)
class Observer:
    """The body that carries the sensors, at each step of the truth."""

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
    """How far recorded motion may be from the true one, which is not known: standard deviation per axis."""

    position_m: float
    velocity_mps: float


EXACT = RecordedNoise(0.0, 0.0)


class Unscored(NamedTuple):
    """Where neither an object nor a track counts: out of range, and on don't-care boxes."""

    range_m: float
    """From the observer, up to which they count; infinite where there is no limit."""
    boxes: Array
    """``(7, boxes)`` from when to when, s; x, y, m; heading, rad; half length and half width, m."""
    others: bool = False
    """Whether tracks on no object count nowhere, since objects without a truth are there too."""


#: The arrays of a truth that are ``(steps, objects, runs)``.
KINEMATICS = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate")


@dataclass(frozen=True)
class Truth:
    """The motion of every object and of the observer, on a grid of times that is regular unless it was recorded.

    With known identities every object is a target. With hidden ones all objects cause detections and hide each other.

    Kinematic arrays are ``(steps, objects, runs)``, where the last axis has length 1 if the motion is the same in
    every run. Values where ``alive`` is False are finite but mean nothing.
    """

    time: Array
    """``(steps,)`` s, from 0."""
    ids: tuple[str, ...]
    """A name for each object."""
    px: Array
    """m."""
    py: Array
    """m."""
    heading: Array
    """Direction in which the body points, rad."""
    course: Array
    """Direction in which it moves (heading plus slip angle), rad."""
    speed: Array
    """Along the course, m/s."""
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
    """Where the truth came from, as it goes into the result (JSON values only)."""
    audit: dict[str, Any] = field(default_factory=dict)
    """What the audit found and did, as it goes into the result (JSON values only)."""
    target: Mask = field(default_factory=lambda: np.ones(0, dtype=bool))
    """``(objects,)``: whether tracks of it are wanted; all unless given."""
    hiders: Truth | None = None
    """With known identities: the objects that are no targets and hide them from sensors with ``occlusion``."""
    known: bool = True
    """False where a recording has measurements alone: no object is known then."""
    recorded_noise: RecordedNoise = EXACT
    """The noise of recorded motion; 0 where the motion is exact."""
    unscored: Unscored | None = None
    """None where objects and tracks count everywhere."""
    beside: Mask | None = None
    """``(steps, objects)`` where it is just before or after its time: a track of it is neither right nor false there,
    and its motion is not known."""
    start: Decimal = Decimal(0)
    """s of the recording's clock at time 0: other files may state times of the same clock."""

    def __repr__(self) -> str:
        names = ", ".join(self.ids[:6]) + (", ..." if len(self.ids) > 6 else "")
        over = f"{len(self.time)} steps over {self.time[-1]:g} s" if len(self.time) else "no steps"
        return f"<truth: {len(self.ids)} objects ({names}), {over}>"

    def __post_init__(self) -> None:
        if len(self.target) != len(self.ids):
            object.__setattr__(self, "target", np.ones(len(self.ids), dtype=bool))

    def with_hiders(self) -> Truth:
        """Its targets alone, and what else there is as ``hiders``."""
        rest = ~self.target
        return replace(self._of(self.target), hiders=self._of(rest)) if rest.any() else self

    def _of(self, chosen: Mask) -> Truth:
        return replace(
            self,
            ids=tuple(name for name, kept in zip(self.ids, chosen, strict=True) if kept),
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
        """``(4, steps, objects)`` in one run."""
        return np.stack([of_runs(each, range(run, run + 1))[..., 0] for each in (self.px, self.py, self.vx, self.vy)])
