"""The published tables of the Udacity projects come back, by the scenario files that are shipped."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tests.udacity import RECORDING, data_folder

from trackbench.results import Result

ROOT = Path(__file__).resolve().parents[1]
WITHIN = 0.01
#: The 95 % points of single innovations, by degrees of freedom.
LINE95 = {"lidar": 5.991, "radar": 7.815}

pytestmark = pytest.mark.skipif(
    not (data_folder() / RECORDING).is_file(),
    reason="no recording: set TRACKBENCH_DATA to the folder that holds udacity/",
)


@pytest.fixture(scope="module")
def project() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs" / "projects"))
        patch.setenv("TRACKBENCH_DATA", str(data_folder()))
        import udacity

        return udacity


@pytest.fixture(scope="module")
def results(project: ModuleType) -> dict[str, Result]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_DATA", str(data_folder()))
        return {name: project.result(name) for name in ("udacity_ukf_tuning", "udacity_fusion")}


def rmse(result: Result, tracker: str) -> np.ndarray:
    entry = next(item for item in result.json()["trackers"] if item["name"] == tracker)
    return np.array([entry["metrics"]["rmse"][name]["value"] for name in ("px", "py", "vx", "vy")])


def test_every_published_row_comes_back(project: ModuleType, results: dict[str, Result]) -> None:
    assert len(project.PUBLISHED) == 13
    for row in project.PUBLISHED:
        ours = rmse(results[row.scenario], row.tracker)
        np.testing.assert_allclose(ours, row.rmse, rtol=WITHIN, err_msg=f"{row.what} by {row.tracker}")


def test_every_estimate_is_scored(project: ModuleType, results: dict[str, Result]) -> None:
    for row in project.PUBLISHED:
        entry = next(item for item in results[row.scenario].json()["trackers"] if item["name"] == row.tracker)
        assert entry["metrics"]["coverage"]["value"] == 1.0
    assert results["udacity_fusion"].json()["truth"]["lines"] == 500


def test_the_courses_limits_hold(results: dict[str, Result]) -> None:
    for result in results.values():
        assert [item["text"] for item in result.json()["expectations"] if not item["passed"]] == []


def test_only_the_faulty_copy_needs_a_repair(results: dict[str, Result]) -> None:
    for tracker in results["udacity_ukf_tuning"].json()["trackers"]:
        assert tracker["failed"] is None
        assert tracker["health"]["repaired_covariances"] == (1 if tracker["name"] == "ukf_radar_faulty" else 0)


def test_share_of_innovations_under_the_line(results: dict[str, Result]) -> None:
    result = results["udacity_ukf_tuning"]
    entry = next(item for item in result.json()["trackers"] if item["name"] == "ukf")
    table = result.tables["recorded_nis"].to_pydict()
    for sensor, line in LINE95.items():
        own = [
            value
            for value, tracker, name in zip(table["nis"], table["tracker"], table["sensor"], strict=True)
            if (tracker, name) == ("ukf", sensor) and value is not None
        ]
        share = np.mean(np.array(own) < line)
        assert share == pytest.approx(entry["metrics"]["nis"][sensor]["inside95"], abs=1e-9)
        # A consistent filter has 95 %; of 249 innovations two standard deviations are 2.8 %.
        assert 0.92 < share < 0.99
