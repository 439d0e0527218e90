"""The PMB filter of its authors on Williams' scenario 1: its estimates as they are, and `pmb` and `jipda` beside it.

Four objects meet within a third of a standard deviation of a detection, and one of them goes. The trackers are told
the model. Source: Williams (2015), "Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer"; the README in the folder of the data has the set-up of the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tests.support.udacity import data_folder

import trackbench as tb
from trackbench.base.types import Array

from .rows import Row, Source, of_metric, of_runs

RUNS = range(1, 21)
METRICS = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false")
#: RMS of each metric over runs and scans, m, as the README of the data prints them.
PRINTED = (3.579, 1.988, 1.908, 2.284)
#: Radius of a disc that holds the area of the objects, and the false alarms that it holds at their density.
REACH, FALSE_ALARMS = 213.0, 15.84

ASSOCIATE: dict[str, Any] = {
    "gate": 1 - float(np.exp(-10)),
    "lifetime_s": -1 / float(np.log(0.99)),
    "visible_s": None,
    "birth_rate_hz": 0.005,
    "undetected": 3,
    "birth_density": {"x": 100, "y": 100, "sigma_m": 150},
    "report_existence": 0.4,
    "delete_existence": 1e-5,
    "delete_after_s": 1000,
}
METHODS = ("pmb", "jipda")
AUTHORS = "authors"


def folder() -> Path:
    """Return the folder with the detections and the reference."""
    return data_folder() / "published" / "williams_one"


def scenario(target: Path, runs: Sequence[int] = RUNS) -> dict[str, Any]:
    """Write truth, detections and the authors' estimates of each run into a folder; return a scenario of these logs."""
    detections, estimates = (pd.read_csv(folder() / f"{name}.csv.gz") for name in ("detections", "estimates"))
    for run in runs:
        (target / f"truth_{run}.csv").write_bytes((folder() / "truth.csv").read_bytes())
        detections[detections["run"] == run].to_csv(target / f"detections_{run}.csv", index=False)
        # The estimates have no identities: each row is a track of its own, which GOSPA does not see.
        own = estimates[estimates["run"] == run].drop(columns="run")
        own.assign(id=range(len(own))).to_csv(target / f"estimates_{run}.csv", index=False)

    def paths(name: str) -> list[str]:
        return [str(target / f"{name}_{run}.csv") for run in runs]

    place = {"time": "time_s", "x": "x_m", "y": "y_m"}
    # The sensor stands in the middle of the area and measures from there; the file's positions are in the fixed frame.
    readings = {**place, "path": paths("detections"), "bias": {"x": 150, "y": 150}}
    columns = {"time": "time_s", "object": "id", "px": "x_m", "py": "y_m", "vx": "vx_mps", "vy": "vy_mps"}
    return {
        "name": "williams_one",
        "truth": {
            "source": "recording",
            "format": "csv",
            "path": paths("truth"),
            "columns": columns,
            "observer": {"x": 150, "y": 150},
            "readings": {"position": readings},
        },
        "sensing": {"identities": "hidden"},
        "sensors": {
            "position": {
                "type": "lidar",
                "position_sigma_m": 1,
                "max_range_m": REACH,
                "states": {"detection_probability": 0.9, "clutter_per_scan": FALSE_ALARMS},
            }
        },
        "score": {"cutoff_m": 10},
        "trackers": {
            AUTHORS: {"use": "tracks", "format": "csv", "path": paths("estimates"), "columns": {**place, "id": "id"}},
            **{
                method: {
                    "filter": "kf",
                    "motion": "cv_continuous",
                    "acceleration_density_mps1p5": float(np.sqrt(0.02)),
                    "initial": {"velocity": "zero", "velocity_sigma_mps": 1},
                    "associate": {"method": method, **ASSOCIATE},
                }
                for method in METHODS
            },
        },
        "monte_carlo": {"runs": 1},
    }


def squared_gospa(result: tb.Result, tracker: str) -> Array:
    """Return the mean squared GOSPA of each run, m^2."""
    runs = result.to_pandas("runs")
    own = runs[runs["tracker"] == tracker].sort_values("scene")
    return np.asarray(own["gospa_total"] / own["gospa_count"])


def williams(target: Path) -> Source:
    """Return the scores of the authors' estimates, and of the bench's filters on the same detections."""
    result = tb.run(tb.load(scenario(target)), workers=1)
    theirs = squared_gospa(result, AUTHORS)

    def scores(tracker: str) -> tuple[float, ...]:
        return tuple(float(result[tracker].metrics[metric]) for metric in METRICS)

    what = "GOSPA, localisation, missed, false"
    rows = [
        Row(f"authors' estimates: {what}", PRINTED, scores(AUTHORS), 3),
        Row(f"`pmb`: {what}", PRINTED, scores("pmb"), 3),
    ]
    rows += [of_metric("`pmb`: GOSPA", PRINTED[0], result["pmb"].metrics["gospa"], 3)]
    rows += [of_runs(f"`{method}` less authors'", 0.0, squared_gospa(result, method) - theirs, 4) for method in METHODS]
    return Source("Williams' scenario 1, the authors' PMB", TEXT, tuple(rows))


TEXT = """\
Williams (2015), IEEE T-AES 51(3). Printed: RMS over 20 runs of 81 scans by the PMB of A. F. García-Fernández
(`Agarciafernandez/MTT`, run under GNU Octave) with its own GOSPA, m. Ours: its estimates as they are, and `pmb` and
`jipda` on the same detections. Last two rows: mean difference of the squared GOSPA in the
same runs, m²; 0 where equal."""
