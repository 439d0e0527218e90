"""The noise that remains: its standard deviation, its covariance, and whether it changes with the range."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackbench.base.distributions import normal_density, normal_within
from trackbench.base.types import Array, Mask
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.joint_fit import KEPT, JointFit
from trackbench.subjects.log_audit.sensor_log import SensorLog

#: Measurements in a band of the range, at least, and bands at most.
IN_BAND, BANDS = 30, 6


@dataclass(frozen=True)
class Band:
    """A value in a band of the range."""

    from_m: float
    to_m: float
    count: int
    interval: BlockInterval


@dataclass(frozen=True)
class ResidualNoise:
    """The noise of one component of a measurement."""

    name: str
    unit: str
    mean: BlockInterval
    """Of measurement minus truth as logged, before anything is corrected."""
    sigma: BlockInterval
    """After the errors that were found are taken out."""
    stated: float
    """The standard deviation that the scenario states."""
    bands: tuple[Band, ...]
    """The standard deviation by range."""
    exponent: BlockInterval | None
    """The standard deviation is proportional to this power of the range; None where the range hardly changes."""
    spread: float
    """Range at the 90 % quantile of the measurements over that at the 10 %."""


def noise_of(log: SensorLog, fit: JointFit) -> tuple[list[ResidualNoise], Array]:
    """The noise of each component, and the covariance ``(m, m)`` of a measurement."""
    inlier = fit.inlier
    logged = log.residual({})[:, inlier]
    residual = fit.residual[:, inlier]
    distance = log.polar(log.log.time, log.log.object, fit.errors)[0, inlier]
    found = [_component(log, fit, i, logged[i], residual[i], distance) for i in range(len(log.components))]
    sigma = np.array([component.sigma.value for component in found])
    inside = (np.abs(residual) <= 3 * sigma[:, None]).all(axis=0)
    alike = np.corrcoef(residual[:, inside]) if inside.sum() > 2 else np.eye(len(sigma))
    correlation = np.where(np.isfinite(alike), alike, np.eye(len(sigma)))
    return found, np.asarray(np.atleast_2d(correlation) * np.outer(sigma, sigma))


def _component(log: SensorLog, fit: JointFit, i: int, logged: Array, residual: Array, distance: Array) -> ResidualNoise:
    known = np.isfinite(logged)
    counted = np.where(known, logged, 0.0)
    mean = fit.blocks.intervals(np.stack([counted, known.astype(float)]), lambda sums: sums[:1] / sums[1:])[0]
    low, high = np.quantile(distance, [0.1, 0.9])
    spread = float(high / max(low, 1e-6))
    sigma = _sigma(fit, residual, np.ones(len(residual), dtype=bool))
    exponent = _exponent(fit, residual, distance, sigma.value) if spread > 1.2 else None
    return ResidualNoise(
        name=log.components[i],
        unit=log.config.units[i],
        mean=mean,
        sigma=sigma,
        stated=float(log.config.sigmas()[i]),
        bands=tuple(_bands(fit, residual, distance)),
        exponent=exponent,
        spread=spread,
    )


def _sigma(fit: JointFit, residual: Array, chosen: Mask) -> BlockInterval:
    """The standard deviation of some of the rows, from those within three of it of their middle."""
    values = residual[chosen]
    middle = float(np.median(values)) if len(values) else 0.0
    sigma = 1.4826 * float(np.median(np.abs(values - middle))) if len(values) else 0.0
    for _ in range(20):
        inside = np.abs(values - middle) <= 3 * sigma
        middle = float(values[inside].mean()) if inside.any() else middle
        sigma = float(np.sqrt(((values[inside] - middle) ** 2).mean() / KEPT)) if inside.any() else 0.0
    inside = chosen & (np.abs(residual - middle) <= 3 * sigma)
    # The logarithm of a standard deviation is nearer to normal, and the share within its limits moves with it.
    share = 1 / (1 - _edge())
    square = np.where(inside, (residual - middle) ** 2, 0.0)
    found = fit.blocks.intervals(
        np.stack([square, inside.astype(float)]),
        lambda sums: 0.5 * np.log(np.maximum(sums[:1], 1e-300) / np.maximum(sums[1:], 1e-300)),
    )[0]
    return BlockInterval(sigma, found.sigma * share * sigma, found.freedom)


def _edge() -> float:
    """How much of a change of the standard deviation limits that follow it, at three of it, take away."""
    density, inside = normal_density(3), normal_within(3)
    return 0.5 * (2 * 27 * density / (inside * KEPT) - 6 * density / inside)


def _exponent(fit: JointFit, residual: Array, distance: Array, sigma: float) -> BlockInterval:
    """The slope of the logarithm of the residual's size over that of the range."""
    size = np.log(np.maximum(np.abs(residual), 1e-3 * max(sigma, 1e-300)))
    along = np.log(np.maximum(distance, 1e-6))
    along = along - along.mean()
    terms = np.stack([np.ones_like(along), along, size, along * along, along * size])

    def slope(sums: Array) -> Array:
        count, x, y, xx, xy = sums
        return np.asarray((xy - x * y / count) / (xx - x * x / count))[None]

    return fit.blocks.intervals(terms, slope)[0]


def band_edges(distance: Array) -> Array:
    """Edges of bands with equally many rows each."""
    count = int(np.clip(len(distance) // IN_BAND, 1, BANDS))
    return np.unique(np.quantile(distance, np.linspace(0, 1, count + 1)))


def _bands(fit: JointFit, residual: Array, distance: Array) -> list[Band]:
    edges = band_edges(distance)
    found = []
    for low, high in pairwise(edges):
        chosen = (distance >= low) & ((distance < high) | (high == edges[-1]))
        if chosen.sum() >= IN_BAND // 2:
            found.append(Band(float(low), float(high), int(chosen.sum()), _sigma(fit, residual, chosen)))
    return found
