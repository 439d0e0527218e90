"""A scenario of a suite never changes under its id: file, truth and scans have the hashes that the suite states."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.runner.rounded_scans import rounded_fingerprints
from trackbench.scenario.truth import truths_of
from trackbench.subjects.suite.suite import FOLDER, find_suite

#: Never to be changed: what is other is another suite.
SUITES = {"trackbench-road-1": "8adb6322adffb26a41c3dc88b0d70a1e91d630d8d49a062285e6d39a69c081cb"}
ROAD = find_suite("trackbench-road-1")
QUICK = ("drawn-ideal", "cut_in-typical", "motorway-recorded", "traffic-recorded")


@pytest.mark.parametrize("name", SUITES)
def test_a_suite_is_as_it_was_released(name: str) -> None:
    assert find_suite(name).chosen([])[0].suite.sha256 == SUITES[name]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in ROAD.scenarios]
)
def test_the_truth_and_the_scans_are_those_of_the_suite(name: str) -> None:
    item = ROAD.scenarios[name]
    truths = truths_of(item.plain)
    assert item.why_other_truth(truths) is None
    assert item.why_other_scans(rounded_fingerprints(item.plain, truths)) is None


def test_a_changed_scenario_is_refused(cli: Callable[..., Any], tmp_path: Path) -> None:
    text = (FOLDER / "trackbench-road-1.yaml").read_text(encoding="utf-8")
    first = ROAD.stated.scenarios[0].sha256
    (tmp_path / "own.yaml").write_text(text.replace(first, first[::-1]), encoding="utf-8")
    done = cli("suite", "list", "own.yaml")
    assert done.status == 2
    assert "own.yaml: scenarios.0.sha256: " in done.err
    assert "a scenario never changes under its id" in done.err


def test_what_is_there_is_listed(cli: Callable[..., Any]) -> None:
    assert cli("suite", "list").out.startswith("trackbench-road-1  ")
    shown = cli("suite", "list", "trackbench-road-1").out
    assert ROAD.sha256 in shown
    assert all(name in shown for name in (*ROAD.scenarios, "ekf_cv", "pmb"))
