"""The mutants made from outside: by wrong options, or by wrappers that alter scans, time or estimates."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from . import altered_estimates as estimates
from . import altered_scans as scans
from .altered_scans import AZIMUTH, RANGE, RATE, YAW, X, Y
from .mutant import ExaminedTracker, Mutant
from .wrappers import AlteredEstimates, AlteredScans, MissedSkipped, WrongClock

ACCELERATION_SIGMA, YAW_ACCELERATION_SIGMA = 3.0, 0.5
DEGREE = pi / 180


def mutants(subject: ExaminedTracker) -> Iterator[Mutant]:
    for part in (measurements, noise, timing, start, chance, answers):
        yield from part(subject)


def measurements(subject: ExaminedTracker) -> Iterator[Mutant]:
    def mutant(fault: str, variant: str, alter: scans.Alter, sensor: str | None = None) -> Mutant:
        return subject.behind(fault, variant, AlteredScans, alter, sensor=sensor)

    fault = "degrees_for_radians"
    yield mutant(fault, "measurement", scans.azimuth(np.radians), "radar")
    yield mutant(fault, "sigma_in_degrees", scans.scaled_noise(DEGREE**-2, "radar", AZIMUTH), "radar")
    yield mutant(fault, "sigma_converted_twice", scans.scaled_noise(DEGREE**2, "radar", AZIMUTH), "radar")
    yield mutant(fault, "yaw_in_degrees", scans.pose(YAW, np.degrees))
    yield mutant(fault, "yaw_converted_twice", scans.pose(YAW, np.radians))
    fault = "sensor_bias"
    for metres in (0.5, 2.0):
        yield mutant(fault, f"range_{metres}", scans.offset("radar", RANGE, metres), "radar")
        yield mutant(fault, f"lidar_x_{metres}", scans.offset("lidar", X, metres), "lidar")
    for degrees in (2, -3):
        yield mutant(
            fault, f"azimuth_{degrees}", scans.azimuth(lambda angle, bias=degrees * DEGREE: angle + bias), "radar"
        )
    fault = "scale_error"
    for factor in (1.02, 0.97):
        yield mutant(fault, f"range_{factor}", scans.scaled("radar", RANGE, factor), "radar")
        yield mutant(fault, f"lidar_{factor}", scans.scaled("lidar", slice(2), factor), "lidar")
    yield mutant("axis_swapped", "lidar", scans.lidar_axes_swapped, "lidar")
    yield mutant("axis_swapped", "azimuth", scans.azimuth(lambda angle: pi / 2 - angle), "radar")
    yield mutant("axis_mirrored", "lidar", scans.component("lidar", Y, np.negative), "lidar")
    yield mutant("axis_mirrored", "azimuth", scans.azimuth(np.negative), "radar")
    fault = "ego_motion_ignored"
    yield mutant(fault, "pose", scans.pose(slice(None), np.zeros_like))
    yield mutant(fault, "position", scans.pose(slice(2), np.zeros_like))
    yield mutant(fault, "yaw", scans.pose(YAW, np.zeros_like))
    if subject.uses_rate:
        yield mutant(fault, "velocity", scans.velocity_ignored, "radar")
        yield mutant("doppler_sign", "measurement", scans.component("radar", RATE, np.negative), "radar")
    for kind in ("radar", "lidar"):
        yield subject.behind("measurement_ignored", kind, AlteredScans, scans.dropped(kind), "started", sensor=kind)
    yield mutant("nonfinite", "missed_measurement", scans.missed_used_as_valid)


def noise(subject: ExaminedTracker) -> Iterator[Mutant]:
    for fault, scales in (("q_too_small", (1e-2, 1e-3, 1e-4)), ("q_too_large", (1e2, 1e3, 1e4))):
        for scale in scales:
            options = {"acceleration_sigma": ACCELERATION_SIGMA * scale**0.5}
            if subject.turning:
                options["yaw_acceleration_sigma"] = YAW_ACCELERATION_SIGMA * scale**0.5
            yield subject.optioned(fault, f"{scale:g}", **options)
    small = [("radar", 1 / 25), ("radar", 1 / 4), ("lidar", 1 / 16), (None, 1 / 10)]
    large = [("radar", 16.0), ("radar", 100.0), ("lidar", 9.0), (None, 25.0), ("lidar", 4.0)]
    for fault, cases in (("r_too_small", small), ("r_too_large", large)):
        for kind, factor in cases:
            alter, variant = scans.scaled_noise(factor, kind), f"{kind or 'all'}_{factor:g}"
            yield subject.behind(fault, variant, AlteredScans, alter, sensor=kind, factor=factor)


def timing(subject: ExaminedTracker) -> Iterator[Mutant]:
    clocks = {
        "stale": lambda _now, before, _time: before,
        "fixed_0.1": lambda now, _before, _time: now + 0.1,
        "fixed_0.05": lambda now, _before, _time: now + 0.05,
        "milliseconds": lambda now, before, time: now + 1000 * (time - before),
        "thousandths": lambda now, before, time: now + (time - before) / 1000,
    }
    for variant, clock in clocks.items():
        yield subject.behind("wrong_dt", variant, WrongClock, clock)
    for variant, lost in (("skipped", False), ("skipped_and_lost", True)):
        yield subject.behind("missed_scan_not_predicted", variant, MissedSkipped, lost)


def start(subject: ExaminedTracker) -> Iterator[Mutant]:
    for sigma in (0.1, 0.3, 1.0):
        start = {"start": "first_measurement"}
        yield subject.optioned("overconfident_start", f"velocity_{sigma}", start, velocity_sigma=sigma)


def chance(subject: ExaminedTracker) -> Iterator[Mutant]:
    fault = "not_deterministic"
    yield subject.behind(fault, "drawn_start", AlteredScans, scans.drawn(1.0), "starting")
    yield subject.behind(fault, "perturbed_measurements", AlteredScans, scans.drawn(0.2), "started")
    yield subject.behind(fault, "sampled_output", AlteredEstimates, estimates.sampled)


def answers(subject: ExaminedTracker) -> Iterator[Mutant]:
    alterations = [
        ("velocity_unit", "kmh", estimates.velocity_in_kmh),
        ("axis_swapped", "output_order", estimates.velocity_beside_position),
        ("covariance_constant", "returned", estimates.constant),
        ("covariance_order", "px_vx_py_vy", estimates.covariance_beside),
        ("covariance_diagonal", "returned", estimates.diagonal_alone),
        ("covariance_asymmetric", "upper_triangle", estimates.upper_triangle_scaled),
        ("covariance_asymmetric", "one_entry", estimates.one_entry_left),
        ("covariance_not_psd", "correlations_doubled", estimates.correlations_doubled),
        ("covariance_not_psd", "negative_eigenvalue", estimates.smallest_eigenvalue_negated),
    ]
    for fault, variant, alter in alterations:
        yield subject.behind(fault, variant, AlteredEstimates, alter)
