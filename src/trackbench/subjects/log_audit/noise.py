"""The noise and the detections of a sensor by range, detections without labels, and the drift of a clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.blocks import BlockInterval, blocks_of
from trackbench.models.sensors import Sensor
from trackbench.sensing.detections import stated_detection
from trackbench.subjects.log_audit.joint_fit import JointFit
from trackbench.subjects.log_audit.sensor_log import SensorLog, reference_noise
from trackbench.truth.config.columns import CARTESIAN, POLAR
from trackbench.truth.recorded.cycles import Cycles
from trackbench.truth.recorded.drive import Drive, Log, RowOrder
from trackbench.truth.recorded.robust import EDGE, KEPT, clipped
from trackbench.truth.recorded.scans import position_of
from trackbench.truth.sources import RecordingTruth

#: Fewest measurements in a band of the range, and largest number of bands.
IN_BAND, BANDS = 30, 6


@dataclass(frozen=True)
class Band:
    """Value with its interval in a band of target range, such as a noise standard deviation or share of detections."""

    from_m: float
    to_m: float
    count: int
    interval: BlockInterval


@dataclass(frozen=True)
class ResidualNoise:
    """Noise of one component of a measurement: estimated from the component's residuals, and as stated."""

    name: str
    unit: str
    sigma: BlockInterval
    """Standard deviation after the errors of the joint fit are taken out."""
    stated: float
    """Standard deviation that the scenario states."""
    bands: tuple[Band, ...]
    """Standard deviation in each band of target range."""


def residual_noises(log: SensorLog, fit: JointFit) -> tuple[ResidualNoise, ...]:
    """Return each measurement component's noise: its standard deviation overall and in bands of target range."""
    distance = log.polar(log.log.time, log.log.object, fit.errors)[0, fit.inlier]
    all_rows = np.ones(len(distance), dtype=bool)
    return tuple(
        ResidualNoise(
            name=name,
            unit=log.config.units[i],
            sigma=_sigma(log, fit, i, all_rows),
            stated=float(log.config.sigmas()[i]),
            bands=_bands(distance, IN_BAND // 2, partial(_sigma, log, fit, i)),
        )
        for i, name in enumerate(log.components)
    )


def _sigma(log: SensorLog, fit: JointFit, i: int, chosen: Mask) -> BlockInterval:
    """Return the standard deviation of component ``i`` in the chosen inliers, without the noise of the reference."""
    residual, reference = fit.residual[i, fit.inlier], fit.reference[i, fit.inlier]
    middle, sigma = (float(value[0]) for value in clipped(residual[chosen], reference[chosen]))
    variance = np.maximum(sigma**2 + reference, 1e-300)
    away = residual - middle
    weight = np.where(chosen & (away**2 <= 9 * variance), (variance.min() / variance) ** 2, 0.0)
    added = float((weight * reference).sum() / weight.sum())
    # The logarithm of a standard deviation is nearer to normal than itself. The clipping limits follow the standard
    # deviation, three of it to either side: they hide a share of its change, which the factor restores.
    share = 1 / (1 - 0.5 * (2 * 27 * EDGE / KEPT - 6 * EDGE))
    logarithm = fit.blocks.intervals(
        np.stack([weight * away**2, weight]),
        lambda sums: 0.5 * np.log(np.maximum(sums[:1], 1e-300) / np.maximum(sums[1:], 1e-300)),
    )[0]
    # Uncertainty of the variance, to which the estimated variance of the reference contributes.
    spread = np.hypot(2 * (sigma**2 + added) * share * logarithm.sigma, log.noise.uncertainty * added)
    return BlockInterval(sigma, float(spread / (2 * sigma)) if sigma > 0 else np.inf, logarithm.freedom)


def _bands(distance: Array, fewest: int, interval_of: Callable[[Mask], BlockInterval]) -> tuple[Band, ...]:
    """Return bands of the range with equally many rows each, without bands of fewer rows than ``fewest``."""
    if not len(distance):
        return ()
    count = int(np.clip(len(distance) // IN_BAND, 1, BANDS))
    edges = np.unique(np.quantile(distance, np.linspace(0, 1, count + 1)))
    bands = []
    for low, high in pairwise(edges):
        rows = (distance >= low) & ((distance < high) | (high == edges[-1]))
        if rows.sum() >= fewest:
            bands.append(Band(float(low), float(high), int(rows.sum()), interval_of(rows)))
    return tuple(bands)


#: Probability of a log with as many successive missed detections by chance, below which a sensor was silent.
UNLIKELY = 1e-4
#: Number of cycles that a silence must exceed.
SILENT = 5


@dataclass(frozen=True)
class Detections:
    """Statistics of a sensor's detections of objects in its field of view."""

    rate_hz: float | None
    """Scan cycles a second, from the median interval; None where there is no regular interval."""
    chances: int
    """Number of pairs of a scan cycle and an object in the field of view, which could be detected."""
    share: BlockInterval
    bands: tuple[Band, ...]
    """Share of chances in which the object was detected, in each band of target range."""
    silent_from_s: float | None
    """Start, s, of the longest time without detections that chance does not explain; None where there is none."""
    silent_for_s: float


def detection_shares(log: SensorLog, cycles: Cycles, errors: dict[str, float]) -> Detections:
    """Return the share of chances in which an object was detected, and the longest silence.

    A chance is a true object at a cycle between the sensor's first and last detection. It lies in the stated field of
    view, and no further out than the outermost detections. ``errors`` are the estimated errors of the sensor by name.
    """
    cycle, first = np.unique(cycles.cycle, return_index=True)
    starts, objects = cycles.instants[first], len(log.drive.motions)
    time = np.repeat(starts, objects)
    owner = np.tile(np.arange(objects), len(starts))
    distance, azimuth = log.polar(time, owner, errors)
    detected = np.zeros((len(cycle), objects), dtype=bool)
    of_row = cycles.cycle[np.searchsorted(cycles.instants, log.log.time)]
    detected[np.searchsorted(cycle, of_row), log.log.object] = True
    hit = detected.reshape(-1)
    limit = np.inf if log.config.max_range_m is None else log.config.max_range_m
    half = np.deg2rad(log.config.fov_deg) / 2
    stated = np.isfinite(distance) & (((np.abs(azimuth) <= half) & (distance <= limit)) | hit)
    seen_half = float(np.max(np.abs(azimuth[stated & hit]), initial=0.0))
    seen_range = float(np.max(distance[stated & hit], initial=0.0))
    inside = stated & (np.abs(azimuth) <= seen_half) & (distance <= seen_range)
    silent_from, silent_for = _longest_silence(starts, inside.reshape(len(starts), -1), detected)
    time, owner, distance, hit = time[inside], owner[inside], distance[inside], hit[inside]
    spacing = np.diff(starts)
    return Detections(
        rate_hz=None if cycles.period is None or not len(spacing) else float(1 / np.median(spacing)),
        chances=int(inside.sum()),
        share=_share(time, owner, hit),
        bands=_bands(distance, 2, lambda rows: _share(time[rows], owner[rows], hit[rows])),
        silent_from_s=silent_from,
        silent_for_s=silent_for,
    )


def _longest_silence(starts: Array, chance: Mask, detected: Mask) -> tuple[float | None, float]:
    """Return begin and length, s, of the longest series of cycles whose misses chance does not explain."""
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
        share = blocks.intervals(np.stack([hit.astype(float), np.ones(count)]), lambda sums: sums[:1] / sums[1:])[0]
        if share.sigma > 0:
            return share
    # With all or none detected, the interval is the rule of three (Clopper and Pearson 1934, one-sided).
    return BlockInterval(value, 3.0 / count / ndtri(0.975), np.inf)


def clock_drift(log: SensorLog, fit: JointFit) -> BlockInterval | None:
    """Return the change of the time offset from the log's start to its end, s; None if the log shows no offset.

    It is the slope over time of the residuals, in units of a time offset's effect.
    """
    if "time_offset" not in fit.estimates:
        return None
    inlier = fit.inlier
    scale = fit.scale[:, inlier]
    column = fit.derivatives[list(fit.estimates).index("time_offset")][:, inlier] / scale
    rest = fit.residual[:, inlier] / scale
    time = log.log.time[inlier]
    along = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    # A constant is fitted beside the slope, since the joint fit has balanced it with other errors.
    parts = [column * column, column * column * along, column * column * along**2, column * rest, column * rest * along]
    terms = np.stack([part.sum(axis=0) for part in parts])

    def slope(sums: np.ndarray) -> np.ndarray:
        squares, once, twice, level, rise = sums
        return np.asarray((rise - level * once / squares) / (twice - once * once / squares))[None]

    return fit.blocks.intervals(terms, slope)[0]


#: Largest distance of a detection from the centre of its box, m: the default cutoff of GOSPA.
GATE_M = 5.0


@dataclass(frozen=True)
class Unlabelled:
    """Statistics of a sensor whose detections have no labels."""

    scans: int
    per_scan: BlockInterval
    """Mean number of detections in a scan."""
    near: BlockInterval
    """Share of the detections that are assigned to a box within the gate, in each scan at most one for each box."""
    others: BlockInterval
    """Mean number of detections in a scan near no box: false alarms, and objects without a box."""
    stated_others: float
    """Mean number of false alarms in a scan by the clutter density that the scenario states."""


def with_boxes(name: str, config: Sensor, drive: Drive, truth: RecordingTruth) -> Log:
    """Assign the detections of a sensor to the nearest boxes, and return them as measurements of these objects.

    Pairs are made within a scan, the nearest first; all other detections are false alarms or objects without a box.

    Raises:
        InputError: the sensor measures no position, or no detection is near a box.
    """
    key, scans, objects = f"truth.readings.{name}.object", drive.detections[name], len(drive.motions)
    if config.components[:2] not in (POLAR, CARTESIAN):
        raise InputError("missing: it measures no position, by which the nearest box is found", key=key)
    in_time = np.isin(scans.time, drive.framed(scans.time))
    rows = in_time[scans.scan]
    time, scan = scans.time[in_time], (np.cumsum(in_time) - 1)[scans.scan[rows]]
    measurement = scans.measurement[:, rows]
    pairs = np.repeat(time, objects), np.tile(np.arange(objects), len(time))
    log = Log(*pairs, np.zeros((len(measurement), len(pairs[0]))), time, RowOrder(len(scan), 0, 0.0, 0))
    sensor = SensorLog(name, config, log, drive, truth, reference_noise(drive), np.ones(len(measurement)))
    boxes, positions = (position_of(config.components, values) for values in (sensor.expected({}), measurement))
    boxes, owner = boxes.reshape(2, -1, objects), np.full(len(scan), -1)
    for number in np.unique(scan).tolist():
        in_scan = np.flatnonzero(scan == number)
        away = np.hypot(*(positions[:, in_scan, None] - boxes[:, number][:, None]))
        away[~(away <= GATE_M)] = np.inf
        while np.isfinite(away).any():
            row, item = np.unravel_index(int(np.argmin(away)), away.shape)
            owner[in_scan[row]] = item
            away[row], away[:, item] = np.inf, np.inf
    near = owner >= 0
    if not near.any():
        raise InputError(f"no detection is within {GATE_M:g} m of a box: check times, frames and units", key=key)
    at, alarms = time[scan], (time[scan[~near]], measurement[:, ~near])
    return Log(at[near], owner[near], measurement[:, near], time, log.order, *alarms)


def unlabelled_detections(sensor: SensorLog) -> Unlabelled:
    """Return the statistics of unlabelled detections, with 95 % intervals over blocks of time."""
    log, config = sensor.log, sensor.config
    near, others, ones = _counts(log.scans, log.time), _counts(log.scans, log.alarm_time), np.ones(len(log.scans))
    _, density = stated_detection(config)
    return Unlabelled(
        scans=len(log.scans),
        per_scan=_ratio(log.scans, near + others, ones),
        near=_ratio(log.scans, near, near + others),
        others=_ratio(log.scans, others, ones),
        stated_others=density * config.volume() if density else 0.0,
    )


def _counts(scans: Array, time: Array) -> Array:
    """Return how many elements of ``time`` equal the time of each scan, ``(scans,)``."""
    return np.bincount(np.searchsorted(scans, time), minlength=len(scans)).astype(float)


def _ratio(time: Array, total: Array, count: Array) -> BlockInterval:
    value = total.sum() / count.sum()
    blocks = blocks_of(time, np.zeros(len(time), dtype=np.intp), (total - value * count)[None])
    return blocks.intervals(np.stack([total, count]), lambda sums: sums[:1] / sums[1:])[0]
