"""A run of traffic on three lanes, recorded, and its file read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests.support.recordings import ReadRecording
from tests.support.results import with_tables

import trackbench as tb
from trackbench.results import Result
from trackbench.subjects.recording import writer as recording

TIME = np.arange(401) * 0.05
#: Place and speed of each vehicle at first, and when it is there; v1 changes lane to the left, v4 arrives, v5 leaves.
VEHICLES = {
    "ego": (0, 4, 25, TIME >= 0),
    "v1": (15, 0, 25.5, TIME >= 0),
    "v2": (-14, 8, 25.5, TIME >= 0),
    "v3": (34, 4, 25, TIME >= 0),
    "v4": (20, 8, 25, TIME > 4.99),
    "v5": (-20, 0, 24.5, TIME < 11.99),
}
TRACKER = "acceleration_sigma_mps2: 2, initial: first_measurement"
SCENARIO = f"""\
name: lanes
truth: {{source: recorded-traffic, format: csv, path: cars.csv, observer: {{vehicle: ego}}, targets: all}}
sensors:
  front_radar: {{type: radar, rate_hz: 20, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}}
  roof_lidar: {{type: lidar, rate_hz: 10, position_sigma_m: 0.15, detection_probability: 0.9}}
trackers:
  ekf_cv: {{filter: ekf, motion: cv, {TRACKER}}}
  ukf_ctrv: {{filter: ukf, motion: ctrv, yaw_acceleration_sigma_radps2: 0.5, {TRACKER}}}
  raw: {{use: raw}}
monte_carlo: {{runs: 3}}
score: {{settle_s: 0}}
"""


@pytest.fixture(scope="session")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The result of the run."""
    folder, parts = tmp_path_factory.mktemp("lanes"), []
    for name, (x, y, speed, there) in VEHICLES.items():
        side = 2 * (1 + np.tanh((TIME - 8) / 1.2)) if name == "v1" else 0 * TIME
        heading = np.arctan2(np.gradient(side, TIME), speed)
        columns = {"time": TIME, "id": name, "x": x + speed * TIME, "y": y + side, "heading": heading}
        parts.append(pd.DataFrame({**columns, "length": 5.0, "width": 2.0})[there])
    pd.concat(parts).to_csv(folder / "cars.csv", index=False)
    (folder / "lanes.yaml").write_text(SCENARIO, encoding="utf-8")
    return tb.run(folder / "lanes.yaml")


@pytest.fixture(scope="session")
def short(result: Result) -> Result:
    """Its first three seconds, of one vehicle."""
    tables = {}
    for name, table in result.tables.items():
        if "object" in table.column_names:
            table = table.filter(pc.is_in(table["object"], pa.array(["observer", "v1"])))
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
