"""The filter of a tracker of several objects: with one object and no clutter it is a tracker of one object."""

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

#: Checks that do not hold for a track: it starts with several measurements, ends soon after its last one, and takes
#: none beyond its gate. How near it is to its object the scenes show.
LEFT_OUT = {"confidence", "growth_by_noise", "drives"}
#: Stated of every scan. So little clutter leaves a detection in the gate no other origin: with probabilistic
#: association, too, the update is that of the filter.
DETECTION, DENSITY = 0.9, 1e-12
#: Variance over the stated one up to which it is a tuning.
TUNING = 6.0
#: Range of the stated field of view, m: everything.
SEEN = 1e6


class Isolated:
    """Answers with the track of the one object that the scans are of.

    Args:
        make: gives a fresh tracker of several objects.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self._tracker, self._state = make(), None

    @property
    def within(self) -> Any:
        """The trackers and their states, below what checks them."""
        return getattr(self._tracker, "_trackers", self._tracker), getattr(self._tracker, "_states", None)

    def step(self, state: int | None, scan: Scan) -> tuple[int | None, Estimate | None]:
        """The estimate of the track that answered before, or else of the one nearest to the detection; None where there
        is neither."""
        detections = 1 if scan.valid else 0
        batch = scan._replace(
            measurement=np.repeat(scan.measurement[:, None, None], detections, axis=1),
            valid=np.ones((detections, 1), dtype=bool),
            detection_probability=DETECTION,
            clutter_density=DENSITY,
            field_of_view=FieldOfView(np.pi, SEEN),
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
    """Examines the filter of trackers of several objects.

    Args:
        sensors: by name; all are at the origin of the observer.
    """

    def __init__(self, sensors: Mapping[str, Sensor]) -> None:
        super().__init__({name: sensor.model_copy(update={"mount": Mount()}) for name, sensor in sensors.items()})
        # Fewer than of a tracker of one object, whose steps take less time; as many with moving observers.
        self._probes = Probes(general=GENERAL[:4])

    @cached_property
    def _drives(self) -> list[tuple[TestDrive, Rollout]]:
        return []

    def _made(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        return PartResult() if check.name in LEFT_OUT else super()._made(check, tracker)


def filter_examined(sensors: Mapping[str, Sensor], make: Callable[[], Any]) -> tuple[list[CheckResult], list[Finding]]:
    """The checks of the filter, and its faults, root causes first.

    Args:
        sensors: by name.
        make: gives a fresh tracker of several objects.
    """
    why = "it cannot be copied"
    try:
        copy.deepcopy(make())
        why = "its examination fails"
        examination = FilterDoctor(sensors).examine("", lambda: Isolated(make))
    except Exception as error:
        why = str(error) if isinstance(error, CannotRun) else f"{why} ({fault_of(error).cause})"
        return [CheckResult("filter", "Is the filter of a track sound?", None, f"not examined: {why}")], []
    tuned = {(finding.fault, finding.sensor) for finding in examination.findings if _tuned(finding)}
    findings = [finding for finding in examination.findings if (finding.fault, finding.sensor) not in tuned]
    sensors_of = {sensor for _, sensor in tuned} - {finding.sensor for finding in findings}
    checks = [
        replace(check, passed=True) if check.name in {f"gain.{sensor}" for sensor in sensors_of} else check
        for check in examination.checks
    ]
    return checks, findings


def _tuned(finding: Finding) -> bool:
    """Whether it is more noise than stated, as much as a tuning has: no drive here shows whether it does harm."""
    return finding.fault == "r_too_large" and finding.factor is not None and finding.factor < TUNING
