"""A run without a simulator, recorded, and its file read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy import stats
from tests.support.example_result import make_result
from tests.support.recordings import ReadRecording
from tests.support.results import with_tables

from trackbench.results import (
    Result,
    Summary,
    Tables,
)
from trackbench.subjects.recording import writer as recording

STEPS, DT, RUNS = 401, 0.05, 100
TARGETS = ("v1", "v2", "v3", "v4", "v5")
TRACKERS = {"raw": 0.9, "ekf_ctrv": 0.5, "ekf_cv": 0.42, "ukf_ctrv": 0.38, "ekf_tight": 0.55}
CLAIMED = 0.4
SENSORS = {"front_radar": (1, 3), "roof_lidar": (2, 2)}
KINDS = {"front_radar": "radar", "roof_lidar": "lidar"}
TIME = np.arange(STEPS) * DT


def synthetic_result() -> Result:
    """Traffic on three lanes: v1 changes lane to the left, v4 arrives at 5 s, v5 leaves at 12 s."""
    rng = np.random.default_rng(5)
    truth = _truth()
    estimates, recorded_nis, steps, nis = [], [], [], []
    for tracker, sigma in TRACKERS.items():
        for name in TARGETS:
            estimates.append(_estimates(rng, tracker, sigma, truth[name]))
        growth = 1 + 2 * np.exp(-TIME)
        rmse = sigma * growth * (1 + 0.03 * rng.standard_normal(STEPS))
        count = RUNS * sum(truth[name]["alive"] for name in TARGETS)
        low, high = (stats.chi2.ppf(q, 4 * count) / count for q in (0.025, 0.975))
        mean = rng.chisquare(4 * count) / count * (3.0 if tracker == "ekf_tight" else 1.0)
        steps.append(
            {
                "tracker": [tracker] * STEPS,
                "time_s": TIME,
                "count": count,
                "given": count,
                "position_rmse_m": rmse,
                "velocity_rmse_mps": 2 * rmse,
                "nees_mean": mean,
                "nees_low": low,
                "nees_high": high,
                "position_reference_m": 0.3 * growth,
                "velocity_reference_mps": 0.5 * growth,
            }
        )
        for sensor, (every, dof) in SENSORS.items():
            if tracker == "raw":
                continue
            at, number = TIME[::every], count[::every]
            low, high = (stats.chi2.ppf(q, dof * number) / number for q in (0.025, 0.975))
            mean = rng.chisquare(dof * number) / number * (1.6 if tracker == "ekf_tight" else 1.0)
            nis.append(
                {
                    "tracker": [tracker] * len(at),
                    "sensor": [sensor] * len(at),
                    "time_s": at,
                    "count": number,
                    "nis_mean": mean,
                    "dof": np.full(len(at), float(dof)),
                    "nis_low": low,
                    "nis_high": high,
                }
            )
            for name in TARGETS:
                seen = at[truth[name]["alive"][::every]]
                recorded_nis.append(
                    {
                        "tracker": [tracker] * len(seen),
                        "sensor": [sensor] * len(seen),
                        "object": [name] * len(seen),
                        "time_s": seen,
                        "nis": rng.chisquare(dof, len(seen)),
                    }
                )
    lanes = [(line, x, 4.0 * line - 2.0) for line in range(4) for x in np.linspace(-50, 650, 71)]
    tables = {
        "truth": [{**rows, "heading_rad": rows["course_rad"]} for rows in truth.values()],
        "measurements": [_measurements(rng, truth, name, sensor) for sensor in SENSORS for name in TARGETS],
        "estimates": estimates,
        "recorded_nis": recorded_nis,
        "steps": steps,
        "nis": nis,
        "roads": [dict(zip(("line", "x_m", "y_m"), map(np.array, zip(*lanes, strict=True)), strict=True))],
    }
    return Result(_summary(), Tables({name: _table(parts) for name, parts in tables.items()}))


def _truth() -> dict[str, dict[str, Any]]:
    starts = {"ego": (0, 4, 25), "v1": (15, 0, 25.5), "v2": (-14, 8, 25.5), "v3": (34, 4, 25), "v4": (20, 8, 25)}
    starts["v5"] = (-20, 0, 24.5)
    lives = {"v4": TIME >= 5, "v5": TIME < 12}
    rows = {}
    for name, (x, y, speed) in starts.items():
        change = 2 * (1 + np.tanh((TIME - 8) / 1.2)) if name == "v1" else np.zeros(STEPS)
        vy = np.gradient(change, DT)
        rows[name] = {
            "object": [name] * STEPS,
            "role": ["observer" if name == "ego" else "target"] * STEPS,
            "time_s": TIME,
            "alive": lives.get(name, np.ones(STEPS, dtype=bool)),
            "px_m": x + speed * TIME,
            "py_m": y + change,
            "course_rad": np.arctan2(vy, speed),
            "length_m": np.full(STEPS, 5.0),
            "width_m": np.full(STEPS, 2.0),
        }
    return rows


def _estimates(rng: np.random.Generator, tracker: str, sigma: float, truth: dict[str, Any]) -> dict[str, Any]:
    smooth = np.exp(-np.arange(20) / 6.0)
    noise = rng.standard_normal((2, STEPS + 40))
    error = np.stack([np.convolve(row, smooth / np.linalg.norm(smooth), "same")[20:-20] for row in noise])
    error *= sigma / np.sqrt(2) * (1 + 2 * np.exp(-TIME))
    alive = truth["alive"]
    number = int(alive.sum())
    p_00, p_11, p_01 = 1.6 * CLAIMED**2, 0.4 * CLAIMED**2, 0.6 * CLAIMED**2
    inverse = np.linalg.inv([[p_00, p_01], [p_01, p_11]])
    return {
        "tracker": [tracker] * number,
        "object": list(np.array(truth["object"])[alive]),
        "time_s": TIME[alive],
        "due": np.ones(number),
        "px_m": (truth["px_m"] + error[0])[alive],
        "py_m": (truth["py_m"] + error[1])[alive],
        "p_00": np.full(number, p_00),
        "p_01": np.full(number, p_01),
        "p_11": np.full(number, p_11),
        "position_error_m": np.hypot(*error)[alive],
        "velocity_error_mps": 2 * np.hypot(*error)[alive],
        "nees": np.einsum("it,ij,jt->t", error, inverse, error)[alive] + rng.chisquare(2, number),
    }


def _measurements(rng: np.random.Generator, truth: dict[str, dict[str, Any]], name: str, sensor: str) -> dict[str, Any]:
    every, _ = SENSORS[sensor]
    rows = {key: np.asarray(values)[::every] for key, values in truth[name].items()}
    number = len(rows["time_s"])
    valid = rows["alive"] & (rng.random(number) < 0.9)
    x, y = (np.where(valid, rows[axis] + 0.4 * rng.standard_normal(number), np.nan) for axis in ("px_m", "py_m"))
    kind = [KINDS[sensor]] * number
    names = {"sensor": [sensor] * number, "kind": kind, "object": [name] * number}
    return {**names, "time_s": rows["time_s"], "valid": valid, "x_m": x, "y_m": y}


def _table(parts: list[dict[str, Any]]) -> pa.Table:
    return pa.table({key: np.concatenate([np.asarray(part[key]) for part in parts]) for key in parts[0]})


def _summary() -> Summary:
    made = make_result().summary
    truth = made.truth.model_copy(update={"objects": list(TARGETS), "steps": STEPS})
    kept = [tracker for tracker in made.trackers if tracker.name in TRACKERS]
    return made.model_copy(
        update={
            "trackers": [tracker.model_copy(update={"place": place}) for place, tracker in enumerate(kept)],
            "ranking": sorted(TRACKERS, key=TRACKERS.__getitem__),
            "truth": truth,
            "score": made.score.model_copy(update={"settle_s": 0.0}),
        }
    )


@pytest.fixture(scope="session")
def result() -> Result:
    return synthetic_result()


@pytest.fixture(scope="session")
def short(result: Result) -> Result:
    """Its first three seconds, of one vehicle."""
    tables = {}
    for name, table in result.tables.items():
        if "object" in table.column_names:
            table = table.filter(pc.is_in(table["object"], pa.array(["ego", "v1"])))
        tables[name] = table.filter(pc.less(table["time_s"], 3.01)) if "time_s" in table.column_names else table
    return with_tables(result, **tables).updated(truth=result.summary.truth.model_copy(update={"objects": ["v1"]}))


@pytest.fixture(scope="session")
def rewritten(short: Result, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., ReadRecording]:
    """Writes ``short`` with other tables, or another result, and reads the recording."""

    def write(result: Result = short, **tables: pa.Table) -> ReadRecording:
        path = tmp_path_factory.mktemp("rewritten") / "run.rrd"
        recording.write(with_tables(result, **tables), path)
        return ReadRecording(path)

    return write


@pytest.fixture(scope="session")
def file(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    recording.write(result, path)
    return path


@pytest.fixture(scope="session")
def read(file: Path) -> ReadRecording:
    return ReadRecording(file)
