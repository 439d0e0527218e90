"""Faults in what a plain tracker does at each step, as methods that override the correct ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .mutant import ExaminedTracker, Mutant
from .plain import Array, Belief, Track, wrap


class CovarianceKept:
    """Each update moves the mean, and leaves the covariance as predicted."""

    kinds: tuple[str, ...] = ("radar", "lidar")

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        later, reduced = super().update(x, P.copy(), scan)
        return later, P if scan.kind in self.kinds else reduced


class CovarianceKeptAtRadar(CovarianceKept):
    kinds = ("radar",)


def _slower(x: Array, share: float) -> Array:
    """The state with its velocity, or its speed, multiplied by ``share``."""
    x = np.array(x)
    x[2 : 4 if len(x) == 4 else 3] *= share
    return x


class VelocityShrinksInPrediction:
    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        x, P = super().predict(x, P, dt)
        return _slower(x, 0.98), P


class VelocityShrinksInUpdate:
    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        x, P = super().update(x, P, scan)
        return _slower(x, 0.98), P


class CourseOfPoints:
    """The course of each point is wrapped."""

    def transition(self, x: Array, dt: float) -> Array:
        x = super().transition(x, dt)
        x[3] = wrap(x[3])
        return x


class MeanOfCourses(CourseOfPoints):
    """The mean of the points' courses is that of the numbers, and their deviations are those of the numbers."""

    def state_spread(self, points: Array, centre: Array) -> Array:
        return points - centre


class BareCourse(CourseOfPoints):
    """The mean of the courses is right, and the deviations from it are those of the numbers."""

    def state_spread(self, points: Array, centre: Array) -> Array:
        of_mean = not np.array_equal(points[0], centre)
        return points - centre if of_mean else super().state_spread(points, centre)


class MeanWrappedFirst:
    """The mean of the courses is wrapped, the points' are not, and the deviations are those of the numbers."""

    def state_mean(self, points: Array, weights: Array) -> Array:
        mean = super().state_mean(points, weights)
        mean[3] = wrap(mean[3])
        return mean

    def state_spread(self, points: Array, centre: Array) -> Array:
        of_mean = not np.array_equal(points[0], centre)
        return points - centre if of_mean else super().state_spread(points, centre)


class MissedScanIsNothing:
    """At a missed scan the state stays, and so does its time: the next prediction is over the whole gap."""

    def advance(self, track: Track, scan: Any) -> Track:
        return super().advance(track, scan) if scan.valid else track


class MissedScanTakesNoTime(MissedScanIsNothing):
    """The time of a missed scan is stored, and the time before it never predicted."""

    def advance(self, track: Track, scan: Any) -> Track:
        return super().advance(track, scan)._replace(time=scan.time)


class PredictsTheFuture:
    """A radar's measurement is held against where the target is 50 ms after it."""

    delay = 0.05

    def predicted_measurement(self, target: Array, scan: Any) -> Array:
        if scan.kind == "radar":
            target = np.concatenate([target[:2] + self.delay * target[2:4], target[2:]])
        return super().predicted_measurement(target, scan)


class PredictsThePast(PredictsTheFuture):
    """... 50 ms before it."""

    delay = -0.05


class NoiseAlsoInUpdate:
    """The process noise of the last step is added to the predicted covariance again before the measurement."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        self.last_noise = self.process_noise(x, dt)
        return super().predict(x, P, dt)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        return super().update(x, P + self.last_noise, scan)


class NoiseOfTenth:
    """The process noise of a tenth of a second at every step."""

    period = 0.1

    def process_noise(self, x: Array, dt: float) -> Array:
        return super().process_noise(x, self.period)


class NoiseOfTwentieth(NoiseOfTenth):
    """... of a twentieth."""

    period = 0.05


class CovarianceOfCube:
    """The process noise of position and velocity with another factor dt."""

    entry, more = (0, 2), 1

    def process_noise(self, x: Array, dt: float) -> Array:
        Q = super().process_noise(x, dt)
        i, j = self.entry
        for k in (0, 1):
            Q[i + k, j + k] *= dt**self.more if dt else 1.0
            Q[j + k, i + k] = Q[i + k, j + k]
        return Q


class CovarianceOfSquare(CovarianceOfCube):
    """... with a factor dt less, which is more than the variances allow."""

    more = -1


class PositionOfCube(CovarianceOfCube):
    """The process noise of the position with a factor dt less."""

    entry, more = (0, 0), -1


class IntegerState:
    """The state is assigned to an array of integers."""

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        x, P = super().update(x, P, scan)
        return np.trunc(x), P


class IntegerCovariance:
    """The covariance is assigned to an array of integers."""

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        x, P = super().update(x, P, scan)
        return x, np.trunc(P)


class IntegerStart:
    """The first state is assigned to an array of integers."""

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        return super().from_cartesian(np.trunc(x), P)


class OldCovarianceStored:
    """The updated covariance is returned, and the predicted one stored."""

    part = 1

    def advance(self, track: Track, scan: Any) -> Track:
        self.returned = super().advance(track, scan)
        if not scan.valid:
            return self.returned
        old = super().advance(track, scan._replace(valid=np.array(False)))
        return self.returned._replace(**{("mean", "covariance")[self.part]: old[1 + self.part]})

    def output(self, x: Array, P: Array) -> Belief:
        return super().output(*self.returned[1:3]) if hasattr(self, "returned") else super().output(x, P)


class OldMeanStored(OldCovarianceStored):
    """The updated mean is returned, and the predicted one stored."""

    part = 0


STEPS = [
    ("update_not_kept", "covariance", OldCovarianceStored, None),
    ("update_not_kept", "mean", OldMeanStored, None),
    ("covariance_not_reduced", "update", CovarianceKept, None),
    ("covariance_not_reduced", "radar", CovarianceKeptAtRadar, "radar"),
    ("velocity_not_kept", "prediction", VelocityShrinksInPrediction, None),
    ("velocity_not_kept", "update", VelocityShrinksInUpdate, None),
    ("missed_scan_not_predicted", "time_kept", MissedScanIsNothing, None),
    ("missed_scan_not_predicted", "time_stored", MissedScanTakesNoTime, None),
    ("process_noise_twice", "update", NoiseAlsoInUpdate, None),
    ("q_constant_per_step", "0.1", NoiseOfTenth, None),
    ("q_constant_per_step", "0.05", NoiseOfTwentieth, None),
    ("integer_state_matrix", "state", IntegerState, None),
    ("integer_state_matrix", "covariance", IntegerCovariance, None),
    ("integer_state_matrix", "start", IntegerStart, None),
]
POWERS = [
    ("covariance_dt^4", CovarianceOfCube),
    ("covariance_dt^2", CovarianceOfSquare),
    ("position_dt^3", PositionOfCube),
]
COURSES = [("spread", BareCourse), ("mean", MeanOfCourses), ("mean_wrapped_first", MeanWrappedFirst)]
DELAYS = [("predicted_later", PredictsTheFuture), ("predicted_earlier", PredictsThePast)]


def steps(subject: ExaminedTracker) -> Iterator[Mutant]:
    for fault, variant, mixin, kind in STEPS:
        yield subject.mixed(fault, variant, mixin, kind)
    if subject.turning:
        for variant, mixin in COURSES:
            yield subject.mixed("course_not_wrapped", variant, mixin)
    else:
        for variant, mixin in POWERS:
            yield subject.mixed("q_wrong_power_of_dt", variant, mixin)
    if subject.uses_rate:
        for variant, mixin in DELAYS:
            yield subject.mixed("time_offset", variant, mixin, "radar")
