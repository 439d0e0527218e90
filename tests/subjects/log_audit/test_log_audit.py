"""The audit of a log: known errors come back within their intervals, and nothing is made up."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.support.recorded_log import OBJECTS, STRAIGHT, Errors, write_log
from tests.support.udacity import data_folder

from trackbench.api.run import run
from trackbench.base.errors import InputError
from trackbench.metrics.blocks import Blocks
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.subjects.log_audit.api import ReportableAudit, audit
from trackbench.subjects.log_audit.audit import yaml_to_paste
from trackbench.truth.recorded.robust import clipped_sigma

#: What is wrong with a radar, and its names in an audit.
RADAR = Errors(
    time_offset_s=-0.06,
    mount={"x_m": 0.4, "y_m": -0.3, "yaw_deg": 1.2},
    truly={"range_sigma_m": 0.45, "detection_probability": 0.7},
    biases={"range": 0.5, "range_rate": 0.15},
)
WRONG = {
    "time_offset": -0.06,
    "mount_x": 0.4,
    "mount_y": -0.3,
    "mount_yaw": math.radians(1.2),
    "bias_range": 0.5,
    "bias_range_rate": 0.15,
}
SEEDS = range(4)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> list[ReportableAudit]:
    """Audits of logs of a radar with known errors."""
    return [audit(write_log(tmp_path_factory.mktemp("log"), seed=seed, radar=RADAR)) for seed in SEEDS]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], ReportableAudit]:
    """By seed, the audit of a log of a radar and a lidar that are as stated."""
    return functools.cache(lambda seed: audit(write_log(tmp_path_factory.mktemp("log"), seed=seed, lidar=Errors())))


def inside(bounds: tuple[float, float], value: float) -> bool:
    return bounds[0] <= value <= bounds[1]


def test_known_errors_are_within_their_intervals(faulty: list[ReportableAudit]) -> None:
    hits = []
    for item in faulty:
        radar = item.sensors["radar"]
        assert radar.fit is not None
        hits += [inside(radar.fit.estimates[name].interval.bounds(), value) for name, value in WRONG.items()]
        hits += [inside(one.sigma.bounds(), true) for one, true in zip(radar.noise, SIGMAS, strict=True)]
        hits.append(inside(radar.detections.share.bounds(), 0.7))
    # Of 40 intervals that cover with 95 %, 33 or fewer do with a probability of 0.04 %.
    assert sum(hits) > 33
    assert len(hits) == 40


SIGMAS = (0.45, math.radians(0.5), 0.1)


def test_every_error_is_found_and_nothing_else(faulty: list[ReportableAudit]) -> None:
    for item in faulty:
        assert {finding.kind for finding in item.findings} == {*WRONG, "sigma"}
        assert [finding.component for finding in item.findings if finding.kind == "sigma"] == ["range"]


def test_a_log_without_errors_gives_no_finding(clean: Callable[[int], ReportableAudit]) -> None:
    audits = [clean(seed) for seed in SEEDS]
    assert [item.findings for item in audits] == [()] * len(audits)
    for item in audits:
        for sensor in item.sensors.values():
            assert sensor.square_before == pytest.approx(1, abs=0.06)
            assert not sensor.fit.unidentified


def test_the_effect_of_what_is_put_in(faulty: list[ReportableAudit], tmp_path: Path) -> None:
    item = faulty[0]
    item.save(tmp_path / "out")
    fixed = load_scenario(tmp_path / "out" / "scenario.yaml")
    block = yaml.safe_load(yaml_to_paste(item.scenario, item.findings))
    whole = yaml.safe_load((tmp_path / "out" / "scenario.yaml").read_text(encoding="utf-8"))
    assert block["sensors"] == {name: whole["sensors"][name] for name in block["sensors"]}
    check(fixed)
    before, after = (run(loaded).summary.trackers[0].metrics for loaded in (item.scenario, fixed))
    # Of a radar, 3 is right; of the state, 4.
    assert before["nis.radar"].mean > 5
    assert after["nis.radar"].mean == pytest.approx(3, abs=0.3)
    assert before["nees"].mean > 5 * after["nees"].mean
    assert after["position_rmse"].value < 0.7 * before["position_rmse"].value
    # And an audit of it finds nothing more.
    assert audit(fixed).findings == ()


def test_degrees_for_radians(tmp_path: Path) -> None:
    item = audit(write_log(tmp_path, radar=Errors(degrees=True)))
    assert [finding.kind for finding in item.findings] == ["unit"]
    assert item.changes == {"truth.readings.radar.azimuth": "azimuth:deg"}
    assert item.sensors["radar"].square_after == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize(
    ("column", "change", "kind", "changes"),
    [
        ("range", lambda value: value / 1000, "unit", {"truth.readings.radar.range": "range:km"}),
        ("range_rate", lambda value: value * 3.6, "unit", {"truth.readings.radar.range_rate": "range_rate:kmph"}),
        ("azimuth", lambda value: -value, "sign", {}),
    ],
)
def test_other_units_and_signs(tmp_path: Path, column: str, change: Any, kind: str, changes: dict[str, str]) -> None:
    file = write_log(tmp_path)
    edit(tmp_path / "radar.csv", column, lambda _, value: change(float(value)))
    item = audit(file)
    assert [finding.kind for finding in item.findings] == [kind]
    assert item.changes == changes


def edit(file: Path, column: str, change: Any) -> None:
    """Change the cells of a column: ``change(row, text)``."""
    head, *rows = [line.split(",") for line in file.read_text().splitlines()]
    i = head.index(column)
    changed = [[*row[:i], str(change(row, row[i])), *row[i + 1 :]] for row in rows]
    file.write_text("\n".join(",".join(row) for row in [head, *changed]))


def test_what_cannot_be_told_apart_is_not_given_a_number(tmp_path: Path) -> None:
    late = Errors(time_offset_s=-0.05)
    item = audit(write_log(tmp_path, objects=STRAIGHT, moving=False, radar=late, lidar=late))
    for name, sensor in item.sensors.items():
        assert "mount_y" in sensor.fit.unidentified
        offset = sensor.fit.estimates["time_offset"]
        assert "time_offset" in sensor.fit.unidentified["mount_y"]
        assert inside(offset.interval.bounds(0.999), -0.05)
        finding = next(one for one in item.findings if one.sensor == name)
        assert finding.kind == "undecided"
        assert {"time_offset", "body_point"} <= {*finding.candidates}
        assert finding.candidates["time_offset"] == pytest.approx(-0.05, abs=0.005)
    assert item.changes == {}
    assert "What this log cannot tell" in str(item)


def driven(*pieces: dict[str, Any]) -> dict[str, Any]:
    """A car that drives off along the axis of the sensor."""
    return {"car": {"start": {"x": 20, "y": 4, "speed_mps": 8.9, "course_deg": 20}, "pieces": [*pieces]}}


MOTIONS = {
    "steady": driven({"for_s": 12}),
    "speed varies": driven(
        {"for_s": 4, "acceleration_mps2": -2.0},
        {"for_s": 2},
        {"for_s": 4, "acceleration_mps2": 2.5},
        {"for_s": 2},
    ),
    "circle": driven({"for_s": 12, "turn_rate_degps": 30}),
    "both vary": driven(
        {"for_s": 4, "acceleration_mps2": -1.5, "turn_rate_degps": 20},
        {"for_s": 4, "acceleration_mps2": 2, "turn_rate_degps": -25},
        {"for_s": 4},
    ),
}
#: What a lidar's log is written with, for 1.1 m along the path at first, and the finding of each with its value.
CAUSES: dict[str, tuple[dict[str, Any], float]] = {
    "time_offset": ({"lidar": Errors(time_offset_s=0.124)}, 0.124),
    "mount_x": ({"lidar": Errors(mount={"x_m": -1.1})}, -1.1),
    "body_point": ({"lidar": Errors(), "truth_ahead_m": 1.1}, -1.1),
}
#: By motion and cause, the errors between which the log does not decide; none: the cause is found.
UNDECIDED = {
    ("steady", "time_offset"): {"time_offset", "mount_x", "body_point"},
    ("steady", "mount_x"): {"time_offset", "mount_x", "body_point"},
    ("steady", "body_point"): {"time_offset", "mount_x", "body_point"},
    ("speed varies", "mount_x"): {"mount_x", "body_point"},
    ("speed varies", "body_point"): {"mount_x", "body_point"},
    ("circle", "time_offset"): {"time_offset", "body_point"},
    ("circle", "body_point"): {"time_offset", "body_point"},
}


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_cause_is_found_only_where_no_other_explains_the_log(tmp_path: Path, motion: str, cause: str) -> None:
    written, value = CAUSES[cause]
    log = write_log(tmp_path, seed=3, duration_s=12, objects=MOTIONS[motion], moving=False, radar=None, **written)
    item = audit(log)
    (finding,) = [each for each in item.findings if each.kind in (*CAUSES, "undecided")]
    among = UNDECIDED.get((motion, cause))
    if among is None:
        assert finding.kind == cause
        assert finding.value == pytest.approx(value, rel=0.1)
    else:
        assert finding.kind == "undecided"
        assert {*finding.candidates} == among
        assert finding.candidates[cause] == pytest.approx(value, rel=0.1)
        assert "Nothing is put in" in finding.fix
    assert bool(item.changes) == (among is None and cause != "body_point")
    # At rest or on a circle 1.1 m is up to eleven sigma, and a scenario in which it stays is of no use.
    written_files = item.save(tmp_path / "out")
    assert "scenario.yaml" in written_files or "undecided" in {each.kind for each in item.findings}
    if "scenario.yaml" in written_files:
        lidar = load_scenario(tmp_path / "out" / "scenario.yaml").config.truth.measurements["lidar"]
        assert lidar.time_offset_s == (pytest.approx(0.124, rel=0.1) if among is None and cause == "time_offset" else 0)


def test_a_bias_of_azimuth_is_a_turned_mount_in_any_log(tmp_path: Path) -> None:
    item = audit(write_log(tmp_path, radar=Errors(biases={"azimuth": math.radians(1.5)})))
    (finding,) = item.findings
    assert finding.kind == "mount_yaw"
    assert inside(finding.ci95, -math.radians(1.5))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_truth_in_other_units_than_stated(tmp_path: Path, form: str) -> None:
    file = write_log(tmp_path, form=form)
    scenario = yaml.safe_load(file.read_text())
    scenario["truth"]["columns"] |= {"vx": "vx:kmph", "vy": "vy:kmph"}
    file.write_text(yaml.safe_dump(scenario))
    item = audit(file)
    assert [finding.kind for finding in item.findings] == ["truth_velocity"]
    assert item.changes == {"truth.columns.vx": "vx:mps", "truth.columns.vy": "vy:mps"}
    assert item.sensors["radar"].square_after == pytest.approx(1, abs=0.06)


def with_turning_observer(file: Path, yaw_factor: float, rate_factor: float) -> Path:
    """Write the yaw and the yaw rate of a log's observer in other units."""
    ego = file.parent / "ego.csv"
    head, *rows = [line.split(",") for line in ego.read_text().splitlines()]
    rows = [[*row[:3], str(float(row[3]) * yaw_factor), str(math.radians(4) * rate_factor)] for row in rows]
    ego.write_text("\n".join(",".join(row) for row in [[*head, "rate"], *rows]))
    scenario = yaml.safe_load(file.read_text())
    scenario["truth"]["ego"]["yaw_rate"] = "rate"
    file.write_text(yaml.safe_dump(scenario))
    return file


@pytest.mark.parametrize(
    ("yaw_factor", "rate_factor", "changed"),
    [
        (1, 1, []),
        (math.degrees(1), 1, ["yaw"]),
        (1, math.degrees(1), ["yaw_rate"]),
        (*[math.degrees(1)] * 2, ["yaw", "yaw_rate"]),
    ],
)
def test_degrees_of_the_observer(tmp_path: Path, yaw_factor: float, rate_factor: float, changed: list[str]) -> None:
    item = audit(with_turning_observer(write_log(tmp_path, lidar=Errors()), yaw_factor, rate_factor))
    assert [finding.kind for finding in item.findings] == ["unit"] * len(changed)
    names = {"yaw": "yaw", "yaw_rate": "rate"}
    assert item.changes == {f"truth.ego.{key}": f"{names[key]}:deg" for key in changed}
    assert item.unexplained == []
    assert item.sensors["radar"].square_after == pytest.approx(1, abs=0.06)


def test_a_scenario_that_the_findings_do_not_explain_is_not_written(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    edit(tmp_path / "ego.csv", "yaw", lambda _, yaw: -float(yaw))
    item = audit(file)
    assert {finding.kind for finding in item.findings} >= {"sigma"}
    (reason,) = item.unexplained
    assert reason.startswith("Even with the findings put in, the errors of radar are typically ")
    assert "scenario.yaml" not in item.save(tmp_path / "out")
    assert not (tmp_path / "out" / "scenario.yaml").exists()
    assert "No scenario.yaml is written" in " ".join(str(item).split())


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        (lambda row, t: float(t) + 0.1 * (float(t) > 15), ["clock_drift"]),
        (lambda row, t: float(t) + 100 * (float(t) > 20), ["outside"]),
        (lambda row, t: round(float(t) * 1.0005, 6), ["clock_drift"]),
    ],
    ids=["set", "goes on later", "drifts"],
)
def test_clocks(tmp_path: Path, change: Any, kinds: list[str]) -> None:
    file = write_log(tmp_path)
    edit(tmp_path / "radar.csv", "t", change)
    found = [finding.kind for finding in audit(file).findings]
    assert [kind for kind in found if kind != "time_offset"] == kinds


def test_milliseconds_for_seconds_are_refused(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    edit(tmp_path / "radar.csv", "t", lambda row, t: float(t) * 1000)
    with pytest.raises(InputError, match=r"only 3 of \d+ measurements of radar .* lie within the time of the truth"):
        audit(file)


def test_rows_in_any_order(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    plain = audit(file)
    head, *rows = (tmp_path / "radar.csv").read_text().splitlines()
    mixed = [rows[i] for i in np.random.default_rng(1).permutation(len(rows))]
    (tmp_path / "radar.csv").write_text("\n".join([head, *mixed, *rows[:50]]))
    item = audit(file)
    assert [finding.kind for finding in item.findings] == ["clock", "duplicates"]
    assert item.sensors["radar"].fit.errors == pytest.approx(plain.sensors["radar"].fit.errors)


def test_a_silent_sensor_and_outliers(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    head, *rows = (tmp_path / "radar.csv").read_text().splitlines()
    kept = [row for row in rows if not 10 < float(row.split(",")[0]) < 14]
    (tmp_path / "radar.csv").write_text("\n".join([head, *kept]))
    item = audit(file)
    assert [finding.kind for finding in item.findings] == ["silence"]
    assert item.sensors["radar"].detections.silent_for_s == pytest.approx(3.9, abs=0.1)
    random = np.random.default_rng(2)
    edit(tmp_path / "radar.csv", "range", lambda _, r: random.uniform(0, 80) if random.random() < 0.1 else r)
    assert "outliers" in {finding.kind for finding in audit(file).findings}


def test_noise_that_grows_with_the_range(tmp_path: Path) -> None:
    file, random = write_log(tmp_path, radar=Errors(truly={"range_sigma_m": 1e-6})), np.random.default_rng(3)
    edit(tmp_path / "radar.csv", "range", lambda _, r: float(r) * (1 + 0.01 * random.normal()))
    item = audit(file)
    bands = item.sensors["radar"].noise[0].bands
    for band in bands:
        assert band.from_m * 0.01 * 0.8 < band.interval.value < band.to_m * 0.01 * 1.2


def test_detections_by_range(tmp_path: Path) -> None:
    file, random = write_log(tmp_path), np.random.default_rng(4)
    head, *rows = (tmp_path / "radar.csv").read_text().splitlines()
    # 90 % near, 30 % beyond 40 m.
    kept = [row for row in rows if random.random() < (0.9 if float(row.split(",")[2]) < 40 else 0.3)]
    (tmp_path / "radar.csv").write_text("\n".join([head, *kept]))
    bands = audit(file).sensors["radar"].detections.bands
    near, far = bands[0], bands[-1]
    assert near.to_m < 40 < far.from_m
    assert inside(near.interval.bounds(0.999), 0.9)
    assert inside(far.interval.bounds(0.999), 0.3)


def test_the_interval_of_a_mean_is_that_of_the_textbook() -> None:
    random = np.random.default_rng(0)
    values = random.normal(size=4000)
    blocks = Blocks((np.repeat(np.arange(40), 100),))
    found = blocks.intervals(np.stack([values, np.ones(4000)]), lambda sums: sums[:1] / sums[1:])[0]
    assert found.value == pytest.approx(values.mean())
    means = values.reshape(40, 100).mean(axis=1)
    assert found.sigma == pytest.approx(means.std(ddof=1) / np.sqrt(40), rel=0.1)


@pytest.mark.slow
def test_correlated_errors_have_wide_intervals(tmp_path: Path) -> None:
    file, random = write_log(tmp_path), np.random.default_rng(6)
    # An error of the range that stays for two seconds.
    slow = np.repeat(random.normal(0, 0.5, 16), 40)
    edit(tmp_path / "radar.csv", "range", lambda row, r: float(r) + slow[min(round(float(row[0]) * 20), 639)])
    wide = audit(file).sensors["radar"].fit.estimates["bias_range"]
    plain = audit(write_log(tmp_path)).sensors["radar"].fit.estimates["bias_range"]
    assert wide.interval.sigma > 3 * plain.interval.sigma


def test_sigma_without_outliers() -> None:
    random = np.random.default_rng(1)
    values = np.concatenate([random.normal(0, 2, 20000), random.uniform(-100, 100, 400)])
    assert clipped_sigma(values) == pytest.approx(2, rel=0.03)


def test_the_recording_of_a_cyclist() -> None:
    if not (data_folder() / "udacity").is_dir():
        pytest.skip("no recording: set TRACKBENCH_DATA to the folder that holds udacity")
    item = audit("recorded/udacity_fusion")
    assert item.findings == ()
    for name, sigmas in {"lidar": (0.15, 0.15), "radar": (0.3, 0.03, 0.3)}.items():
        sensor = item.sensors[name]
        assert [inside(one.sigma.bounds(), true) for one, true in zip(sensor.noise, sigmas, strict=True)] == [
            True
        ] * len(sigmas)
        offset = sensor.fit.estimates["time_offset"].interval
        assert inside(offset.bounds(), 0.0)
        assert offset.sigma < 0.01


def test_few_measurements_are_said_to_be_few(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    head, *rows = (tmp_path / "radar.csv").read_text().splitlines()
    for count in (1, 2, 19):
        (tmp_path / "radar.csv").write_text("\n".join([head, *rows[100 : 100 + count]]))
        item = audit(file)
        assert item.sensors["radar"].fit is None
        assert "too few" in str(item)
        assert item.json()["sensors"]["radar"]["reason"]


@pytest.mark.slow
def test_a_fast_observer_and_slow_truth(tmp_path: Path) -> None:
    file = write_log(tmp_path, truth_hz=10)
    head, *rows = [line.split(",") for line in (tmp_path / "ego.csv").read_text().splitlines()]
    times = np.arange(0, 30, 0.001)
    columns = [np.interp(times, *np.array([[float(row[0]), float(row[i])] for row in rows]).T) for i in (1, 2, 3)]
    lines = [",".join(map(repr, map(float, row))) for row in zip(times, *columns, strict=True)]
    (tmp_path / "ego.csv").write_text("\n".join([",".join(head), *lines]))
    assert audit(file).findings == ()


@pytest.mark.parametrize(
    ("name", "column", "change"),
    [
        ("radar", "range", lambda row, v: 20),
        ("radar", "range_rate", lambda row, v: 1e-300),
        ("radar", "range", lambda row, v: 1e29),
        ("radar", "azimuth", lambda row, v: 3 * math.sin(1e4 * float(row[0]))),
        ("radar", "t", lambda row, v: 5.0),
        ("truth", "x", lambda row, v: 1e29),
        ("truth", "vx", lambda row, v: 0),
        ("truth", "who", lambda row, v: v),
        ("ego", "yaw", lambda row, v: 1e9 * math.sin(float(row[0]))),
    ],
)
@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_nonsense_ends_in_a_report_or_one_message(tmp_path: Path, name: str, column: str, change: Any) -> None:
    file = write_log(tmp_path, objects={"car": OBJECTS["car"]})
    edit(tmp_path / f"{name}.csv", column, change)
    refused = ""
    try:
        item = audit(file, out=tmp_path / "out")
    except InputError as error:
        refused = str(error)
    if refused:
        # What cannot be meant is refused where it stands.
        assert f"{name}.csv" in refused
        assert "can be meant: check its unit" in refused
        return
    assert str(item)
    if not item.unexplained:
        check(load_scenario(tmp_path / "out" / "scenario.yaml"))


def test_a_clock_that_was_set_during_the_log_is_no_clean_log(tmp_path: Path) -> None:
    file = write_log(tmp_path)
    edit(tmp_path / "radar.csv", "t", lambda _, value: float(value) + 0.12 * (float(value) > 20))
    item = audit(file)
    assert [finding.kind for finding in item.findings] == ["remaining"]
    assert item.sensors["radar"].square_after > 1.5
