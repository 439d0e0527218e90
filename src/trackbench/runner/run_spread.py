"""How much a tracker's positions differ between the runs of a scene, which differ in nothing but the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.runner.work import Work

if TYPE_CHECKING:
    from trackbench.runner.block import Block


class RunSpread:
    """Sums of squared deviations from the mean over the runs of a block; sums of several blocks add up."""

    def __init__(self) -> None:
        self.sums = np.zeros(2)
        """Squared deviations of the positions, m^2, and their degrees of freedom."""

    def take(self, position: Array, there: Mask) -> None:
        """Take in the positions of an instant.

        Args:
            position: ``(2, objects, runs)`` m; NaN where there is none.
            there: ``(objects, runs)`` where measurements have been taken in.
        """
        there = there & np.isfinite(position).all(axis=0)
        count = there.sum(axis=-1)
        mean = np.where(there, position, 0.0).sum(axis=-1, keepdims=True) / np.maximum(count, 1)[:, None]
        self.sums[0] += np.where(there, (position - mean) ** 2, 0.0).sum()
        self.sums[1] += 2 * np.maximum(count - 1, 0).sum()


def run_spreads(work: Work, blocks: Sequence[Block]) -> dict[str, float]:
    """By plug-in, the standard deviation of its positions over runs as a share of that of the finest measurement.

    None is told of a tracker that reads recorded measurements alone.
    """
    spreads = {}
    for name in {name for block in blocks for name in block.spreads}:
        squares, freedom = np.sum([block.spreads[name] for block in blocks if name in block.spreads], axis=0)
        finest = _finest_measurement(work, name)
        if freedom > 0 and finest > 0:
            spreads[name] = float(np.sqrt(squares / freedom) / finest)
    return spreads


def _finest_measurement(work: Work, tracker: str) -> float:
    """Smallest standard deviation, m, of a simulated measurement in the direction that it tells most of; 0 of none."""
    used = work.trackers[tracker].sensors_used
    roots = [
        scene.information[sensor.name].root[:, :, :2]
        for scene in work.scenes
        for sensor in scene.sensors
        if not sensor.recorded and sensor.detections is None and (used is None or sensor.name in used)
    ]
    told = [np.linalg.eigvalsh(np.einsum("krio,krjo->koij", root, root)).max(initial=0.0) for root in roots]
    largest = max(told, default=0.0)
    return float(largest**-0.5) if largest > 0 else 0.0
