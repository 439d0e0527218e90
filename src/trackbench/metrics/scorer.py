"""Scores a tracker's estimates as they come, several instants at a time so that NumPy's calls are few."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.driving.drive import DriveStep
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
from trackbench.metrics.protocol import Chunk, Innovation, Metric, Scope, SquaredErrors, Target, raise_fault
from trackbench.metrics.silence import Silence
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE, TOO_LARGE
from trackbench.trackers.track_steps import log_likelihood

if TYPE_CHECKING:
    from trackbench.engine.kernels import Kernels
    from trackbench.metrics.score_sequence import ScoreSequence

#: Numbers of batch and instants whose product makes one batch of scoring: large enough that NumPy's calls are few.
BATCH = 16_000
#: Instants that are scored by themselves, at most, before a sequence of calls is tried again.
BEFORE_SEQUENCES = 8


class Scorer:
    """Takes in the estimates of one tracker on one block of runs; ``close`` gives the sums at the end."""

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
        """A scorer of one block.

        Args:
            target: what the estimates are held against.
            classes: ``(instants, objects, runs or 1)`` of :func:`trackbench.metrics.conditions.condition_classes`.
            measurements: how many instants each sensor has.
            tracker: whose estimates they are.
            single: whether it is a run whose stretches of time stand for independent runs.
            metrics: what is to be computed.
            compute: how equations are computed.
            measured: gives ``(2, instants, batch)`` the latest measured position at some instants, m; needed where the
                tracker gave no estimate that is due.
            bodies: the ego and the sizes of the objects.
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
        self._silence = Silence(target.state, target.due | target.starting, measured)
        self._sensors = tuple(measurements)
        self.none = Estimate(np.full((4, batch), np.nan), np.full((4, 4, batch), np.nan))
        """In the place of the estimates of a tracker that gives none."""
        self._begin_chunk()
        if self.kernels is not None:
            self.chunk = min(self.chunk, BEFORE_SEQUENCES)

    def take(self, step: DriveStep[Estimate | None]) -> None:
        """Take in what a tracker made of a scan; to be called in order.

        Raises:
            Fault: an estimate cannot be scored.
        """
        estimate = step.answer or self.none
        self.scan(step.instant, step.scan, estimate, step.seconds)
        if step.last:
            self.estimate(estimate)

    def scan(self, instant: int, scan: Scan, estimate: Estimate, seconds: float = math.nan) -> None:
        """Take in what a tracker made of a scan, and how long it took; to be called for every scan, in order."""
        if not scan.asked:
            white, used = whitened_innovation(estimate), scan.valid & self._due[instant]
            # A view would keep all that the step computed, so that the next one found no memory that is in the cache.
            white = None if white is None else white.copy()
            density = log_likelihood(estimate) if self._of_density else None
            self._innovations[scan.sensor].append(Innovation(instant, white, used, used & self._had, density))
        if estimate.repaired is not None:
            repaired = estimate.repaired & self._due[instant]
            self._repaired += repaired.reshape(self._objects, self._runs).sum(axis=0)
        self._seconds += seconds
        self._steps += scan.valid.size

    def estimate(self, estimate: Estimate) -> None:
        """Take in the estimate after the last scan of an instant; score what waits at the end of a chunk.

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
        """Whether something was taken in that is not scored yet."""
        return self._filled > 0

    @cached_property
    def kernels(self) -> Kernels | None:
        """The kernels by whose sequences of calls instants can be scored; None: they cannot."""
        others = dict(self._accumulators)
        if others.pop(ESTIMATES.name, None) is None or self._classes.shape[-1] > 1:
            return None
        of_squares = all(is_built_in(item) and getattr(item, "of_squares", False) for item in others.values())
        return kernels_of(self._compute, self._runs) if of_squares else None

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of objects and of runs."""
        return self._objects, self._runs

    @property
    def due(self) -> Mask:
        """``(instants, batch)`` where an estimate is due."""
        return self._due

    def has_all(self, started: Mask, here: slice) -> bool:
        """Whether tracks ``(batch,)`` that have started are all that an estimate is expected of at some instants."""
        return not (self._expected[here] & ~started).any()

    def sequence(self, here: slice) -> ScoreSequence:
        """What scores some instants, the next ones, by a sequence of calls."""
        from trackbench.metrics.score_sequence import ScoreSequence

        classes, count = self._sums[ESTIMATES.name].classes
        return ScoreSequence(self._target, classes[..., 0], count, here)

    def innovations(self, sensor: str) -> Innovations:
        """What sums the innovations of a sensor."""
        innovations: Innovations = self._sums[ESTIMATES.name].innovations(sensor)
        return innovations

    def take_sequence(
        self, scores: ScoreSequence, repaired: Array, latest: Array, given: Mask, spent: tuple[float, int]
    ) -> None:
        """Take in what a sequence has scored.

        Args:
            scores: at the next instants.
            repaired: ``(instants, batch or 1)`` number of repaired covariances.
            latest: ``(4, batch)`` the estimates at the last of them.
            given: ``(batch,)`` which of them there are.
            spent: seconds, and for how many steps of single objects.
        """
        here = scores.here
        due = self._due[here]
        squares = SquaredErrors(here, scores.squares, due, np.broadcast_to(given, due.shape), self._runs, *spent)
        repairs = (repaired * due).sum(axis=0).reshape(self._objects, self._runs).sum(axis=0) if repaired.any() else 0.0
        for name, accumulator in self._accumulators.items():
            if name == ESTIMATES.name:
                self._sums[name].add_sequence(scores, squares, repairs)
            else:
                self._sums[name] = accumulator.update(self._sums[name], squares)
        self._first = here.stop
        self._had = given & self._expected[here.stop - 1]
        self._silence.note(np.where(given, latest, np.nan), here.stop - 1)

    def close(self) -> dict[str, Any]:
        """By accumulator, the sums of everything that was scored."""
        return {name: accumulator.close(self._sums[name]) for name, accumulator in self._accumulators.items()}

    def score(self) -> None:
        """Score what waits.

        Raises:
            Fault: an estimate is not finite, a covariance not positive definite, or an error too large.
        """
        chunk = self._taken()
        for name, accumulator in self._accumulators.items():
            self._sums[name] = accumulator.update(self._sums[name], chunk)
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._innovations: dict[str, list[Innovation]] = {name: [] for name in self._sensors}
        self._repaired = np.zeros(self._runs)
        self._seconds, self._steps = 0.0, 0

    def _taken(self) -> Chunk:
        here, estimates = self._waiting, self._estimates()
        self._filled, self._first = 0, here.stop
        truth = self._target.state[:, here]
        finite, given = _masks(self._computed(GIVEN, estimates), "finite", "given")
        if not finite.all():
            raise_fault(NOT_FINITE, self._alive(here) & given & ~finite, here.start)
        self._silence.charge(estimates["mean"].reshape(4, *finite.shape), finite, here)
        shape = estimates["mean"].shape[1:]
        held_against = {
            "truth": truth,
            "reference": self._target.reference[:, here],
            "finite": finite.reshape(shape),
            "scored": self._target.due[here],
        }
        errors = self._computed(ERRORS, {**estimates, **held_against})
        definite, bounded = _masks(errors, "definite", "bounded")
        if not definite.all():
            raise_fault(NOT_DEFINITE, self._alive(here) & ~definite, here.start)
        if not bounded.all():
            raise_fault(TOO_LARGE, ~bounded, here.start)
        return Chunk(
            instants=here,
            time=self._target.time[here],
            truth=truth,
            mean=estimates["mean"].reshape(4, *finite.shape),
            covariance=estimates["covariance"].reshape(4, 4, *finite.shape),
            values=errors["rows"].reshape(-1, *finite.shape),
            scored=self._due[here],
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
        """What waits, with the batch axes ``(instants, objects, runs)``."""
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
