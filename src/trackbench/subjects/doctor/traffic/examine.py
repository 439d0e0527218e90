"""The examination of one tracker of several objects."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Progress, no_progress
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.doctor.findings import TRAFFIC_CHECKS, CheckResult, DoctorCheck, Finding, PartResult, checks_of
from trackbench.subjects.doctor.root_causes import rank
from trackbench.subjects.doctor.site import simplified
from trackbench.subjects.doctor.traffic.checks.tracks import begins, together
from trackbench.subjects.doctor.traffic.scenes import Make, Site

Outcome = TypeVar("Outcome")
Scene = tuple[str, Callable[[Make], PartResult]]


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
    def examine(self, name: str, make: Make, progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker, with each sensor whose detections alone give it tracks.

        Args:
            name: what it is called in the results.
            make: gives a fresh tracker.
            progress: called after each scene with the number of scenes done and of all scenes.

        Raises:
            CannotRun: the tracker fails in a scene.
        """
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            used = [site for site in self._sites if _played("begins", partial(begins, site=site), make)]
            used = used or self._sites[:1]
            scenes = list(_scenes(used))
            checks = [_left_out(site) for site in self._sites if site not in used]
            findings: list[Finding] = []
            for done, (scene, part) in enumerate(scenes, start=1):
                result = _played(scene, part, make)
                checks += result.checks
                findings += result.findings
                progress(done, len(scenes))
        return Examination(name, rank(_of_sensors(findings, used), TRAFFIC_CHECKS), checks)


def _scenes(sites: list[Site]) -> Iterator[Scene]:
    for site in sites:
        for check in checks_of(TRAFFIC_CHECKS):
            yield check.name, partial(_of_one, check, site, len(sites) > 1)
    if len(sites) > 1:
        yield together.__name__, partial(together, sites=sites)


def _played(scene: str, part: Callable[[Make], Outcome], make: Make) -> Outcome:
    try:
        return part(make)
    except Exception as error:
        raise CannotRun(f"in the scene {scene}: {error or type(error).__name__}") from error


def _of_one(check: DoctorCheck[[Make, Site]], site: Site, several: bool, make: Make) -> PartResult:
    """The result of a check with a sensor, which its answers and findings name where there are several."""
    result, asks = check.make(make, site), {question.name: question.asks for question in check.questions}
    checks = [replace(one, question=asks[one.name]) for one in result.checks]
    if not several:
        return PartResult(checks, result.findings)
    named = [replace(one, name=f"{one.name}.{site.name}") for one in checks]
    return PartResult(named, [replace(finding, sensor=site.name) for finding in result.findings])


def _of_sensors(findings: list[Finding], sites: list[Site]) -> list[Finding]:
    """Each fault once; of no sensor in particular where all show it."""
    by_fault: dict[str, list[Finding]] = {}
    for finding in findings:
        by_fault.setdefault(finding.fault, []).append(finding)
    return [replace(own[0], sensor=None) if len(own) >= len(sites) else own[0] for own in by_fault.values()]


def _left_out(site: Site) -> CheckResult:
    said = "no track comes of its detections alone; nothing was tried with it"
    return CheckResult(
        f"confirmation.{site.name}", "Does an object that this sensor detects become a track?", None, said
    )
