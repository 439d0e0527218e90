"""What tests of the doctor share: trackers under test, injected faults by their names, and programs as trackers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.faults import CORRECT, MUTANTS, Mutant
from benchmarks.doctor.traffic.nearest_global import NearestGlobal
from benchmarks.doctor.traffic.subject import looped
from benchmarks.faults.corpus import Program

from trackbench.base.types import Scan
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor import traffic
from trackbench.subjects.doctor.assumptions import Assumptions
from trackbench.subjects.doctor.drives import Rollout, TestDrive, rollout, simulate_drives
from trackbench.subjects.doctor.examine import reference_tracker
from trackbench.subjects.doctor.findings import CheckResult, Finding, PartResult
from trackbench.subjects.doctor.isolated import filter_examined
from trackbench.subjects.doctor.probes import GENERAL, Probe, Probes
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

Make = Callable[[], Any]
#: A check of trackers of one object.
Part = Callable[[TrackerUnderTest], PartResult]
#: Some of the probes, for statements that need no more: a probe that is there twice is tried once.
FEW = Probes(general=GENERAL[:3], radial=GENERAL[0], passing=())


def under_test(
    make: Make,
    drives: Sequence[tuple[TestDrive, Rollout]] = (),
    sensors: Mapping[str, Sensor] = SENSORS,
    probes: Probes = FEW,
    **stated: Any,
) -> TrackerUnderTest:
    """A tracker as the checks of an examination get it; ``stated`` are fields of `Assumptions`."""
    return TrackerUnderTest(make, sensors, drives, probes, 0, {}, Assumptions(**stated))


def mutant(name: str) -> Mutant:
    """An injected fault by its name: ``jacobian_wrong/plain_ekf/azimuth_sign``."""
    return next(injected for injected in MUTANTS if injected.name == name)


@cache
def mutant_under_test(name: str) -> TrackerUnderTest:
    """Its tracker, whose trials several tests look at."""
    return under_test(mutant(name).make)


@cache
def correct_under_test(name: str) -> TrackerUnderTest:
    """A sound tracker by its name, whose trials several tests look at."""
    return under_test(CORRECT[name])


@cache
def drives_of(*names: str) -> list[tuple[TestDrive, Rollout]]:
    """Test drives by name, each with the estimates of the reference."""
    return [
        (drive, rollout(reference_tracker, drive.scans)) for drive in simulate_drives(SENSORS, 0) if drive.name in names
    ]


@cache
def _filter_of_nearest_global(sensors: tuple[str, ...]) -> tuple[list[CheckResult], list[Finding]]:
    return filter_examined({name: SENSORS[name] for name in sensors}, looped(NearestGlobal))


def examine_filters_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of trackers of several objects whose filter is that of `NearestGlobal`, examine it once."""

    def examined(sensors: Mapping[str, Sensor], _make: Make) -> tuple[list[CheckResult], list[Finding]]:
        checks, findings = _filter_of_nearest_global(tuple(sensors))
        return list(checks), list(findings)

    monkeypatch.setattr(traffic, "filter_examined", examined)


def scans_of(probe: Probe, names: tuple[str, ...] = ("lidar", "radar"), until: float = 0.0) -> list[Scan]:
    """Scans of a target without noise, from -1 s on, every 0.05 s."""
    times = np.arange(-20, round(until / 0.05) + 1) * 0.05
    return [probe.scan(name, SENSORS[name], float(time)) for time in times for name in names]


def with_causes(findings: Iterable[Finding]) -> list[tuple[str, str | None]]:
    """The faults, each with that of which it is a consequence."""
    return [(finding.fault, finding.consequence_of) for finding in findings]


def program_named(programs: Iterable[Program], module: str) -> Program:
    """The program of a module."""
    return next(program for program in programs if program.module == module)


def tracker_of(program: Program, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """The tracker of a program, which is written to a folder."""
    program.write(folder)
    monkeypatch.syspath_prepend(folder)
    tracker: Make = import_module(program.module).Tracker
    return tracker
