"""Outcome of a tracker in a block of runs: sums of scores and mode probabilities, and the run that is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Gaussian, Indices, Mask, Scan
from trackbench.metrics import BlockScores, MetricSums
from trackbench.metrics.built_in.step_time import StepTime
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.protocol import Fault, Target
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.metrics.traffic.timeline import TIMELINE, Timeline
from trackbench.results.columns import Record


@dataclass
class Outcome:
    """Sums of one tracker's scores in one block of runs, and its estimates in the run that is kept for plots."""

    sums: MetricSums
    recorded: RecordedEstimates | RecordedTracks | None
    """Estimates or tracks in the recorded run (the run that is kept for plots); None if it is in another block."""
    modes: ModeSums | None = None
    """Sums of the tracker's mode probabilities; None for a tracker without modes."""
    offset: Array | None = None
    """``(5, P)`` P rows of external tracks that are near an object: number of the run, time, s, number of the object,
    error along the path, m, and speed of the object, m/s. None for any other tracker."""
    external_rows: Indices | None = None
    """Three counts of a file of tracks: its rows, rows within the time of the truth, and runs without a row in that
    time. None for any other tracker."""

    @property
    def scores(self) -> BlockScores:
        """Sums of squared errors, NEES and innovations, from which the built-in metrics of estimates are computed."""
        scores: BlockScores = self.sums[ESTIMATES.name]
        return scores

    @property
    def timeline(self) -> Timeline:
        """Squared GOSPA's parts (localisation, missed, false) at each instant, summed over runs, with events."""
        timeline: Timeline = self.sums[TIMELINE]
        return timeline

    @property
    def seconds(self) -> float:
        """Computing time of the tracker in the block, s."""
        seconds: float = self.sums[StepTime.name][0] if StepTime.name in self.sums else np.nan
        return seconds


@dataclass
class RecordedEstimates:
    """Estimates of one tracker in the recorded run, the one run whose estimates are kept for plots."""

    mean: Array
    """``(4, instants, objects)`` estimated px, py, vx, vy, NaN where there is no estimate."""
    covariance: Array
    """``(4, 4, instants, objects)`` covariance of each estimate."""
    due: Mask
    """``(instants, objects)`` True where an estimate is due and scored."""
    nis: dict[str, list[Array]] = field(default_factory=dict)
    """``(objects,)`` NIS in each scan, by sensor; NaN for an object without an innovation."""

    @classmethod
    def empty(cls, target: Target, run: int, measurements: Mapping[str, int]) -> RecordedEstimates:
        """Return arrays without estimates for one run of a block; ``measurements`` is the number of scans by sensor."""
        instants, objects = target.alive.shape
        nis = {sensor: [np.full(objects, np.nan)] * count for sensor, count in measurements.items()}
        mean, covariance = np.full((4, instants, objects), np.nan), np.full((4, 4, instants, objects), np.nan)
        return cls(mean, covariance, target.due[..., run], nis)


class RecordedInstant(NamedTuple):
    """Estimates of all trackers in the recorded run (kept for plots) at one instant."""

    number: int
    """Index of the instant among those at which trackers are scored, from 0."""
    estimates: dict[str, Gaussian]
    """Mean ``(4, objects)``, NaN for no estimate, and covariance, by name of each tracker that has not failed."""


#: Function that gets the recorded run while it is made: first all scans, then each tracker's estimates by instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]


@dataclass
class RecordedScans:
    """Scans of the recorded run (kept for plots), with the origins of their detections if identities are hidden."""

    scans: list[Scan]
    """Scans whose batch axis is ``(objects,)``, or ``(detections,)`` with hidden identities."""
    origins: list[Indices] = field(default_factory=list)
    """``(D,)`` number of the object that caused each detection of a scan; empty with known identities."""
    status: npt.NDArray[np.int8] | None = None
    """``(instants, objects)`` whether an object must be tracked (``DUE``), may be without penalty (``OPTIONAL``), or is
    ``ABSENT``; None with known identities."""


class ModeSums:
    """Sums of a tracker's mode probabilities in a block.

    Args:
        size: number of modes.
        target: ground truth that the tracker is scored against.
        recorded_run: index within the block of the recorded run (kept for plots); None if that run is in another block.
    """

    def __init__(self, size: int, target: Target, recorded_run: int | None) -> None:
        instants, objects = target.alive.shape
        self.total = np.zeros((size, instants))
        """Sum of the mode probabilities over runs and objects whose estimate is due, by mode and instant."""
        self.count = np.zeros(instants)
        """Number of terms in ``total`` at each instant."""
        self.recorded = None if recorded_run is None else np.full((size, instants, objects), np.nan)
        """``(modes, instants, objects)`` mode probabilities in the recorded run, NaN where an object has no estimate;
        None if that run is in another block."""
        self._recorded_run = recorded_run

    def take(self, instant: int, probability: Array, target: Target) -> None:
        """Add the mode probabilities ``(modes, objects * runs)`` at an instant.

        Raises:
            Fault: the number of modes has changed.
        """
        if len(probability) != len(self.total):
            raise Fault(f"it gave {len(probability)} mode probabilities, and {len(self.total)} before", instant, None)
        scored = target.due[instant].reshape(-1) & np.isfinite(probability[0])
        self.total[:, instant] = probability[:, scored].sum(axis=1)
        self.count[instant] = scored.sum()
        if self.recorded is not None and self._recorded_run is not None:
            of_run = probability[:, self._recorded_run :: target.due.shape[2]]
            self.recorded[:, instant] = np.where(target.alive[instant], of_run, np.nan)


def state_columns(mean: Array, covariance: Array) -> Record:
    """Return table columns of states ``(4, rows)`` and of the upper half of their covariances."""
    states = dict(zip(("px_m", "py_m", "vx_mps", "vy_mps"), mean, strict=True))
    return states | {f"p_{a}{b}": covariance[a, b] for a in range(4) for b in range(a, 4)}
