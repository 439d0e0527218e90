"""A result with one of everything: good and bad trackers, missing values, a failure, a repaired truth."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pyarrow as pa

from trackbench.results import SCHEMA_VERSION, Difference, Result, difference_table

SENSORS = {"front_radar": 3, "roof_lidar": 2}
RMSE = {"ukf_ctrv": 0.382, "ekf_ctrv": 0.385, "ekf_cv": 0.412, "ekf_tight": 0.63, "alpha_beta": 0.71, "raw": 1.93}
NEES = {"ukf_ctrv": 4.02, "ekf_ctrv": 4.1, "ekf_cv": 3.1, "ekf_tight": 96.0, "alpha_beta": None, "raw": 4.0}
TIED = {frozenset(("ukf_ctrv", "ekf_ctrv"))}
BOUND = 0.35
TIME = np.arange(0, 20.01, 0.05)


def metric(value: float | None, unit: str, reason: str = "") -> dict[str, Any]:
    if value is None:
        return {"value": None, "unit": unit, "reason": reason}
    return {"value": value, "unit": unit, "ci95": [0.98 * value, 1.02 * value]}


def chi_square(mean: float | None, dof: int, reason: str = "") -> dict[str, Any]:
    if mean is None:
        return {"mean": None, "dof": dof, "unit": "1", "reason": reason}
    low, high = 0.9 * dof, 1.1 * dof
    verdict = "pessimistic" if mean < low else "optimistic" if mean > high else "consistent"
    return {"mean": mean, "dof": dof, "unit": "1", "ci95": None, "verdict": verdict}


def mixed(mean: float) -> dict[str, Any]:
    """A NEES that is right over all and off under two conditions."""
    found = [("straight", 2.9, "pessimistic"), ("turning", 39.7, "optimistic"), ("0 to 20 m", 4.0, "consistent")]
    conditions = [
        {"name": name, "mean": value, "ci95": [0.98 * value, 1.02 * value], "verdict": word}
        for name, value, word in found
    ]
    return {**chi_square(mean, 4), "verdict": "mixed", "conditions": conditions}


def tracker(name: str, place: int) -> dict[str, Any]:
    rmse, nees = RMSE[name], NEES[name]
    no_innovation = "the tracker gives no innovation of this sensor"
    scale = None if name in ("raw", "alpha_beta") else (nees or 4.0) / 4
    white = {**metric(scale and 0.011, "1", no_innovation), "verdict": scale and "white"}
    units = {"px": "m", "py": "m", "vx": "m/s", "vy": "m/s"}
    return {
        "name": name,
        "place": place,
        "describe": f"{name.replace('_', ', ')}, acceleration sigma 3 m/s^2, all sensors",
        "failed": None,
        "metrics": {
            "position_rmse": metric(rmse, "m"),
            "velocity_rmse": metric(None if name == "raw" else 2.1 * rmse, "m/s", "raw gives no velocity"),
            **{f"rmse.{axis}": metric(0.7 * rmse, unit) for axis, unit in units.items()},
            "nees": mixed(4.1) if name == "ekf_ctrv" else chi_square(nees, 4, "the tracker gives no covariance"),
            **{
                f"nis.{sensor}": {
                    **chi_square(scale and dof * scale, dof, no_innovation),
                    "inside95": scale and min(0.99, 0.95 / scale),
                }
                for sensor, dof in SENSORS.items()
            },
            **{f"whiteness.{sensor}": white for sensor in SENSORS},
            "position_over_reference": metric(rmse / BOUND, "1"),
            "velocity_over_reference": metric(1.2, "1"),
            "coverage": {"value": 0.99, "unit": "1"},
            "step_time": {"value": 0.2 * 2.5**place, "unit": "us"},
        },
        "health": {
            "diverged_runs": 3 if name == "ekf_tight" else 0,
            "repaired_covariances": 7 if name == "ekf_tight" else 0,
            "repaired_runs": 0,
            "non_finite_estimates": 0,
        },
    }


def failed_tracker() -> dict[str, Any]:
    nothing = {"value": None, "unit": "1", "reason": "the tracker failed"}
    keys = ("position_rmse", "velocity_rmse", "nees")
    return {
        "name": "mine",
        "describe": "mypkg:Mine, all sensors",
        "failed": {
            "cause": "ValueError: matrix <3> is singular",
            "step": 12,
            "time_s": 0.6,
            "sensor": "roof_lidar",
            "run": 0,
            "object": "v1",
        },
        "metrics": dict.fromkeys(keys, nothing),
        "health": {"non_finite_estimates": 0},
    }


def make_summary() -> dict[str, Any]:
    names = list(RMSE)
    expectation = {"tracker": "ekf_cv", "metric": "position_rmse", "operator": "below"}
    return {
        "schema_version": SCHEMA_VERSION,
        "scenario": {
            "name": "highway_overtake",
            "description": "Four cars on a highway, one overtakes.",
            "file": "highway.yaml",
            "text": "name: highway_overtake\nsensors: {}  # <b>not bold</b>\n",
            "overrides": [],
        },
        "seed": 7,
        "runs": 100,
        "versions": {"trackbench": "0.1.0", "numpy": "2.4.6"},
        "command": "trackbench run scenarios/highway.yaml --runs 100",
        "fingerprints": [f"{run:016x}" for run in range(100)],
        "truth": {
            "source": "highway-env",
            "env": "highway-v0",
            "objects": ["v1", "v2", "v3"],
            "steps": len(TIME),
            "dt": 0.05,
            "duration_s": 20.0,
            "audit": {
                "mode": "repair",
                "verdict": "repaired",
                "velocity_error_before": {"max_mps": 5.3, "mean_mps": 0.2, "object": "v2", "time_s": 4.5},
                "velocity_error_after": {"max_mps": 0.012, "mean_mps": 0.001, "object": "v2", "time_s": 4.5},
                "jumps": [{"object": "v3", "time_s": 15.0, "distance_m": 1.4}],
                "velocity_jumps": {
                    "limit_mps2": 20.0,
                    "count": 4,
                    "largest_mps": 5.03,
                    "object": "v2",
                    "time_s": 4.55,
                    "peak_acceleration_mps2": 100.6,
                },
                "repaired": {
                    "velocity_from_displacement": ["v1", "v2"],
                    "cut_at_jump": ["v3"],
                },
            },
            "cached": True,
        },
        "engine": "numpy",
        "sensors": {
            "front_radar": {
                "kind": "radar",
                "sigmas": {"range_m": 0.3, "azimuth_deg": 0.5, "range_rate_mps": 0.1},
                "fov_deg": 120.0,
                "max_range_m": 150.0,
                "rate_hz": 20.0,
                "preset": "bosch_lrr3",
                "detection_rate": 0.93,
            },
            "roof_lidar": {
                "kind": "lidar",
                "sigmas": {"x_m": 0.15, "y_m": 0.15},
                "fov_deg": 360.0,
                "max_range_m": None,
                "rate_hz": 10.0,
                "preset": None,
                "detection_rate": None,
            },
        },
        "reference": {
            "kind": "reference",
            "acceleration_sigma_mps2": 1.0,
            "acceleration_from": "truth",
        },
        "score": {
            "settle_s": 1.0,
            "min_coverage": 0.9,
            "from_s": 0.0,
            "to_s": 20.0,
            "margin": {"percent": 1.0, "position_m": 0.005, "velocity_mps": 0.02, "course_deg": 0.05},
        },
        "recorded_run": 0,
        "trackers": [
            *(tracker(name, i) for i, name in enumerate(reversed(names))),
            {**failed_tracker(), "place": len(names)},
        ],
        "ranking": [*names, "mine"],
        "expectations": [
            {**expectation, "limit": 0.5, "value": 0.412, "passed": True, "text": "ekf_cv position_rmse below 0.5"},
            {**expectation, "limit": 0.4, "value": 0.412, "passed": False, "text": "ekf_cv position_rmse below 0.4"},
        ],
        "passed": False,
        "artifacts": {},
    }


def make_differences() -> list[Difference]:
    names = list(RMSE)
    return [
        Difference(
            a=a,
            b=b,
            metric="position_rmse",
            unit="m",
            value=RMSE[a] - RMSE[b],
            ci95=(RMSE[a] - RMSE[b] - 0.005, RMSE[a] - RMSE[b] + 0.005),
            margin=0.005,
            p_value=0.3 if {a, b} in TIED else 1e-9,
            better=None if {a, b} in TIED else a if RMSE[a] < RMSE[b] else b,
            verdict="undecided" if {a, b} in TIED else f"{a if RMSE[a] < RMSE[b] else b} better",
        )
        for a, b in combinations(names, 2)
    ]


def make_tables() -> dict[str, pa.Table]:
    rng = np.random.default_rng(1)
    settling = 1 + 8 * np.exp(-TIME / 0.4)
    steps, nis, estimates = [], [], []
    paths = {f"v{i}": np.stack([20 * i + (22 + i) * TIME, 4 * i + 2 * np.tanh(TIME - 8)]) for i in (1, 2, 3)}
    for name, rmse in RMSE.items():
        error = rmse * settling * (1 + 0.05 * rng.standard_normal(TIME.size))
        nees = np.full(TIME.size, np.nan) if NEES[name] is None else NEES[name] * rng.normal(1, 0.08, TIME.size)
        steps.append(
            {
                "tracker": [name] * TIME.size,
                "time_s": TIME,
                "position_rmse_m": error,
                "velocity_rmse_mps": 2.1 * error,
                "nees_mean": nees,
                "nees_low": np.full(TIME.size, 3.6),
                "nees_high": np.full(TIME.size, 4.4),
                "position_reference_m": BOUND * settling,
                "velocity_reference_mps": 0.8 * settling,
            }
        )
        if name not in ("raw", "alpha_beta"):
            nis += [
                {
                    "tracker": [name] * TIME.size,
                    "sensor": [sensor] * TIME.size,
                    "time_s": TIME,
                    "count": np.full(TIME.size, 300.0),
                    "dof": np.full(TIME.size, float(dof)),
                    "nis_mean": dof * (NEES[name] or 4) / 4 * rng.normal(1, 0.08, TIME.size),
                    "nis_low": np.full(TIME.size, 0.9 * dof),
                    "nis_high": np.full(TIME.size, 1.1 * dof),
                }
                for sensor, dof in SENSORS.items()
            ]
        for target, path in paths.items():
            noise = rmse * rng.standard_normal(path.shape)
            estimates.append(
                {
                    "tracker": [name] * TIME.size,
                    "object": [target] * TIME.size,
                    "time_s": TIME,
                    "px_m": path[0] + noise[0],
                    "py_m": path[1] + noise[1],
                    "vx_mps": np.gradient(path[0], TIME),
                    "vy_mps": np.gradient(path[1], TIME),
                    **{f"p_{a}{b}": np.full(TIME.size, float(a == b)) for a in range(4) for b in range(a, 4)},
                    "position_error_m": np.hypot(*noise),
                    "velocity_error_mps": 2.1 * np.hypot(*noise),
                    "nees": np.full(TIME.size, NEES[name] or np.nan),
                    "due": (TIME >= 1.0).astype(float),
                }
            )
    bodies = {**paths, "observer": np.stack([21 * TIME, np.full(TIME.size, 4.0)])}
    truth = [
        {
            "object": [name] * TIME.size,
            "role": ["observer" if name == "observer" else "target"] * TIME.size,
            "time_s": TIME,
            "alive": np.full(TIME.size, True),
            "px_m": path[0],
            "py_m": path[1],
            "vx_mps": np.gradient(path[0], TIME),
            "vy_mps": np.gradient(path[1], TIME),
            "heading_rad": np.arctan2(np.gradient(path[1], TIME), np.gradient(path[0], TIME)),
            "length_m": np.full(TIME.size, 5.0),
            "width_m": np.full(TIME.size, 2.0),
        }
        for name, path in bodies.items()
    ]
    measurements = [
        {
            "sensor": [sensor] * TIME.size,
            "object": [name] * TIME.size,
            "time_s": TIME,
            "valid": np.full(TIME.size, True),
            "x_m": path[0] + 0.3,
            "y_m": path[1],
            "sensor_x_m": 21 * TIME,
            "sensor_y_m": np.full(TIME.size, 4.0),
            "sensor_yaw_rad": np.zeros(TIME.size),
        }
        for sensor in SENSORS
        for name, path in paths.items()
    ]
    roads = [{"line": np.full(2, i), "x_m": [0, 600], "y_m": [4 * i - 2, 4 * i - 2]} for i in range(5)]
    parts = {
        "steps": steps,
        "nis": nis,
        "estimates": estimates,
        "truth": truth,
        "measurements": measurements,
        "roads": roads,
    }
    tables = {
        name: pa.table({key: np.concatenate([row[key] for row in rows]) for key in rows[0]})
        for name, rows in parts.items()
    }
    return {**tables, "differences": difference_table(make_differences())}


def make_result() -> Result:
    return Result.from_json(make_summary(), make_tables())
