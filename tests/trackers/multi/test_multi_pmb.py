"""One scan of the Poisson multi-Bernoulli filter against all its associations, and existence against ten lines."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from trackbench.base.types import Array, FieldOfView, Scan, Tracks
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.associate import AssociateConfig
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import MultiObjectTracker, build_multi
from trackbench.trackers.multi.intensity import intensity

DETECTION, GATE, SURVIVAL, BORN, UNDETECTED, REACH, FALSE_ALARMS = 0.8, 0.99999, 0.97, 0.4, 3.0, 60.0, 4.0
NOISE, VELOCITY_SIGMA, DENSITY = 1.0, 1.0, 0.2
BIRTHS = {"x": 4.0, "y": -3.0, "sigma_m": 12.0}
OBJECTS = np.array([[0.0, 0.0], [2.5, 1.0], [-2.0, 2.0]])


def tracker(method: str, **associate: Any) -> MultiObjectTracker:
    keys = {
        "filter": "kf", "motion": "cv_continuous", "acceleration_density_mps1p5": DENSITY,
        "initial": {"velocity": "zero", "velocity_sigma_mps": VELOCITY_SIGMA},
        "associate": {
            "method": method, "gate": GATE, "lifetime_s": -1 / np.log(SURVIVAL), "visible_s": None,
            "birth_rate_hz": BORN, "undetected": UNDETECTED, "delete_after_s": 99.0, "delete_existence": 1e-9,
            "report_existence": 0.4, **associate,
        },
    }  # fmt: skip
    return build_multi(FilterConfig.model_validate(keys)).tracker


def scan_of(time: float, detections: Array) -> Scan:
    """Positions about a sensor at the origin."""
    return Scan(
        time, "lidar", "lidar", detections.T.reshape(2, -1), np.ones(len(detections), dtype=bool), NOISE * np.eye(2),
        np.zeros(3), np.zeros(2), time, DETECTION, FALSE_ALARMS / (np.pi * REACH**2), FieldOfView(np.pi, REACH),
    )  # fmt: skip


def normal(apart: Array, covariance: Array) -> float:
    return float(
        np.exp(-0.5 * apart @ np.linalg.solve(covariance, apart)) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))
    )


def birth_density(place: Array, births: dict[str, float] | str) -> float:
    if births == "uniform":
        return 1 / (np.pi * REACH**2)
    assert isinstance(births, dict)
    return normal(place - [births["x"], births["y"]], (births["sigma_m"] ** 2 + NOISE) * np.eye(2))


@pytest.mark.parametrize("births", ["uniform", BIRTHS])
@pytest.mark.parametrize("method", ["pmb", "jipda"])
def test_a_scan_equals_the_sum_over_all_associations(method: str, births: dict[str, float] | str) -> None:
    """Three tracks that compete for three detections; each association of tracks with detections has its weight.

    Source: Williams (2015), "Marginal multi-Bernoulli filters", theorem 2 with the marginals of section IV.
    """
    of = tracker(method, birth_density=births)
    state, _ = of.step(None, scan_of(0.0, OBJECTS))
    second = np.array([[0.8, 0.3], [1.6, 1.4], [-1.0, 3.0]])
    before = state.table
    assert len(before.run) == 3
    f = np.kron([[1, 1], [0, 1]], np.eye(2))
    q = DENSITY**2 * np.kron([[1 / 3, 1 / 2], [1 / 2, 1]], np.eye(2))
    h = np.eye(2, 4)
    mean = f @ before.belief.mean
    covariance = np.stack([f @ before.belief.covariance[..., i] @ f.T + q for i in range(3)])
    exists = before.evidence[0] * SURVIVAL
    unseen = UNDETECTED * (1 - DETECTION) * SURVIVAL + BORN
    alarms = FALSE_ALARMS / (np.pi * REACH**2)
    new = np.array([unseen * DETECTION * birth_density(z, births) for z in second])
    # jipda takes each detection of no track for a false alarm.
    rest = alarms + (new if method == "pmb" else 0.0 * new)
    total, share, missed = 0.0, np.zeros((3, 3)), np.zeros(3)
    likelihood = np.array(
        [[normal(z - h @ mean[:, i], h @ covariance[i] @ h.T + NOISE * np.eye(2)) for z in second] for i in range(3)]
    )
    no_detection = 1 - exists * DETECTION * GATE
    for choice in product((None, 0, 1, 2), repeat=3):
        taken = [j for j in choice if j is not None]
        if len(taken) != len(set(taken)):
            continue
        weight = float(np.prod([rest[j] for j in range(3) if j not in taken]))
        for i, j in enumerate(choice):
            weight *= no_detection[i] if j is None else exists[i] * DETECTION * likelihood[i, j]
        total += weight
        for i, j in enumerate(choice):
            if j is None:
                missed[i] += weight
            else:
                share[i, j] += weight
    share, missed = share / total, missed / total
    kept = missed * exists * (1 - DETECTION * GATE) / no_detection
    expected = kept + share.sum(axis=1)
    state, _ = of.step(state, scan_of(1.0, second))
    after = state.table
    np.testing.assert_allclose(after.evidence[0, :3], expected, rtol=1e-9)
    free = 1 - share.sum(axis=0)
    np.testing.assert_allclose(np.sort(after.evidence[0, 3:]), np.sort(free * new / (alarms + new)), rtol=1e-9)
    for i in range(3):
        gain = covariance[i] @ h.T @ np.linalg.inv(h @ covariance[i] @ h.T + NOISE * np.eye(2))
        parts = [mean[:, i] + gain @ (z - h @ mean[:, i]) for z in second]
        weights = np.array([*share[i], kept[i]]) / expected[i]
        states = np.array([*parts, mean[:, i]])
        centre = weights @ states
        np.testing.assert_allclose(after.belief.mean[:, i], centre, atol=1e-9)
        updated = covariance[i] - gain @ h @ covariance[i]
        spread = np.einsum("k,ki,kj->ij", weights, states - centre, states - centre)
        mixed = (1 - weights[-1]) * updated + weights[-1] * covariance[i] + spread
        np.testing.assert_allclose(after.belief.covariance[..., i], mixed, atol=1e-9)


def reported_at(of: MultiObjectTracker, scans: list[Scan]) -> tuple[list[Tracks], list[float]]:
    """What is reported, and the existence of the oldest track, after each scan."""
    state, answers, existence = None, [], []
    for scan in scans:
        state, tracks = of.step(state, scan)
        answers.append(tracks)
        existence.append(float(state.table.evidence[0, 0]))
    return answers, existence


HITS = [True] * 5 + [False, False, False, True, True, False, True]


@pytest.mark.parametrize("confirm", ["existence", [3, 5]])
@pytest.mark.parametrize("method", ["pmb", "jipda"])
def test_a_confirmed_track_comes_back_under_its_own_id(method: str, confirm: Any) -> None:
    of = tracker(method, confirm=confirm, report_existence=0.7, birth_density="uniform")
    scans = [scan_of(float(k), OBJECTS[:1] if hit else OBJECTS[:0]) for k, hit in enumerate(HITS)]
    answers, existence = reported_at(of, scans)
    # A single target without false alarms in its gate: the recursion of Musicki, Evans and Stankovic (1994).
    r = existence[4]
    for hit, stated in zip(HITS[5:], existence[5:], strict=True):
        r *= SURVIVAL
        if not hit:
            r = r * (1 - DETECTION * GATE) / (1 - r * DETECTION * GATE)
            assert stated == pytest.approx(r, rel=1e-12)
        r = stated
    reported = [tracks.ids.tolist() for tracks in answers]
    first = 2 if confirm == [3, 5] else next(k for k, value in enumerate(existence) if value >= 0.7)
    assert [ids == [0] for ids in reported] == [k >= first and value >= 0.7 for k, value in enumerate(existence)]
    silent = [k for k, ids in enumerate(reported) if k > first and not ids]
    assert silent
    assert max(silent) < len(HITS) - 1


def test_a_track_ends_below_the_existence_of_deletion_alone() -> None:
    scans = [scan_of(float(k), OBJECTS[: int(k < 5)]) for k in range(12)]
    state, of, alive = None, tracker("pmb", delete_existence=1e-3), []
    for scan in scans:
        state, tracks = of.step(state, scan)
        alive.append((state.table.evidence[0].tolist(), tracks.ids.tolist()))
    assert any(existence and existence[0] < 0.4 for existence, _ in alive[5:])
    assert all(existence[0] >= 1e-3 for existence, _ in alive if existence)
    assert alive[-1] == ([], [])


@pytest.mark.parametrize("kind", ["lidar", "radar"])
def test_a_gaussian_birth_density_is_the_integral_over_positions(kind: str) -> None:
    """Of what the sensor would measure of objects that are drawn: a grid of positions, each with its likelihood."""
    pose = np.array([20.0, -5.0, 0.6])
    sigmas = {"lidar": [0.8, 0.8], "radar": [0.6, 0.01, 1e-3]}[kind]
    births = {"x": 40.0, "y": 12.0, "sigma_m": 6.0}
    place = np.array([[38.0, 44.0], [10.0, 17.0], [0.0, 0.0], [0.0, 0.0]])
    model = SENSOR_MODELS[kind]
    measurement = model.measure(place, pose[:, None], np.zeros((2, 1)))
    noise = np.diag(np.square(sigmas))
    scan = Scan(
        0.0, kind, kind, measurement, np.ones(2, dtype=bool), noise, pose, np.zeros(2), 0.0, 1.0, 1e-4,
        FieldOfView(np.pi, 100.0),
    )  # fmt: skip
    config = AssociateConfig.model_validate({"method": "pmb", "birth_density": births})
    stated = intensity(scan, len(measurement), config, 2.0, 0.9, VELOCITY_SIGMA).new_objects
    step = 0.05
    grid = np.stack(np.meshgrid(np.arange(10, 70, step), np.arange(-18, 42, step), indexing="ij")).reshape(2, -1)
    away = np.sum((grid - [[births["x"]], [births["y"]]]) ** 2, axis=0)
    prior = np.exp(-away / (2 * births["sigma_m"] ** 2)) / (2 * np.pi * births["sigma_m"] ** 2)
    at = model.measure(np.concatenate([grid, np.zeros_like(grid)]), pose[:, None], np.zeros((2, 1)))
    for i in range(2):
        apart = at[:2] - measurement[:2, i, None]
        likelihood = np.prod(
            [np.exp(-0.5 * (a / s) ** 2) / (np.sqrt(2 * np.pi) * s) for a, s in zip(apart, sigmas, strict=False)],
            axis=0,
        )
        integral = 2.0 * 0.9 * np.sum(prior * likelihood) * step**2
        # The range rate of an object that is about to move is normal about zero.
        width = np.sqrt(2 * np.pi) * VELOCITY_SIGMA if kind == "radar" else 1.0
        assert np.asarray(stated)[i] == pytest.approx(integral / width, rel=0.01)
