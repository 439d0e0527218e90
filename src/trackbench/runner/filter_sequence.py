"""The steps of a built-in single-object tracker through many scans, as one sequence of kernel calls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Scan
from trackbench.engine.beliefs import REUSED, belief_of, belief_values, component_axes
from trackbench.engine.filters import FusedFilter
from trackbench.engine.sequences import Addresses, ArrayPlace, CallSequence, place, place_of_each
from trackbench.filters import choose
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.track_steps import TrackState, where_tracked


class SequenceStep(NamedTuple):
    """One step in a sequence of kernel calls: a tracker's processing of one scan."""

    instant: int
    """Index of the instant in the sequence, from 0."""
    scan: Scan
    elapsed: float
    """Time since the previous scan that advanced the state, s."""
    reads: bool
    """Whether the measurements of the scan update the state."""
    advances: bool
    """Whether the state advances to the time of the scan."""
    last: bool
    """Whether the tracker is scored by the estimate after this step, the last one at its instant."""


def filter_steps(tracker: FilterTracker, state: TrackState, instants: Sequence[Sequence[Scan]]) -> list[SequenceStep]:
    """Return a tracker's steps through the first instants, as far as each step only predicts and updates its filter.

    The steps end before an instant at which a track can start, a scan is late, or a tracker with a guard (test of each
    prediction) reads nothing.
    There are no steps before the first track, or while a track waits by a prior or at rest. Nor are there while a track
    is in the Cartesian fallback (followed by position and velocity alone).
    """
    started = state.started
    some_wait = not started.all()
    waits_with_state = some_wait and (tracker.prior is not None or tracker.initial.waiting == "at_rest")
    steps: list[SequenceStep] = []
    if state.fallback is not None or not started.any() or waits_with_state:
        return steps
    starting, time = tracker.initial.sensors or tracker.sensors, state.time
    for instant, scans in enumerate(instants):
        group: list[SequenceStep] = []
        for number, taken in enumerate(scans):
            scan = tracker.assumed.read(taken)
            advances = tracker.advances(scan.sensor) and not scan.asked
            reads = advances and (tracker.sensors is None or scan.sensor in tracker.sensors)
            may_start = some_wait and advances and (starting is None or scan.sensor in starting)
            if (
                scan.arrival_time != scan.time
                or scan.time < time
                or (not reads and tracker.guard is not None)
                or (may_start and (scan.valid & ~started).any())
            ):
                return steps
            group.append(SequenceStep(instant, scan, scan.time - time, reads, advances, number == len(scans) - 1))
            time = scan.time if advances else time
        steps += group
    return steps


class Slot(NamedTuple):
    """One place in an array ``(components..., slots, objects, runs)``, for values before or after a step."""

    array: Array
    number: int

    @property
    def value(self) -> Array:
        """Values of the slot, ``(components..., objects * runs)``."""
        axes = self.array.ndim - 3
        value: Array = self.array[(slice(None),) * axes + (self.number,)]
        return value.reshape(*value.shape[:axes], -1)


class FilterSequence:
    """Steps of a tracker as a sequence of kernel calls, with the arrays that the calls read and write.

    Args:
        tracker: tracker whose filter is computed by kernels.
        state: state before the first step.
        steps: steps of the tracker.
        shape: number of objects and number of runs.
        recorded_runs: runs whose estimates are kept at all steps and not scored; None for all runs, scored, with only
            the latest estimates kept.
    """

    def __init__(
        self,
        tracker: FilterTracker,
        state: TrackState,
        steps: Sequence[SequenceStep],
        shape: tuple[int, int],
        recorded_runs: range | None = None,
    ) -> None:
        assert isinstance(tracker.computed_filter, FusedFilter)
        self._tracker, self._filter, self._state, self.steps = tracker, tracker.computed_filter, state, steps
        self._keeps, self._all_runs = recorded_runs is not None, shape[1]
        runs = recorded_runs or range(shape[1])
        self._first_run, self.shape = runs.start, (shape[0], len(runs))
        """Number of objects and number of runs in the arrays."""
        advances = np.array([step.advances for step in steps])
        self._still = ~advances & (np.array([step.elapsed for step in steps]) <= 0.0)
        self._of_state = advances | self._still
        aside = ~self._of_state
        # The slot that each step reads, and the slot of its estimate: of the state, or of predictions beside it.
        self._from = np.cumsum(advances) - advances
        self._to = np.where(self._of_state, self._from + advances, np.cumsum(aside) - 1)
        belief = belief_values(state.belief._replace(repaired=None), without=REUSED)
        self._main = {name: self._slots(name, value.shape[:-1], 1 + advances.sum()) for name, value in belief.items()}
        for name, value in belief.items():
            self._main[name][..., 0, :, :] = value.reshape(*value.shape[:-1], *shape)[..., runs.start : runs.stop]
        self._beside = {name: self._slots(name, value.shape[:-1], aside.sum()) for name, value in belief.items()}
        # As many slots as the state has, so that all estimates have the same stride.
        slots = len(steps) if self._keeps else min(2, 1 + int(advances.sum()))
        self._cartesian = np.empty((4, slots, *self.shape)), np.empty((4, 4, slots, *self.shape))
        self.refused, self.repaired = np.zeros((2, len(steps), *self.shape), dtype=bool)
        """``(steps, objects, runs)`` True where a test (the guard) refused a step, and where a covariance was
        repaired."""
        # An update is followed by the call for its innovation, a prediction by the call for px, py, vx, vy; a scored
        # step ends with the call for its scores.
        reads, scored = (np.array([getattr(step, name) for step in steps]) for name in ("reads", "last"))
        behind = ~reads & ~self._still if self._keeps else ~self._still + scored.astype(int)
        calls = 1 + behind
        self._first, self.length = np.cumsum(calls) - calls, int(calls.sum())
        self.scored = np.flatnonzero(scored)
        """Index of each step that is scored, among all steps of the sequence."""
        self.score_calls = (self._first + calls - 1)[self.scored]
        """Index of the kernel call that computes the scores, for each scored step."""
        self.cartesian: list[tuple[Slot, Slot]] = []
        """Slots of the mean and the covariance of px, py, vx, vy after each step; filled by ``add``."""
        self._addresses, self._strides = np.zeros((2, len(steps)), dtype=np.int64), set[tuple[int, int, int]]()
        self._alive: list[Any] = []
        """Arrays that the calls refer to by address, so that they must not be freed."""

    def _slots(self, name: str, components: tuple[int, ...], count: int) -> Array:
        count = count if self._keeps or name == "probability" else min(2, count)
        return np.empty((*components, count, *self.shape))

    def add(self, sequence: CallSequence, white: Addresses) -> bool:
        """Add the kernel calls of all steps to a sequence, and return whether a kernel exists for each.

        Args:
            sequence: sequence with ``length`` calls.
            white: ``(steps,)`` addresses to which each step that reads writes its whitened innovations; each component
                is a row over all members.
        """
        self.cartesian = [(Slot(self._cartesian[0], 0), Slot(self._cartesian[1], 0))] * len(self.steps)
        groups: dict[Any, list[int]] = {}
        for number, step in enumerate(self.steps):
            scan = step.scan
            kind = scan.kind, scan.sensor, scan.noise_covariance.ndim
            groups.setdefault(kind if step.reads else (step.advances, self._still[number]), []).append(number)
        return all(
            self._add_updates(sequence, np.array(numbers), white)
            if self.steps[numbers[0]].reads
            else self._add_predictions(sequence, np.array(numbers))
            for numbers in groups.values()
        )

    def _add_updates(self, sequence: CallSequence, numbers: Indices, white: Addresses) -> bool:
        scans = [self.steps[number].scan for number in numbers]
        kernel = self._filter.step_kernel(self._state.belief, scans[0], self._tracker.guard)
        if kernel is None:
            return False
        noise = [scan.noise_covariance for scan in scans]
        inputs = {
            **self._inputs(self._main, self._from[numbers]),
            **self._time(numbers),
            "measurement": self._each([scan.measurement for scan in scans], 1),
            "valid": self._each([scan.valid for scan in scans], 0),
            "noise": self._of_all(noise, 2) if noise[0].ndim == 2 else self._each(noise, 2),
            "pose": self._of_all([scan.sensor_pose for scan in scans], 1),
            "velocity": self._of_all([scan.sensor_velocity for scan in scans], 1),
        }
        outputs = {
            **self._outputs(self._main, self._to[numbers]),
            "refused": place(self.refused, 0, numbers),
            "repaired": place(self.repaired, 0, numbers),
            "whitened": ArrayPlace(white[numbers], self.shape[0] * self.shape[1], 8 * self.shape[1]),
        }
        same = kernel.layout.same
        if same.get("cartesian") == "mean" and same.get("cartesian covariance") == "covariance":
            self._note_places(numbers, (self._main["mean"], self._main["covariance"]), self._to[numbers])
        else:
            outputs |= self._cartesian_places(numbers)
        sequence.call(kernel, self._first[numbers], inputs, outputs)
        return True

    def _add_predictions(self, sequence: CallSequence, numbers: Indices) -> bool:
        prediction = self._filter.prediction_kernel(self._state.belief)
        cartesian = self._filter.cartesian_kernel(self._state.belief)
        if prediction is None or cartesian is None:
            return False
        calls, still = self._first[numbers], self._still[numbers[0]]
        into = self._arrays_after(numbers[0])
        if not still:
            inputs = self._inputs(self._main, self._from[numbers]) | self._time(numbers)
            sequence.call(prediction, calls, inputs, self._outputs(into, self._to[numbers]))
        inputs = self._inputs(into, self._to[numbers])
        sequence.call(cartesian, calls + (not still), inputs, self._cartesian_places(numbers))
        return True

    def _arrays_after(self, number: int) -> dict[str, Array]:
        return self._main if self._of_state[number] else self._beside

    def _inputs(self, arrays: dict[str, Array], slots: Indices) -> dict[str, ArrayPlace]:
        constants = {
            name: self._of_all([np.float64(value)] * len(slots), 0) for name, value in self._filter.options.items()
        }
        return self._outputs(arrays, slots) | constants

    def _outputs(self, arrays: dict[str, Array], slots: Indices) -> dict[str, ArrayPlace]:
        return {name: place(array, component_axes(name), slots % array.shape[-3]) for name, array in arrays.items()}

    def _time(self, numbers: Indices) -> dict[str, ArrayPlace]:
        times = [self._filter.time(self.steps[number].elapsed) for number in numbers]
        return {name: self._of_all([time[name] for time in times], component_axes(name)) for name in times[0]}

    def _cartesian_places(self, numbers: Indices) -> dict[str, ArrayPlace]:
        slots = numbers if self._keeps else np.zeros_like(numbers)
        self._note_places(numbers, self._cartesian, slots)
        mean, covariance = self._cartesian
        return {"cartesian": place(mean, 1, slots), "cartesian covariance": place(covariance, 2, slots)}

    def _note_places(self, numbers: Indices, arrays: tuple[Array, Array], slots: Indices) -> None:
        slots = slots % arrays[0].shape[-3]
        self._places = place(arrays[0], 1, slots), place(arrays[1], 2, slots)
        self._addresses[:, numbers] = [each.address for each in self._places]
        self._strides |= {(axes, each.stride, each.group) for axes, each in enumerate(self._places, 1)}
        for number, slot in zip(numbers, slots, strict=True):
            self.cartesian[number] = Slot(arrays[0], slot), Slot(arrays[1], slot)

    def innovation_calls(self, numbers: Sequence[int]) -> tuple[Indices, ArrayPlace]:
        """Return kernel call indices for the innovations of steps ``numbers``, and addresses of these scans' masks."""
        return self._first[numbers] + 1, self._each([self.steps[number].scan.valid for number in numbers], 0)

    def _each(self, arrays: Sequence[npt.NDArray[Any]], axes: int) -> ArrayPlace:
        arrays = [np.ascontiguousarray(array) for array in arrays]
        self._alive.append(arrays)
        result = place_of_each(arrays, axes, self._all_runs)
        return result._replace(address=result.address + self._first_run * arrays[0].itemsize)

    def _of_all(self, arrays: Sequence[Any], axes: int) -> ArrayPlace:
        """Return the addresses of one constant array per kernel call, with the same values for all objects and runs."""
        array = np.moveaxis(np.array(arrays, dtype=float), 0, -1)
        self._alive.append(array)
        return place(array, axes, np.arange(len(arrays)))

    def places(self, numbers: Indices) -> tuple[ArrayPlace, ArrayPlace]:
        """Return the addresses of the mean and the covariance of px, py, vx, vy after the steps with these indices."""
        assert len(self._strides) == 2
        mean, covariance = self._places
        addresses = self._addresses[:, numbers]
        return mean._replace(address=addresses[0]), covariance._replace(address=addresses[1])

    def repairs(self) -> Array:
        """Return how many covariances were repaired at each instant, ``(instants, batch)``."""
        instants, repaired = [step.instant for step in self.steps], self.repaired.reshape(len(self.steps), -1)
        starts = np.flatnonzero(np.diff(instants, prepend=-1))
        return np.add.reduceat(repaired, starts, axis=0, dtype=float) if repaired.any() else np.zeros((len(starts), 1))

    def probability(self, number: int) -> Array | None:
        """Return mode probabilities ``(modes, batch)`` after step ``number``, NaN without track; None without modes."""
        arrays = self._arrays_after(number)
        if "probability" not in arrays:
            return None
        return where_tracked(self._state.started, Slot(arrays["probability"], self._to[number]).value)

    def state(self) -> TrackState:
        """Return the tracker's state after the last step."""
        before, steps = self._state, [step for step in self.steps if step.advances]
        if not steps:
            return before
        slots = {name: Slot(array, len(steps) % array.shape[-3]) for name, array in self._main.items()}
        belief = belief_of({name: slot.value.copy() for name, slot in slots.items()}, self._filter.modes)
        # Tracks that have not started keep their belief.
        return before._replace(time=steps[-1].scan.time, belief=choose(before.started, belief, before.belief))
