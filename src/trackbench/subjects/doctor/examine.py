"""The examination of one tracker."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Progress, no_progress
from trackbench.driving.faults import TrackFault
from trackbench.engine.choice import Engine, choose_engine
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor.assumptions import Assumptions, require_known_checks
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.checks.stated_covariance import stated_covariance_fault
from trackbench.subjects.doctor.checks.steps import CannotRun, require_runnable
from trackbench.subjects.doctor.drives import Rollout, Setting, TestDrive, rollout, simulate_drives
from trackbench.subjects.doctor.evidence import EvidenceRun, evidence_run, shown_drives
from trackbench.subjects.doctor.findings import (
    CHECKS,
    CheckResult,
    DoctorCheck,
    PartResult,
    check_named,
    checks_of,
    rank_findings,
)
from trackbench.subjects.doctor.inside.pinned import models_alone, of_each_model
from trackbench.subjects.doctor.output_checks import quiet
from trackbench.subjects.doctor.probes import Carrier, Probes, simplified, site_of, varied
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.session import NO_PREDICTION, Examined
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import Tracker
from trackbench.trackers.builtin import ekf

#: Steps of all other checks over those of the drives, of an EKF. More where answers are averaged over samples.
OTHERS = 0.6
#: Time between two reports, s.
REPORTED = 0.2


class StepCount:
    """Called at every step.

    Args:
        progress: told of the number of steps done and of all steps.
        expected: how many steps there will be about.
    """

    def __init__(self, progress: Progress, expected: int) -> None:
        self._progress, self._expected = progress, expected
        self._done, self._reported = 0, 0.0
        progress(0, expected)

    def __call__(self) -> None:
        self._done += 1
        now = time.monotonic()
        if now - self._reported >= REPORTED:
            self._reported = now
            self._progress(self._done, max(self._expected, self._done))

    def left(self, steps: int) -> None:
        """Correct the number of steps by how many are left."""
        self._expected = self._done + steps
        self._progress(self._done, self._expected)


def drive_steps(drives: Sequence[TestDrive], *, batched: bool) -> int:
    """Steps of a tracker in drives: one for each scan, and for each run unless it takes all runs at once."""
    return sum(1 if batched else scan.valid.size for drive in drives for scan in drive.scans)


def evidence_steps(drives: Sequence[TestDrive]) -> int:
    """Steps of a tracker in one run of drives, with the differences for the innovation of each measurement."""
    return sum(3 + 2 * len(scan.measurement) for drive in drives for scan in drive.scans)


def reference_tracker(engine: Engine = "numpy") -> Tracker:
    """The tracker that others are compared with: an extended Kalman filter with constant velocity."""
    # No scan of a drive is late.
    tracker: Tracker = replace(ekf(motion="cv", acceleration_sigma_mps2=3.0).tracker, engine=engine)
    return tracker


class Doctor:
    """Examines trackers with given sensors.

    Args:
        sensors: by name. Their kinds, noise, rates, mountings and latencies are used: in an examination they
            see all around and miss nothing, and no scan of a drive is late.
        seed: of the noise and of the variation of the probes; None for the probes as they are, and noise of seed 0.
        observer: that carries them; None for one that stands at the origin and the examination's own that move.
        static_sensors: whether no sensor moves, whatever the observer does.
        no_misses: whether every scan has a detection.
        skip: checks that are not made, by name or by name and sensor: "gain", "gain.radar".

    Raises:
        InputError: there is no such check.
    """

    def __init__(
        self,
        sensors: Mapping[str, Sensor],
        seed: int | None = None,
        *,
        observer: Carrier | None = None,
        static_sensors: bool = False,
        no_misses: bool = False,
        skip: Sequence[str] = (),
    ) -> None:
        require_known_checks(skip, sensors)
        still = ""
        if static_sensors:
            still = "--static-sensors"
        elif observer is not None and not observer.moves:
            still = "the scenario's stands still"
        late = {name: sensor.latency[1] for name, sensor in sensors.items() if sensor.latency[1] > 0.0}
        self._assumptions = Assumptions(no_misses=no_misses, skip=tuple(skip), still=still, late=late)
        self.sensors = {name: simplified(sensor) for name, sensor in sensors.items()}
        probes = Probes() if seed is None else varied(np.random.default_rng(seed))
        # Angles are those of a sensor that has some.
        polar_first = sorted(self.sensors.values(), key=lambda sensor: sensor.type == "lidar")
        sites = [
            site_of(sensor.mount, observer.at_rest() if observer and still else observer) for sensor in polar_first
        ]
        self._probes = (probes.standing() if still else probes).placed(sites)
        self._setting = Setting(sites[0], bool(still), no_misses, observer is not None)
        self._seed = seed or 0

    @cached_property
    def _drives(self) -> list[tuple[TestDrive, Rollout]]:
        """The test drives, each with the estimates of the reference."""
        drives = simulate_drives(self.sensors, self._seed, self._setting)
        make = partial(reference_tracker, choose_engine("auto", drive_steps(drives, batched=False)))
        skip = self._assumptions.skip
        return [(drive, rollout(make, drive.scans)) for drive in drives if drive.name not in skip]

    @one_blas_thread()
    @quiet()
    def examine(self, name: str, make: Callable[[], Tracker], progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker.

        Args:
            name: what it is called in the results.
            make: gives a fresh tracker.
            progress: called several times a second with the number of the tracker's steps so far and, about, of all.

        Raises:
            CannotRun: the tracker cannot process one scan of any sensor, or gives no estimate at any.
        """
        in_drives = drive_steps([drive for drive, _ in self._drives], batched=bool(getattr(make(), "batched", False)))
        count = StepCount(progress, round((1.0 + OTHERS) * in_drives))
        tracker = TrackerUnderTest(make, self.sensors, self._drives, self._probes, self._seed, self._assumptions, count)
        require_runnable(tracker)
        *checks, last = checks_of(CHECKS)
        results = []
        for number, check in enumerate(checks):
            if check.every_drive:
                count.left(in_drives)
            try:
                with tracker.recording_failures(check.name):
                    results.append(self._asked(check, tracker))
            except TrackFault:
                # Its process has ended, and no tracker can be made any more.
                ended = "the tracker's process had ended"
                results += [PartResult(self._not_made(left, ended)) for left in checks[number:]]
                break
        results.append(self._made(last, tracker))
        findings = [finding for result in results for finding in result.findings]
        for check, result in zip((*checks, last), results, strict=True):
            # A drive in which a step failed is explained by what is found of that step.
            also = results[-1].findings if check.every_drive else []
            result.checks = check.with_faults(result.checks, [*result.findings, *also])
        if not findings and tracker.output_checks.estimates == 0:
            raise CannotRun("it gave no estimate at any scan")
        made = [check for result in results for check in result.checks]
        return Examination(name, rank_findings(findings), made)

    def _asked(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        """The result of a check; what is asked of a filter, of each model alone where the tracker has several."""
        models = tracker.once(models_alone) if check.of_filters and not check.every_drive else []
        if not models:
            return self._made(check, tracker)
        results = []
        for model in models:
            with model.alone() as one:
                results.append(self._made(check, one))
        of_models = of_each_model(results)
        # What one of several models is for is its own affair, where it does no harm.
        sizes = [finding for finding in of_models.findings if finding.fault in ("q_too_large", "q_too_small")]
        if sizes and tracker.once(harmless) is not None:
            of_models.findings = [finding for finding in of_models.findings if finding not in sizes]
            of_models.checks = [replace(check, passed=True, faults=()) for check in of_models.checks]
        return of_models

    def _made(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        """The result of a check; what is not asked has the reason."""
        left_out = self._not_made(check)
        every = self._not_made(check, "")
        if every and {result.name for result in every} == {result.name for result in left_out}:
            return PartResult(left_out)
        if check.of_filters and tracker.memoryless:
            why = "it predicts no motion, and its position is that of the last measurement"
            return PartResult(self._not_made(check, why))
        if check.of_own_covariance and self._states_another(tracker):
            why = "the covariance that is returned is not the tracker's own (stated_covariance)"
            return PartResult(self._not_made(check, why))
        made = check.make(tracker)
        made.checks = check.with_questions(made.checks)
        if (check.asks_at_misses or check.of_filters) and tracker.silent_at_misses:
            made.checks = [
                replace(result, result=NO_PREDICTION) if result.passed is None else result for result in made.checks
            ]
        return self._assumptions.applied(made, left_out, check)

    def _states_another(self, tracker: TrackerUnderTest) -> bool:
        """Whether the covariance that a tracker returns is found not to be its own."""
        not_made = self._not_made(check_named("stated_covariance"))
        return not (not_made or tracker.memoryless) and tracker.once(stated_covariance_fault) is not None

    def _not_made(self, check: DoctorCheck[Any], why: str | None = None) -> list[CheckResult]:
        """The questions of a check that are not asked by what the user states, or all of them for another reason."""
        if len(self.sensors) < check.least_sensors:
            return []
        return self._assumptions.left_out(check, list(self.sensors), why)

    @one_blas_thread()
    def evidence(
        self, examination: Examination, make: Callable[[], Tracker], progress: Progress = no_progress
    ) -> list[EvidenceRun]:
        """The runs that show the root causes; the run of the default drive where none does.

        Args:
            examination: the findings and checks.
            make: gives a fresh tracker.
            progress: as of ``examine``.
        """
        shown = shown_drives(examination.findings, examination.checks, [drive for drive, _ in self._drives])
        drives = {drive.name: (drive, reference) for drive, reference in self._drives}
        runs = [(*drives[name], of) for name, of in shown.items() if name in drives]
        count = StepCount(progress, evidence_steps([drive for drive, *_ in runs]))
        examined = Examined(make, self._assumptions.no_misses, count)
        try:
            return [evidence_run(examined, *run) for run in runs]
        except TrackFault:
            # Its process has ended.
            return []
