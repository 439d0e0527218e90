"""Published numbers beside those of the bench: what agrees, what differs, and that each difference has its cause."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmarks.published.association import association
from benchmarks.published.projects import range_3km, udacity_ekf, ukf_copy, ukf_own
from benchmarks.published.rows import Row, Source, differing
from benchmarks.published.single import acceleration, air_traffic, car
from benchmarks.published.williams import AUTHORS, METHODS, folder, scenario, squared_gospa, williams
from tests.support.places import ROOT
from tests.support.udacity import data_folder

import trackbench as tb

with_data = pytest.mark.skipif(
    not (data_folder() / "published").is_dir(),
    reason="the published data are not there: set TRACKBENCH_DATA to the folder that holds published/",
)


def differences(source: Source) -> list[str]:
    """Return the quantities that do not agree, after a look at whether the page prints each number and each cause."""
    page = (ROOT / "results" / "published" / "README.md").read_text(encoding="utf-8")
    section = page.split(f"## {source.title}\n")[1].split("\n## ")[0]
    for row in source.rows:
        quantity, printed, *_, agrees = row.cells()
        [line] = [line for line in section.splitlines() if line.startswith(f"| {quantity} | {printed} |")]
        assert line.endswith(f"| {agrees} |")
        assert row.agrees or row.why
    assert all(line in page for line in differing([source]))
    return [row.quantity for row in source.rows if not row.agrees]


@pytest.mark.parametrize(
    ("row", "cells"),
    [
        (Row("a", (1.0,), (1.04,), 1), ("a", "1.0", "1.0", "", "0", "yes")),
        (Row("a", (1.0,), (1.06,), 1), ("a", "1.0", "1.1", "", "+0.1", "**no**")),
        (Row("a", (1.0, 2.0), (0.8, 2.0), 1), ("a", "1.0 2.0", "0.8 2.0", "", "-0.2", "**1 of 2**")),
        (Row("a", (1.0,), (1.2,), 1, (0.9, 1.5)), ("a", "1.0", "1.2", "0.9 to 1.5", "+0.2", "yes")),
        (Row("a", (1.0,), (1.2,), 1, (1.1, 1.5)), ("a", "1.0", "1.2", "1.1 to 1.5", "+0.2", "**no**")),
    ],
)
def test_a_row_agrees_in_its_interval_or_to_its_last_digit(row: Row, cells: tuple[str, ...]) -> None:
    assert row.cells() == cells


@with_data
def test_the_car_differs_by_another_noise_alone(tmp_path: Path) -> None:
    source = car(tmp_path)
    assert differences(source) == ["Kalman filter, `cv`", "RTS smoother, `cv`"]
    for row in source.rows[:3]:
        assert row.ours == pytest.approx(row.printed, abs=1e-12)


def test_the_error_under_acceleration_is_that_of_the_closed_form() -> None:
    assert differences(acceleration()) == []


def test_air_traffic_agrees_with_an_independent_program_and_with_the_expectation() -> None:
    source = air_traffic()
    assert differences(source) == []
    # A NumPy filter with the turns written out gives 141.5198.
    assert source.rows[1].printed[0] == pytest.approx(141.5198, abs=1e-4)


def test_the_best_assignment_is_worse_in_space_than_the_formula() -> None:
    """The interval of 20 draws is wider than that of the page, and the formula is above it all the same."""
    assert differences(association(runs=20)) == ["best assignment, %"]


@pytest.mark.slow
@with_data
@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (ukf_copy, ["std_a 0.1, std_yawdd 0.1"]),
        (ukf_own, ["lidar and radar", "radar"]),
        (udacity_ekf, ["EKF, from two lidar measurements"]),
        (range_3km, ["(a) x", "(b) y"]),
    ],
)
def test_the_projects_differ_where_the_page_says_so(source: Callable[[], Source], expected: list[str]) -> None:
    assert differences(source()) == expected


@pytest.mark.slow
@with_data
def test_the_filters_agree_with_the_authors_pmb(tmp_path: Path) -> None:
    source = williams(tmp_path)
    assert differences(source) == []
    low, high = source.rows[-2].interval or (np.nan, np.nan)
    assert low < 0 < high
    assert high - low < 0.01


@pytest.mark.slow
@with_data
def test_gospa_of_the_authors_estimates_is_theirs_in_every_run(tmp_path: Path) -> None:
    """Their program is in MATLAB; positions are rounded to 1 mm."""
    content = scenario(tmp_path)
    for method in METHODS:
        del content["trackers"][method]
    ours = squared_gospa(tb.run(tb.load(content), workers=1), AUTHORS)
    theirs = pd.read_csv(folder() / "reference.csv").groupby("run")["gospa_squared_m2"].mean()
    np.testing.assert_allclose(ours, theirs, atol=1e-3)
