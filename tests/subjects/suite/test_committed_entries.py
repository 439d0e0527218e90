"""The entries that are committed in results/suite: of the suite that is here, whole, and as their README says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from benchmarks.suite.__main__ import ONLY
from tests.support.places import ROOT

from trackbench.subjects.suite.entry import read_entry
from trackbench.subjects.suite.suite import find_suite
from trackbench.subjects.suite.tracker import find_tracker

FOLDER = ROOT / "results" / "suite"
FILES = {file.stem: str(file) for file in (ROOT / "benchmarks" / "suite").glob("*.yaml")}
SUITE = find_suite("trackbench-road-1")


def test_every_tracker_has_an_entry() -> None:
    built_in = {name for trackers in SUITE.stated.trackers.values() for name in trackers}
    assert {file.parent.name for file in FOLDER.glob("*/entry.json")} == built_in | {*FILES}
    assert {*json.loads((FOLDER / "times.json").read_text(encoding="utf-8"))} == built_in | {*FILES}


@pytest.mark.parametrize("place", sorted(FOLDER.glob("*/entry.json")), ids=lambda place: place.parent.name)
def test_an_entry_is_whole_and_of_the_suite_here(place: Path) -> None:
    stored = read_entry(place)
    entry, name = stored.entry, place.parent.name
    assert stored.is_whole
    assert entry.suite.model_dump() == SUITE.identity
    stated = find_tracker(FILES.get(name, name), SUITE)
    chosen = SUITE.chosen(ONLY[name].split(",") if name in ONLY else [])
    entering = {item.id for item in stated.scenarios(chosen)}
    assert {item.id for item in entry.scenarios} == entering
    assert {f"{item}/estimates.parquet" for item in entering} <= {*entry.files}
    assert entry.tracker.options == {kind: options for kind in ("single", "traffic") if (options := stated.entry(kind))}
    assert f"| **{name}** | {entry.tracker.version} | MIT | " in (FOLDER / "README.md").read_text(encoding="utf-8")
