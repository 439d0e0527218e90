"""Examiner of trackers of several objects: short scenes with known answers, each for one kind of fault.

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
from trackbench.subjects.doctor.isolated import examine_filter
from trackbench.subjects.doctor.output_checks import without_warnings
from trackbench.subjects.doctor.probes import simplified
from trackbench.subjects.doctor.report import Examination
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE, tracks_of_run

#: Rate of the sensor, Hz; its range, m; its stated detection probability; its stated number of false alarms a scan.
RATE, RANGE, DETECTION, FALSE_ALARMS = 20.0, 150.0, 0.9, 2.0
#: px, py, vx, vy of objects far from each other, m and m/s.
OBJECTS = np.array([[60.0, 30, -8, 2], [-50, 40, 6, -3], [20, -60, 1, 9]]).T
#: Distance from an object within which a track is on it, m.
NEAR = 5.0
#: Fault of a failed step by words of its error.
FAILURES = {NOT_DEFINITE: "covariance_not_psd", NOT_FINITE: "nonfinite"}
#: Makes a fresh tracker.
Make = Callable[[], Any]


@dataclass(frozen=True)
class Site:
    """A sensor at rest at the origin of the fixed frame, and the scans that it makes of objects."""

    name: str
    sensor: Sensor

    def detections(self, objects: Array, time: float = 0.0, random: np.random.Generator | None = None) -> Array:
        """Return measurements ``(m, n)`` at ``time`` s of objects ``(4, n)`` at 0 s; exact without ``random``."""
        ideal = self.sensor.measure(moved_objects(objects, time), np.zeros(3), np.zeros(2))
        if random is None:
            return ideal
        return ideal + np.array(self.sensor.sigmas())[:, None] * random.standard_normal(ideal.shape)

    def scan(self, time: float, detections: Array, random: np.random.Generator) -> Scan:
        """Return a scan with detections ``(m, D)`` in a random order."""
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
        """Return scans that detect every object ``(4, n)``.

        Args:
            objects: px, py, vx, vy of the objects at the time ``origin``.
            seconds: duration, s.
            random: source of the noise and of the order of the detections; None for no noise.
            start: time from ``origin`` to the first scan, s.
            origin: time at which ``objects`` holds, s.
        """
        times = start + np.arange(round(seconds * RATE)) / RATE
        order = random or np.random.default_rng(0)
        return [self.scan(float(t) + origin, self.detections(objects, float(t), random), order) for t in times]

    def expected(self, tracks: Tracks, column: int) -> tuple[Array, Array, Array]:
        """Return predicted measurement ``(m,)``, innovation covariance ``(m, m)`` and gain ``(4, m)`` of a track."""
        mean, prior = tracks.mean[:, column], tracks.covariance[:, :, column]
        slope = self.sensor.jacobian(mean, np.zeros(3), np.zeros(2))
        covariance = slope @ prior @ slope.T + self.sensor.noise_covariance()
        gain = np.asarray(np.linalg.solve(covariance, slope @ prior).T, dtype=float)
        return self.detections(mean), covariance, gain


class MultiObjectSession:
    """A fresh tracker of several objects, with its state between scans."""

    def __init__(self, make: Make) -> None:
        self._tracker, self._state = make(), None

    def step(self, scan: Scan) -> Tracks:
        """Return the tracks that the tracker reports after a scan."""
        batch = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
        self._state, tracks = self._tracker.step(self._state, batch)
        return tracks_of_run(tracks, 0)

    def follow(self, scans: Sequence[Scan]) -> list[Tracks]:
        """Return the tracks after each scan."""
        return [self.step(scan) for scan in scans]


@dataclass(frozen=True)
class FollowedTrack:
    """Track of an object after ``scans``; a further scan is tried by giving all scans to a fresh tracker."""

    make: Make
    site: Site
    scans: Sequence[Scan]
    tracks: Tracks
    column: int

    @classmethod
    def of_object(cls, make: Make, site: Site, target: Array, seconds: float) -> Self | None:
        """Return the track after noise-free scans of one object ``(4,)``; None where the object has no track."""
        scans = site.scans(target[:, None], seconds)
        tracks = MultiObjectSession(make).follow(scans)[-1]
        column = column_of_nearest(tracks, moved_objects(target, scans[-1].time))
        return None if column is None else cls(make, site, scans, tracks, column)

    @property
    def mean(self) -> Array:
        """px, py, vx, vy of the track ``(4,)``."""
        return self.tracks.mean[:, self.column]

    def after_scan(self, scan: Scan) -> tuple[Array, Array] | None:
        """Return mean and covariance after one more scan; None where the track has ended."""
        tracks = MultiObjectSession(self.make).follow([*self.scans, scan])[-1]
        same = np.flatnonzero(tracks.ids == self.tracks.ids[self.column])
        return (tracks.mean[:, same[0]], tracks.covariance[:, :, same[0]]) if len(same) else None


def with_detections(scan: Scan, detections: Array) -> Scan:
    """Return the scan with its detections replaced by ``detections`` ``(m, D)``."""
    return scan._replace(measurement=detections, valid=np.ones(detections.shape[1], dtype=bool))


def column_of_nearest(tracks: Tracks, position: Array) -> int | None:
    """Return the index of the track nearest to a position ``(2,)``; None where no track is within 5 m."""
    distance = distances(tracks, position[:2, None])[:, 0]
    return int(np.argmin(distance)) if len(distance) and distance.min() < NEAR else None


def moved_objects(objects: Array, time: float) -> Array:
    """Return the states ``(4, ...)`` of objects after ``time`` s at constant velocity."""
    return np.concatenate([objects[:2] + objects[2:] * time, objects[2:]])


def distances(tracks: Tracks, positions: Array) -> Array:
    """Return the distances ``(K, n)``, m, of K tracks from n positions ``(2, n)``."""
    difference = tracks.mean[:2, :, None] - positions[:2, None, :]
    return np.asarray(np.hypot(difference[0], difference[1]))


class TrafficDoctor:
    """Examiner of trackers of several objects with sensors mounted at the origin that see all around.

    Args:
        sensors: sensors by name; kind and noise of the first sensor of each kind are used.

    Raises:
        InputError: no sensor has a field of view with a volume.
    """

    def __init__(self, sensors: Mapping[str, Sensor]) -> None:
        kinds: dict[str, Site] = {}
        for name, sensor in sensors.items():
            if type(sensor).volume is not Sensor.volume:
                kinds.setdefault(sensor.type, Site(name, simplified(sensor)))
        if not kinds:
            raise InputError("clutter needs a field of view with a volume, which no sensor has", key="sensors")
        self._sites = list(kinds.values())

    @one_blas_thread()
    @without_warnings()
    def examine(self, name: str, make: Make, progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker, with each sensor whose detections alone give it tracks.

        Args:
            name: name of the tracker in the results.
            make: makes a fresh tracker.
            progress: called after each scene with the number of scenes done and of all scenes.

        Raises:
            CannotRun: the tracker fails at the detections of one object, or its process ends.
        """
        used = [site for site in self._sites if _starts_track(make, site)] or self._sites[:1]
        records = checks_of(TRAFFIC_CHECKS)
        scenes = [(record, [site]) for site in used for record in records if record.least_sensors == 1]
        scenes += [(record, used) for record in records if 1 < record.least_sensors <= len(used)]
        reason = "its detections alone start no track, so nothing was tried with it"
        question = "Does an object that this sensor detects become a track?"
        left_out = [site.name for site in self._sites if site not in used]
        checks = [CheckResult(f"confirmation.{sensor}", question, None, reason) for sensor in left_out]
        findings: dict[str, list[Finding]] = {}
        for done, (record, sites) in enumerate(scenes, start=1):
            try:
                result = record.make(make, sites[0] if record.least_sensors == 1 else sites)
            except Exception as error:
                result = _failed_scene(record, fault_of(error))
            # A check made with one of several sensors has the sensor's name.
            sensor = sites[0].name if len(sites) < len(used) else None
            ending = "" if sensor is None else f".{sensor}"
            asks = {question.name: question.asks for question in record.questions}
            checks += [replace(check, name=check.name + ending, question=asks[check.name]) for check in result.checks]
            for finding in result.findings:
                findings.setdefault(finding.fault, []).append(replace(finding, sensor=sensor))
            progress(done, len(scenes) + 1)
        # Each fault is found once; without a sensor where all sensors show it.
        unique = [
            replace(group[0], sensor=None) if len({finding.sensor for finding in group}) >= len(used) else group[0]
            for group in findings.values()
        ]
        filter_checks, filter_findings = examine_filter({site.name: site.sensor for site in used}, make)
        progress(len(scenes) + 1, len(scenes) + 1)
        # Some faults of a filter show only in a scene of several detections.
        track_findings = [finding for finding in unique if finding.fault in faults_of(TRAFFIC_CHECKS)]
        filter_findings += [finding for finding in unique if finding not in track_findings]
        return Examination(name, rank_together(filter_findings, track_findings), [*checks, *filter_checks])


def rank_together(of_filter: Sequence[Finding], of_tracks: Sequence[Finding]) -> list[Finding]:
    """Rank the faults of the filter within each track before faults of association, birth and deletion.

    A sure finding about the filter becomes the cause of all findings about the tracks.
    """
    faults = {finding.fault for finding in of_tracks}
    if "empty_scan_not_predicted" in faults:
        of_filter = [finding for finding in of_filter if not _track_stands_still(finding)]
    first, tracks = rank_findings(of_filter), rank_findings(of_tracks)
    if not first or first[0].confidence < SURE:
        return sorted([*tracks, *first], key=lambda finding: finding.consequence_of is not None)
    return [*first, *(replace(finding, consequence_of=finding.consequence_of or first[0].fault) for finding in tracks)]


def _track_stands_still(finding: Finding) -> bool:
    no_step = finding.fault == "wrong_dt" and finding.factor == 0.0
    return no_step or finding.fault == "missed_scan_not_predicted"


def _starts_track(make: Make, site: Site) -> bool:
    session = MultiObjectSession(make)
    try:
        return any(len(session.step(scan).ids) for scan in site.scans(OBJECTS[:, :1], 4.0))
    except Exception as error:
        raise CannotRun(f"at the detections of one object: {fault_of(error)}") from error


def _failed_scene(record: DoctorCheck[Any], fault: TrackFault) -> PartResult:
    if fault.kind == "died":
        raise CannotRun(f"in the scene {record.name}: {fault}")
    name = "invalid_estimate" if fault.kind == "answer" else "exception_raised"
    for words, fault_name in FAILURES.items():
        if words in fault.cause:
            name = fault_name
    text = f"the tracker fails in it: {fault}"
    return PartResult().add(record.questions[0].name, False, text, Finding(name, 0.95, f"In {record.name}: {fault}."))
