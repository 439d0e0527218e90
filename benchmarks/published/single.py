"""Published numbers of filters of one object: a car, a steady acceleration, air traffic."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.udacity import data_folder

import trackbench as tb
from trackbench.base.types import Array

from .rows import Row, Source, of_metric

#: In the notebook: raw, Kalman filter, smoother.
CAR = {"raw": 0.7679855237247215, "kf": 0.4253824660526518, "rts": 0.26497104638205465}
#: Deterministic tracking index, k by Blair's Table I and k of the numerical optimum.
BLAIR = ((0.01, 4.225, 4.235), (0.1, 2.650, 2.651), (1.0, 1.677, 1.677), (10.0, 1.174, 1.173))
#: Position RMSE by an independent program, m.
AIR_TRAFFIC = {"kf": 141.7, "imm": 108.2}


def car_scenario(target: Path) -> dict[str, Any]:
    """Write the car's truth and measurements into a folder; return a scenario of them.

    The published filter starts from (0, 0, 1, -1) with the unit covariance, one step before the first measurement. The
    scenario has two readings of a further sensor that give this start, at (-1, 1) and 1 s later at the origin.
    """
    data = json.loads((data_folder() / "published" / "car_track.json").read_text(encoding="utf-8"))
    start = np.array([[-1.0, 1.0, 1.0, -1.0], [0.0, 0.0, 1.0, -1.0]])
    time, before = 0.1 * np.arange(1, 101), np.array([-1.0, 0.0])
    tables = {
        "truth": np.column_stack([np.append(before, time), np.vstack([start, np.transpose(data["X"])])]),
        "position": np.column_stack([time, np.transpose(data["Y"])]),
        "start": np.column_stack([before, start[:, :2]]),
    }
    for name, values in tables.items():
        header = "time,x,y,vx,vy" if name == "truth" else "time,x,y"
        np.savetxt(target / f"{name}.csv", values, "%.17g", ",", header=header, comments="")
    initial = {"from": "two_measurements", "sensors": ["start"], "covariance_diag": [1, 1, 1, 1]}
    kf = {"filter": "kf", "motion": "cv_continuous", "acceleration_density_mps1p5": 1, "initial": initial}
    # White acceleration of the same intensity that is constant over each step of 0.1 s.
    piecewise = {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": float(np.sqrt(10)), "initial": initial}
    readings = {
        name: {"time": "time", "x": "x", "y": "y", "path": str(target / f"{name}.csv")}
        for name in ("start", "position")
    }
    return {
        "name": "car_track",
        "truth": {
            "source": "recording",
            "format": "csv",
            "path": str(target / "truth.csv"),
            "columns": {"time": "time", "px": "x", "py": "y", "vx": "vx", "vy": "vy"},
            "readings": readings,
        },
        "sensors": {
            "start": {"type": "lidar", "position_sigma_m": 1},
            "position": {"type": "lidar", "position_sigma_m": 0.5},
        },
        "trackers": {
            "raw": {"use": "raw", "sensors": ["position"]},
            "kf": kf,
            "rts": {**kf, "smoother": "rts"},
            "kf_piecewise": piecewise,
            "rts_piecewise": {**piecewise, "smoother": "rts"},
        },
        "monte_carlo": {"runs": 1},
        "score": {"settle_s": 1.05},  # the 100 measurements alone
    }


def car(target: Path) -> Source:
    """Return the RMSE of the car of Särkkä and Svensson, whose data are recorded."""
    scenario = car_scenario(target)
    result = tb.run(tb.load(scenario), workers=1)
    ours = {name: float(result[name].position_rmse) for name in scenario["trackers"]}

    def row(what: str, printed: str, tracker: str, why: str = "") -> Row:
        return Row(what, (CAR[printed],), (ours[tracker],), 10, why=why)

    rows = (
        row("measurements", "raw", "raw"),
        row("Kalman filter", "kf", "kf"),
        row("RTS smoother", "rts", "rts"),
        row("Kalman filter, `cv`", "kf", "kf_piecewise", PIECEWISE),
        row("RTS smoother, `cv`", "rts", "rts_piecewise", PIECEWISE),
    )
    return Source("Särkkä and Svensson's car", CAR_TEXT, rows)


def gains(index: float) -> tuple[float, float]:
    """Return alpha and beta of the steady filter at a tracking index sigma_v T^2 / sigma_w (Kalata 1984)."""
    root = (4 + index - np.sqrt(8 * index + index**2)) / 4
    alpha = 1 - root**2
    return alpha, 2 * (2 - alpha) - 4 * np.sqrt(1 - alpha)


def largest_mse(k: float, index: float) -> float:
    """Return the mean-square error in units of sigma_w^2 under the steady acceleration: noise, and lag squared."""
    alpha, beta = gains(k * index)
    noise = (2 * alpha**2 + beta * (2 - 3 * alpha)) / (alpha * (4 - 2 * alpha - beta))
    return float(noise + ((1 - alpha) / beta * index) ** 2)


def acceleration() -> Source:
    """Return the errors under a steady acceleration beside Blair's closed form."""
    from scipy.optimize import minimize_scalar

    result = tb.run(tb.load("published/constant_acceleration"), workers=1)
    rows, best = [], []
    for index, k, _ in BLAIR:
        name = f"k_{k:.3f}".replace(".", "p")
        metric, sigma = result[name].metrics["rmse.px"], 1 / index
        low, high = metric.ci95 or (np.nan, np.nan)
        value, interval = (float(metric) / sigma) ** 2, ((low / sigma) ** 2, (high / sigma) ** 2)
        rows.append(Row(f"error, index {index:g}, k {k:.3f}", (largest_mse(k, index),), (value,), 4, interval))
        best.append(minimize_scalar(largest_mse, args=(index,), bounds=(0.5, 10), method="bounded").x)
    indices, _, printed = zip(*BLAIR, strict=True)
    what = " ".join(f"{index:g}" for index in indices)
    rows.append(Row(f"optimal k, index {what}", printed, tuple(best), 3))
    return Source("Blair's constant acceleration", BLAIR_TEXT, tuple(rows), ("closed form", "ours", "95 %"))


def expected_kf_rmse(positions: Array, velocities: Array, period: float) -> float:
    """Return the exact position RMSE of the Kalman filter of air traffic: its bias and covariance, by recursion.

    Args:
        positions, velocities: ``(n, 2)`` the aircraft at each scan.
        period: between scans, s.
    """
    motion = np.array([[1, period], [0, 1]])
    gain_of_noise = np.array([[period**2 / 2], [period]])
    noise, variance, measure = gain_of_noise @ gain_of_noise.T, 100.0**2, np.array([[1.0, 0.0]])
    stated, actual, bias = (
        np.diag([variance, 300.0**2]),
        np.diag([variance, 0.0]),
        np.stack([0 * velocities[0], -velocities[0]]),
    )
    squares = [2 * variance]
    states = np.stack([positions, velocities], axis=1)
    for before, now in pairwise(states):
        predicted = motion @ stated @ motion.T + noise
        gain = predicted @ measure.T / (measure @ predicted @ measure.T + variance)
        rest = np.eye(2) - gain @ measure
        stated = rest @ predicted
        actual = rest @ motion @ actual @ motion.T @ rest.T + gain @ gain.T * variance
        bias = rest @ (motion @ (before + bias) - now)
        squares.append(2 * actual[0, 0] + float(np.sum(bias[0] ** 2)))
    return float(np.sqrt(np.mean(squares)))


def air_traffic() -> Source:
    """Return the errors of a Kalman filter and of an IMM behind a turning aircraft."""
    result = tb.run(tb.load("published/air_traffic"), workers=1)
    truth = result.to_pandas("truth")
    scans = truth[(truth["object"] == "aircraft") & (np.round(truth["time_s"]) % 5 == 0)]
    exact = expected_kf_rmse(scans[["px_m", "py_m"]].to_numpy(), scans[["vx_mps", "vy_mps"]].to_numpy(), 5.0)
    kf, imm = (result[name].metrics["position_rmse"] for name in ("kf", "imm"))
    rows = (
        of_metric("Kalman filter, program", AIR_TRAFFIC["kf"], kf, 1),
        of_metric("Kalman filter, expectation", exact, kf, 2),
        of_metric("IMM, program", AIR_TRAFFIC["imm"], imm, 1),
    )
    return Source("Bar-Shalom, Li and Kirubarajan's air traffic", AIR_TEXT, rows, ("given", "ours", "95 %"))


CAR_TEXT = """\
Särkkä and Svensson (2023), "Bayesian Filtering and Smoothing", examples 6.8 and 12.4: position RMSE, m. Printed in
`python/example_notebooks/car_track.ipynb` of `EEA-sensors/Bayesian-Filtering-and-Smoothing`; ours has the same 100
measurements."""
PIECEWISE = """\
The book has continuous white acceleration, `cv_continuous` here. `cv` holds the acceleration over each step: at the
same intensity q its position variance is q dt³/4 in place of q dt³/3. A NumPy filter of ten lines gives both
numbers."""
BLAIR_TEXT = """\
Blair (2008), "Design of nearly constant velocity track filters for tracking maneuvering targets": k = sigma_v / A. The
error, in units of sigma_w², is a closed form of k. Table I has a polynomial for k: 4.225 at index 0.01, where
the numerical optimum is 4.235 (last row). Ours: x of `published/constant_acceleration`, 2,000 runs after 60 s."""
AIR_TEXT = """\
Bar-Shalom, Li and Kirubarajan (2001), section 11.7.4: position RMSE, m. The book has curves only; given are
numbers of an independent program (number of runs unknown) and of a recursion for the exact expectation. Ours:
`published/air_traffic`, 2,000 runs. 20,000 runs give the Kalman filter 141.53 (141.41 to 141.66) and the IMM 108.47
(108.35 to 108.58): both numbers of the program are outside, 0.2 and 0.3 away, less than the standard error of 500
runs."""
