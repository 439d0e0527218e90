"""What the fused engine is held against: filters, scans, and how far two beliefs are apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.support.scenes import LIDAR_NOISE, MOTIONS, NOISE, RADAR_NOISE, TRACKERS, scan, tracker

from trackbench.base.types import Array, Estimate, Gaussian, Mask, Scan
from trackbench.engine.choice import Engine
from trackbench.filters import AnyBelief, Belief, MultiModelBelief, PredictedMeasurement, Update
from trackbench.models.motion import Kinematics
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.filtered import FilterTracker

KINDS = ("radar", "lidar")
NEAR_TRUTH = {"from": "truth", "position_sigma_m": 0.5, "velocity_sigma_mps": 0.5}
#: Process noise that fits the circles: of innovations that are 30 times as large as stated, rounding is so too.
DIAGONALS = {"cv": [0.01, 0.01, 0.25, 0.25], "ca": [0.01] * 6, "ctrv": [0.01] * 5, "ctra": [0.01] * 6}


def of_modes(filter: str, *models: str, **options: Any) -> dict[str, Any]:
    """The keys of an IMM of these models."""
    modes = [{"model": model, **NOISE[model]} for model in models]
    return {"filter": filter, "motion": {"imm": modes, "stay_s": [5.0, 2.0, 3.0][: len(modes)]}, **options}


def _with_diagonals() -> Iterator[tuple[str, dict[str, Any]]]:
    for name, keys in TRACKERS.items():
        motion = str(keys["motion"])
        rest = {key: value for key, value in keys.items() if key not in NOISE[motion]}
        yield f"{name}-diagonal", {**rest, "process_noise_diag": DIAGONALS[motion]}


#: Every filter with every motion model, each also with a stated process noise, and several models together.
FILTERS: Mapping[str, dict[str, Any]] = {
    **TRACKERS,
    **dict(_with_diagonals()),
    "kf-imm": of_modes("kf", "cv", "ca"),
    **{f"{name}-imm": of_modes(name, "cv", "ctrv") for name in ("ekf", "ukf", "ckf")},
    "ukf_additive-imm": of_modes("ukf", "ca", "ctra", augmented=False),
    "ukf_classic-imm": of_modes("ukf", "ctrv", "ctra", sigma_points="classic", kappa=0.5),
    "ekf-imm3": of_modes("ekf", "cv", "ca", "ctra"),
    "kf-cv_continuous": {"filter": "kf", "motion": "cv_continuous", **NOISE["cv_continuous"]},
    **{
        f"{filter}-{motion}": {"filter": filter, "motion": motion, **NOISE[motion]}
        for filter in ("ekf", "ukf")
        for motion in NOISE
        if motion not in MOTIONS
    },
}
#: Those that are tried at every change.
CHOSEN = (
    "kf-ca",
    "ekf-cv",
    "ekf-ctra-diagonal",
    "ukf-ctrv",
    "ukf_additive-ca",
    "ckf-cv-diagonal",
    "ekf-imm",
    "ukf-cv_continuous",
    "ekf-singer",
    "ukf-ct",
)
CASES = [pytest.param(name, marks=() if name in CHOSEN else pytest.mark.slow) for name in FILTERS]
#: Largest difference between the engines, relative or in sigmas.
LIMIT = 1e-12


class Drive(NamedTuple):
    """Objects that drive in circles, seen in turn by each kind of sensor on a moving observer."""

    motion: Kinematics
    """At the first scan, each ``(batch,)``."""
    normal: Array
    """``(6, batch)`` standard normal numbers, by which the tracks start elsewhere."""
    scans: list[Scan]

    def part(self, where: slice) -> Drive:
        """Some of the objects."""
        motion = Kinematics(*(values[where] for values in self.motion))
        scans = [scan._replace(measurement=scan.measurement[:, where], valid=scan.valid[where]) for scan in self.scans]
        return Drive(motion, self.normal[:, where], scans)

    def tracker(self, name: str, engine: Engine = "numpy", initial: dict[str, Any] | None = None) -> FilterTracker:
        """One of ``FILTERS``, whose tracks start near the truth unless it is said how."""
        made = tracker(**FILTERS[name], initial=initial or NEAR_TRUTH)
        if initial is None:
            made = made.with_prior(np.zeros(len(self.motion.px)), self.motion, self.normal)
        return replace(made, engine=engine)


def drive(
    steps: int,
    batch: int,
    kinds: Sequence[str] = KINDS,
    *,
    seed: int = 1,
    valid: float = 0.9,
    period: float = 0.1,
    speeds: tuple[float, float] = (4.0, 12.0),
) -> Drive:
    """Such a drive, each object detected with the probability ``valid``, and by the first scan in any case."""
    random = np.random.default_rng(seed)
    radius, speed = random.uniform(15.0, 30.0, batch), random.uniform(*speeds, batch)
    turn = speed / radius * random.choice([-1.0, 1.0], batch)
    first = random.uniform(-np.pi, np.pi, batch)
    made: list[Scan] = []
    for k in range(steps):
        kind, time = kinds[k % len(kinds)], k * period
        px, py, course = _at(first + turn * time, radius, turn)
        pose, own = (0.5 * time % 10.0, 0.2, 0.1 * np.sin(time)), (0.5, 0.0)
        target = np.stack([px, py, speed * np.cos(course), speed * np.sin(course)])
        exact = SENSOR_MODELS[kind].measure(target, np.array(pose), np.array(own))
        noise = LIDAR_NOISE if kind == "lidar" else RADAR_NOISE
        measured = exact + np.sqrt(np.diag(noise))[:, None] * random.normal(size=exact.shape)
        there = random.random(batch) < (valid if k else 1.0)
        made.append(scan(kind, time, measured, there, noise, pose, own)._replace(sensor=kind))
    px, py, course = _at(first, radius, turn)
    return Drive(Kinematics(px, py, speed, course, np.zeros(batch), turn), random.normal(size=(6, batch)), made)


def _at(course: Array, radius: Array, turn: Array) -> tuple[Array, Array, Array]:
    side = np.sign(turn) * radius
    return 60.0 + side * np.sin(course), 10.0 - side * np.cos(course), course


def apart(one: AnyBelief, other: AnyBelief, angular: tuple[tuple[int, ...], ...]) -> float:
    """The largest difference of two beliefs, relative to a mean or its sigma, and to the sigmas of a covariance.

    Args:
        one: a belief.
        other: that of NumPy.
        angular: of each mode, which components of its state are angles.
    """
    if isinstance(one, MultiModelBelief):
        assert isinstance(other, MultiModelBelief)
        modes = [apart(a, b, (at,)) for a, b, at in zip(one.modes, other.modes, angular, strict=True)]
        return max(difference(one.probability, other.probability, 1e-3), *modes)
    assert isinstance(other, Belief)
    assert marks(one.repaired) == marks(other.repaired)
    away = one.mean - other.mean
    for i in angular[0]:
        away[i] = np.where(np.abs(away[i]) > np.pi, np.abs(away[i]) - 2 * np.pi, away[i])
    sigma = np.sqrt(np.einsum("ii...->i...", other.covariance))
    mean = _largest(away / np.maximum(np.abs(other.mean), sigma), one.mean, other.mean)
    spread = (one.covariance - other.covariance) / (sigma[:, None] * sigma)
    return max(mean, _largest(spread, one.covariance, other.covariance))


def of_gaussians(one: Gaussian, other: Gaussian) -> float:
    """The largest difference of two distributions without angles."""
    return apart(Belief(*one), Belief(*other), ((),))


def of_estimates(one: Estimate, other: Estimate) -> float:
    """The largest difference of two estimates, in all that they say of the object and of the measurement."""
    assert marks(one.repaired) == marks(other.repaired)
    return max(
        of_gaussians(Gaussian(one.mean, one.covariance), Gaussian(other.mean, other.covariance)),
        of_innovations(one, other),
        *(
            difference(getattr(one, name), getattr(other, name), least)
            for name, least in SMALL.items()
            if _both(getattr(one, name), getattr(other, name))
        ),
    )


def of_updates(one: Update[Any], other: Update[Any], scan: Scan, angular: tuple[tuple[int, ...], ...]) -> float:
    """The largest difference of two updates, of their innovations where there is a measurement."""
    said = [part(update, scan.valid) for update in (one, other)]
    mixtures = [update.mixture for update in said]
    return max(
        apart(one.belief, other.belief, angular),
        of_innovations(*said),
        difference(*mixtures, 1.0) if _both(*mixtures) else 0.0,
    )


def of_innovations(one: Any, other: Any) -> float:
    """The largest difference of two innovations, in units of their sigma."""
    if not _both(one.innovation, other.innovation):
        return 0.0
    said = [Gaussian(each.innovation, each.innovation_covariance) for each in (one, other)]
    return max(of_gaussians(*said), difference(one.whitened_innovation, other.whitened_innovation, 1.0))


def of_predictions(one: PredictedMeasurement, other: PredictedMeasurement, belief: AnyBelief) -> float:
    """The largest difference of two predicted measurements of a belief."""
    found = [of_gaussians(Gaussian(one.mean, one.covariance), Gaussian(other.mean, other.covariance))]
    if isinstance(belief, Belief):
        of_state, of_scan = (np.sqrt(np.einsum("ii...->i...", p)) for p in (belief.covariance, other.covariance))
        found.append(_largest((one.cross - other.cross) / (of_scan[:, None] * of_state), one.cross, other.cross))
    else:
        found += [of_predictions(*each) for each in zip(one.modes, other.modes, belief.modes, strict=True)]
    assert len(one.modes) == len(other.modes)
    return max(found)


def part(update: Update[Any], where: Mask) -> Update[Any]:
    """What an update says of some measurements."""
    mixture = None if update.mixture is None else update.mixture[where]
    shape = (*update.innovation_covariance.shape[:2], *where.shape)
    return update._replace(
        innovation=update.innovation[:, where],
        innovation_covariance=np.broadcast_to(update.innovation_covariance, shape)[..., where],
        whitened_innovation=update.whitened_innovation[:, where],
        mixture=mixture,
    )


#: Of which parts of an estimate what counts as small.
SMALL = {"mode_probabilities": 1e-3, "log_likelihood": 1.0}


def _both(one: Any, other: Any) -> bool:
    assert (one is None) == (other is None)
    return one is not None


def difference(one: Array, other: Array, least: float) -> float:
    """The largest difference, relative to the second or to ``least``."""
    return _largest((one - other) / np.maximum(np.abs(other), least), one, other)


def marks(repaired: Any) -> list[int]:
    """Which members are marked; none where nothing is."""
    return [] if repaired is None else np.flatnonzero(repaired).tolist()


def _largest(away: Array, one: Array, other: Array) -> float:
    """The largest of some differences; where one is not finite, the other is the same."""
    unlike = ~(np.isfinite(one) & np.isfinite(other))
    np.testing.assert_array_equal(
        np.broadcast_to(one, unlike.shape)[unlike], np.broadcast_to(other, unlike.shape)[unlike]
    )
    return float(np.abs(np.where(unlike, 0.0, away)).max(initial=0.0))
