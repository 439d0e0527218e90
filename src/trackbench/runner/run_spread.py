"""How much a tracker's positions differ between the runs of a scene, which differ in nothing but the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.runner.work import Work


class RunSpread:
    """Sums over the runs of a block at each instant; those of the blocks of a scene add up.

    Args:
        truth: ``(2, instants, objects)`` m, near the positions and the same in every block, which keeps rounding small.
    """

    def __init__(self, truth: Array) -> None:
        self._truth = truth[..., None]
        self.sums: list[Array] = []
        """For each instant ``(4, objects)``: number of positions, sums of x and y, m, sum of squares of both, m^2."""

    def take(self, instant: int, position: Array, there: Mask) -> None:
        """Take in the positions of an instant.

        Args:
            instant: its number.
            position: ``(2, objects, runs)`` m; NaN where there is none.
            there: ``(objects, runs)`` where measurements have been taken in.
        """
        there = there & np.isfinite(position).all(axis=0)
        apart = np.where(there, position - self._truth[:, instant], 0.0)
        with np.errstate(over="ignore"):
            square = (apart**2).sum(axis=(0, 2))
        self.sums.append(np.concatenate([there.sum(axis=-1)[None], apart.sum(axis=-1), square[None]]))


def spread_in(work: Work, number: int) -> RunSpread | None:
    """Return what sums the spread of a tracker in a scene; None without a truth.

    Where identities are hidden it is that of the mean position of the tracks.
    """
    scene, hidden = work.scenes[number], work.hidden
    if not scene.truth.known:
        return None
    steps = work.scored_steps(scene)
    truth = np.nan_to_num(np.stack([scene.truth.px[steps, :, 0], scene.truth.py[steps, :, 0]]))
    return RunSpread(truth.sum(axis=2, keepdims=True) / max(truth.shape[2], 1) if hidden else truth)


def run_spreads(work: Work, blocks: Sequence[tuple[int, Mapping[str, Sequence[Array]]]]) -> dict[str, float]:
    """Return the standard deviation of each plug-in's positions over runs, over that of the finest measurement.

    A tracker that reads recorded measurements alone is left out.

    Args:
        work: the work of the run.
        blocks: of each block its scene and the sums of ``RunSpread`` by tracker.
    """
    spreads = {}
    for name in dict.fromkeys(name for _, sums in blocks for name in sums):
        scenes: dict[int, Array] = {}
        for scene, sums in blocks:
            if len(sums.get(name, ())):
                scenes[scene] = scenes.get(scene, 0.0) + np.array(sums[name])
        squares = freedom = 0.0
        for count, x, y, square in (total.transpose(1, 0, 2) for total in scenes.values()):
            several = count > 1
            squares += np.maximum(square - (x**2 + y**2) / np.maximum(count, 1), 0.0)[several].sum()
            freedom += 2 * (count[several] - 1).sum()
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
    eigenvalues = [np.linalg.eigvalsh(np.einsum("krio,krjo->koij", root, root)).max(initial=0.0) for root in roots]
    largest = max(eigenvalues, default=0.0)
    return float(largest**-0.5) if largest > 0 else 0.0
