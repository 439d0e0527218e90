"""How often a sensor detects what it could: by range, and where it can see at all."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackbench.base.distributions import normal_quantile
from trackbench.base.types import Array, Indices, Mask
from trackbench.subjects.log_audit.blocks import BlockInterval, blocks_of
from trackbench.subjects.log_audit.noise import Band, band_edges
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.recorded.drive import Cycles

#: The field of view is taken as narrower than stated if more than this share of the chances outside it gave nothing.
OUTSIDE = 0.02
#: A sensor was silent if chance leaves so many detections out in fewer logs than this share.
UNLIKELY = 1e-4
#: And for more than so many cycles.
SILENT = 5


@dataclass(frozen=True)
class Detections:
    """How often a sensor detects an object that is in its field of view."""

    rate_hz: float | None
    """Cycles a second, of the median interval; None where the detections have no regular one."""
    chances: int
    """Pairs of a cycle and an object in the field of view."""
    share: BlockInterval
    bands: tuple[Band, ...]
    """The share by range."""
    seen_half_angle: float
    """The largest azimuth of a detection to either side of the boresight, rad."""
    seen_range_m: float
    """The largest range of a detection."""
    narrower: bool
    """Whether much of the stated field of view gave no detection; the shares are of what did."""
    silent_from_s: float | None
    """When the longest time began in which nothing was detected though chance does not explain it."""
    silent_for_s: float


def detections_of(log: SensorLog, looked: Cycles, errors: dict[str, float]) -> Detections:
    """The share of the chances to detect an object that were taken.

    A chance is an object of the truth in the field of view, as stated and as far as there was a detection, at a cycle
    of the sensor between its first and its last detection.
    """
    cycle, first = np.unique(looked.cycle, return_index=True)
    starts, objects = looked.instants[first], len(log.drive.motions)
    time = np.repeat(starts, objects)
    owner = np.tile(np.arange(objects), len(starts))
    distance, azimuth = log.polar(time, owner, errors)
    detected = np.zeros((len(cycle), objects), dtype=bool)
    of_row = looked.cycle[np.searchsorted(looked.instants, log.log.time)]
    detected[np.searchsorted(cycle, of_row), log.log.object] = True
    hit = detected.reshape(-1)
    limit = np.inf if log.config.max_range_m is None else log.config.max_range_m
    half = np.deg2rad(log.config.fov_deg) / 2
    stated = np.isfinite(distance) & (((np.abs(azimuth) <= half) & (distance <= limit)) | hit)
    seen_half = float(np.max(np.abs(azimuth[stated & hit]), initial=0.0))
    seen_range = float(np.max(distance[stated & hit], initial=0.0))
    inside = stated & (np.abs(azimuth) <= seen_half) & (distance <= seen_range)
    narrower = bool(stated.sum() > 0 and (stated & ~inside).sum() > OUTSIDE * stated.sum())
    silent_from, silent_for = _silence(starts, inside.reshape(len(starts), -1), detected)
    time, owner, distance, hit = time[inside], owner[inside], distance[inside], hit[inside]
    spacing = np.diff(starts)
    return Detections(
        rate_hz=None if looked.period is None or not len(spacing) else float(1 / np.median(spacing)),
        chances=int(inside.sum()),
        share=_share(time, owner, hit),
        bands=tuple(_bands(time, owner, distance, hit)),
        seen_half_angle=seen_half,
        seen_range_m=seen_range,
        narrower=narrower,
        silent_from_s=silent_from,
        silent_for_s=silent_for,
    )


def _silence(starts: Array, chance: Mask, detected: Mask) -> tuple[float | None, float]:
    """Begin and length of the longest run of cycles that detected nothing of many chances."""
    share = float(detected[chance].mean()) if chance.any() else 1.0
    best: tuple[float | None, float] = (None, 0.0)
    shortest = SILENT * float(np.median(np.diff(starts))) if len(starts) > 1 else np.inf
    begin, unlikely = 0, 0.0
    for cycle, (chances, hits) in enumerate(zip(chance.sum(axis=1), np.asarray(detected.any(axis=1)), strict=True)):
        if hits:
            begin, unlikely = cycle + 1, 0.0
            continue
        unlikely += float(chances) * np.log(max(1 - share, 1e-3))
        length = float(starts[cycle] - starts[begin])
        if unlikely < np.log(UNLIKELY / len(starts)) and length > max(best[1], shortest):
            best = float(starts[begin]), length
    return best


def _share(time: Array, owner: Indices, hit: Mask) -> BlockInterval:
    count = len(hit)
    if count < 2:
        return BlockInterval(float(hit.mean()) if count else 0.0, np.inf, 1)
    value = float(hit.mean())
    if 0 < value < 1:
        blocks = blocks_of(time, owner, np.asarray(hit - value, dtype=np.float64)[None])
        found = blocks.intervals(np.stack([hit.astype(float), np.ones(count)]), lambda sums: sums[:1] / sums[1:])[0]
        if found.sigma > 0:
            return found
    # All or none: as far as the rule of three reaches (Clopper and Pearson 1934, one-sided).
    return BlockInterval(value, 3.0 / count / normal_quantile(0.975), np.inf)


def _bands(time: Array, owner: Indices, distance: Array, hit: Mask) -> list[Band]:
    if not len(distance):
        return []
    edges = band_edges(distance)
    found = []
    for low, high in pairwise(edges):
        own = (distance >= low) & ((distance < high) | (high == edges[-1]))
        if own.sum() >= 2:
            found.append(Band(float(low), float(high), int(own.sum()), _share(time[own], owner[own], hit[own])))
    return found
