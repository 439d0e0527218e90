"""Estimates that are scored after each measurement, held against a UKF of the textbook and against published rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from tests.support import scenes

from trackbench.api.run import run
from trackbench.base.types import Array
from trackbench.models.sensors import Lidar
from trackbench.models.sensors.radar import MIN_RANGE
from trackbench.results import Result
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns
from trackbench.scenario import load_scenario
from trackbench.sensing.scans import sense_known

COMPONENTS = ("px", "py", "vx", "vy")
#: Two UKFs of the course, as their authors describe them.
SCENARIO = yaml.safe_load("""\
name: udacity_samples
truth: {source: recording, format: udacity, path: $TRACKBENCH_DATA/udacity/sample-laser-radar-measurement-data-1.txt}
sensors:
  lidar: {type: lidar, position_sigma_m: 0.15}
  radar: {type: radar, range_sigma_m: 0.3, azimuth_sigma_deg: 1.71887339, range_rate_sigma_mps: 0.3}
trackers:
  at_rest: &ukf
    filter: ukf
    motion: ctrv
    sigma_points: classic
    kappa: -2
    acceleration_sigma_mps2: 0.5
    yaw_acceleration_sigma_radps2: 0.5
    initial: {from: first_measurement, velocity: zero, unbiased: false, covariance_diag: [1, 1, 1, 1, 1]}
  radial:
    <<: *ukf
    kappa: -4
    acceleration_sigma_mps2: 0.8
    yaw_acceleration_sigma_radps2: 0.6
    initial: {from: first_measurement, velocity: radial, unbiased: false, covariance_diag: [1, 1, 1, 1, 1]}
score: {each: measurement, settle_s: 0}
monte_carlo: {runs: 1}
""")
NOISE = {"L": np.diag([0.15, 0.15]), "R": np.diag([0.3, np.deg2rad(1.71887339), 0.3])}


def wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def lines(folder: Path) -> list[tuple[str, Array, float, Array]]:
    """A recording with two measurements at each of 60 instants, as letter, measurement, time and truth."""
    random, rows = np.random.default_rng(5), []
    for k in range(60):
        time, yaw = 0.2 * k, 0.3 + 0.02 * k
        truth = np.array([5 + 3 * np.sin(0.05 * k) + 0.3 * k, 4 + 0.1 * k, 2 * np.cos(yaw), 2 * np.sin(yaw)])
        distance = np.hypot(*truth[:2])
        polar = np.array([distance, np.arctan2(truth[1], truth[0]), truth[:2] @ truth[2:] / distance])
        for letter, seen in (("L", truth[:2]), ("R", polar)):
            rows.append((letter, seen + NOISE[letter] @ random.normal(size=len(seen)), time, truth))
    text = [
        "\t".join([letter, *map(repr, map(float, seen)), str(round(1e6 * time)), *map(repr, map(float, truth))])
        for letter, seen, time, truth in rows
    ]
    (folder / "lines.txt").write_text("\n".join(text))
    return rows


def textbook_errors(rows: list[tuple[str, Array, float, Array]], straight_below: float = 0.0) -> Array:
    """``(4, measurements)`` of the augmented UKF on CTRV with lambda = -2, from the first position at rest.

    ``straight_below``: the turn rate below which a sigma point is taken to go straight on, rad/s.
    """
    state, covariance, now = np.r_[rows[0][1], 0, 0, 0], np.eye(5), rows[0][2]
    weights = np.r_[-2 / 5, np.full(14, 1 / 10)]
    errors = []
    for number, (letter, seen, time, truth) in enumerate(rows):
        if number:
            dt, now = time - now, time
            root = np.sqrt(5) * np.linalg.cholesky(
                np.block([[covariance, np.zeros((5, 2))], [np.zeros((2, 5)), 0.25 * np.eye(2)]])
            )
            px, py, v, yaw, rate, a, turn = np.r_[state, 0, 0][:, None] + np.c_[np.zeros(7), root, -root]
            # v / rate (sin(yaw + rate dt) - sin yaw), also for a rate of zero.
            curved = np.where(np.abs(rate) < straight_below, 0.0, rate)
            chord = v * dt * np.sinc(curved * dt / 2 / np.pi)
            points = np.array(
                [
                    px + chord * np.cos(yaw + curved * dt / 2) + a * dt**2 / 2 * np.cos(yaw),
                    py + chord * np.sin(yaw + curved * dt / 2) + a * dt**2 / 2 * np.sin(yaw),
                    v + a * dt,
                    yaw + rate * dt + turn * dt**2 / 2,
                    rate + turn * dt,
                ]
            )
            state = points @ weights
            away = points - state[:, None]
            away[3] = wrapped(away[3])
            covariance = (weights * away) @ away.T
            px, py, v, yaw, _ = points
            distance = np.maximum(np.hypot(px, py), MIN_RANGE)
            expected = np.array([px, py])
            if letter == "R":
                expected = np.array(
                    [distance, np.arctan2(py, px), v * (px * np.cos(yaw) + py * np.sin(yaw)) / distance]
                )
            middle = expected @ weights
            deviation = expected - middle[:, None]
            s = (weights * deviation) @ deviation.T + NOISE[letter] ** 2
            gain = (weights * away) @ deviation.T @ np.linalg.inv(s)
            state = state + gain @ (seen - middle)
            covariance = covariance - gain @ s @ gain.T
        errors.append(np.r_[state[:2], state[2] * np.cos(state[3]), state[2] * np.sin(state[3])] - truth)
    return np.array(errors).T


def scored(folder: Path, path: Path, each: str = "measurement", at_rest: object = None) -> Result:
    tracker = at_rest or SCENARIO["trackers"]["at_rest"]
    scenario = {
        **SCENARIO,
        "truth": {**SCENARIO["truth"], "path": str(path)},
        "trackers": {"at_rest": tracker, "radial": SCENARIO["trackers"]["radial"]},
        "score": {**SCENARIO["score"], "each": each, "min_coverage": 0.4},
    }
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(scenario))
    return run(load_scenario(file), in_process=True)


def rmse(result: Result, tracker: str) -> list[float]:
    return [result[tracker].metrics[f"rmse.{name}"].value for name in COMPONENTS]


def test_each_measurement_is_scored_as_by_the_textbook(tmp_path: Path) -> None:
    errors = textbook_errors(lines(tmp_path))
    result = scored(tmp_path, tmp_path / "lines.txt")
    np.testing.assert_allclose(rmse(result, "at_rest"), np.sqrt((errors**2).mean(axis=1)), rtol=1e-9)
    # Once an instant, it is the second of the two.
    result = scored(tmp_path, tmp_path / "lines.txt", each="instant")
    np.testing.assert_allclose(rmse(result, "at_rest"), np.sqrt((errors[:, 1::2] ** 2).mean(axis=1)), rtol=1e-9)


def test_the_folder_of_a_run_has_each_estimate(tmp_path: Path) -> None:
    lines(tmp_path)
    scored(tmp_path, tmp_path / "lines.txt").save(tmp_path / "run", {})
    assert Result.load(tmp_path / "run").tables.estimates.num_rows == 2 * 120


class SecondAlone:
    """Answers with a fixed state to the second measurement of an instant and to no other."""

    batched = True
    STATE = (5.0, 4.0, 1.0, 0.5)

    def step(self, state, scan):
        mean = np.full((4, scan.valid.size), np.nan)
        if scan.kind == "radar":
            mean[:] = np.array(self.STATE)[:, None]
        return True, (mean, np.eye(4)[..., None] + np.zeros_like(mean[0]))


def test_a_missing_estimate_is_charged_with_measurements_until_then(tmp_path: Path) -> None:
    """Not with the second measurement of the same instant; before that, the state that was given last is worse."""
    rows = lines(tmp_path)
    result = scored(tmp_path, tmp_path / "lines.txt", at_rest={"use": f"{__name__}:SecondAlone"})
    errors = np.zeros((4, len(rows)))
    for number, (letter, seen, _, truth) in enumerate(rows):
        fixed = np.array(SecondAlone.STATE)
        candidates = [fixed] if letter == "R" else [np.r_[seen, 0, 0], *([fixed] if number else [])]
        for part in (slice(0, 2), slice(2, 4)):
            errors[part, number] = max(((state - truth)[part] for state in candidates), key=np.linalg.norm)
    np.testing.assert_allclose(rmse(result, "at_rest"), np.sqrt((errors**2).mean(axis=1)), rtol=1e-9)


def test_an_object_is_due_from_its_first_detection_on() -> None:
    """Not from the other measurement of the same instant on, which came before."""
    zero = np.zeros((30, 1, 1))
    of = scenes.truth(np.arange(30) * 0.1, zero + 20, zero + 5, zero + 1, zero)
    lidar = Lidar(rate_hz=10, position_sigma_m=0.15, detection_probability=0.3)
    whole = scenes.work(of, {"first": lidar, "second": lidar}, {}, 50)
    whole.scenes[0] = replace(whole.scenes[0], each_measurement=True)
    measured = sense_known(whole.scenes[0].sensors, whole.seed, whole.noise_of(0), range(50))
    detected = np.maximum.accumulate(np.stack([scan.valid for scan in measured.scans]))
    np.testing.assert_array_equal(Targets(whole, BlockRuns(0, range(50)), measured).due[:, 0], detected)
    assert (detected[1::2] & ~detected[::2]).any()
