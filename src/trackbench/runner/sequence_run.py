"""Run a built-in single-object tracker through many scans by one sequence of kernel calls, and score it."""

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
from trackbench.trackers.track_steps import TrackState

#: Smallest number of instants for which a sequence is faster than single steps.
LEAST_INSTANTS = 4


class RecordedSequence(NamedTuple):
    """A tracker's estimates and innovations in the recorded run (kept for plots), at all steps of a sequence."""

    sequence: FilterSequence
    white: Array
    """``(steps, m, objects, runs)`` whitened innovations; zeros in components that a sensor does not have."""
    member: int
    """Index of the recorded run (kept for plots) among the runs of the sequence."""
    started: Mask
    """``(objects,)`` True where there is a track."""

    def estimate(self, number: int) -> tuple[Array, Array]:
        """Return mean ``(4, objects)`` and covariance after the step with index ``number``, NaN without a track."""
        slots = self.sequence.cartesian[number]
        runs = self.sequence.shape[1]
        mean, covariance = (np.where(self.started, slot.value[..., self.member :: runs], np.nan) for slot in slots)
        return mean, covariance

    def whitened(self, number: int) -> Array:
        """Return the whitened innovations ``(m, objects)`` of the step with index ``number``."""
        return self.white[number, ..., self.member]


def run_sequence(
    tracker: FilterTracker,
    state: TrackState,
    instants: Sequence[Sequence[Scan]],
    scorer: Scorer,
    first: int,
    recorded: int | None,
) -> tuple[FilterSequence, RecordedSequence | None] | None:
    """Take a tracker through instants by one sequence of kernel calls, and score its estimates.

    Args:
        tracker: built-in tracker of single objects.
        state: state before the first instant.
        instants: scans of each instant.
        scorer: scorer of the tracker, with no estimate waiting.
        first: index of the first instant.
        recorded: number of the run in the block whose estimates are kept; None for no run.

    Returns:
        The sequence, and the estimates of the run ``recorded``, None without it; None where steps have to be taken one
        by one.
    """
    kernel_set, objects, runs = scorer.kernels, *scorer.shape
    is_fused = kernel_set and isinstance(tracker.computed_filter, FusedFilter)
    steps = filter_steps(tracker, state, instants) if is_fused else []
    span = slice(first, first + (steps[-1].instant + 1 if steps else 0))
    if kernel_set is None or span.stop - first < LEAST_INSTANTS or not scorer.has_all(state.started, span):
        return None
    rows: dict[str, list[int]] = {}
    for number, step in enumerate(steps):
        if step.reads:
            rows.setdefault(step.scan.sensor, []).append(number)
    if not all(scorer.innovations(sensor).known for sensor in rows):
        return None
    sequence, scores = FilterSequence(tracker, state, steps, (objects, runs)), scorer.sequence(span)
    calls, white = CallSequence(kernel_set, objects, runs, sequence.length), np.zeros(len(steps), dtype=np.int64)
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
    for sensor, summed in sums.items():
        scorer.innovations(sensor).take_sums(summed.per_step, summed.per_run, *summed.latest)
    no_member = np.zeros(objects * runs, dtype=bool)
    for step in steps:
        if not step.reads and not step.scan.asked:
            scorer.innovations(step.scan.sensor).add(None, no_member, no_member)
    step_time = seconds, len(steps) * len(state.started)
    scorer.take_sequence(scores, sequence.repairs(), sequence.cartesian[-1][0].value, state.started, step_time)
    return sequence, None if recorded is None else _recorded(tracker, state, steps, (objects, runs), recorded)


def _recorded(
    tracker: FilterTracker, state: TrackState, steps: Sequence[SequenceStep], shape: tuple[int, int], run: int
) -> RecordedSequence:
    """Repeat the steps for the run ``run`` and its neighbours, as many as fill a vector, and keep all estimates."""
    first = min(run, shape[1] - WIDTH)
    sequence = FilterSequence(tracker, state, steps, shape, range(first, first + WIDTH))
    calls = CallSequence(kernels(), *sequence.shape, sequence.length)
    white = np.zeros((len(steps), max(len(step.scan.measurement) for step in steps), *sequence.shape))
    sequence.add(calls, white.ctypes.data + np.arange(len(steps)) * white.strides[0])
    calls.run()
    return RecordedSequence(sequence, white, run - first, state.started[run :: shape[1]])
