"""Does a tracker take what is well within a gate, and take a target up again that it has lost?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.exhibits import Course, OverTime, update_shown
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe, with_measurement_noise
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: Time without a measurement, and time of measurements after it, s: with a white acceleration of 1.5 m/s^2 the standard
#: deviation of the position is 4 m after 7 s of these, so that a gate of four opens.
GAP, AFTER = 3.0, 10.0
#: Least distance of the target from its prediction after the gap, m, and the same in the standard deviations of the
#: prediction: a target that braked or turned is as far.
LEAST, FAR = 15.0, 8.0
#: Share of that distance by which the estimate has to come nearer.
TAKEN_UP = 0.3
#: Share of the measurements near their prediction that have to be rejected, and least number of these: near are those
#: whose squared distance is at most its expectation, as 58 to 63 % are, and every gate is larger.
MOST, LEAST_NEAR = 0.2, 10
#: Change of a mean that is rounding, in standard deviations. A robust filter takes less of a far measurement, and not
#: nothing.
NOTHING = 1e-9


class Return(NamedTuple):
    """A target that is elsewhere after a gap."""

    probe: Probe
    away: float
    """m from the prediction."""
    sigma: float
    """Standard deviation of the predicted position, m."""
    distances: list[float]
    """Of the estimate from the target in the time after the gap, m, from the prediction on."""

    @property
    def left(self) -> float:
        """The least of them."""
        return min(self.distances)


@doctor_check(
    Question("gate", "Is a target that is elsewhere after a gap taken up again?"),
    place=200,
    asks_at_misses=True,
    faults={
        "gate_never_reopens": KnownFault(
            "a gate that has rejected the target rejects it for ever",
            "Where a measurement is held against a gate.",
            "Gate on y^T S^-1 y with S = H P H^T + R, let P grow at rejected measurements too, or start the track "
            "again.",
            Role("step", drive="gap_in_a_turn"),
        )
    },
)
def gate_reopens(tracker: TrackerUnderTest) -> PartResult:
    """Let targets be elsewhere after a gap, and measure them there."""
    returns = [one for probe in tracker.probes.general[:2] if (one := _return(tracker, probe)) is not None]
    if not returns:
        return PartResult().add("gate", None, "there was no estimate")
    worst = max(returns, key=lambda one: one.left / one.away)
    text = (
        f"of {worst.probe.description}, {worst.away:.3g} m from its prediction after {GAP:g} s without a measurement, "
        f"the estimate is {worst.left:.3g} m away at the nearest in {AFTER:g} s of measurements"
    )
    lost = worst.left > (1.0 - TAKEN_UP) * worst.away
    if not lost:
        return PartResult().add("gate", True, text)
    distance = np.array(worst.distances)
    taken_up = np.full(len(distance), (1.0 - TAKEN_UP) * worst.away)
    bounds = np.zeros(len(distance)), taken_up
    course = Course("distance from the target, m", distance, None, bounds, "taken up again")
    time = np.asarray(0.1 * np.arange(len(distance)))
    title = f"After a gap of {GAP:g} s: {worst.probe.description}"
    exhibit = OverTime(title, "time of measurements, s", time, (course,))
    evidence = f"{text}; its prediction stated a standard deviation of {worst.sigma:.3g} m"
    finding = Finding("gate_never_reopens", 0.95, evidence, shown_by="gap_in_a_turn", exhibit=exhibit)
    return PartResult().add("gate", False, text, finding)


@doctor_check(
    Question(
        "gate_width",
        "Are measurements used that are near their prediction?",
        "Are measurements of {sensor} used that are near their prediction?",
        each_sensor=True,
    ),
    place=132,
    of_filters=True,
    faults={
        "gate_too_small": KnownFault(
            "the gate is too small",
            "Where the squared distance of a measurement is held against a threshold.",
            "Take y^T S^-1 y with S = H P H^T + R, and the point of chi-square with as many degrees of freedom as the "
            "measurement has, at 0.99 or more.",
            Role(
                "exact", rank=12, causes="measured noise growth offset", always="gate_never_reopens", drive="own_model"
            ),
        )
    },
)
def gate_width(tracker: TrackerUnderTest) -> PartResult:
    """Follow targets with noise, and count the measurements near their prediction that move nothing."""
    near: dict[str, list[tuple[bool, Trial]]] = {name: [] for name in tracker.sensors}
    random = np.random.default_rng([tracker.seed, 3])
    for probe in tracker.probes.general[:3]:
        session = TrackerSession(tracker.make)
        with tracker.recording_failures(probe.name):
            for scan in tracker.approach(probe, tracker.sensor_sets()[-1]):
                noisy = with_measurement_noise(scan, random)
                before = session.predict(noisy) if session.given else None
                trial = None if before is None else Trial(probe.name, probe.description, noisy, before, session)
                if trial is not None and trial.usable and _near(trial):
                    near[scan.sensor] += [(lost, trial) for lost in _lost(trial)]
                session.step(noisy)
    result = PartResult()
    for name, of in near.items():
        rejected = [trial for lost, trial in of if lost]
        if len(of) < LEAST_NEAR:
            result.add(f"gate_width.{name}", None, "too few measurements are used, or near their predictions")
            continue
        share = len(rejected) / len(of)
        text = (
            f"of {len(of)} measurements of {name} that are near their predictions (y^T S^-1 y not above its "
            f"expectation) {share:.0%} move nothing"
        )
        finding = None
        if share > MOST:
            shown = update_shown(rejected[0], rejected[0].scan.measurement)
            finding = Finding("gate_too_small", 0.96, text, sensor=name, shown_by="manoeuvre", exhibit=shown)
        result.add(f"gate_width.{name}", finding is None, text, finding)
    return result


def _lost(trial: Trial) -> list[bool]:
    """Whether the measurement moves nothing; not known where one without an innovation is not used either."""
    after = trial.posterior(trial.scan.measurement)
    if after is None:
        return []
    if np.abs((after.mean - trial.prediction.mean) / trial.state_sigma).max() > NOTHING:
        return [False]
    update = trial.update(trial.predicted_measurement)
    return [] if update is None or np.abs(update.relative_gain).max() < NOTHING else [True]


def _near(trial: Trial) -> bool:
    """Whether the squared distance of the measurement is at most its expectation."""
    angular = SENSOR_MODELS[trial.scan.kind].angular
    apart = difference(trial.scan.measurement, trial.predicted_measurement, angular)
    covariance = linalg.quadratic(trial.jacobian, linalg.symmetrise(trial.prediction.covariance))
    return bool(apart @ np.linalg.solve(covariance + trial.scan.noise_covariance, apart) <= len(apart))


def _return(tracker: TrackerUnderTest, probe: Probe) -> Return | None:
    sensor_set = tracker.sensor_sets()[-1]
    session = tracker.session_at(probe, sensor_set)
    if session is None:
        return None
    with tracker.recording_failures(probe.name):
        session = session.copy()
        asked = sensor_set[0]
        predicted = None
        if tracker.assumptions.no_misses:
            predicted = session.predict(tracker.scan(probe, asked, GAP))
        else:
            for k in range(int(GAP * 10) + 1):
                predicted = session.step(tracker.missed(probe, asked, 0.1 * k))
        if predicted is None or not finite(predicted):
            return None
        sigma = float(np.sqrt(max(0.0, np.trace(predicted.covariance[:2, :2]))))
        away = max(LEAST, FAR * sigma)
        elsewhere = _moved(probe, predicted.mean[:2] - probe.truth(GAP)[:2], away)
        distances = [away]
        for k in range(1, int(AFTER * 10) + 1):
            time = GAP + 0.1 * k
            for name in sensor_set:
                estimate = session.step(tracker.scan(elsewhere, name, time))
            if estimate is not None and finite(estimate):
                distances.append(float(np.hypot(*(estimate.mean - elsewhere.truth(time))[:2])))
            if distances[-1] < (1.0 - TAKEN_UP) * away:
                break
        return Return(probe, away, sigma, distances)
    return None


def _moved(probe: Probe, error: np.ndarray, away: float) -> Probe:
    """The target with the same velocity, at a distance from its prediction, outward from the sensor."""
    px, py, vx, vy = probe.target
    outward = np.array([px + GAP * vx - probe.observer.x, py + GAP * vy - probe.observer.y])
    outward = outward / max(float(np.hypot(*outward)), 1e-9)
    shift = error + away * outward
    return probe._replace(target=(px + shift[0], py + shift[1], vx, vy))
