"""The text of a scenario with changed keys."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trackbench as tb
from trackbench.scenario.overrides import apply_overrides, changed_text, written_with_changes
from trackbench.scenario.source import parse_yaml

TEXT = """\
name: two  # of them
sensors:
  # The one in front.
  radar: {type: radar, rate_hz: 20, range_sigma_m: 0.3}  # metres
  lidar:
    type: lidar
    rate_hz: 10
trackers:
  imm: {motion: {imm: [{model: cv, acceleration_sigma_mps2: 1}, {model: ca}]}}
"""


def test_comments_stay_where_values_change_in_place() -> None:
    changes = [
        "sensors.radar.range_sigma_m=1.5",
        "sensors.lidar.rate_hz=5",
        "trackers.imm.motion.imm.0.acceleration_sigma_mps2=4",
        "recording.run=7",
        "sensors.lidar.latency_ms=20",
        "sensors.radar.latency_ms=30",
        "recording.scene=2",
    ]
    assert (
        changed_text(TEXT, changes)
        == """\
name: two  # of them
sensors:
  # The one in front.
  radar: {latency_ms: 30, type: radar, rate_hz: 20, range_sigma_m: 1.5}  # metres
  lidar:
    latency_ms: 20
    type: lidar
    rate_hz: 5
trackers:
  imm: {motion: {imm: [{model: cv, acceleration_sigma_mps2: 4}, {model: ca}]}}

recording: {scene: 2, run: 7}
"""
    )


@pytest.mark.parametrize("name", ["highway", "traffic/dense_highway"])
def test_a_shipped_scenario_keeps_its_comments_and_is_what_it_would_be(name: str, tmp_path: Path) -> None:
    loaded = tb.load(name, {"monte_carlo.runs": 7, "recording.run": 3, "truth.seed": 12})
    text = written_with_changes(loaded, tmp_path)
    comments = [line for line in loaded.text.splitlines() if line.strip().startswith("#")]
    assert comments
    assert all(line in text.splitlines() for line in comments)
    file = tmp_path / "changed.yaml"
    file.write_text(text)
    assert tb.load(file).config == loaded.config


KEYS = st.sampled_from(
    ["name", "sensors.radar.rate_hz", "sensors.lidar", "sensors.lidar.a.b", "trackers.imm.motion.imm.1", "new", "new.a"]
)
VALUES = st.one_of(
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(codec="latin-1", categories=["L", "N", "P"])),
    st.lists(st.booleans()),
)


@settings(max_examples=50)
@given(st.lists(st.tuples(KEYS, VALUES), max_size=4, unique_by=lambda pair: pair[0].partition(".")[0]))
def test_whatever_changes_it_reads_as_the_changes_say(pairs: list[tuple[str, object]]) -> None:
    changes = [f"{key}={json.dumps(value)}" for key, value in pairs]
    wanted = apply_overrides(parse_yaml(TEXT, "text"), changes).value
    assert parse_yaml(changed_text(TEXT, changes), "text").value == wanted


def test_the_path_of_a_recorded_truth_is_as_seen_from_the_new_folder(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new" / "deep"
    for folder in (old, new):
        folder.mkdir(parents=True)
    (old / "cars.csv").touch()
    text = "truth: {source: recording, path: cars.csv}  # of a day\n"
    loaded = replace(tb.load("highway"), text=text, path=old / "scenario.yaml", document=parse_yaml(text, "text"))
    assert written_with_changes(loaded, new) == text.replace("cars.csv", '"../../old/cars.csv"')
