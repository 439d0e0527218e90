"""The text of a scenario with its changed keys, for another folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import trackbench as tb
from trackbench.scenario.load import written_with_changes
from trackbench.scenario.source import parse_yaml


@pytest.mark.parametrize("name", ["highway", "traffic/dense_highway"])
def test_a_shipped_scenario_is_what_it_would_be(name: str, tmp_path: Path) -> None:
    changes = {"monte_carlo.runs": 7, "recording.run": 3, "truth.seed": 12}
    loaded = tb.load(name, changes)
    file = tmp_path / "changed.yaml"
    file.write_text(written_with_changes(loaded, tmp_path))
    assert tb.load(file).config == loaded.config
    assert tb.load(file).config.monte_carlo.runs == 7


def test_the_path_of_a_recorded_truth_is_as_seen_from_the_new_folder(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new" / "deep"
    for folder in (old, new):
        folder.mkdir(parents=True)
    (old / "cars.csv").touch()
    text = "truth: {source: recording, path: cars.csv}\n"
    loaded = replace(tb.load("highway"), text=text, path=old / "scenario.yaml", document=parse_yaml(text, "text"))
    assert parse_yaml(written_with_changes(loaded, new), "text").value["truth"]["path"] == "../../old/cars.csv"
