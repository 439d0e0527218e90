"""Vehicles at constant velocity and the scans of a radar and a lidar that do not say whose detection is whose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, FieldOfView, Indices, Scan
from trackbench.models.sensors import SENSOR_MODELS

RANGE, RATES = 150.0, 40.0
NOISE = {"radar": np.square([0.3, np.deg2rad(0.5), 0.1]), "lidar": np.square([0.15, 0.15])}
#: Volume of the measurement space in which false alarms are drawn.
VOLUME = {"radar": RANGE * 2 * np.pi * 2 * RATES, "lidar": np.pi * RANGE**2}
FALSE_ALARM, PADDING = -1, -2


class Traffic(NamedTuple):
    """Scans of many runs, which detection stems from which vehicle, and where the vehicles are at each scan."""

    scans: list[Scan]
    origins: list[Indices]
    truth: list[Array]
    """``(4, N)`` at each scan."""


def vehicles(count: int, spacing: float = 14.0, seed: int = 0) -> Array:
    """``(4, count)`` on four lanes, at least ``spacing`` apart along the road."""
    random = np.random.default_rng(seed)
    x = spacing * (np.arange(count) - (count - 1) / 2)
    return np.array([x, np.resize([-6.0, -2.0, 2.0, 6.0], count), random.uniform(-3, 3, count), np.zeros(count)])


def traffic(
    start: Array,
    steps: int,
    runs: int = 1,
    *,
    detection: float = 0.95,
    clutter: float = 10.0,
    sensors: tuple[str, ...] = ("radar", "lidar"),
    dt: float = 0.05,
    seed: int = 0,
) -> Traffic:
    """``steps`` scans of each sensor, of each of the runs."""
    random = np.random.default_rng(seed)
    made = Traffic([], [], [])
    for k in range(steps):
        for number, kind in enumerate(sensors):
            time = k * dt + 0.01 * number
            state = start.copy()
            state[:2] += time * start[2:]
            scan, origins = one_scan(random, kind, time, state, runs, detection, clutter)
            made.scans.append(scan)
            made.origins.append(origins)
            made.truth.append(state)
    return made


def one_scan(
    random: np.random.Generator, kind: str, time: float, state: Array, runs: int, detection: float, clutter: float
) -> tuple[Scan, Indices]:
    """One scan of all runs and the origins of its detections, shuffled in each run."""
    count = state.shape[1]
    sigma = np.sqrt(NOISE[kind])
    ideal = SENSOR_MODELS[kind].measure(state, np.zeros(3), np.zeros(2))
    each = []
    for _ in range(runs):
        false = random.poisson(clutter)
        if kind == "radar":
            alarms = random.uniform([[0], [-np.pi], [-RATES]], [[RANGE], [np.pi], [RATES]], (3, false))
        else:
            away, angle = RANGE * np.sqrt(random.random(false)), random.uniform(-np.pi, np.pi, false)
            alarms = away * np.array([np.cos(angle), np.sin(angle)])
        own = np.flatnonzero(random.random(count) < detection)
        noisy = ideal[:, own] + sigma[:, None] * random.normal(size=(len(sigma), len(own)))
        both = np.concatenate([noisy, alarms], axis=1)
        order = random.permutation(both.shape[1])
        each.append((both[:, order], np.concatenate([own, np.full(false, FALSE_ALARM)])[order]))
    most = max(values.shape[1] for values, _ in each)
    measurement, origins = np.full((len(sigma), most, runs), np.nan), np.full((most, runs), PADDING)
    for run, (values, causes) in enumerate(each):
        measurement[:, : values.shape[1], run], origins[: len(causes), run] = values, causes
    scan = Scan(
        time, kind, kind, measurement, origins != PADDING, np.diag(NOISE[kind]), np.zeros(3), np.zeros(2), time,
        detection, clutter / VOLUME[kind], FieldOfView(np.pi, RANGE),
    )  # fmt: skip
    return scan, origins
