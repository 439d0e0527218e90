"""Scorer of a tracker's estimates while it runs, which sums errors, NEES and NIS for several instants at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.driving.drive import Delivery
from trackbench.engine.choice import kernels_of
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.conditions import Classes
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.errors import ERRORS, GIVEN
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import accumulators, is_built_in
from trackbench.metrics.innovations import Innovations
from trackbench.metrics.missing_estimates import ChargedEstimates
from trackbench.metrics.protocol import Chunk, Innovation, Metric, Scope, SquaredErrors, Target, raise_fault
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE, TOO_LARGE
from trackbench.trackers.track_steps import log_likelihood

if TYPE_CHECKING:
    from trackbench.engine.kernels import Kernels
    from trackbench.metrics.score_sequence import ScoreSequence

#: Number of estimates that are scored at a time, over batch and instants: large enough to save NumPy calls.
BATCH = 16_000
#: Largest number of instants that are scored without kernels before a sequence of calls is tried again.
BEFORE_SEQUENCES = 8


class Scorer:
    """Scorer of one tracker's estimates in one block of runs; ``close`` returns the sums at the end."""

    def __init__(
        self,
        target: Target,
        classes: Classes,
        measurements: dict[str, int],
        *,
        tracker: str = "tracker",
        single: bool = False,
        metrics: Sequence[Metric] = BUILT_IN,
        compute: Compute = by_numpy,
        measured: Callable[[slice], Array] | None = None,
        bodies: EgoScene | None = None,
    ) -> None:
        """Start the sums of one block of runs at zero.

        Args:
            target: ground truth that the estimates are compared with.
            classes: class of each object by condition, ``(instants, objects, runs or 1)``.
            measurements: number of instants at which each sensor measures, by name of the sensor.
            tracker: name of the tracker.
            single: whether the block is a single run whose stretches of time stand for independent runs.
            metrics: metrics to compute.
            compute: function that computes equations.
            measured: returns ``(2, instants, batch)`` the latest measured positions at some instants, m; needed where
                an estimate that is due is missing.
            bodies: ego and sizes of the objects.
        """
        self._target, self._compute = target, compute
        _, _, self._objects, _ = target.state.shape
        self._runs = target.due.shape[2]
        batch = self._objects * self._runs
        self.chunk: int = max(1, BATCH // batch)
        self.tracker = tracker
        scope = Scope(
            tracker,
            self._runs,
            bodies,
            target=target,
            classes=classes,
            measurements=measurements,
            single=single,
            compute=compute,
        )
        self._due = scope.labelled.each(target.due)
        self._expected = self._due | scope.labelled.each(target.starting)
        self._classes = classes
        self._accumulators = accumulators(metrics)
        self._of_density = any(metric.of_density for metric in metrics)
        self._sums = {name: accumulator.init(scope) for name, accumulator in self._accumulators.items()}
        self._mean = np.empty((4, self.chunk, batch))
        self._covariance = np.empty((4, 4, self.chunk, batch))
        self._first, self._filled = 0, 0
        self._had = np.zeros(batch, dtype=bool)
        self._charged = ChargedEstimates(target.state, target.due | target.starting, measured)
        self._sensors = tuple(measurements)
        self.no_estimate = Estimate(np.full((4, batch), np.nan), np.full((4, 4, batch), np.nan))
        """Placeholder for the answer of a tracker without any estimate."""
        self._begin_chunk()
        if self.kernels is not None:
            self.chunk = min(self.chunk, BEFORE_SEQUENCES)

    def take(self, delivery: Delivery, answer: Estimate | None, seconds: float = math.nan) -> None:
        """Score the tracker's answer to a scan, which took some seconds; call it for each scan in order.

        Raises:
            Fault: an estimate cannot be scored.
        """
        estimate = answer or self.no_estimate
        self.scan(delivery.instant, delivery.scan, estimate, seconds)
        if delivery.last:
            self.estimate(estimate)

    def scan(self, instant: int, scan: Scan, estimate: Estimate, seconds: float = math.nan) -> None:
        """Add the innovations, repairs and computing time at a scan; call it for each scan in order."""
        if not scan.asked:
            white, used = whitened_innovation(estimate), scan.valid & self._due[instant]
            # A view would keep all arrays of this step alive, and the next step could not reuse their cached memory.
            white = None if white is None else white.copy()
            density = log_likelihood(estimate) if self._of_density else None
            self._innovations[scan.sensor].append(Innovation(instant, white, used, used & self._had, density))
        if estimate.repaired is not None:
            repaired = estimate.repaired & self._due[instant]
            self._repaired += repaired.reshape(self._objects, self._runs).sum(axis=0)
        self._seconds += seconds
        self._steps += scan.valid.size

    def estimate(self, estimate: Estimate) -> None:
        """Add the estimate after the last scan of an instant; score the waiting estimates once a chunk is full.

        Raises:
            Fault: an estimate cannot be scored.
        """
        self._mean[:, self._filled] = estimate.mean
        self._covariance[:, :, self._filled] = estimate.covariance
        self._had = (self._had | np.isfinite(estimate.mean[0])) & self._expected[self._first + self._filled]
        self._filled += 1
        if self._filled == self.chunk or self._waiting.stop == len(self._target.time):
            self.score()

    @property
    def waits(self) -> bool:
        """Whether some estimates are added but not scored yet."""
        return self._filled > 0

    @cached_property
    def kernels(self) -> Kernels | None:
        """Kernels that score several instants in one sequence of calls; None where NumPy scores the instants."""
        accumulators_left = dict(self._accumulators)
        if accumulators_left.pop(ESTIMATES.name, None) is None or self._classes.shape[-1] > 1:
            return None
        of_squares = all(
            is_built_in(item) and getattr(item, "of_squares", False) for item in accumulators_left.values()
        )
        return kernels_of(self._compute, self._runs) if of_squares else None

    @property
    def shape(self) -> tuple[int, int]:
        """Number of objects and number of runs, whose product is the length of a batch."""
        return self._objects, self._runs

    @property
    def due(self) -> Mask:
        """``(instants, batch)`` mask of the estimates that a tracker should give."""
        return self._due

    def has_all(self, started: Mask, instants: slice) -> bool:
        """Return whether the tracks ``(batch,)`` that have started cover all estimates expected at some instants."""
        return not (self._expected[instants] & ~started).any()

    def sequence(self, instants: slice) -> ScoreSequence:
        """Return empty scores of the next instants, to be filled by a sequence of kernel calls."""
        from trackbench.metrics.score_sequence import ScoreSequence

        classes, count = self._sums[ESTIMATES.name].classes
        return ScoreSequence(self._target, classes[..., 0], count, instants)

    def innovations(self, sensor: str) -> Innovations:
        innovations: Innovations = self._sums[ESTIMATES.name].innovations(sensor)
        return innovations

    def take_sequence(
        self, scores: ScoreSequence, repaired: Array, latest: Array, given: Mask, spent: tuple[float, int]
    ) -> None:
        """Add the scores of instants that a sequence of kernel calls has scored.

        Args:
            scores: scores at the next instants.
            repaired: ``(instants, batch or 1)`` number of repaired covariances.
            latest: ``(4, batch)`` estimates at the last of these instants.
            given: ``(batch,)`` mask of the latest estimates that the tracker gave.
            spent: seconds, and number of steps of single objects in this time.
        """
        instants = scores.instants
        due = self._due[instants]
        squares = SquaredErrors(instants, scores.squares, due, np.broadcast_to(given, due.shape), self._runs, *spent)
        repairs = (repaired * due).sum(axis=0).reshape(self._objects, self._runs).sum(axis=0) if repaired.any() else 0.0
        for name, accumulator in self._accumulators.items():
            if name == ESTIMATES.name:
                self._sums[name].add_sequence(scores, squares, repairs)
            else:
                self._sums[name] = accumulator.update(self._sums[name], squares)
        self._first = instants.stop
        self._had = given & self._expected[instants.stop - 1]
        self._charged.note(np.where(given, latest, np.nan), instants.stop - 1)

    def close(self) -> dict[str, Any]:
        """Return the sums over all scored estimates, by name of the accumulator that summed."""
        return {name: accumulator.close(self._sums[name]) for name, accumulator in self._accumulators.items()}

    def score(self) -> None:
        """Score the estimates that were added since the last scoring.

        Raises:
            Fault: an estimate is not finite, a covariance not positive definite, or an error too large.
        """
        chunk = self._scored_chunk()
        for name, accumulator in self._accumulators.items():
            self._sums[name] = accumulator.update(self._sums[name], chunk)
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._innovations: dict[str, list[Innovation]] = {name: [] for name in self._sensors}
        self._repaired = np.zeros(self._runs)
        self._seconds, self._steps = 0.0, 0

    def _scored_chunk(self) -> Chunk:
        instants, estimates = self._waiting, self._estimates()
        self._filled, self._first = 0, instants.stop
        truth = self._target.state[:, instants]
        finite, given = _masks(self._computed(GIVEN, estimates), "finite", "given")
        if not finite.all():
            raise_fault(NOT_FINITE, self._alive(instants) & given & ~finite, instants.start)
        self._charged.charge(estimates["mean"].reshape(4, *finite.shape), finite, instants)
        shape = estimates["mean"].shape[1:]
        compared_with = {
            "truth": truth,
            "reference": self._target.reference[:, instants],
            "finite": finite.reshape(shape),
            "scored": self._target.due[instants],
        }
        errors = self._computed(ERRORS, {**estimates, **compared_with})
        definite, bounded = _masks(errors, "definite", "bounded")
        if not definite.all():
            raise_fault(NOT_DEFINITE, self._alive(instants) & ~definite, instants.start)
        if not bounded.all():
            raise_fault(TOO_LARGE, ~bounded, instants.start)
        return Chunk(
            instants=instants,
            time=self._target.time[instants],
            truth=truth,
            mean=estimates["mean"].reshape(4, *finite.shape),
            covariance=estimates["covariance"].reshape(4, 4, *finite.shape),
            values=errors["rows"].reshape(-1, *finite.shape),
            scored=self._due[instants],
            given=finite,
            innovations=self._innovations,
            repaired=self._repaired,
            seconds=self._seconds,
            steps=self._steps,
        )

    @property
    def _waiting(self) -> slice:
        return slice(self._first, self._first + self._filled)

    def _estimates(self) -> dict[str, Array]:
        shape = self._filled, self._objects, self._runs
        mean, covariance = self._mean[:, : self._filled], self._covariance[:, :, : self._filled]
        return {"mean": mean.reshape(4, *shape), "covariance": covariance.reshape(4, 4, *shape)}

    def _computed(self, equations: Equations, values: Values) -> dict[str, Array]:
        with np.errstate(all="ignore"):
            return self._compute(equations, values)

    def _alive(self, instants: slice) -> Mask:
        return np.repeat(self._target.alive[instants], self._runs, axis=1)


def _masks(computed: Mapping[str, Any], *names: str) -> list[Mask]:
    return [computed[name].reshape(len(computed[name]), -1) for name in names]
