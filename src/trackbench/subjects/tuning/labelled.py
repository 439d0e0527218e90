"""Trials of a tracker of labelled objects: several go through the same measurements as one batch."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Indices, Mask, Scan
from trackbench.driving.drive import deliveries, scans_read
from trackbench.driving.start import ending
from trackbench.driving.steppers import Offline
from trackbench.engine.choice import users_kernels_compared
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.consistency import normalised_square
from trackbench.metrics.silence import Silence
from trackbench.metrics.sums import SHORTEST, STRETCHES, stretch_numbers
from trackbench.metrics.verdicts import HALVES
from trackbench.runner.loop import keep_freed_memory
from trackbench.runner.start import stepper_of
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import sense_known
from trackbench.subjects.tuning.entry import Entry
from trackbench.subjects.tuning.measures import CONDITIONS, OF_ALL, Sums, condition_members
from trackbench.trackers.track_steps import log_likelihood

#: Shortest time at the beginning of a stretch that counts neither for tuning nor for trying, s.
GAP = 1.0


class LogTime(NamedTuple):
    """The stretches of time of a single run that are scored, each by itself.

    Held-out stretches alternate with those that are tuned on, so that both have whatever the log has at all times.
    """

    gap: float
    """At the beginning of each stretch, s: as long as a track needs to settle."""
    held_out: bool | None = None
    """Whether it is the stretches that are held out, or those that are tuned on; None: the whole log."""

    @property
    def shortest(self) -> float:
        """Shortest duration of a log of which a part can be held out, s."""
        return 2 * (SHORTEST + self.gap)

    def stretch(self, time: Array) -> Indices:
        """Return the number of the stretch of each instant ``(instants,)``, -1 where it does not count.

        Args:
            time: ``(instants,)`` s.
        """
        duration = float(time[-1] - time[0])
        if self.held_out is None:
            return stretch_numbers(len(time), duration)
        count = min(2 * STRETCHES, int(duration / (SHORTEST + self.gap)))
        place = (time - time[0]) / duration * count
        number = np.minimum(place.astype(np.intp), count - 1)
        scored = (number % 2 == int(self.held_out)) & ((place - number) * duration / count >= self.gap)
        return np.where(scored, number // 2, -1)


#: Where a tracker gives an innovation, ``(scans, objects, runs)``, the scans in the order in which they are taken.
#: Whether a filter gives an innovation is settled before the measurement comes, so that a likelihood of these alone is
#: a partial likelihood (Cox 1975, "Partial likelihood", Biometrika 62(2)): its expectation is largest at the true
#: values.
Availability = Mask
#: So many instants are summed at once, as far as their estimates fit the processor's cache.
KEPT_INSTANTS, KEPT_ESTIMATES = 64, 8000


def score_labelled(
    work: Work,
    piece: BlockRuns,
    entry: Entry,
    trials: int = 1,
    counted: Availability | None = None,
    log_time: LogTime | None = None,
) -> tuple[list[Sums], Availability, EngineUsed | None]:
    """Return the sums of several trials over some runs of one scene, the counted innovations, and what computed them.

    Args:
        work: what all blocks share.
        piece: the runs.
        entry: of the tracker; its noise levels may be arrays ``(trials * objects * runs,)``.
        trials: how many there are.
        counted: ``(scans, objects, runs)`` the innovations that are summed, where a trial gives them; unless given,
            those that the first trial gives, which are returned.
        log_time: of a single run, the stretches of time that are summed, each by itself in place of the run.

    Raises:
        Exception: what the tracker raises.
    """
    keep_freed_memory()
    scene = work.scenes[piece.scene]
    measurements = sense_known(scene.sensors, work.seed, work.noise_of(piece.scene), piece.runs)
    targets = Targets(work, piece, measurements)
    sensors, scans = entry.sensors_used, measurements.scans
    shape = trials, len(scene.truth.ids), len(piece.runs)
    stretch = None if log_time is None else log_time.stretch(scene.truth.time[scene.instants()])
    sums = _Sums(targets, entry, shape, len(scans), counted, stretch)
    # Trials are tiled scan by scan: all scans of all of them at once may not fit the memory.
    tiled = (_tiled(scan, trials) for scan in scans_read(scans, sensors))
    # The first trial is the tracker as it is.
    is_first_trial = counted is None
    with (
        np.errstate(all="ignore"),
        users_kernels_compared(work.engine_here, is_first_trial),
        ending(stepper_of(work, piece, entry, tiled, trials)) as stepper,
    ):
        given = [scan.prompt() for scan in scans] if isinstance(stepper, Offline) else scans
        state = None
        for instant, group in enumerate(deliveries(given, sensors, scene.each_measurement)):
            for delivery in group:
                scan = _tiled(delivery.scan, trials)
                state, estimate = stepper.step(state, scan)
                if delivery.number is not None and estimate is not None:
                    sums.add_innovation(instant, delivery.number, scan, estimate)
            sums.add_error(instant, estimate)
        sums.flush()
    return sums.of_trials(), sums.available, work.engine_of(getattr(stepper, "engine_used", None))


def _tiled(scan: Scan, trials: int) -> Scan:
    """Return the scan for a batch of trials, which vary slowest."""
    if trials == 1:
        return scan
    return scan._replace(measurement=np.tile(scan.measurement, (1, trials)), valid=np.tile(scan.valid, trials))


class _Sums:
    """The sums under way: total and number of the terms of each measure ``(trials, objects, runs or stretches)``."""

    def __init__(
        self,
        targets: Targets,
        entry: Entry,
        shape: tuple[int, int, int],
        scans: int,
        counted: Availability | None,
        stretch: Indices | None,
    ) -> None:
        self._state, self._due = targets.state, targets.due
        self._silence = Silence(
            targets.state, targets.due | targets.starting, partial(targets.measured, entry), copies=shape[0]
        )
        self._shape, self._counted = shape, counted
        self._stretch, parts = stretch, shape[2]
        if stretch is not None:
            self._due, parts = self._due & (stretch >= 0)[:, None, None], int(stretch.max()) + 1
        self.available = np.zeros((scans, *shape[1:]), dtype=bool)
        """Innovations of the first trial; filled in where nothing says what counts."""
        sums = *shape[:2], parts
        self._sums = {name: (np.zeros(sums), np.zeros(sums)) for name in (*OF_ALL, *HALVES)}
        self._member = condition_members(targets.conditions(entry))
        self._nees = np.zeros((2, len(CONDITIONS), shape[0], parts))
        batch = math.prod(shape)
        kept = max(1, min(KEPT_INSTANTS, KEPT_ESTIMATES // batch))
        self._mean, self._covariance = np.empty((4, kept, batch)), np.empty((4, 4, kept, batch))
        self._first = self._held = 0

    def add_error(self, instant: int, estimate: Estimate | None) -> None:
        """Hold the estimates of an instant; a missing one is charged as in a run, and has no NEES."""
        if self._held and self._part(instant) != self._part(self._first):
            self.flush()
        if not self._held:
            self._first = instant
        self._mean[:, self._held] = np.nan if estimate is None else estimate.mean.reshape(4, -1)
        self._covariance[:, :, self._held] = np.nan if estimate is None else estimate.covariance.reshape(4, 4, -1)
        self._held += 1
        if self._held == self._mean.shape[1]:
            self.flush()

    def add_innovation(self, instant: int, number: int, scan: Scan, estimate: Estimate) -> None:
        """Add the log-likelihoods of the innovations of a scan."""
        log_density = log_likelihood(estimate)
        if log_density is None:
            return
        log_density = log_density.reshape(self._shape)
        summed = scan.valid.reshape(self._shape) & ~np.isnan(log_density)
        if self._counted is None:
            summed = np.asarray(summed & self._due[instant])
            self.available[number] = summed[0]
        else:
            summed = summed & self._counted[number]
        self._add("log_likelihood", log_density[None], summed[None], self._part(instant))

    def flush(self) -> None:
        """Sum the estimates that are held, in the order of their instants."""
        if self._held:
            with np.errstate(all="ignore"):
                self._sum_errors(slice(self._first, self._first + self._held))
        self._held = 0

    def _sum_errors(self, here: slice) -> None:
        mean, shape = self._mean[:, : self._held], (self._held, *self._shape)
        covariance = self._covariance[:, :, : self._held].reshape(4, 4, *shape)
        given, charged = np.asarray(np.isfinite(mean).all(axis=0)), mean.copy()
        self._silence.charge(charged, given, here)
        error = charged.reshape(4, *shape) - self._state[:, here, None]
        scored = np.asarray(self._due[here, None] & np.isfinite(error).all(axis=0))
        summed = scored & given.reshape(shape)
        square = error * error
        nees, whitened, positive = normalised_square(error, covariance)
        part = self._part(here.start)
        self._add("position_rmse", square[0] + square[1], scored, part)
        self._add("velocity_rmse", square[2] + square[3], scored, part)
        self._add("nees", np.where(positive, nees, np.nan), summed, part)
        # The factor is triangular: its first rows are those of the position by itself.
        self._add(HALVES[0], np.where(positive, whitened[0] ** 2 + whitened[1] ** 2, np.nan), summed, part)
        self._add(HALVES[1], normalised_square(error[2:], covariance[2:, 2:])[0], summed, part)
        counted = np.stack([np.where(summed, nees, 0.0), np.broadcast_to(summed, shape)])
        for k in range(self._held):
            self._nees[..., part] += np.einsum("cor,ftor->fctr", self._member[:, here.start + k], counted[:, k])

    def of_trials(self) -> list[Sums]:
        by_run = {name: [values.sum(axis=1) for values in both] for name, both in self._sums.items()}
        by_run |= {name: list(self._nees[:, number]) for number, name in enumerate(CONDITIONS)}
        return [
            Sums({name: np.stack([total[trial], count[trial]]) for name, (total, count) in by_run.items()})
            for trial in range(self._shape[0])
        ]

    def _part(self, instant: int) -> slice:
        """Return the part of the sums that an instant belongs to: all runs, or its stretch."""
        if self._stretch is None:
            return slice(None)
        number = max(0, int(self._stretch[instant]))
        return slice(number, number + 1)

    def _add(self, name: str, values: Array, where: Mask, part: slice) -> None:
        """Add values instant by instant, so that the sums do not depend on how many instants are held."""
        total, count = self._sums[name]
        for value, counted in zip(np.where(where, values, 0.0), where, strict=True):
            total[..., part] += value
            count[..., part] += counted
