"""The tracker under test: sessions that have followed the targets of probes, trials there, and its kind of filter."""

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
from trackbench.subjects.doctor.session import Examined, MissGiven, StepFailed, TrackerSession, finite, not_counted
from trackbench.subjects.doctor.trial import Trial, averaged
from trackbench.trackers.answers import Tracker, is_random

#: How long a probe's target is followed before time 0, s.
WARM_UP = 3.0
#: Least number of scans of each sensor with which it is followed.
LEAST_SCANS = 30
#: How often a tracker is asked whose copies draw different random numbers.
REPEATS = 16
#: Time of the additional prediction that shifts the random numbers of a tracker that draws some at every step, s.
ADDITIONAL_STEP = 1e-3
#: Gap after which the predictions are uncertain enough for the second order, s.
UNCERTAIN = 1.0
#: Second-order term that is large enough to be looked for, in standard deviations of the measurement.
CLEAR = 0.3
#: Difference of the predicted measurement from that of the predicted mean which an EKF does not have, in standard
#: deviations: 0.00 with linearisation, 0.1 and more with sigma points or samples, however wrong their weights are.
LINEARISED = 0.03
#: Offset of the measurements for a tracker that may learn it, in their standard deviations; and for how long, s.
OFFSET, LEARNING = 3.0, 4.0

Answer = TypeVar("Answer")


class TrackerUnderTest:
    """What the checks of an examination share.

    Args:
        make: gives a fresh tracker.
        sensors: by name.
        drives: the test drives, each with the estimates of the reference.
        probes: all probes.
        seed: of the noise.
        assumptions: what the user states.
        on_step: called after each of its steps.
    """

    def __init__(
        self,
        make: Callable[[], Tracker],
        sensors: Mapping[str, Sensor],
        drives: Sequence[tuple[TestDrive, Rollout]],
        probes: Probes,
        seed: int,
        assumptions: Assumptions = NONE,
        on_step: Callable[[], None] = not_counted,
    ) -> None:
        self.make = Examined(make, assumptions.no_misses, on_step)
        self.assumptions = assumptions
        self.sensors = sensors
        self.drives = drives
        self.probes = probes
        self.seed = seed
        self.output_checks = OutputChecks()
        self.failures: list[tuple[str, StepFailed]] = []
        """Each with the name of the probe, drive or check where it happened."""
        self._sessions: dict[tuple[Probe, tuple[str, ...], bool], TrackerSession | None] = {}
        self._trials: dict[tuple[Probe, str, tuple[str, ...], bool], Trial | None] = {}
        self._at_zero: dict[Probe, tuple[TrackerSession, Estimate] | None] = {}
        self._predictions: dict[tuple[Probe, float], Estimate | None] = {}
        self._answers: dict[Callable[[TrackerUnderTest], Any], Any] = {}

    def of_another(self, make: Callable[[], Tracker]) -> TrackerUnderTest:
        """Another tracker, examined as this one is."""
        on_step = self.make.on_step
        return TrackerUnderTest(make, self.sensors, self.drives, self.probes, self.seed, self.assumptions, on_step)

    def once(self, ask: Callable[[TrackerUnderTest], Answer]) -> Answer:
        """What a function tells of the tracker; it is called once."""
        if ask not in self._answers:
            self._answers[ask] = ask(self)
        answer: Answer = self._answers[ask]
        return answer

    @contextmanager
    def recording_failures(self, where: str) -> Iterator[None]:
        """Add a failed step to the failures, and end the block."""
        try:
            yield
        except MissGiven:
            # Not its fault.
            return
        except StepFailed as failure:
            self.failures.append((where, failure))

    def sensor_sets(self) -> list[tuple[str, ...]]:
        """The sets of sensors with which targets are followed: each sensor alone, and all."""
        alone: list[tuple[str, ...]] = [(name,) for name in self.sensors]
        return alone if len(alone) == 1 else [*alone, tuple(self.sensors)]

    def session_at(self, probe: Probe, sensor_set: tuple[str, ...], *, replica: bool = False) -> TrackerSession | None:
        """A session that has followed the probe's target without noise up to time 0; None if the tracker failed.

        Args:
            probe: where.
            sensor_set: with what.
            replica: with one prediction more, so that a tracker that draws random numbers has others.
        """
        key = (probe, sensor_set, replica)
        if key not in self._sessions:
            self._sessions[key] = self._follow(*key)
        return self._sessions[key]

    def session_of_most(self, probe: Probe) -> TrackerSession | None:
        """The same with all sensors, or with one of those with which the tracker does not fail."""
        found = (self.session_at(probe, sensor_set) for sensor_set in reversed(self.sensor_sets()))
        return next((session for session in found if session is not None), None)

    def _follow(self, probe: Probe, sensor_set: tuple[str, ...], replica: bool) -> TrackerSession | None:
        session = TrackerSession(self.make)
        # One that starts earlier has other random numbers, too.
        earlier = 0.1 if replica and self.assumptions.no_misses else 0.0
        scans = self.approach(probe, sensor_set, WARM_UP + earlier)
        if replica and not self.assumptions.no_misses:
            # A prediction shortly before the one two thirds on: the same to a Kalman filter, other random numbers from
            # there on to a filter that draws some.
            at = 2 * len(scans) // 3
            scans.insert(at, empty_scan(scans[at]._replace(time=scans[at].time - ADDITIONAL_STEP)))
        estimates: list[Estimate | None] = []
        with self.recording_failures(probe.name):
            estimates.extend(session.walk(scans))
        self.output_checks.add_track(estimates, scans, probe.name)
        return session if len(estimates) == len(scans) else None

    def scan(self, probe: Probe, name: str, time: float) -> Scan:
        """The measurement of a probe's target by a sensor, without noise."""
        return probe.scan(name, self.sensors[name], time)

    def missed(self, probe: Probe, name: str, time: float) -> Scan:
        """The scan of a sensor that does not detect the target."""
        return empty_scan(self.scan(probe, name, time))

    def peek(self, session: TrackerSession | None, scan: Scan, where: str) -> Estimate | None:
        """What a session would answer to a scan; None where there is no estimate, or the step fails."""
        if session is not None:
            with self.recording_failures(where):
                return session.peek(scan)
        return None

    def predict(self, session: TrackerSession | None, scan: Scan, where: str) -> Estimate | None:
        """What a session predicts to a scan; None where there is no estimate, or the step fails."""
        if session is not None:
            with self.recording_failures(where):
                return session.predict(scan)
        return None

    def approach(self, probe: Probe, sensor_set: tuple[str, ...], duration: float = WARM_UP) -> list[Scan]:
        """The scans without noise before time 0, ordered by time and then by sensor."""
        scans = []
        for name in sensor_set:
            rate = probe_rate(self.sensors[name])
            before = max(int(duration * rate), LEAST_SCANS)
            scans += [self.scan(probe, name, k / rate) for k in range(-before, 0)]
        return sorted(scans, key=lambda scan: scan.time)

    def trial(self, probe: Probe, sensor: str, sensor_set: tuple[str, ...], *, replica: bool = False) -> Trial | None:
        """A trial of one sensor at a probe; None where the tracker failed or has no estimate."""
        key = (probe, sensor, sensor_set, replica)
        if key not in self._trials:
            self._trials[key] = self._tried(*key)
        return self._trials[key]

    def _tried(self, probe: Probe, sensor: str, sensor_set: tuple[str, ...], replica: bool) -> Trial | None:
        session = self.session_at(probe, sensor_set, replica=replica)
        if session is None:
            return None
        scan = self.scan(probe, sensor, 0.0)
        with self.recording_failures(probe.name):
            if self.assumptions.no_misses:
                prediction = session.predict(scan)
            else:
                prediction = averaged(session, empty_scan(scan), self.repeats)
            if prediction is not None:
                return Trial(probe.name, probe.description, scan, prediction, session, self.repeats, sensor_set)
        return None

    def predicted(self, probe: Probe, step: float) -> tuple[Estimate, Estimate] | None:
        """The estimates at a missed scan at time 0 and at one ``step`` s later, after measurements of most sensors.

        None where the tracker failed, or one of them is none or not finite.
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
        """By sensor: the usable trials at the regular probes."""
        return self._regular_trials(replica=False)

    @cached_property
    def replicas(self) -> dict[str, list[Trial]]:
        """The same with other samples."""
        return self._regular_trials(replica=True)

    def _regular_trials(self, *, replica: bool) -> dict[str, list[Trial]]:
        found: dict[str, list[Trial]] = {name: [] for name in self.sensors}
        for probe in self.probes.regular:
            for sensor_set in self.sensor_sets():
                for name in self.sensors:
                    trial = self.trial(probe, name, sensor_set, replica=replica)
                    if trial is not None and trial.usable:
                        found[name].append(trial)
        return found

    @cached_property
    def batched(self) -> bool:
        """Whether it takes a batch of targets at once."""
        return bool(getattr(self.make(), "batched", False))

    @cached_property
    def repeats(self) -> int:
        """How often an answer is asked for: once, unless copies of the tracker draw different random numbers."""
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
        """Whether a track that goes on after a measurement has no estimate (None) at a missed one."""
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
        """Whether the tracker predicts no motion, and its position is that of the last measurement."""
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
    """Whether the predicted measurement is that of the predicted mean, as an EKF has it; None where unknown.

    Sigma points and samples add a term of second order, ``tr(A P) / 2`` with the second derivative A of the model from
    the filter's own state (Bar-Shalom, Li and Kirubarajan 2001, section 10.3.2).
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
    """A trial of a sensor some time after the last measurement."""
    scan = tracker.scan(probe, name, gap)
    prediction = tracker.predict(session, scan, probe.name)
    return None if prediction is None else Trial(probe.name, probe.description, scan, prediction, session)


def learned_offsets(tracker: TrackerUnderTest, sensor: str) -> list[str]:
    """The components of a sensor whose constant errors the tracker estimates, besides what it returns."""
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[-1]
    model = SENSOR_MODELS[tracker.sensors[sensor].type]
    found = []
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
                found.append(component.replace("_", " "))
    return found
