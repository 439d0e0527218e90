"""The published EKF at 3 km: its scenarios, and the script that makes the tables of its page."""

from types import ModuleType

import numpy as np
import pytest
import yaml
from tests.support.places import DOCS, SCENARIOS

CASES = "abcd"


@pytest.fixture
def project(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(DOCS / "projects"))
    import range_3km

    return range_3km


def test_the_cases_differ_in_their_truth_alone():
    read = [yaml.safe_load((SCENARIOS / "published" / f"range_3km_{case}.yaml").read_text()) for case in CASES]
    for key in ("sensors", "trackers", "monte_carlo", "score"):
        assert all(scenario[key] == read[0][key] for scenario in read)
    assert len({scenario["name"] for scenario in read}) == len(CASES)


@pytest.mark.parametrize("case", CASES)
def test_expectations_hold(project, case):
    found = project.result(case)
    assert [item["text"] for item in found.json()["expectations"] if not item["passed"]] == []
    assert not any(tracker["failed"] for tracker in found.json()["trackers"])


@pytest.mark.parametrize(("case", "velocity", "steps"), [("a", (22, 0), 100), ("b", (0, 22), 100), ("c", (12, 8), 50)])
def test_raw_error_is_that_of_the_closed_form(project, case, velocity, steps):
    found = project.result(
        case, "monte_carlo.runs=400", "expect=[]", "trackers={raw: {use: raw, sensors: [speed_radar]}}"
    )
    # The raw tracker gives its first estimate, with a velocity, at the second measurement.
    x, y = (3000 + v * np.arange(1, steps) for v in velocity)
    along, across = np.full(len(x), 30.0), 0.009 * np.hypot(x, y)
    bearing = np.arctan2(y, x)
    expected = [
        np.sqrt(np.mean((along * np.cos(bearing)) ** 2 + (across * np.sin(bearing)) ** 2)),
        np.sqrt(np.mean((along * np.sin(bearing)) ** 2 + (across * np.cos(bearing)) ** 2)),
    ]
    rmse = found.json()["trackers"][0]["metrics"]
    # Of 400 runs of some 100 measurements each, the RMSE is known to half a per cent.
    np.testing.assert_allclose([rmse["rmse.px"]["value"], rmse["rmse.py"]["value"]], expected, rtol=0.015)


def test_the_outlier_is_one(project):
    """The published y of case b is below that of every run, and the other axis is not."""
    options = project.HYPOTHESES["as published"][0]
    tracker = f"trackers={{ekf: {{filter: ekf, motion: cv, sensors: [speed_radar], {options}}}}}"
    x, y = project.places("b", project.result("b", "monte_carlo.runs=300", "expect=[]", tracker), "ekf")
    assert y.percentile == 0
    assert not y.inside
    assert x.inside
    assert 10 < x.percentile < 60


def test_the_page_has_every_published_value(project):
    page = (DOCS / "projects" / "range-3km.md").read_text(encoding="utf-8")
    values = [value for case in project.PUBLISHED.values() for value in case["ekf"]]
    assert all(f"| {value:.2f} |" in page for value in values)
