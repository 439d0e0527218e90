"""The scans and the truth of a scenario, run by run and as tables.

A table of scans has a row for each measurement, and a row for each scan without any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from trackbench.base.config.key_units import SPELLINGS
from trackbench.base.types import Scan, Truth, scan_of_run
from trackbench.models.sensors import Sensor
from trackbench.runner.work import Work, work_of
from trackbench.scenario import Scenario
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import fingerprint_of, sense_known
from trackbench.truth import LoadedTruth


class RunKey(NamedTuple):
    """Identification of a Monte-Carlo run: its scene, and its number in the scene."""

    scene: int
    """Number of the scene, from 0."""
    run: int
    """Number of the run in the scene, from 0."""

    @property
    def stem(self) -> str:
        """File name of the run without ending, for formats with a file for each run."""
        return f"scene{self.scene}_run{self.run}"


class RunScans(NamedTuple):
    """All scans of a Monte-Carlo run, of all sensors, with a hash of their measurements."""

    key: RunKey
    fingerprint: str
    """Hash of all measurements of the run, as in ``result.json``."""
    scans: list[Scan]
    """Scans by arrival, then by time, then in the scenario's order of sensors.
    ``measurement`` is ``(m, objects)`` with known identities, else ``(m, D)``."""
    objects: tuple[str, ...] | None
    """Names of the objects; None with hidden identities."""


@dataclass
class ScanSource:
    """Scenario with the truth of each scene, from which scans are made run by run."""

    loaded: Scenario
    truths: Sequence[LoadedTruth]
    fingerprints: dict[RunKey, str] = field(default_factory=dict)
    """Fingerprints of the runs that were made so far."""

    @cached_property
    def work(self) -> Work:
        """Scenes with their sensors, without trackers."""
        config = self.loaded.config.model_copy(update={"trackers": {}})
        return work_of(replace(self.loaded, config=config), self.truths)

    @property
    def hidden(self) -> bool:
        """Whether the trackers are not told which object caused a measurement."""
        return self.loaded.config.sensing.identities == "hidden"

    @property
    def keys(self) -> list[RunKey]:
        """Scene number and run number of every Monte-Carlo run."""
        return [RunKey(scene, run) for scene in range(len(self.truths)) for run in range(self.work.runs)]

    @property
    def scene_names(self) -> list[str]:
        """Names of the scenes, such as ``seed 13``."""
        sources = self.loaded.config.truth.scenes()
        return [source.scene_name or f"scene {number + 1}" for number, source in enumerate(sources)]

    def scans(self, key: RunKey) -> RunScans:
        """Return the scans of one run, which do not depend on the other exported runs."""
        work, scene, runs = self.work, self.work.scenes[key.scene], range(key.run, key.run + 1)
        noise, objects = work.noise_of(key.scene), None
        if self.hidden:
            hidden = sense_hidden(scene.sensors, work.seed, noise, runs)
            digest, scans = hidden.digests[0], [scan_of_run(scan, 0) for scan in hidden.scans]
        else:
            measurements = sense_known(scene.sensors, work.seed, noise, runs)
            digest, scans, objects = measurements.digests[0], measurements.scans, scene.truth.ids
        arrived = sorted(scans, key=lambda scan: (scan.arrival_time, scan.time))
        self.fingerprints[key] = fingerprint_of(digest)
        return RunScans(key, self.fingerprints[key], arrived, objects)


#: Meaning of each column of the exported tables; the unit is at the end of the column's name.
OF_RUN = {
    "scene": "number of the scene, from 0",
    "run": "number of the Monte-Carlo run within the scene, from 0",
    "fingerprint": "fingerprint of all measurements of the run; copy it into the file of tracks",
}
OF_SCAN = {
    "scan": "number of the scan within the run, from 0, in the order in which a tracker gets them",
    "sensor": "name of the sensor",
    "time_s": "when the measurement was taken",
    "arrival_time_s": "when the measurement reaches the tracker",
    "sensor_x_m": "of the sensor in the fixed frame",
    "sensor_y_m": "of the sensor in the fixed frame",
    "sensor_yaw_rad": "direction of the boresight, counter-clockwise from the x axis",
    "sensor_vx_mps": "of the sensor in the fixed frame",
    "sensor_vy_mps": "of the sensor in the fixed frame",
}
OF_HIDDEN = {
    "detection_probability": "probability stated by the sensor for an object in its field of view; 0 while silent",
    "clutter_density": "false alarms stated by the sensor, per scan and unit volume of the measurement space",
    "detection": "number of the detection within the scan, from 0; empty in a scan without one",
}
OBJECT = {"object": "name of the object"}
VALID = {"valid": "1: the row has a measurement; 0: the sensor looked and detected nothing"}

TRUTH = {
    "scene": OF_RUN["scene"],
    "run": "number of the run if the motion differs by run; empty if it is the same in all runs",
    "time_s": "from the beginning of the scene",
    "object": OBJECT["object"],
    "target": "1: the object should be tracked; 0: it may be tracked and need not be",
    "x_m": "of the centre in the fixed frame",
    "y_m": "of the centre in the fixed frame",
    "heading_rad": "of the body, counter-clockwise from the x axis",
    "vx_mps": "of the centre in the fixed frame",
    "vy_mps": "of the centre in the fixed frame",
    "length_m": "of the body",
    "width_m": "of the body",
}


def component_columns(sensor: Sensor | type[Sensor]) -> list[str]:
    """Return the column name of each component of a measurement, with its SI unit at the end: ``range_rate_mps``."""
    return [f"{name}_{SPELLINGS.get(unit, unit)}" for name, unit in zip(sensor.components, sensor.units, strict=True)]


def scan_columns(sensors: Mapping[str, Sensor], hidden: bool) -> dict[str, str]:
    """Return the columns of a table of scans with their meanings; ``hidden`` says whether identities are hidden."""
    columns = OF_RUN | OF_SCAN | (OF_HIDDEN if hidden else OBJECT) | VALID
    for sensor in sensors.values():
        for column, name in zip(component_columns(sensor), sensor.components, strict=True):
            whose = "; empty of sensors that do not measure it" if len(sensors) > 1 else ""
            columns[column] = f"measured {name.replace('_', ' ')}{whose}"
    return columns


def scan_table(run_scans: RunScans, sensors: Mapping[str, Sensor], hidden: bool) -> pa.Table:
    """Return the table of a run's scans, with the columns of :func:`scan_columns`."""
    scans = run_scans.scans
    counts = np.array([max(scan.valid.size, 1) for scan in scans], dtype=np.intp)
    starts, rows = np.cumsum(counts) - counts, int(counts.sum())
    number = np.repeat(np.arange(len(scans)), counts)
    pose = np.array([scan.sensor_pose for scan in scans]).reshape(-1, 3)[number]
    velocity = np.array([scan.sensor_velocity for scan in scans]).reshape(-1, 2)[number]
    values: dict[str, Any] = {
        "scene": np.full(rows, run_scans.key.scene),
        "run": np.full(rows, run_scans.key.run),
        "fingerprint": pa.repeat(run_scans.fingerprint, rows),
        "scan": number,
        "sensor": pa.array([scan.sensor for scan in scans], pa.string()).take(number),
        "time_s": np.array([scan.time for scan in scans])[number],
        "arrival_time_s": np.array([scan.arrival_time for scan in scans])[number],
        **dict(zip(("sensor_x_m", "sensor_y_m", "sensor_yaw_rad"), pose.T, strict=True)),
        **dict(zip(("sensor_vx_mps", "sensor_vy_mps"), velocity.T, strict=True)),
    }
    place, valid = np.arange(rows) - starts[number], np.zeros(rows, dtype=np.int8)
    sensor_columns = {name: component_columns(sensor) for name, sensor in sensors.items()}
    measured = {column: np.full(rows, np.nan) for columns in sensor_columns.values() for column in columns}
    for scan, start in zip(scans, starts.tolist(), strict=True):
        rows_of_scan = slice(start, start + scan.valid.size)
        valid[rows_of_scan] = scan.valid
        for name, component in zip(sensor_columns[scan.sensor], scan.measurement, strict=True):
            measured[name][rows_of_scan] = component
    if hidden:
        values["detection_probability"] = np.array([scan.detection_probability for scan in scans])[number]
        values["clutter_density"] = np.array([scan.clutter_density for scan in scans])[number]
        values["detection"] = pa.array(place, mask=valid == 0)
    else:
        values["object"] = pa.array(run_scans.objects or (), pa.string()).take(place)
    values |= {**measured, "valid": valid}
    return pa.table({name: _nan_as_missing(values[name]) for name in scan_columns(sensors, hidden)})


def truth_table(scene: int, truth: Truth) -> pa.Table:
    """Return a scene's truth with the columns of ``TRUTH``: a row for each instant and object that is present."""
    runs = truth.px.shape[-1]
    parts = []
    for run in range(runs):
        step, body = np.nonzero(truth.alive)
        at = step, body, run
        parts.append(
            {
                "scene": np.full(len(step), scene),
                "run": pa.array(np.full(len(step), run), mask=np.full(len(step), runs == 1)),
                "time_s": truth.time[step],
                "object": pa.array(truth.ids, pa.string()).take(body),
                "target": truth.target[body].astype(np.int8),
                "x_m": truth.px[at],
                "y_m": truth.py[at],
                "heading_rad": truth.heading[at],
                "vx_mps": truth.vx[at],
                "vy_mps": truth.vy[at],
                "length_m": truth.length[body],
                "width_m": truth.width[body],
            }
        )
    return pa.concat_tables([pa.table(part) for part in parts])


def _nan_as_missing(values: Any) -> Any:
    return pa.array(values, from_pandas=True) if isinstance(values, np.ndarray) else values
