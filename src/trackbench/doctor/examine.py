"""The examination of one tracker."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.breaks import broken_findings, require_runnable
from trackbench.doctor.checks.drives import drives
from trackbench.doctor.checks.expectation import expectation
from trackbench.doctor.checks.gain import gain
from trackbench.doctor.checks.innovations import innovations
from trackbench.doctor.checks.models import models
from trackbench.doctor.checks.output import output
from trackbench.doctor.checks.prediction import prediction, spreading
from trackbench.doctor.checks.process_noise import process_noise
from trackbench.doctor.checks.soundness import repeatability, vital_signs
from trackbench.doctor.checks.start import confidence, first_position
from trackbench.doctor.checks.wrapping import wrapping
from trackbench.doctor.drives import Course, courses
from trackbench.doctor.exhibits import Exhibit, exhibit
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.following import Track, follow
from trackbench.doctor.session import Broken
from trackbench.doctor.stations import Stations, varied
from trackbench.doctor.weighing import weigh
from trackbench.models.sensors import Mount, Sensor
from trackbench.trackers.base import Tracker
from trackbench.trackers.builtin import ekf
from trackbench.types import Progress, no_progress

#: In this order; the vital signs last, when all answers have been seen.
PARTS: tuple[Callable[[Bench], Outcome], ...] = (
    repeatability,
    output,
    first_position,
    confidence,
    prediction,
    spreading,
    expectation,
    gain,
    models,
    wrapping,
    process_noise,
    innovations,
    drives,
    vital_signs,
)


#: What only makes sense of a tracker that predicts, and weighs measurements against its prediction.
OF_FILTERS = (prediction, spreading, expectation, gain, wrapping, process_noise, innovations)

#: The drive that is shown where no other shows more.
USUAL = "azimuth_crossing"
#: How many drives are shown.
MOST_SHOWN = 3


@dataclass(frozen=True)
class Examination:
    """What was found in a tracker."""

    tracker: str
    findings: list[Finding]
    checks: list[Check]

    @property
    def healthy(self) -> bool:
        """Whether nothing was found, and no check failed."""
        return not self.findings and all(check.passed is not False for check in self.checks)

    def json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        return {
            "tracker": self.tracker,
            "healthy": self.healthy,
            "findings": [finding.json() for finding in self.findings],
            "checks": [check.json() for check in self.checks],
        }


def reference() -> Tracker:
    """The tracker that others are held against: an extended Kalman filter with constant velocity."""
    return ekf(motion="cv", acceleration_sigma_mps2=3.0)


class Doctor:
    """Examines trackers with some sensors.

    Args:
        sensors: by name. Only their kinds and noise count: in every examination they sit at the observer's centre,
            see all around, and have the same rates.
        seed: of the noise, and of other stations than the usual ones; None for those.
    """

    def __init__(self, sensors: Mapping[str, Sensor], seed: int | None = None) -> None:
        self._stations = Stations() if seed is None else varied(np.random.default_rng(seed))
        self._seed = seed or 0
        self.sensors = {name: _plain(sensor) for name, sensor in sensors.items()}

    @cached_property
    def _courses(self) -> list[tuple[Course, Track]]:
        """The drives, each with the reference's track."""
        return [(course, follow(reference, course.scans)) for course in courses(self.sensors, self._seed)]

    def examine(self, name: str, make: Callable[[], Tracker], progress: Progress = no_progress) -> Examination:
        """Take a tracker through the whole battery.

        Args:
            name: what it is called in the results.
            make: gives a fresh one.
            progress: told after each part how many are done, and of how many.

        Raises:
            CannotRun: the tracker breaks where nothing is out of the ordinary.
        """
        # What a faulty tracker divides by zero is seen in its answers.
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._examine(name, make, progress)

    def _examine(self, name: str, make: Callable[[], Tracker], progress: Progress) -> Examination:
        require_runnable(self._bench(make, []))
        bench = self._bench(make, self._courses)
        outcomes = []
        for done, part in enumerate(PARTS, start=1):
            try:
                if not (part in OF_FILTERS and bench.memoryless):
                    outcomes.append(part(bench))
            except Broken as broken:
                bench.broken.append((part.__name__, broken))
            progress(done, len(PARTS))
        findings = [finding for outcome in outcomes for finding in outcome.findings]
        findings += broken_findings(bench, findings)
        return Examination(name, weigh(findings), [check for outcome in outcomes for check in outcome.checks])

    def _bench(self, make: Callable[[], Tracker], courses: list[tuple[Course, Track]]) -> Bench:
        return Bench(make, self.sensors, courses, self._stations, self._seed)

    def exhibits(self, examination: Examination, make: Callable[[], Tracker]) -> list[Exhibit]:
        """What shows the roots among the findings; of a healthy tracker, a drive in which most could go wrong."""
        shown: dict[str, list[Finding]] = {}
        for finding in examination.findings:
            if finding.consequence_of is None and len(shown) < MOST_SHOWN:
                shown.setdefault(self._course_of(finding), []).append(finding)
        ready = {course.name: (course, track) for course, track in self._courses}
        return [exhibit(make, *ready[name], findings) for name, findings in (shown or {USUAL: []}).items()]

    def _course_of(self, finding: Finding) -> str:
        for course, _ in self._courses:
            if finding.station == course.name or finding.fault in course.drive.shows:
                return course.name
        return USUAL


def _plain(sensor: Sensor) -> Sensor:
    """The sensor without anything that would hide a target or shift a measurement."""
    biases = {field: 0.0 for field in type(sensor).model_fields if "_bias_" in field}
    rate = 10.0 if sensor.type == "lidar" else 20.0
    sees: dict[str, Any] = {
        "mount": Mount(),
        "fov_deg": 360.0,
        "max_range_m": None,
        "detection_probability": 1.0,
        "dropouts": [],
    }
    return sensor.model_copy(update={**biases, **sees, "rate_hz": rate, "phase_s": 0.0, "latency_s": 0.0})
