"""Any tracker as one that takes a whole batch, its answers checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Scan, scan_of_member
from trackbench.driving.alone import Stateful
from trackbench.driving.faults import fault_of
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import GIVEN_UP, NOT_FINITE, Tracker, TrackerFault, checked
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker
from trackbench.trackers.in_order import TrackState
from trackbench.trackers.published import create


class Stepper(Protocol):
    """A tracker made ready for a batch."""

    def step(self, scan: Scan) -> Estimate | None: ...

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computed the steps so far; None of a tracker that is not built in."""
        ...

    def close(self) -> None:
        """It is no longer needed."""


def local(
    config: FilterConfig | PluginConfig,
    folder: Path | None,
    batch: int,
    with_initial_states: Callable[[FilterTracker], FilterTracker],
) -> Stepper:
    """A fresh tracker in this process, as a scenario names it.

    Args:
        config: the scenario's entry.
        folder: where a tracker's module is looked for first.
        batch: how many tracks it follows at once.
        with_initial_states: gives a built-in tracker its first states, where it starts from the truth.

    Raises:
        InputError: a plug-in cannot be found or does not take its options, or it is a smoother.
    """
    if isinstance(config, FilterConfig):
        if config.smoother is not None:
            raise InputError("a smoother needs all measurements of a run; remove it", key="smoother")
        return Direct(with_initial_states(build(config)))
    make = create(config.use, config.options, folder)
    tracker = make()
    if isinstance(tracker, FilterTracker):
        return Direct(with_initial_states(tracker.reading_only(config.sensors)))
    if getattr(tracker, "batched", False):
        return Batched(tracker)
    return Looped(make, batch)


class InProcessStepper:
    """What ends with the bench."""

    @property
    def engine_used(self) -> EngineUsed | None:
        """Only a built-in tracker says what computed it."""
        return None

    def close(self) -> None:
        """Nothing is left to end."""


class Direct(InProcessStepper):
    """A built-in tracker, whose answers have the right form by construction."""

    def __init__(self, tracker: FilterTracker) -> None:
        self._tracker = tracker
        self._state: TrackState | None = None

    def step(self, scan: Scan) -> Estimate:
        """Estimates of every member of the batch."""
        self._state, estimate = self._tracker.step(self._state, scan)
        return estimate

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        return self._tracker.engine_used


class Offline(InProcessStepper):
    """A smoother, which is told all scans before the first step."""

    def __init__(self, tracker: SmoothedTracker, scans: Sequence[Scan]) -> None:
        self._tracker, self._scans = tracker, scans
        self._estimates: Iterator[Estimate] | None = None

    def step(self, scan: Scan) -> Estimate:
        """Estimates of every member of the batch at the next scan."""
        if self._estimates is None:
            self._estimates = iter(self._tracker.estimates(self._scans))
        return next(self._estimates)

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps."""
        return self._tracker.tracker.engine_used


class Batched(InProcessStepper):
    """A tracker that steps every member of the batch at once."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = Stateful(tracker, checked)
        self._estimated = False

    def step(self, scan: Scan) -> Estimate | None:
        """Estimates of every member of the batch, or None before the first."""
        estimate = self._tracker.step(scan)
        if estimate is None and self._estimated:
            raise TrackerFault(GIVEN_UP)
        self._estimated = estimate is not None
        return estimate


class Looped(InProcessStepper):
    """A tracker that knows one object: a fresh one for each member, called from the member's first measurement on."""

    def __init__(self, make: Callable[[], Tracker], batch: int) -> None:
        self._trackers = [Stateful(make(), checked) for _ in range(batch)]
        self._begun = [False] * batch
        self._known = [False] * batch

    def step(self, scan: Scan) -> Estimate | None:
        """Step every member that has had a measurement. Members are ``(batch,)``.

        Raises:
            TrackFault: a member's tracker raised, or what it gave is not an estimate.
        """
        answers: list[Estimate | None] = []
        for member in range(len(self._trackers)):
            self._begun[member] = self._begun[member] or bool(scan.valid[member])
            try:
                answers.append(self._one(member, scan) if self._begun[member] else None)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                raise fault_of(error, member) from error
        return together(answers, len(scan.measurement))

    def _one(self, member: int, scan: Scan) -> Estimate | None:
        estimate = self._trackers[member].step(scan_of_member(scan, member))
        if estimate is None:
            if self._known[member]:
                raise TrackerFault(GIVEN_UP)
            return None
        if not np.isfinite(estimate.mean.sum() + estimate.covariance.sum()):
            raise TrackerFault(NOT_FINITE)
        self._known[member] = True
        return estimate


def together(answers: list[Estimate | None], size: int) -> Estimate | None:
    """One estimate with a member axis from those of single batch; NaN where there is none."""
    given = [answer for answer in answers if answer is not None]
    if not given:
        return None
    size = next((len(answer.innovation) for answer in given if answer.innovation is not None), size)
    batch = len(answers)
    mean, covariance = np.full((4, batch), np.nan), np.full((4, 4, batch), np.nan)
    innovation, innovation_covariance = np.full((size, batch), np.nan), np.full((size, size, batch), np.nan)
    repaired = np.zeros(batch, dtype=bool)
    modes = _together_modes(answers)
    for member, answer in enumerate(answers):
        if answer is None:
            continue
        mean[:, member], covariance[:, :, member] = answer.mean, answer.covariance
        repaired[member] = bool(answer.repaired) if answer.repaired is not None else False
        if answer.innovation is not None and answer.innovation_covariance is not None:
            innovation[:, member], innovation_covariance[:, :, member] = answer.innovation, answer.innovation_covariance
    if np.isnan(innovation).all():
        return Estimate(mean, covariance, repaired=repaired, mode_probabilities=modes)
    return Estimate(
        mean,
        covariance,
        innovation=innovation,
        innovation_covariance=innovation_covariance,
        repaired=repaired,
        mode_probabilities=modes,
    )


def _together_modes(answers: list[Estimate | None]) -> Array | None:
    given = [None if answer is None else answer.mode_probabilities for answer in answers]
    sizes = {len(modes) for modes in given if modes is not None}
    if not sizes:
        return None
    if len(sizes) > 1:
        raise TrackerFault(f"it gave {' and '.join(map(str, sorted(sizes)))} mode probabilities")
    nothing = np.full(sizes.pop(), np.nan)
    return np.stack([nothing if modes is None else modes for modes in given], axis=-1)
