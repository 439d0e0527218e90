"""What a block leaves of a tracker: its sums, the recorded run, and the mode probabilities of all."""

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
    """What a block leaves of one tracker."""

    sums: MetricSums
    recorded: RecordedEstimates | RecordedTracks | None
    """What the tracker gave in the recorded run; None where that is not in this block."""
    modes: ModeSums | None = None
    """Of a tracker that has modes."""
    offset: Array | None = None
    """Of tracks made elsewhere, ``(5, P)``: the run, and the rows of :func:`offset_pairs`."""
    filed: Indices | None = None
    """Of tracks made elsewhere, the numbers of rows, of those within the time of the truth, and of runs without any."""

    @property
    def scores(self) -> BlockScores:
        """The sums that the built-in metrics of estimates share."""
        scores: BlockScores = self.sums[ESTIMATES.name]
        return scores

    @property
    def timeline(self) -> Timeline:
        """The sums of tracks at each instant."""
        timeline: Timeline = self.sums[TIMELINE]
        return timeline

    @property
    def seconds(self) -> float:
        """Time spent in the tracker."""
        seconds: float = self.sums[StepTime.name][0] if StepTime.name in self.sums else np.nan
        return seconds


@dataclass
class RecordedEstimates:
    """One tracker's estimates of the recorded run."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, instants, objects)``"""
    due: Mask
    """``(instants, objects)`` where an estimate is due, and scored."""
    nis: dict[str, list[Array]] = field(default_factory=dict)
    """Per sensor and measurement ``(objects,)``, NaN where there is none."""

    @classmethod
    def empty(cls, target: Target, run: int, measurements: Mapping[str, int]) -> RecordedEstimates:
        """None yet, of a run of a block; ``measurements``: by sensor, how many it has."""
        instants, objects = target.alive.shape
        nis = {sensor: [np.full(objects, np.nan)] * count for sensor, count in measurements.items()}
        mean, covariance = np.full((4, instants, objects), np.nan), np.full((4, 4, instants, objects), np.nan)
        return cls(mean, covariance, target.due[..., run], nis)


class RecordedInstant(NamedTuple):
    """The estimates of the recorded run at one instant."""

    number: int
    """Of the instant, from 0."""
    estimates: dict[str, Gaussian]
    """By tracker that has not failed: mean ``(4, objects)``, NaN where there is none, and covariance."""


#: Called with the recorded run while it is made: with its scans first, then with the estimates of one tracker after the
#: other at each instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]


@dataclass
class RecordedScans:
    """The scans of the recorded run."""

    scans: list[Scan]
    """Batch axis ``(objects,)``; with hidden identities ``(D,)``."""
    origins: list[Indices] = field(default_factory=list)
    """With hidden identities, of their detections."""
    status: npt.NDArray[np.int8] | None = None
    """With hidden identities ``(instants, objects)``."""


class ModeSums:
    """What the estimates of a block say of the modes."""

    def __init__(self, size: int, target: Target, kept: int | None) -> None:
        """Nothing yet, of ``size`` modes; ``kept`` is the number of the recorded run in the block, if it is there."""
        instants, objects = target.alive.shape
        self.total = np.zeros((size, instants))
        """Sum over the runs and objects where an estimate is due."""
        self.count = np.zeros(instants)
        """How many these are."""
        self.recorded = None if kept is None else np.full((size, instants, objects), np.nan)
        """Of the recorded run; NaN where there is none."""
        self._kept = kept

    def take(self, instant: int, probability: Array, target: Target) -> None:
        """Take in ``(M, objects * runs)`` mode probabilities.

        Raises:
            Fault: before there were more or fewer modes.
        """
        if len(probability) != len(self.total):
            raise Fault(f"it gave {len(probability)} mode probabilities, and {len(self.total)} before", instant, None)
        scored = target.due[instant].reshape(-1) & np.isfinite(probability[0])
        self.total[:, instant] = probability[:, scored].sum(axis=1)
        self.count[instant] = scored.sum()
        if self.recorded is not None and self._kept is not None:
            of_run = probability[:, self._kept :: target.due.shape[2]]
            self.recorded[:, instant] = np.where(target.alive[instant], of_run, np.nan)


def state_columns(mean: Array, covariance: Array) -> Record:
    """The columns of states ``(4, rows)`` and of the upper half of their covariances."""
    states = dict(zip(("px_m", "py_m", "vx_mps", "vy_mps"), mean, strict=True))
    return states | {f"p_{a}{b}": covariance[a, b] for a in range(4) for b in range(a, 4)}
