"""The filter of a tracker of several objects, examined with one object and no clutter."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, FieldOfView, Scan
from trackbench.driving.faults import fault_of
from trackbench.models.sensors import SENSOR_MODELS, Mount, Sensor
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.drives import Rollout, TestDrive
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import CheckResult, DoctorCheck, Finding, PartResult
from trackbench.subjects.doctor.probes import GENERAL, Probes
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import tracks_of_run

#: Checks that do not hold for a track: it starts with several measurements, ends soon after its last one, and takes no
#: measurement beyond its gate. The scenes show how near a track is to its object.
LEFT_OUT = {"confidence", "growth_by_noise", "drives"}
#: Detection probability and clutter density stated with every scan. With so little clutter a detection in the gate has
#: no other origin, so that probabilistic association, too, gives the update of the filter.
DETECTION, DENSITY = 0.9, 1e-12
#: Noise variance relative to the stated one up to which a larger noise counts as tuning.
TUNING = 6.0
#: Range of the stated field of view, m: every target is inside.
FIELD_RANGE_M = 1e6


class SingleObjectTracker:
    """A tracker of one object made of a tracker of several: it answers with the track of the only object.

    Args:
        make: makes a fresh tracker of several objects.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self._tracker, self._state = make(), None

    @property
    def within(self) -> Any:
        """The user's trackers and their states, without the wrapper that checks their answers."""
        return getattr(self._tracker, "_trackers", self._tracker), getattr(self._tracker, "_states", None)

    def step(self, state: int | None, scan: Scan) -> tuple[int | None, Estimate | None]:
        """Return id and estimate of the track followed so far, or else of the one nearest to the detection.

        The estimate is None where there is no track.
        """
        detections = 1 if scan.valid else 0
        batch = scan._replace(
            measurement=np.repeat(scan.measurement[:, None, None], detections, axis=1),
            valid=np.ones((detections, 1), dtype=bool),
            detection_probability=DETECTION,
            clutter_density=DENSITY,
            field_of_view=FieldOfView(np.pi, FIELD_RANGE_M),
        )
        self._state, answer = self._tracker.step(self._state, batch)
        tracks = tracks_of_run(answer, 0)
        same = np.flatnonzero(tracks.ids == state)
        if len(same):
            column = int(same[0])
        elif len(tracks.ids) and scan.valid:
            position = SENSOR_MODELS[scan.kind].position(scan).mean
            column = int(np.argmin(np.hypot(*(tracks.mean[:2] - position[:, None]))))
        else:
            return state, None
        return int(tracks.ids[column]), Estimate(tracks.mean[:, column], tracks.covariance[:, :, column])


class FilterDoctor(Doctor):
    """Examiner of the filter within trackers of several objects.

    Args:
        sensors: sensors by name; all are moved to the origin of the observer.
    """

    def __init__(self, sensors: Mapping[str, Sensor]) -> None:
        super().__init__({name: sensor.model_copy(update={"mount": Mount()}) for name, sensor in sensors.items()})
        # Fewer probes with an observer at rest than for a tracker of one object, whose steps take less time.
        self._probes = Probes(general=GENERAL[:4])

    @cached_property
    def _drives(self) -> list[tuple[TestDrive, Rollout]]:
        return []

    def _make_check(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        return PartResult() if check.name in LEFT_OUT else super()._make_check(check, tracker)


def examine_filter(sensors: Mapping[str, Sensor], make: Callable[[], Any]) -> tuple[list[CheckResult], list[Finding]]:
    """Return the checks of the filter within a tracker of several objects, and its faults, root causes first.

    Args:
        sensors: sensors by name.
        make: makes a fresh tracker of several objects.
    """
    problem = "it cannot be copied"
    try:
        copy.deepcopy(make())
        problem = "its examination fails"
        examination = FilterDoctor(sensors).examine("", lambda: SingleObjectTracker(make))
    except Exception as error:
        problem = str(error) if isinstance(error, CannotRun) else f"{problem} ({fault_of(error).cause})"
        return [CheckResult("filter", "Is the filter of a track sound?", None, f"not examined: {problem}")], []
    tuned = {(finding.fault, finding.sensor) for finding in examination.findings if _is_tuning(finding)}
    findings = [finding for finding in examination.findings if (finding.fault, finding.sensor) not in tuned]
    tuned_sensors = {sensor for _, sensor in tuned} - {finding.sensor for finding in findings}
    checks = [
        replace(check, passed=True) if check.name in {f"gain.{sensor}" for sensor in tuned_sensors} else check
        for check in examination.checks
    ]
    return checks, findings


def _is_tuning(finding: Finding) -> bool:
    """Return whether a finding is a noise moderately larger than stated, perhaps chosen: no drive shows its harm."""
    return finding.fault == "r_too_large" and finding.factor is not None and finding.factor < TUNING
