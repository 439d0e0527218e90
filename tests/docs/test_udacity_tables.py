"""The published tables of the Udacity projects come back, by the scenario files that are shipped."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

#: The 95 % points of single innovations, by degrees of freedom.
from tests.support.places import DOCS
from tests.support.udacity import RECORDING, data_folder

from trackbench.results import Result

LINE95 = {"lidar": 5.991, "radar": 7.815}

pytestmark = pytest.mark.skipif(
    not (data_folder() / RECORDING).is_file(),
    reason="no recording: set TRACKBENCH_DATA to the folder that holds udacity/",
)


@pytest.fixture(scope="module")
def project() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS / "projects"))
        import udacity

        return udacity


@pytest.fixture(scope="module", params=["first table", pytest.param("every table", marks=pytest.mark.slow)])
def rows(request: pytest.FixtureRequest, project: ModuleType) -> tuple[Any, ...]:
    """Published rows of the UKF."""
    return project.UKF if request.param == "first table" else (*project.UKF, *project.TUNED)


@pytest.fixture(scope="module")
def results(project: ModuleType, rows: tuple[Any, ...]) -> dict[str, Result]:
    trackers = [name for row in rows for name in (row.copy, row.sound)]
    return {project.TUNING: project.result(project.TUNING, trackers), project.FUSION: project.result(project.FUSION)}


def test_every_digit_of_the_published_ukf_comes_back(
    project: ModuleType, rows: tuple[Any, ...], results: dict[str, Result]
) -> None:
    for row in rows:
        ours = project.rmse(results[project.TUNING], row.copy, project.UKF_SCORED)
        np.testing.assert_array_equal(np.round(ours, 4), row.published, err_msg=row.what)


def test_without_the_published_faults_only_the_radar_alone_differs(
    project: ModuleType, rows: tuple[Any, ...], results: dict[str, Result]
) -> None:
    for row in rows:
        ours = project.rmse(results[project.TUNING], row.sound, project.UKF_SCORED)
        assert (abs(project.largest(ours, row.published)) < 0.01) == (row.sound != "ukf_radar"), row.what


def test_the_published_ekf_comes_back(project: ModuleType, results: dict[str, Result]) -> None:
    first, fitted = project.EKF
    np.testing.assert_array_equal(np.round(project.rmse(results[project.FUSION], first.copy), 4), first.published)
    assert abs(project.largest(project.rmse(results[project.FUSION], fitted.copy), fitted.published)) < 0.01


def test_every_estimate_is_given_and_those_of_the_ukf_are_scored(
    project: ModuleType, rows: tuple[Any, ...], results: dict[str, Result]
) -> None:
    trackers = {project.TUNING: [row.copy for row in rows]}
    trackers[project.FUSION] = [row.copy for row in project.EKF]
    for name, expected in trackers.items():
        entries = {item["name"]: item["metrics"] for item in results[name].json()["trackers"]}
        for tracker in expected:
            assert entries[tracker]["coverage"]["value"] == 1.0
            own = project.rmse(results[name], tracker)
            assert np.isfinite(own).all()
            if name == project.TUNING:
                metrics = [entries[tracker][f"rmse.{key}"]["value"] for key in project.COMPONENTS]
                assert metrics == pytest.approx(own)
    assert results[project.FUSION].json()["truth"]["lines"] == 500


def test_the_courses_limits_hold(results: dict[str, Result]) -> None:
    for result in results.values():
        assert [item["text"] for item in result.json()["expectations"] if not item["passed"]] == []


def test_only_the_faulty_copy_needs_a_repair(results: dict[str, Result]) -> None:
    for tracker in results["udacity_ukf_tuning"].json()["trackers"]:
        assert tracker["failed"] is None
        assert tracker["health"]["repaired_covariances"] == (1 if tracker["name"] == "published_radar" else 0)


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
        assert share == pytest.approx(entry["metrics"][f"nis.{sensor}"]["inside95"], abs=1e-9)
        # A consistent filter has 95 %; of 249 innovations two standard deviations are 2.8 %.
        assert 0.92 < share < 0.99
