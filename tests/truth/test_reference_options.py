"""What of the reference of a log counts, and what is refused of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.support.recorded_log import write_table

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.types import ABSENT, DUE, OPTIONAL, Array, RecordedMeasurements, Truth
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.runner.work import Scene, work_of
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.detections import sense_hidden

HEAD = ["t", "who", "type", "conf", "x", "y", "vx", "vy", "yaw", "l", "w"]
COLUMNS = {
    "time": "t",
    "object": "who",
    "class": "type",
    **{key: key.removeprefix("p") for key in ("px", "py", "vx", "vy")},
    "heading": "yaw",
    "length": "l",
    "width": "w",
}
RADAR = {"type": "radar", "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1}
GNN = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 1, "associate": {"method": "gnn"}}
#: Place, class and confidence of four objects at rest.
OBJECTS = {"near": (20, 0, "car", 1), "far": (80, 0, "car", 1), "left": (20, 30, "car", 1), "bike": (40, 0, "bike", 1)}


def box(t: float, who: str, x: float, y: float, kind: str = "car", conf: Any = 1) -> list[Any]:
    return [t, who, kind, conf, x, y, 0, 0, 0, 4, 2]


def boxes(times: Array) -> list[list[Any]]:
    return [box(float(t), who, x, y, kind, conf) for t in times for who, (x, y, kind, conf) in OBJECTS.items()]


TIMES = np.arange(101) / 10


def write(
    folder: Path,
    rows: list[list[Any]] | None = None,
    radar: list[list[Any]] | None = None,
    reference: dict[str, Any] | None = None,
    columns: dict[str, Any] | None = None,
    **sections: Any,
) -> Path:
    """A log at 10 Hz with a detection of the object ``near`` at each time, and its scenario; keys of None are not."""
    write_table(folder / "boxes.csv", HEAD, boxes(TIMES) if rows is None else rows)
    write_table(folder / "radar.csv", ["t", "who", "r", "az", "rr"], detections() if radar is None else radar)
    readings = {"path": "radar.csv", "range": "r", "azimuth": "az", "range_rate": "rr", **sections.pop("readings", {})}
    content = {
        "name": "log",
        "truth": {
            "source": "recording",
            "format": "csv",
            "path": "boxes.csv",
            "columns": _given({**COLUMNS, **(columns or {})}),
            "readings": {"radar": readings},
            "reference": reference or {},
            **sections.pop("truth", {}),
        },
        "sensing": {"identities": "hidden"},
        "sensors": {"radar": {**RADAR, "fov_deg": 180, "max_range_m": 100}},
        "trackers": {"gnn": GNN},
        "monte_carlo": {"runs": 1},
        **sections,
    }
    file = folder / "log.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def _given(keys: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in keys.items() if value is not None}


def detections(who: str = "near") -> list[list[Any]]:
    return [[float(t), who, 20, 0, 0] for t in TIMES]


def scene(file: Path) -> Scene:
    loaded = load_scenario(file)
    return work_of(loaded, truths_of(loaded)).scenes[0]


def truth_in(file: Path) -> Truth:
    return truths_of(load_scenario(file))[0].truth


def statuses(file: Path) -> dict[str, int]:
    """Of each object at the last instant."""
    read = scene(file)
    return dict(zip(read.truth.ids, read.due.status[-1, :, 0].tolist(), strict=True))


@pytest.mark.parametrize(
    ("reference", "optional"),
    [
        ({}, set()),
        ({"range_m": 50}, {"far"}),
        ({"classes": ["car"]}, {"bike"}),
        ({"classes": ["tram"]}, {*OBJECTS}),
        ({"classes": ["car"], "range_m": 25}, {"bike", "far", "left"}),
    ],
)
def test_what_does_not_count_is_optional(tmp_path: Path, reference: dict[str, Any], optional: set[str]) -> None:
    expected = {name: OPTIONAL if name in optional else DUE for name in OBJECTS}
    assert statuses(write(tmp_path, reference=reference)) == expected


def test_an_object_is_absent_in_a_gap(tmp_path: Path) -> None:
    rows = [row for row in boxes(TIMES) if row[1] != "far" or not (2 < row[0] < 2.3 or 4 < row[0] < 6)]
    read = scene(write(tmp_path, rows))
    status = read.due.status[:, read.truth.ids.index("far"), 0]
    np.testing.assert_array_equal(status == ABSENT, (TIMES > 4) & (TIMES < 6))


def test_without_columns_of_the_velocity_it_is_that_of_the_displacement(tmp_path: Path) -> None:
    rows = [[t, "a", "car", 1, 20 + 3 * t, 2 * t, "", "", 0.3, 4, 2] for t in TIMES.tolist()]
    file = write(tmp_path, rows, detections("a"), columns={"vx": None, "vy": None})
    truth = truth_in(file)
    np.testing.assert_allclose(truth.vx, 3)
    np.testing.assert_allclose(truth.vy, 2)
    file.write_text(file.read_text().replace("identities: hidden", "identities: known"))
    with pytest.raises(InputError, match=r"truth.columns: the velocity is missing: write vx and vy"):
        truth_in(file)


def test_the_noise_of_the_reference_is_found_and_carried(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    rows = [
        [t, "a", "car", 1, 20 + t + 0.2 * random.normal(), 0.2 * random.normal(), 1, 0, 0, 4, 2]
        for t in np.arange(0, 60, 0.1).round(1).tolist()
    ]
    truth = truth_in(write(tmp_path, rows, detections("a")))
    assert truth.recorded_noise.position_m == pytest.approx(0.2, rel=0.1)
    assert truth.recorded_noise.velocity_mps == pytest.approx(0, abs=1e-9)
    assert truth.source["recorded_noise"] == truth.recorded_noise._asdict()
    # A velocity that is made of the positions has their noise.
    truth = truth_in(write(tmp_path, rows, detections("a"), columns={"vx": None, "vy": None}))
    assert truth.recorded_noise.velocity_mps == pytest.approx(0.2 / (np.sqrt(2) * 0.1), rel=0.1)


def test_a_blank_object_is_a_false_alarm_where_identities_are_hidden(tmp_path: Path) -> None:
    clutter = [[float(t), "", 50, 0.5, 3] for t in TIMES]
    read = scene(write(tmp_path, radar=detections() + clutter, readings={"object": "who"}))
    hidden = sense_hidden(read.sensors, 1, "log", range(1))
    near = read.truth.ids.index("near")
    for scan, origin in zip(hidden.scans, hidden.origins, strict=True):
        of_scan = {int(number): scan.measurement[0, i, 0] for i, number in enumerate(origin[:, 0])}
        assert of_scan == {near: 20, -1: 50}


def test_a_blank_object_is_left_out_where_identities_are_known(tmp_path: Path) -> None:
    radar = [*detections(), [5.0, "", 50, 0.5, 3]]
    file = write(tmp_path, radar=radar, sensing={"identities": "known"}, trackers={"raw": {"use": "raw"}}, reference={})
    (read,) = truths_of(load_scenario(file))
    assert read.notes[1:] == ("radar: left out 1 rows of no object",)
    assert read.measurements is not None
    measurements = read.measurements["radar"]
    assert isinstance(measurements, RecordedMeasurements)
    assert measurements.valid.sum() == 101


#: The sensor misses the near object for a while, at the border of two stretches.
GAP = [row for row in detections() if not 4 < row[0] < 6]


def test_a_log_in_stretches_is_driven_and_scored_as_one(tmp_path: Path) -> None:
    whole = tb.run(write(tmp_path, radar=GAP))
    tracks = whole.to_pandas("tracks")
    tracks.drop(columns="tracker").to_csv(tmp_path / "tracks.csv", index=False)
    trackers = {"gnn": GNN, "theirs": {"use": "tracks", "path": "tracks.csv"}}
    cut = tb.run(write(tmp_path, radar=GAP, truth={"stretches": 2}, trackers=trackers))
    values = {path: value.value for path, value in whole["gnn"].metrics.items() if path in TRACK_METRICS}
    assert values["gospa_missed"] > 0
    for tracker in ("gnn", "theirs"):
        found = {path: cut[tracker].metrics[path].value for path in values}
        # Only a tracker says which detection it took.
        found |= {path: values[path] for path, value in found.items() if value is None and path.startswith("associ")}
        assert found == pytest.approx(values, abs=1e-5), tracker
    assert [scene.name for scene in cut.summary.truth.scenes] == ["stretch 1", "stretch 2"]
    assert len({*cut.summary.fingerprints}) == cut.summary.runs == 2
    runs = cut.to_pandas("runs").query("tracker == 'gnn'")
    assert runs.gospa_total.sum() / runs.gospa_count.sum() == pytest.approx(values["gospa"] ** 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reference": {"range_m": -1}}, "truth.reference.range_m: "),
        (
            {"reference": {"classes": ["car"]}, "columns": {"class": None}},
            "truth.columns.class: missing",
        ),
        ({"readings": {"slot": "who", "object": "who"}}, "truth.readings.radar.slot: only used with unlabelled"),
        (
            {"trackers": {"best": {**GNN, "associate": {"method": "oracle"}}}},
            "trackers.best.associate.method: oracle needs the object of each detection, which is not",
        ),
        ({"truth": {"stretches": 40}}, "one of 40 stretches is shorter than 4 s, or has no scan: take at most 2"),
        ({"truth": {"stretches": 1}}, "truth.stretches: "),
        (
            {
                "truth": {"stretches": 2},
                "sensors": {"radar": RADAR, "lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2}},
                "monte_carlo": {"runs": 2},
            },
            "truth.stretches: only used with monte_carlo: {runs: 1}",
        ),
        ({"sensing": {"identities": "known"}, "reference": {"range_m": 5}}, "truth.reference.range_m: only used with"),
        ({"sensing": {"identities": "known"}, "truth": {"stretches": 2}}, "truth.stretches: only used with"),
        (
            {"sensors": {"radar": {**RADAR, "detection_probability": 0.9}}},
            "sensors.radar.detection_probability: the measurements of radar are recorded",
        ),
    ],
)
def test_what_does_not_fit_is_named_in_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    trackers = {"raw": {"use": "raw"}} if changes.get("sensing") else {"gnn": GNN}
    with pytest.raises(InputError) as caught:
        truths_of(load_scenario(write(tmp_path, **{"trackers": trackers, **changes})))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ([1.0, "near", "car", 1, 20, 0, 0, 0, 0, 0, 2], "boxes.csv:2: l is '0': it would be 0 m, and 0.001 to 100 m"),
        ([1.0, "near", "car", 1, 20, 0, 0, 0, 0, 4, -2], "boxes.csv:2: w is '-2': it would be -2 m"),
        ([1.0, "near", "car", 1, 20, 0, 0, 0, 0, "", 2], "boxes.csv:2: l is not a finite number: ''"),
        ([1.0, "", "car", 1, 20, 0, 0, 0, 0, 4, 2], "boxes.csv:2: who is empty"),
    ],
)
def test_a_damaged_box_is_named(tmp_path: Path, row: list[Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        truth_in(write(tmp_path, [row, *boxes(TIMES)]))
    assert message in str(caught.value)


def test_a_log_most_of_which_is_outside_the_truth_is_refused(tmp_path: Path) -> None:
    slow = [[row[0] * 3, *row[1:]] for row in detections()]
    with pytest.raises(
        InputError, match=r"only \d+ of \d+ measurements of radar \(from 0 to 30 s\) lie within the time"
    ):
        truth_in(write(tmp_path, radar=slow))
