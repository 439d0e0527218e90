"""Examines trackers of several objects: short scenes with known answers, each of which shows one kind of fault.

A scene has objects that move straight and steadily about a sensor at rest. The checks are in ``traffic_checks/``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Array, FieldOfView, Progress, Scan, Tracks, no_progress
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.findings import (
    SURE,
    TRAFFIC_CHECKS,
    CheckResult,
    DoctorCheck,
    Finding,
    PartResult,
    checks_of,
    faults_of,
    rank_findings,
)
from trackbench.subjects.doctor.isolated import filter_examined
from trackbench.subjects.doctor.output_checks import quiet
from trackbench.subjects.doctor.probes import simplified
from trackbench.subjects.doctor.report import Examination
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE, tracks_of_run

#: Of the sensor, Hz; its range, m; and what it states: detection probability, false alarms a scan.
RATE, RANGE, DETECTION, FALSE_ALARMS = 20.0, 150.0, 0.9, 2.0
#: px, py m, vx, vy m/s, far from each other.
OBJECTS = np.array([[60.0, 30, -8, 2], [-50, 40, 6, -3], [20, -60, 1, 9]]).T
#: A track this near to an object is on it, m.
NEAR = 5.0
#: What a failed step is called by the words of its error.
FAILURES = {NOT_DEFINITE: "covariance_not_psd", NOT_FINITE: "nonfinite"}
#: Gives a fresh tracker.
Make = Callable[[], Any]


@dataclass(frozen=True)
class Site:
    """A sensor at rest, at the origin."""

    name: str
    sensor: Sensor

    def detections(self, objects: Array, time: float = 0.0, random: np.random.Generator | None = None) -> Array:
        """``(m, n)`` measurements of objects ``(4, n)`` that were there at time 0; without ``random`` without noise."""
        ideal = self.sensor.measure(moved_objects(objects, time), np.zeros(3), np.zeros(2))
        if random is None:
            return ideal
        return ideal + np.array(self.sensor.sigmas())[:, None] * random.standard_normal(ideal.shape)

    def scan(self, time: float, detections: Array, random: np.random.Generator) -> Scan:
        """Detections ``(m, D)`` in a random order."""
        order = random.permutation(detections.shape[1])
        return Scan(
            time=time,
            sensor=self.name,
            kind=self.sensor.type,
            measurement=detections[:, order],
            valid=np.ones(len(order), dtype=bool),
            noise_covariance=self.sensor.noise_covariance(),
            sensor_pose=np.zeros(3),
            sensor_velocity=np.zeros(2),
            arrival_time=time,
            detection_probability=DETECTION,
            clutter_density=FALSE_ALARMS
            / self.sensor.model_copy(update={"max_range_m": RANGE, "fov_deg": 360.0}).volume(),
            field_of_view=FieldOfView(np.pi, RANGE),
        )

    def scans(
        self,
        objects: Array,
        seconds: float,
        random: np.random.Generator | None = None,
        *,
        start: float = 0.0,
        origin: float = 0.0,
    ) -> list[Scan]:
        """Every object ``(4, n)`` detected in every scan.

        Args:
            objects: where they are ``start`` seconds before the first scan.
            seconds: length.
            random: of the noise and of the order of the detections; None: without noise.
            start: time of the first scan after ``origin``, s.
            origin: time at which the objects are where they are, s.
        """
        times = start + np.arange(round(seconds * RATE)) / RATE
        order = random or np.random.default_rng(0)
        return [self.scan(float(t) + origin, self.detections(objects, float(t), random), order) for t in times]

    def expected(self, tracks: Tracks, column: int) -> tuple[Array, Array, Array]:
        """The measurement that a track expects at its own time, its covariance, and the gain of a Kalman filter."""
        mean, prior = tracks.mean[:, column], tracks.covariance[:, :, column]
        slope = self.sensor.jacobian(mean, np.zeros(3), np.zeros(2))
        covariance = slope @ prior @ slope.T + self.sensor.noise_covariance()
        gain = np.asarray(np.linalg.solve(covariance, slope @ prior).T, dtype=float)
        return self.detections(mean), covariance, gain


class MultiObjectSession:
    """A tracker on its way through scans."""

    def __init__(self, make: Make) -> None:
        self._tracker, self._state = make(), None

    def step(self, scan: Scan) -> Tracks:
        """The tracks after a scan."""
        batch = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
        self._state, tracks = self._tracker.step(self._state, batch)
        return tracks_of_run(tracks, 0)

    def follow(self, scans: Sequence[Scan]) -> list[Tracks]:
        """The tracks after each scan."""
        return [self.step(scan) for scan in scans]


@dataclass(frozen=True)
class FollowedTrack:
    """The track of an object after some scans; what another scan does to it is tried on a fresh tracker."""

    make: Make
    site: Site
    scans: Sequence[Scan]
    tracks: Tracks
    column: int

    @classmethod
    def of_object(cls, make: Make, site: Site, target: Array, seconds: float) -> Self | None:
        """After scans without noise of one object ``(4,)``; None where it has no track."""
        scans = site.scans(target[:, None], seconds)
        tracks = MultiObjectSession(make).follow(scans)[-1]
        column = column_of_nearest(tracks, moved_objects(target, scans[-1].time))
        return None if column is None else cls(make, site, scans, tracks, column)

    @property
    def mean(self) -> Array:
        """``(4,)``"""
        return self.tracks.mean[:, self.column]

    def after_scan(self, scan: Scan) -> tuple[Array, Array] | None:
        """Mean and covariance after one more scan; None where the track has ended."""
        tracks = MultiObjectSession(self.make).follow([*self.scans, scan])[-1]
        same = np.flatnonzero(tracks.ids == self.tracks.ids[self.column])
        return (tracks.mean[:, same[0]], tracks.covariance[:, :, same[0]]) if len(same) else None


def with_detections(scan: Scan, detections: Array) -> Scan:
    """The scan with other detections ``(m, D)``."""
    return scan._replace(measurement=detections, valid=np.ones(detections.shape[1], dtype=bool))


def column_of_nearest(tracks: Tracks, position: Array) -> int | None:
    """The column of the track that is on an object at ``(2,)``; None: there is none."""
    away = distances(tracks, position[:2, None])[:, 0]
    return int(np.argmin(away)) if len(away) and away.min() < NEAR else None


def moved_objects(objects: Array, time: float) -> Array:
    """Objects ``(4, ...)`` some time later."""
    return np.concatenate([objects[:2] + objects[2:] * time, objects[2:]])


def distances(tracks: Tracks, positions: Array) -> Array:
    """``(K, n)`` m, of tracks to positions ``(2, n)``."""
    away = tracks.mean[:2, :, None] - positions[:2, None, :]
    return np.asarray(np.hypot(away[0], away[1]))


class TrafficDoctor:
    """Examines trackers of several objects with sensors mounted at the origin that see all around.

    Args:
        sensors: by name; of each kind the first one is used, its kind and noise.

    Raises:
        InputError: none has a field of view with a volume.
    """

    def __init__(self, sensors: Mapping[str, Sensor]) -> None:
        kinds: dict[str, Site] = {}
        for name, sensor in sensors.items():
            if type(sensor).volume is not Sensor.volume:
                kinds.setdefault(sensor.type, Site(name, simplified(sensor)))
        if not kinds:
            raise InputError("no sensor of it has a field of view with a volume, which clutter needs", key="sensors")
        self._sites = list(kinds.values())

    @one_blas_thread()
    @quiet()
    def examine(self, name: str, make: Make, progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker, with each sensor whose detections alone give it tracks.

        Args:
            name: what it is called in the results.
            make: gives a fresh tracker.
            progress: called after each scene with the number of scenes done and of all scenes.

        Raises:
            CannotRun: the tracker fails at the detections of one object, or its process ends.
        """
        used = [site for site in self._sites if _begins(make, site)] or self._sites[:1]
        records = checks_of(TRAFFIC_CHECKS)
        scenes = [(record, [site]) for site in used for record in records if record.least_sensors == 1]
        scenes += [(record, used) for record in records if 1 < record.least_sensors <= len(used)]
        why = "no track comes of its detections alone; nothing was tried with it"
        question = "Does an object that this sensor detects become a track?"
        left_out = [site.name for site in self._sites if site not in used]
        checks = [CheckResult(f"confirmation.{sensor}", question, None, why) for sensor in left_out]
        findings: dict[str, list[Finding]] = {}
        for done, (record, sites) in enumerate(scenes, start=1):
            try:
                result = record.make(make, sites[0] if record.least_sensors == 1 else sites)
            except Exception as error:
                result = _failed(record, fault_of(error))
            # A check with one of several sensors names it.
            sensor = sites[0].name if len(sites) < len(used) else None
            ending = "" if sensor is None else f".{sensor}"
            asks = {question.name: question.asks for question in record.questions}
            checks += [replace(check, name=check.name + ending, question=asks[check.name]) for check in result.checks]
            for finding in result.findings:
                findings.setdefault(finding.fault, []).append(replace(finding, sensor=sensor))
            progress(done, len(scenes) + 1)
        # Each fault once; of no sensor in particular where all show it.
        once = [
            replace(same[0], sensor=None) if len({finding.sensor for finding in same}) >= len(used) else same[0]
            for same in findings.values()
        ]
        of_filter, filter_findings = filter_examined({site.name: site.sensor for site in used}, make)
        progress(len(scenes) + 1, len(scenes) + 1)
        # Some faults of a filter show in a scene of several detections alone.
        of_tracks = [finding for finding in once if finding.fault in faults_of(TRAFFIC_CHECKS)]
        filter_findings += [finding for finding in once if finding not in of_tracks]
        return Examination(name, ranked_together(filter_findings, of_tracks), [*checks, *of_filter])


def ranked_together(of_filter: Sequence[Finding], of_tracks: Sequence[Finding]) -> list[Finding]:
    """Rank the findings of a filter, which is examined without association, before those of its tracks.

    A sure finding of the filter explains all findings of the tracks.
    """
    faults = {finding.fault for finding in of_tracks}
    if "empty_scan_not_predicted" in faults:
        of_filter = [finding for finding in of_filter if not _stands_still(finding)]
    first, tracks = rank_findings(of_filter), rank_findings(of_tracks)
    if not first or first[0].confidence < SURE:
        return sorted([*tracks, *first], key=lambda finding: finding.consequence_of is not None)
    return [*first, *(replace(finding, consequence_of=finding.consequence_of or first[0].fault) for finding in tracks)]


def _stands_still(finding: Finding) -> bool:
    """Whether it says that the track of a filter stays where it is at a missed scan."""
    no_step = finding.fault == "wrong_dt" and finding.factor == 0.0
    return no_step or finding.fault == "missed_scan_not_predicted"


def _begins(make: Make, site: Site) -> bool:
    """Whether detections of one object make a track at all.

    Raises:
        CannotRun: the tracker fails.
    """
    session = MultiObjectSession(make)
    try:
        return any(len(session.step(scan).ids) for scan in site.scans(OBJECTS[:, :1], 4.0))
    except Exception as error:
        raise CannotRun(f"at the detections of one object: {fault_of(error)}") from error


def _failed(record: DoctorCheck[Any], fault: TrackFault) -> PartResult:
    """What a failure in a scene is called.

    Raises:
        CannotRun: the tracker's process ended.
    """
    if fault.kind == "died":
        raise CannotRun(f"in the scene {record.name}: {fault}")
    name = "invalid_estimate" if fault.kind == "answer" else "exception_raised"
    for words, other in FAILURES.items():
        if words in fault.cause:
            name = other
    text = f"the tracker fails in it: {fault}"
    return PartResult().add(record.questions[0].name, False, text, Finding(name, 0.95, f"In {record.name}: {fault}."))
