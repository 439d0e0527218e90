"""The tracker under test: its sessions and trials at the probes, and its kind of filter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.subjects.doctor.assumptions import NONE, Assumptions
from trackbench.subjects.doctor.drives import Rollout, TestDrive
from trackbench.subjects.doctor.output_checks import OutputChecks
from trackbench.subjects.doctor.probes import Probe, Probes, probe_rate
from trackbench.subjects.doctor.session import MissGiven, StepFailed, TrackerFactory, TrackerSession, do_nothing, finite
from trackbench.subjects.doctor.trial import Trial, average_answers
from trackbench.trackers.answers import Tracker, is_random

#: Time for which a probe's target is followed before time 0, s.
WARM_UP = 3.0
#: Least number of scans of each sensor before time 0.
LEAST_SCANS = 30
#: Number of answers that are averaged where copies of the tracker draw different random numbers.
REPEATS = 16
#: Time from the additional prediction, which shifts the random numbers of a tracker, to the next scan, s.
ADDITIONAL_STEP = 1e-3
#: Gap after which predictions are uncertain enough to show second-order terms, s.
UNCERTAIN = 1.0
#: Least second-order term at which the kind of filter is looked for, in standard deviations of the measurement.
CLEAR = 0.3
#: Largest difference of an EKF's predicted measurement from the measurement of its predicted mean, in standard
#: deviations. Linearisation has 0.00, sigma points or samples have 0.1 and more, however wrong their weights are.
LINEARISED = 0.03
#: Offset given to a tracker that may learn it, in standard deviations of the measurement, and its duration, s.
OFFSET, LEARNING = 3.0, 4.0

Answer = TypeVar("Answer")


class TrackerUnderTest:
    """The tracker under test, and the sessions, trials and failures that all its checks share.

    Args:
        make: makes a fresh tracker.
        sensors: sensors by name.
        drives: test drives, each with the estimates of the reference tracker.
        probes: test targets at which single measurements are tried.
        seed: seed of the noise.
        assumptions: what the user states of the tracker and its sensors.
        on_step: called after each step of the tracker.
    """

    def __init__(
        self,
        make: Callable[[], Tracker],
        sensors: Mapping[str, Sensor],
        drives: Sequence[tuple[TestDrive, Rollout]],
        probes: Probes,
        seed: int,
        assumptions: Assumptions = NONE,
        on_step: Callable[[], None] = do_nothing,
    ) -> None:
        self.make = TrackerFactory(make, assumptions.no_misses, on_step)
        self.assumptions = assumptions
        self.sensors = sensors
        self.drives = drives
        self.probes = probes
        self.seed = seed
        self.output_checks = OutputChecks()
        self.failures: list[tuple[str, StepFailed]] = []
        """Failed steps, each with the name of the probe (test target), test drive or check where it happened."""
        self._sessions: dict[tuple[Probe, tuple[str, ...], bool], TrackerSession | None] = {}
        self._trials: dict[tuple[Probe, str, tuple[str, ...], bool], Trial | None] = {}
        self._at_zero: dict[Probe, tuple[TrackerSession, Estimate] | None] = {}
        self._predictions: dict[tuple[Probe, float], Estimate | None] = {}
        self._answers: dict[Callable[[TrackerUnderTest], Any], Any] = {}

    def for_tracker(self, make: Callable[[], Tracker]) -> TrackerUnderTest:
        """Return a test of the trackers of ``make`` with the sensors, drives, probes and assumptions of this test."""
        on_step = self.make.on_step
        return TrackerUnderTest(make, self.sensors, self.drives, self.probes, self.seed, self.assumptions, on_step)

    def once(self, question: Callable[[TrackerUnderTest], Answer]) -> Answer:
        """Return ``question(self)``, computed at the first call and kept for later ones."""
        if question not in self._answers:
            self._answers[question] = question(self)
        answer: Answer = self._answers[question]
        return answer

    @contextmanager
    def recording_failures(self, where: str) -> Iterator[None]:
        """Catch a failed step in the ``with`` block, and add it to ``failures`` with the name ``where``."""
        try:
            yield
        except MissGiven:
            # Not the tracker's fault.
            return
        except StepFailed as failure:
            self.failures.append((where, failure))

    def sensor_sets(self) -> list[tuple[str, ...]]:
        """Return the sets of sensors with which targets are followed: each sensor alone, then all together."""
        single_sensors: list[tuple[str, ...]] = [(name,) for name in self.sensors]
        return single_sensors if len(single_sensors) == 1 else [*single_sensors, tuple(self.sensors)]

    def session_at(self, probe: Probe, sensor_set: tuple[str, ...], *, replica: bool = False) -> TrackerSession | None:
        """Return a session that has followed the probe's target without noise up to time 0; None if the tracker failed.

        Args:
            probe: probe whose target is followed.
            sensor_set: names of the sensors that measure the target.
            replica: whether an additional prediction shifts the random numbers of a tracker that draws some.
        """
        key = (probe, sensor_set, replica)
        if key not in self._sessions:
            self._sessions[key] = self._follow(*key)
        return self._sessions[key]

    def session_of_most(self, probe: Probe) -> TrackerSession | None:
        """Return a session at a probe with all sensors, else with one sensor; None if the tracker fails with each."""
        sessions = (self.session_at(probe, sensor_set) for sensor_set in reversed(self.sensor_sets()))
        return next((session for session in sessions if session is not None), None)

    def _follow(self, probe: Probe, sensor_set: tuple[str, ...], replica: bool) -> TrackerSession | None:
        session = TrackerSession(self.make)
        # A session that starts earlier has other random numbers, too.
        earlier = 0.1 if replica and self.assumptions.no_misses else 0.0
        scans = self.approach(probe, sensor_set, WARM_UP + earlier)
        if replica and not self.assumptions.no_misses:
            # One prediction more changes nothing in a Kalman filter; a filter that draws samples has other random
            # numbers from there on.
            index = 2 * len(scans) // 3
            scans.insert(index, empty_scan(scans[index]._replace(time=scans[index].time - ADDITIONAL_STEP)))
        estimates: list[Estimate | None] = []
        with self.recording_failures(probe.name):
            estimates.extend(session.walk(scans))
        self.output_checks.add_track(estimates, scans, probe.name)
        return session if len(estimates) == len(scans) else None

    def scan(self, probe: Probe, name: str, time: float) -> Scan:
        """Return the noise-free measurement of a probe's target by a sensor at a time in s."""
        return probe.scan(name, self.sensors[name], time)

    def missed(self, probe: Probe, name: str, time: float) -> Scan:
        """Return a sensor's scan of a probe (test target) without a detection, at a time in s."""
        return empty_scan(self.scan(probe, name, time))

    def peek(self, session: TrackerSession | None, scan: Scan, where: str) -> Estimate | None:
        """Return the estimate after a scan, without changing the session; None if there is none or the step fails."""
        if session is not None:
            with self.recording_failures(where):
                return session.peek(scan)
        return None

    def predict(self, session: TrackerSession | None, scan: Scan, where: str) -> Estimate | None:
        """Return a session's prediction to the time of a scan; None where there is no estimate, or the step fails."""
        if session is not None:
            with self.recording_failures(where):
                return session.predict(scan)
        return None

    def approach(self, probe: Probe, sensor_set: tuple[str, ...], duration: float = WARM_UP) -> list[Scan]:
        """Return the noise-free scans of a probe's target before time 0, ordered by time and then by sensor."""
        scans = []
        for name in sensor_set:
            rate = probe_rate(self.sensors[name])
            count = max(int(duration * rate), LEAST_SCANS)
            scans += [self.scan(probe, name, k / rate) for k in range(-count, 0)]
        return sorted(scans, key=lambda scan: scan.time)

    def trial(self, probe: Probe, sensor: str, sensor_set: tuple[str, ...], *, replica: bool = False) -> Trial | None:
        """Return a trial of ``sensor`` at a probe followed with ``sensor_set``; None where there is no estimate."""
        key = (probe, sensor, sensor_set, replica)
        if key not in self._trials:
            self._trials[key] = self._make_trial(*key)
        return self._trials[key]

    def _make_trial(self, probe: Probe, sensor: str, sensor_set: tuple[str, ...], replica: bool) -> Trial | None:
        session = self.session_at(probe, sensor_set, replica=replica)
        if session is None:
            return None
        scan = self.scan(probe, sensor, 0.0)
        with self.recording_failures(probe.name):
            if self.assumptions.no_misses:
                prediction = session.predict(scan)
            else:
                prediction = average_answers(session, empty_scan(scan), self.repeats)
            if prediction is not None:
                return Trial(probe.name, probe.description, scan, prediction, session, self.repeats, sensor_set)
        return None

    def predicted(self, probe: Probe, step: float) -> tuple[Estimate, Estimate] | None:
        """Return the estimates at a scan without a detection at time 0, and at another ``step`` s later.

        None where the tracker failed, or an estimate is missing or not finite. Before time 0 all sensors measure,
        or one sensor where the tracker fails with all.
        """
        name = next(iter(self.sensors))
        if probe not in self._at_zero:
            self._at_zero[probe] = None
            session = self.session_of_most(probe)
            if session is not None:
                with self.recording_failures(probe.name):
                    session = session.copy()
                    now = session.step(self.missed(probe, name, 0.0))
                    self._at_zero[probe] = None if now is None or not finite(now) else (session, now)
        at_zero = self._at_zero[probe]
        if at_zero is None:
            return None
        session, now = at_zero
        if (probe, step) not in self._predictions:
            self._predictions[probe, step] = self.peek(session, self.missed(probe, name, step), probe.name)
        then = self._predictions[probe, step]
        return None if then is None or not finite(then) else (now, then)

    @cached_property
    def trials(self) -> dict[str, list[Trial]]:
        """Trials with a valid prediction at the regular probes (test targets), by name of the sensor."""
        return self._regular_trials(replica=False)

    @cached_property
    def replicas(self) -> dict[str, list[Trial]]:
        """Trials with other random samples at the probes of ``trials``, by name of the sensor."""
        return self._regular_trials(replica=True)

    def _regular_trials(self, *, replica: bool) -> dict[str, list[Trial]]:
        trials: dict[str, list[Trial]] = {name: [] for name in self.sensors}
        for probe in self.probes.regular:
            for sensor_set in self.sensor_sets():
                for name in self.sensors:
                    trial = self.trial(probe, name, sensor_set, replica=replica)
                    if trial is not None and trial.usable:
                        trials[name].append(trial)
        return trials

    @cached_property
    def batched(self) -> bool:
        """Whether the tracker follows a batch of targets, each a column of its arrays, in one step."""
        return bool(getattr(self.make(), "batched", False))

    @cached_property
    def repeats(self) -> int:
        """Number of answers that are averaged: 1, unless copies of the tracker draw different random numbers."""
        probe, sensor_set = self.probes.general[0], self.sensor_sets()[0]
        session = self.session_at(probe, sensor_set)
        scan = self.scan(probe, sensor_set[0], 0.0)
        with self.recording_failures(probe.name):
            answers = [None if session is None else session.peek(scan) for _ in range(2)]
            if answers[0] is not None and answers[1] is not None:
                return 1 if np.array_equal(answers[0].mean, answers[1].mean, equal_nan=True) else REPEATS
        return 1

    @cached_property
    def silent_at_misses(self) -> bool:
        """Whether the tracker returns no estimate (None) at a scan without a detection, but returns one with it."""
        probe, sensor_set = self.probes.general[0], self.sensor_sets()[-1]
        session = self.session_at(probe, sensor_set)
        scan = self.scan(probe, sensor_set[0], 0.0)
        with self.recording_failures(probe.name):
            if session is not None and session.peek(scan) is not None:
                return session.predict(scan) is None
        return False

    @cached_property
    def random(self) -> bool:
        """Whether the tracker says that it draws random numbers, by an attribute ``random = True``."""
        return is_random(self.make())

    @cached_property
    def memoryless(self) -> bool:
        """Whether the tracker predicts no motion, and only returns the last measured position."""
        for trial in (trial for trials in self.trials.values() for trial in trials):
            scan, predicted = trial.scan, trial.prediction.mean
            if not self.assumptions.no_misses:
                later = self.peek(trial.session, empty_scan(scan._replace(time=scan.time + 1.0)), trial.name)
                if later is None or not np.allclose(later.mean[:2], predicted[:2]):
                    return False
            offset = 5.0 * np.array([trial.state_sigma[0], -trial.state_sigma[1], 0.0, 0.0])
            measurement = SENSOR_MODELS[scan.kind].measure(predicted + offset, scan.sensor_pose, scan.sensor_velocity)
            estimate = trial.posterior(measurement)
            measured = (predicted + offset)[:2]
            if estimate is None or np.hypot(*(estimate.mean[:2] - measured)) > 5e-3 * np.hypot(*offset[:2]):
                return False
        return any(self.trials.values())


def linearises(tracker: TrackerUnderTest) -> bool | None:
    """Return whether the tracker linearises the measurement model, as an EKF does; None where unknown.

    An EKF predicts the measurement of its predicted mean. Sigma points and samples add a second-order term,
    ``tr(A P) / 2`` with the model's second derivative A (Bar-Shalom, Li and Kirubarajan 2001, section 10.3.2).
    """
    offsets = []
    for probe in (*tracker.probes.general, tracker.probes.tangential):
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        for name in (name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"):
            trial = None if session is None else after_gap(tracker, probe, name, session, UNCERTAIN)
            if trial is not None and trial.usable and np.abs(trial.second_order / trial.sigma).max() > CLEAR:
                offset = trial.offset()
                if offset is not None:
                    offsets.append(float(np.linalg.norm(offset / trial.sigma)))
    return float(np.median(offsets)) < LINEARISED if len(offsets) >= 3 else None


def after_gap(tracker: TrackerUnderTest, probe: Probe, name: str, session: TrackerSession, gap: float) -> Trial | None:
    """Return a trial of a sensor after ``gap`` s without scans from time 0; None where there is no prediction."""
    scan = tracker.scan(probe, name, gap)
    prediction = tracker.predict(session, scan, probe.name)
    return None if prediction is None else Trial(probe.name, probe.description, scan, prediction, session)


def learned_offsets(tracker: TrackerUnderTest, sensor: str) -> list[str]:
    """Return the measurement components of a sensor whose constant offset the tracker estimates and takes off."""
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[-1]
    model = SENSOR_MODELS[tracker.sensors[sensor].type]
    learned = []
    for i, component in enumerate(model.components):
        last = tracker.scan(probe, sensor, 0.0)
        error = np.zeros(len(last.measurement))
        error[i] = OFFSET * np.sqrt(last.noise_covariance[i, i])
        scans = [
            scan._replace(measurement=scan.measurement + error) if scan.sensor == sensor else scan
            for scan in tracker.approach(probe, sensor_set, LEARNING)
        ]
        with tracker.recording_failures(probe.name):
            session = TrackerSession.after(tracker.make, scans)
            trial = after_gap(tracker, probe, sensor, session, 0.0)
            offset = None if trial is None or not trial.usable else trial.offset()
            if offset is not None and offset[i] > error[i] / 2:
                learned.append(component.replace("_", " "))
    return learned
