"""What is in a recording, as JSON values: contents, versions, scores computed afresh, single moments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from trackbench import results
from trackbench.errors import InputError
from trackbench.metrics.stored import ROOT_MEAN_SQUARES
from trackbench.recording.moments import scene_at, worst
from trackbench.recording.reader import Recorded, read
from trackbench.recording.rescore import rescored
from trackbench.recording.shown import recorded_run
from trackbench.recording.tables import columns, split

Json = dict[str, Any]


def inspect(path: Path, at: float | None = None, count: int | None = None) -> Json:
    """Everything about a recording or the folder of a run that can be read without a viewer.

    Args:
        path: the recording or folder.
        at: also the scene at this time, s.
        count: also so many worst moments of each tracker.

    Raises:
        InputError: it cannot be read, or has no such time.
    """
    recorded = read(path)
    summary, tables = recorded.result.json(), recorded.result.tables
    if "score" not in summary:
        raise InputError("this result does not say how it was scored: it is of an earlier version", file=recorded.file)
    shown = recorded_run(recorded.result)
    scores = rescored(recorded.result, shown)
    found: Json = {
        "file": str(recorded.file),
        "rerun": recorded.rerun,
        "note": recorded.note,
        "scenario": summary["scenario"]["name"],
        "description": summary["scenario"]["description"],
        "command": summary["command"],
        "seed": summary["seed"],
        "runs": summary["runs"],
        "recorded_run": summary["recorded_run"],
        "objects": summary["truth"]["objects"],
        "duration_s": summary["truth"]["duration_s"],
        "fingerprint": recorded.result.summary.fingerprint,
        "versions": summary["versions"],
        "rows": {name: table.num_rows for name, table in sorted(tables.items())},
        "sensors": {name: _measurements(rows) for (name,), rows in split(tables["measurements"], "sensor").items()},
        "trackers": [
            {"name": entry["name"], "describe": entry["describe"], "failed": entry["failed"]}
            | scores.get(entry["name"], {})
            for entry in summary["trackers"]
        ],
        "checked": _checked(recorded, scores),
    }
    if at is not None:
        found["at"] = scene_at(recorded.result, shown, at)
    if count is not None:
        found["worst"] = worst(shown, count)
    return found


def _measurements(rows: Any) -> Json:
    instants = len(np.unique(rows["time_s"]))
    return {"kind": str(rows["kind"][0]), "instants": instants, "measurements": int(rows["valid"].sum())}


def _checked(recorded: Recorded, scores: dict[str, Json]) -> Json | None:
    """How far the scores are from those that the run itself left beside the recording, if it did."""
    folder = recorded.file if recorded.file.is_dir() else recorded.file.parent
    try:
        beside = results.Result.load(folder)
    except InputError:
        return None
    summary = recorded.result.json()
    if "runs" not in beside.tables or beside.summary.fingerprints != recorded.result.summary.fingerprints:
        return None
    runs = columns(beside.tables["runs"])
    apart = [0.0]
    for tracker, found in scores.items():
        (row,) = np.flatnonzero((runs["tracker"].astype(str) == tracker) & (runs["run"] == summary["recorded_run"]))
        pairs = [(found["metrics"]["nees"]["mean"], runs["nees_mean"][row])]
        for name, metric in ROOT_MEAN_SQUARES.items():
            node = found["metrics"]
            for part in name.split("."):
                node = node[part]
            pairs.append((node["value"], runs[metric.column][row]))
        apart += [abs(new - old) / old for new, old in pairs if new is not None and old > 0]
    return {"file": str(folder / "runs.parquet"), "largest_relative_difference": float(max(apart))}
