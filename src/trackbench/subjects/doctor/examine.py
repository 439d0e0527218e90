"""Examiner of trackers of one object: it makes all checks of a tracker and ranks their findings."""

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
from trackbench.subjects.doctor.inside.pinned import merge_models, single_models
from trackbench.subjects.doctor.output_checks import without_warnings
from trackbench.subjects.doctor.probes import Carrier, Probes, simplified, site_of, varied
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.session import NO_PREDICTION, TrackerFactory
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import Tracker
from trackbench.trackers.builtin import ekf

#: Steps of all other checks relative to the steps in drives, for an EKF; more where answers are averaged over samples.
OTHER_STEPS = 0.6
#: Least time between two reports of progress, s.
REPORT_PERIOD_S = 0.2


class StepCount:
    """Counter that is called at every step of a tracker (one scan), and reports the progress.

    Args:
        progress: called with the number of steps done and of all steps.
        expected: estimated number of all steps.
    """

    def __init__(self, progress: Progress, expected: int) -> None:
        self._progress, self._expected = progress, expected
        self._done, self._reported = 0, 0.0
        progress(0, expected)

    def __call__(self) -> None:
        self._done += 1
        now = time.monotonic()
        if now - self._reported >= REPORT_PERIOD_S:
            self._reported = now
            self._progress(self._done, max(self._expected, self._done))

    def set_remaining(self, steps: int) -> None:
        """Correct the estimated number of all steps: ``steps`` remain."""
        self._expected = self._done + steps
        self._progress(self._done, self._expected)


def count_drive_steps(drives: Sequence[TestDrive], *, batched: bool) -> int:
    """Return the number of steps in drives: one for each scan and run, or for each scan of a batched tracker."""
    return sum(1 if batched else scan.valid.size for drive in drives for scan in drive.scans)


def count_evidence_steps(drives: Sequence[TestDrive]) -> int:
    """Return the number of steps in one run of each drive, including steps of tracker copies that show innovations."""
    return sum(3 + 2 * len(scan.measurement) for drive in drives for scan in drive.scans)


def reference_tracker(engine: Engine = "numpy") -> Tracker:
    """Return the reference tracker: an extended Kalman filter with constant velocity."""
    # Without the part that handles late scans: no scan of a drive is late.
    tracker: Tracker = replace(ekf(motion="cv", acceleration_sigma_mps2=3.0).tracker, engine=engine)
    return tracker


class Doctor:
    """Examiner of trackers of one object, with given sensors.

    Args:
        sensors: sensors by name. Their kinds, noise, rates, mountings and latencies are used. In an examination they
            see all around and miss nothing, and no scan of a drive is late.
        seed: seed of the noise and of the variation of the probes; None for unvaried probes and noise of seed 0.
        observer: carrier of the sensors; None for the probes' own observers, at rest at the origin and moving.
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
        rest_reason = ""
        if static_sensors:
            rest_reason = "--static-sensors"
        elif observer is not None and not observer.moves:
            rest_reason = "the scenario's stands still"
        late = {name: sensor.latency[1] for name, sensor in sensors.items() if sensor.latency[1] > 0.0}
        self._assumptions = Assumptions(no_misses=no_misses, skip=tuple(skip), rest_reason=rest_reason, late=late)
        self.sensors = {name: simplified(sensor) for name, sensor in sensors.items()}
        probes = Probes() if seed is None else varied(np.random.default_rng(seed))
        # All probes are placed at the first site: that of a sensor with angles, if there is one.
        polar_first = sorted(self.sensors.values(), key=lambda sensor: sensor.type == "lidar")
        carrier = observer.at_rest() if observer and rest_reason else observer
        sites = [site_of(sensor.mount, carrier) for sensor in polar_first]
        self._probes = (probes.standing() if rest_reason else probes).placed(sites)
        self._setting = Setting(sites[0], bool(rest_reason), no_misses, observer is not None)
        self._seed = seed or 0

    @cached_property
    def _drives(self) -> list[tuple[TestDrive, Rollout]]:
        """Test drives, each with the estimates of the reference tracker."""
        drives = simulate_drives(self.sensors, self._seed, self._setting)
        make = partial(reference_tracker, choose_engine("auto", count_drive_steps(drives, batched=False)))
        skip = self._assumptions.skip
        return [(drive, rollout(make, drive.scans)) for drive in drives if drive.name not in skip]

    @one_blas_thread()
    @without_warnings()
    def examine(self, name: str, make: Callable[[], Tracker], progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker, and rank their findings.

        Args:
            name: name of the tracker in the results.
            make: makes a fresh tracker.
            progress: called several times a second with the number of steps done and the estimated number of all steps.

        Raises:
            CannotRun: the tracker cannot process one scan of any sensor, or gives no estimate at any scan.
        """
        batched = bool(getattr(make(), "batched", False))
        in_drives = count_drive_steps([drive for drive, _ in self._drives], batched=batched)
        count = StepCount(progress, round((1.0 + OTHER_STEPS) * in_drives))
        tracker = TrackerUnderTest(make, self.sensors, self._drives, self._probes, self._seed, self._assumptions, count)
        require_runnable(tracker)
        *checks, last = checks_of(CHECKS)
        results = []
        for number, check in enumerate(checks):
            if check.every_drive:
                count.set_remaining(in_drives)
            try:
                with tracker.recording_failures(check.name):
                    results.append(self._make_for_models(check, tracker))
            except TrackFault:
                # The tracker's process has ended, and no tracker can be made any more.
                ended = "the tracker's process had ended"
                results += [PartResult(self._unmade(unmade, ended)) for unmade in checks[number:]]
                break
        results.append(self._make_check(last, tracker))
        findings = [finding for result in results for finding in result.findings]
        for check, result in zip((*checks, last), results, strict=True):
            # The finding of a failed step explains the drive in which the step failed.
            step_findings = results[-1].findings if check.every_drive else []
            result.checks = check.with_faults(result.checks, [*result.findings, *step_findings])
        if not findings and tracker.output_checks.estimates == 0:
            raise CannotRun("it gave no estimate at any scan")
        all_checks = [check for result in results for check in result.checks]
        return Examination(name, rank_findings(findings), all_checks)

    def _make_for_models(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        """Return the result of a check; a check of filters is made for each model of a tracker with several models."""
        models = tracker.once(single_models) if check.of_filters and not check.every_drive else []
        if not models:
            return self._make_check(check, tracker)
        results = []
        for model in models:
            with model.as_tracker() as model_tracker:
                results.append(self._make_check(check, model_tracker))
        of_models = merge_models(results)
        # The models of a bank may be made with more and less process noise, where that does no harm.
        sizes = [finding for finding in of_models.findings if finding.fault in ("q_too_large", "q_too_small")]
        if sizes and tracker.once(harmless) is not None:
            of_models.findings = [finding for finding in of_models.findings if finding not in sizes]
            of_models.checks = [replace(check, passed=True, faults=()) for check in of_models.checks]
        return of_models

    def _make_check(self, check: DoctorCheck[[TrackerUnderTest]], tracker: TrackerUnderTest) -> PartResult:
        """Make a check and return its result; a question that is not asked gets the reason as its answer."""
        left_out = self._unmade(check)
        every = self._unmade(check, "")
        if every and {result.name for result in every} == {result.name for result in left_out}:
            return PartResult(left_out)
        if check.of_filters and tracker.memoryless:
            reason = "it predicts no motion, and its position is that of the last measurement"
            return PartResult(self._unmade(check, reason))
        if check.of_own_covariance and self._returned_covariance_is_not_own(tracker):
            reason = "the covariance that is returned is not the tracker's own (stated_covariance)"
            return PartResult(self._unmade(check, reason))
        made = check.make(tracker)
        made.checks = check.with_questions(made.checks)
        if (check.asks_at_misses or check.of_filters) and tracker.silent_at_misses:
            made.checks = [
                replace(result, result=NO_PREDICTION) if result.passed is None else result for result in made.checks
            ]
        return self._assumptions.apply(made, left_out, check)

    def _returned_covariance_is_not_own(self, tracker: TrackerUnderTest) -> bool:
        unmade = self._unmade(check_named("stated_covariance"))
        return not (unmade or tracker.memoryless) and tracker.once(stated_covariance_fault) is not None

    def _unmade(self, check: DoctorCheck[Any], reason: str | None = None) -> list[CheckResult]:
        """Return results without a verdict for a check's questions that the user excludes, or with a reason for all."""
        if len(self.sensors) < check.least_sensors:
            return []
        return self._assumptions.left_out(check, list(self.sensors), reason)

    @one_blas_thread()
    def evidence(
        self, examination: Examination, make: Callable[[], Tracker], progress: Progress = no_progress
    ) -> list[EvidenceRun]:
        """Return the runs that show the root causes, or a run of the default drive where no drive does.

        Args:
            examination: findings and checks.
            make: makes a fresh tracker.
            progress: called several times a second with the number of steps done and the estimated number of all steps.
        """
        shown = shown_drives(examination.findings, examination.checks, [drive for drive, _ in self._drives])
        drives = {drive.name: (drive, reference) for drive, reference in self._drives}
        runs = [(*drives[name], findings) for name, findings in shown.items() if name in drives]
        count = StepCount(progress, count_evidence_steps([drive for drive, *_ in runs]))
        factory = TrackerFactory(make, self._assumptions.no_misses, count)
        try:
            return [evidence_run(factory, *run) for run in runs]
        except TrackFault:
            # The tracker's process has ended.
            return []
