"""Take a built-in tracker of single objects through many scans by one sequence of calls, and score it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan
from trackbench.engine.filters import FusedFilter, kernels
from trackbench.engine.sequences import CallSequence
from trackbench.engine.vector_code import WIDTH
from trackbench.metrics import Scorer
from trackbench.metrics.score_sequence import InnovationSequence
from trackbench.runner.filter_sequence import FilterSequence, SequenceStep, filter_steps
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.track_steps import TrackState, where_tracked

#: Instants from which on a sequence is worth the making.
LEAST = 4


class RecordedSequence(NamedTuple):
    """The estimates and innovations of one run at all steps."""

    sequence: FilterSequence
    white: Array
    """``(steps, m, objects, runs)`` whitened innovations, zeros behind those of fewer components."""
    member: int
    """Which of its runs it is."""
    started: Mask
    """``(objects,)`` where there is a track."""

    def estimate(self, number: int) -> tuple[Array, Array]:
        """Mean ``(4, objects)`` and covariance after a step, NaN where there is no track."""
        slots = self.sequence.cartesian[number]
        runs = self.sequence.shape[1]
        mean, covariance = (np.where(self.started, slot.value[..., self.member :: runs], np.nan) for slot in slots)
        return mean, covariance

    def whitened(self, number: int) -> Array:
        """``(m, objects)`` whitened innovations of a step."""
        return self.white[number, ..., self.member]


class SequenceResult(NamedTuple):
    """What a tracker made of a sequence of steps, all of which are scored."""

    steps: Sequence[SequenceStep]
    sequence: FilterSequence
    started: Mask
    recorded: RecordedSequence | None

    def probability(self, number: int) -> Array | None:
        """``(M, batch)`` mode probabilities after a step, NaN where there is no track; None without modes."""
        probability = self.sequence.probability(number)
        return None if probability is None else where_tracked(self.started, probability)


def run_sequence(
    tracker: FilterTracker,
    state: TrackState,
    instants: Sequence[Sequence[Scan]],
    scorer: Scorer,
    first: int,
    recorded: int | None,
) -> SequenceResult | None:
    """Take a tracker through instants by one sequence of calls, and score it.

    Args:
        tracker: the tracker.
        state: its state before them.
        instants: the scans of each.
        scorer: scores it; nothing waits there.
        first: number of the first instant.
        recorded: the run whose estimates are kept, if any.

    Returns:
        None where they have to be taken step by step.
    """
    by, objects, runs = scorer.kernels, *scorer.shape
    steps = filter_steps(tracker, state, instants) if by and isinstance(tracker.computed_filter, FusedFilter) else []
    here = slice(first, first + (steps[-1].instant + 1 if steps else 0))
    if by is None or here.stop - first < LEAST or not scorer.has_all(state.started, here):
        return None
    rows: dict[str, list[int]] = {}
    for number, step in enumerate(steps):
        if step.reads:
            rows.setdefault(step.scan.sensor, []).append(number)
    if not all(scorer.innovations(sensor).known for sensor in rows):
        return None
    sequence, scores = FilterSequence(tracker, state, steps, (objects, runs)), scorer.sequence(here)
    calls, white = CallSequence(by, objects, runs, sequence.length), np.zeros(len(steps), dtype=np.int64)
    sums: dict[str, InnovationSequence] = {}
    for sensor, numbers in rows.items():
        latest = scorer.innovations(sensor).latest()
        sums[sensor] = InnovationSequence(*latest, (objects, runs), len(numbers))
        white[numbers] = sums[sensor].white.address
    possible = sequence.add(calls, white)
    possible = possible and scores.add(calls, sequence.score_calls, *sequence.places(sequence.scored))
    for sensor, numbers in rows.items():
        due = scores.due(np.array([steps[number].instant for number in numbers]))
        possible = possible and sums[sensor].add(calls, *sequence.innovation_calls(numbers), due)
    begin = time.perf_counter()
    if not (
        possible
        and calls.run()
        and scores.sound
        and not (sequence.refused.reshape(len(steps), -1) & state.started).any()
    ):
        return None
    seconds = time.perf_counter() - begin
    for sensor, own in sums.items():
        scorer.innovations(sensor).take_sums(own.per_step, own.per_run, *own.latest)
    nobody = np.zeros(objects * runs, dtype=bool)
    for step in steps:
        if not step.reads and not step.scan.asked:
            scorer.innovations(step.scan.sensor).add(None, nobody, nobody)
    spent = seconds, len(steps) * len(state.started)
    scorer.take_sequence(scores, sequence.repairs(), sequence.cartesian[-1][0].value, state.started, spent)
    of_recorded = None if recorded is None else _recorded(tracker, state, steps, (objects, runs), recorded)
    return SequenceResult(steps, sequence, state.started, of_recorded)


def _recorded(
    tracker: FilterTracker, state: TrackState, steps: Sequence[SequenceStep], shape: tuple[int, int], run: int
) -> RecordedSequence:
    """The same steps of a run and as many beside it as make a vector, of which all estimates are kept."""
    first = min(run, shape[1] - WIDTH)
    sequence = FilterSequence(tracker, state, steps, shape, range(first, first + WIDTH))
    calls = CallSequence(kernels(), *sequence.shape, sequence.length)
    white = np.zeros((len(steps), max(len(step.scan.measurement) for step in steps), *sequence.shape))
    sequence.add(calls, white.ctypes.data + np.arange(len(steps)) * white.strides[0])
    calls.run()
    return RecordedSequence(sequence, white, run - first, state.started[run :: shape[1]])
