"""What tests of the doctor share: trackers under test, programs of the corpus as trackers, and drives."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.gnn import Tracker as NearestGlobal
from benchmarks.faults.corpus import Program, bases, faults

from trackbench.base.types import Scan
from trackbench.driving.steppers import ForeignTracker
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor import traffic
from trackbench.subjects.doctor.assumptions import Assumptions
from trackbench.subjects.doctor.drives import Rollout, TestDrive, rollout, simulate_drives
from trackbench.subjects.doctor.examine import reference_tracker
from trackbench.subjects.doctor.findings import CheckResult, Finding, PartResult
from trackbench.subjects.doctor.isolated import examine_filter
from trackbench.subjects.doctor.probes import GENERAL, Probe, Probes, simplified
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.traffic import Site
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

Make = Callable[[], Any]
#: A check of trackers of one object.
Part = Callable[[TrackerUnderTest], PartResult]
#: Some of the probes, for statements that need no more: a probe that is there twice is tried once.
FEW = Probes(general=GENERAL[:3], radial=GENERAL[0], passing=())
#: Sensors at rest of scenes with several objects.
SITES = {name: Site(name, simplified(sensor)) for name, sensor in SENSORS.items()}


def under_test(
    make: Make,
    drives: Sequence[tuple[TestDrive, Rollout]] = (),
    sensors: Mapping[str, Sensor] = SENSORS,
    probes: Probes = FEW,
    **stated: Any,
) -> TrackerUnderTest:
    """Return a tracker as the checks of an examination get it; ``stated`` are fields of `Assumptions`."""
    return TrackerUnderTest(make, sensors, drives, probes, 0, Assumptions(**stated))


@cache
def programs() -> dict[str, Program]:
    """Return the faulty and the sound programs of the corpus by name."""
    return {program.name: program for program in (*faults(), *bases())}


@cache
def _modules() -> TemporaryDirectory[str]:
    """Return a folder for programs, from which they are imported."""
    folder = TemporaryDirectory()
    sys.path.insert(0, folder.name)
    return folder


@cache
def tracker_of(name: str) -> type:
    """Return the class of a program of the corpus."""
    programs()[name].write(Path(_modules().name))
    tracker: type = import_module(name).Tracker
    return tracker


@cache
def program_under_test(name: str) -> TrackerUnderTest:
    """Return a program of the corpus as the checks get it; several tests look at its trials."""
    return under_test(tracker_of(name))


@cache
def drives_of(*names: str) -> list[tuple[TestDrive, Rollout]]:
    """Return test drives by name, each with the estimates of the reference."""
    return [
        (drive, rollout(reference_tracker, drive.scans)) for drive in simulate_drives(SENSORS, 0) if drive.name in names
    ]


def looped(tracker: Callable[..., Any], **options: Any) -> Make:
    """Return what makes a class that follows several objects in one run."""
    return partial(ForeignTracker, partial(tracker, **options), 1, several=True)


def built_in(method: str, **associate: Any) -> Make:
    """Return what makes a built-in tracker of several objects with extended Kalman filters."""
    options = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3.0}
    config = FilterConfig.model_validate({**options, "associate": {"method": method, **associate}})
    return partial(build_multi, config)


@cache
def _filter_of_nearest_global(sensors: tuple[str, ...]) -> tuple[list[CheckResult], list[Finding]]:
    return examine_filter({name: SENSORS[name] for name in sensors}, looped(NearestGlobal))


def examine_filters_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Examine the filter of trackers of several objects once, where it is that of `NearestGlobal`."""

    def examined(sensors: Mapping[str, Sensor], _make: Make) -> tuple[list[CheckResult], list[Finding]]:
        checks, findings = _filter_of_nearest_global(tuple(sensors))
        return list(checks), list(findings)

    monkeypatch.setattr(traffic, "examine_filter", examined)


def scans_of(probe: Probe, names: tuple[str, ...] = ("lidar", "radar"), until: float = 0.0) -> list[Scan]:
    """Return scans of a target without noise, from -1 s on, every 0.05 s."""
    times = np.arange(-20, round(until / 0.05) + 1) * 0.05
    return [probe.scan(name, SENSORS[name], float(time)) for time in times for name in names]


def with_causes(findings: Iterable[Finding]) -> list[tuple[str, str | None]]:
    """Return the faults, each with that of which it is a consequence."""
    return [(finding.fault, finding.consequence_of) for finding in findings]
