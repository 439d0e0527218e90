"""Methods of association beside the PMB filter of its authors, on their detections of Williams' scenario 1.

``python -m benchmarks.williams_one`` prints the table of docs/traffic-trackers.md; TRACKBENCH_DATA holds the data.

Four objects meet within a third of a standard deviation of a detection, and one of them goes. The trackers are told
the model. Source: Williams (2015), "Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer"; the folder's README has the set-up of the reference.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tests.support.udacity import data_folder

import trackbench as tb
from trackbench.base.types import Array

RUNS = range(1, 21)
#: Columns of the reference, and the metric of the same name here.
PARTS = {
    "gospa_squared_m2": "gospa",
    "localisation_m2": "gospa_localisation",
    "missed_m2": "gospa_missed",
    "false_m2": "gospa_false",
}
#: Radius of a disc that holds the area of the objects, and the false alarms that it holds at their density.
REACH, FALSE_ALARMS = 213.0, 15.84

POISSON: dict[str, Any] = {
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
COUNTING: dict[str, Any] = {"gate": POISSON["gate"], "confirm": [3, 5], "delete_after_s": 3}
QUICK: dict[str, Any] = {"gate": POISSON["gate"], "confirm": [2, 3]}
METHODS: dict[str, dict[str, Any]] = {
    "pmb": {"method": "pmb", **POISSON},
    "jipda": {"method": "jipda", **POISSON},
    "gnn_3_of_5": {"method": "gnn", **COUNTING},
    "jpda_3_of_5": {"method": "jpda", **COUNTING},
    "gnn_2_of_3": {"method": "gnn", **QUICK},
    "jpda_2_of_3": {"method": "jpda", **QUICK},
}


class Row(NamedTuple):
    """One method on several runs beside the reference."""

    rms: dict[str, float]
    """Root mean square of GOSPA and of its parts, m, by the metric."""
    reference: dict[str, float]
    """The same of the authors' filter."""
    paired_t: float
    """Of the difference of the mean squared GOSPA, run by run."""

    @property
    def ratio(self) -> float:
        """RMS GOSPA over that of the reference."""
        return self.rms["gospa"] / self.reference["gospa"]


def folder() -> Path:
    """Where the detections and the reference are."""
    return data_folder() / "published" / "williams_one"


def scenario(target: Path, runs: Sequence[int], methods: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Write the truth and the detections of each run into a folder; return a scenario in which each run is a log."""
    detections = pd.read_csv(folder() / "detections.csv.gz")
    for run in runs:
        (target / f"truth_{run}.csv").write_bytes((folder() / "truth.csv").read_bytes())
        detections[detections["run"] == run].to_csv(target / f"detections_{run}.csv", index=False)
    columns = {"time": "time_s", "object": "id", "px": "x_m", "py": "y_m", "vx": "vx_mps", "vy": "vy_mps"}
    # The sensor stands in the middle of the area and measures from there; the file's positions are in the fixed frame.
    readings = {"time": "time_s", "x": "x_m", "y": "y_m", "bias": {"x": 150, "y": 150}}
    return {
        "name": "williams_one",
        "truth": {
            "source": "recording",
            "format": "csv",
            "path": [str(target / f"truth_{run}.csv") for run in runs],
            "columns": columns,
            "observer": {"x": 150, "y": 150},
            "readings": {"position": {**readings, "path": [str(target / f"detections_{run}.csv") for run in runs]}},
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
            name: {
                "filter": "kf",
                "motion": "cv_continuous",
                "acceleration_density_mps1p5": float(np.sqrt(0.02)),
                "initial": {"velocity": "zero", "velocity_sigma_mps": 1},
                "associate": associate,
            }
            for name, associate in methods.items()
        },
        "monte_carlo": {"runs": 1},
    }


def squared_gospa(result: tb.Result, method: str) -> Array:
    """Mean squared GOSPA of each run, m^2."""
    runs = result.to_pandas("runs")
    own = runs[runs["tracker"] == method].sort_values("scene")
    return np.asarray(own["gospa_total"] / own["gospa_count"])


def rows(result: tb.Result, runs: Sequence[int], methods: Sequence[str]) -> dict[str, Row]:
    """Each method beside the reference on the same runs."""
    reference = pd.read_csv(folder() / "reference.csv")
    by_run = reference[reference["run"].isin(runs)].groupby("run")[list(PARTS)].mean()
    theirs = {PARTS[column]: float(np.sqrt(value)) for column, value in by_run.mean().items()}
    found = {}
    for method in methods:
        difference = squared_gospa(result, method) - by_run["gospa_squared_m2"].to_numpy()
        error = difference.std(ddof=1) / np.sqrt(len(difference))
        rms = {metric: result[method].metrics[metric].value for metric in PARTS.values()}
        found[method] = Row(rms, theirs, float(difference.mean() / error))
    return found


def table(found: dict[str, Row]) -> str:
    """The rows as Markdown, the reference first."""
    lines = ["| method | GOSPA | localisation | missed | false | ratio | paired t |", "|:--|--:|--:|--:|--:|--:|--:|"]

    def line(name: str, values: dict[str, float], *more: str) -> str:
        return " | ".join([f"| {name}", *(f"{values[metric]:.3f}" for metric in PARTS.values()), *more]) + " |"

    first = next(iter(found.values()))
    lines.append(line("PMB of the authors", first.reference, "1", ""))
    lines += [line(f"`{name}`", row.rms, f"{row.ratio:.3f}", f"{row.paired_t:.1f}") for name, row in found.items()]
    return "\n".join(lines)


def main() -> None:
    """Print the table of all runs."""
    with tempfile.TemporaryDirectory() as target:
        result = tb.run(tb.load(scenario(Path(target), RUNS, METHODS)))
    print(table(rows(result, RUNS, list(METHODS))))


if __name__ == "__main__":
    main()
