"""The short synthetic drives of the checks: one target, or two cars with hidden identities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, FieldOfView, Mask, Scan
from trackbench.models.sensors import SENSOR_MODELS

NOISE = {
    "radar": np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2,
    "lidar": np.diag([0.15, 0.15]) ** 2,
}
#: Pose of the sensor at time 0: x, y in m and yaw in rad; neither at the origin nor along the x axis.
POSE = np.array([4.0, -3.0, 0.4])
#: px, py, vx, vy of two cars in separate lanes at time 0.
CARS = np.array([[20.0, 15.0, 12.0, 3.0], [35.0, 40.0, 9.0, -1.0]])
DURATION, STEP = 6.0, 0.05
FIELD = FieldOfView(np.pi, 200.0)


def drive(
    kinds: Sequence[str],
    times: Sequence[float],
    missed: Sequence[int] = (),
    target: int = 0,
    velocity: tuple[float, float] = (0.0, 0.0),
) -> list[Scan]:
    """Return the scans of a target that drives past a sensor.

    Args:
        kinds: kind of each scan, "radar" or "lidar".
        times: time of each scan, s.
        missed: indices, from 0, of the scans that do not detect the target.
        target: index of the target, from 0, which determines its motion and noise.
        velocity: vx, vy of the sensor, m/s.
    """
    random = np.random.default_rng(target)
    sensor_velocity = np.array(velocity)
    scans = []
    for number, (kind, time) in enumerate(zip(kinds, times, strict=True)):
        pose = POSE + np.array([*sensor_velocity * time, 0.0])
        ideal = SENSOR_MODELS[kind].measure(target_at(time, target), pose, sensor_velocity)
        valid = np.array(number not in missed)
        noise = np.sqrt(np.diag(NOISE[kind])) * random.standard_normal(len(ideal))
        scans.append(_scan(kind, time, np.where(valid, ideal + noise, np.nan), valid, pose, sensor_velocity))
    return scans


def target_at(time: float, target: int = 0) -> Array:
    """Return px, py, vx, vy of a target at a time, ``(4,)``."""
    vx, vy = 12.0 - target, 3.0
    return np.array([20.0 + vx * time, 15.0 + 4.0 * target + vy * time, vx, vy])


def usual_drive(target: int = 0, missed: Sequence[int] = (), velocity: tuple[float, float] = (0.0, 0.0)) -> list[Scan]:
    """Return 120 scans of a target, by a lidar and a radar in turn; scans with an index in ``missed`` miss it."""
    return drive(["lidar", "radar"] * 60, [STEP * i for i in range(120)], missed, target, velocity)


def hidden_drive(seed: int = 0, *, clutter: float = 0.0, probability: float = 1.0) -> list[Scan]:
    """Return the scans of two cars with hidden identities, by a lidar and a radar in turn.

    Args:
        seed: seed of noise, misses and false alarms.
        clutter: mean number of false alarms in a scan.
        probability: probability to detect a car.
    """
    random = np.random.default_rng(seed)
    still = np.zeros(2)
    scans = []
    for number in range(round(DURATION / STEP)):
        kind, time = ("lidar", "radar")[number % 2], STEP * number
        model = SENSOR_MODELS[kind]
        ideal = model.measure(cars_at(time), POSE[:, None], still[:, None])
        detected = random.random(len(CARS)) < probability
        result = ideal + np.sqrt(np.diag(NOISE[kind]))[:, None] * random.standard_normal(ideal.shape)
        alarms = random.poisson(clutter)
        anywhere = np.concatenate([random.uniform(-100, 100, (2, alarms)), random.uniform(-20, 20, (2, alarms))])
        false = model.measure(anywhere, POSE[:, None], still[:, None])
        measurement = np.concatenate([result[:, detected], false], axis=1)
        scan = _scan(kind, time, measurement, np.ones(measurement.shape[1], dtype=bool), POSE, still)
        density = max(clutter, 1e-3) / 200.0**2
        scans.append(scan._replace(detection_probability=probability, clutter_density=density, field_of_view=FIELD))
    return scans


def cars_at(time: float) -> Array:
    """Return px, py, vx, vy of the two cars of ``hidden_drive`` at a time, ``(4, 2)``."""
    cars: Array = CARS.T + np.array([[time], [time], [0.0], [0.0]]) * np.roll(CARS.T, -2, axis=0)
    return cars


def _scan(kind: str, time: float, measurement: Array, valid: Mask, pose: Array, velocity: Array) -> Scan:
    # The arrays are read-only as in the bench, so that a tracker that writes into them fails.
    for shared in (measurement, valid, NOISE[kind], pose, velocity):
        shared.setflags(write=False)
    return Scan(time, kind, kind, measurement, valid, NOISE[kind], pose, velocity, time)


def batched_scan(runs: Sequence[Scan]) -> Scan:
    """Stack the scans of several runs at one instant along a last axis, padded to the largest number of detections."""
    most = np.max([scan.valid.shape for scan in runs], axis=0).astype(int)
    measurement = np.full((len(runs[0].measurement), *most, len(runs)), np.nan)
    valid = np.zeros((*most, len(runs)), dtype=bool)
    for run, scan in enumerate(runs):
        place: tuple[slice | int, ...] = (*map(slice, scan.valid.shape), run)
        measurement[:, *place], valid[place] = scan.measurement, scan.valid
    for shared in (measurement, valid):
        shared.setflags(write=False)
    return runs[0]._replace(measurement=measurement, valid=valid)
