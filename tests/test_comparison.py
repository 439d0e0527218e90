"""The comparison of trackers over scenarios."""

from __future__ import annotations

import json
import re
from itertools import combinations
from xml.etree import ElementTree

import pytest
from tests.example_result import failed_tracker, tracker

from trackbench.report.comparison import Comparison, compare
from trackbench.results import Result


def scenario(name: str, rmse: dict[str, float], tied: tuple[tuple[str, str], ...] = (), failed: bool = False) -> Result:
    """A result that holds only what a comparison reads."""
    trackers = []
    for i, (who, value) in enumerate(rmse.items()):
        entry = tracker("ekf_cv", i)
        entry["name"] = who
        entry["metrics"]["position_rmse"] |= {"value": value, "ci95": [value - 0.01, value + 0.01]}
        entry["metrics"]["position_efficiency"] |= {"value": value / 0.5}
        trackers.append(entry)
    if failed:
        trackers.append(failed_tracker())
    differences = [
        {
            "a": a,
            "b": b,
            "metric": "position_rmse",
            "value": rmse[a] - rmse[b],
            "ci95": None,
            "verdict": "no difference shown" if (a, b) in tied else "a better" if rmse[a] < rmse[b] else "b better",
        }
        for a, b in combinations(rmse, 2)
    ]
    summary = {
        "scenario": {"name": name, "description": f"the {name} one"},
        "runs": 100,
        "seed": 7,
        "trackers": trackers,
        "ranking": [*sorted(rmse, key=rmse.__getitem__), *(["mine"] if failed else [])],
        "differences": differences,
        "expectations": [{"passed": True}, {"passed": False}],
    }
    return Result.from_json(summary, {})


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return compare(
        [
            scenario("first", {"good": 0.5, "fair": 0.6, "poor": 2.0}),
            scenario("second", {"good": 0.5, "fair": 0.51, "poor": 1.5}, tied=(("good", "fair"),)),
            scenario("third", {"good": 0.7, "fair": 0.6, "poor": 1.0}, failed=True),
            scenario("fourth", {"good": 0.4, "poor": 0.9}),
        ]
    )


def test_ranking(compared: Comparison) -> None:
    assert [standing.tracker for standing in compared.standings] == ["good", "fair", "poor", "mine"]
    good, fair, poor, mine = compared.standings
    # A field of four: places 1 and 2 of 3 are ranks 1 and 2.5, the last of 2 is rank 4.
    assert good.mean_rank == pytest.approx((1 + 1 + 2 + 1) / 4)
    assert fair.mean_rank == pytest.approx((2.5 + 2.5 + 1) / 3)
    assert poor.mean_rank == pytest.approx((4 + 4 + 3 + 4) / 4)
    assert mine.mean_rank == 4
    assert [s.scenarios for s in compared.standings] == [4, 3, 4, 1]


def test_real_wins_and_losses(compared: Comparison) -> None:
    good, fair, poor, mine = compared.standings
    assert (good.won, good.lost, good.undecided) == (2 + 1 + 2 + 1, 1, 1)
    assert (fair.won, fair.lost, fair.undecided) == (1 + 1 + 3, 1, 1)
    assert (poor.won, poor.lost, poor.undecided) == (1, 2 + 2 + 2 + 1, 0)
    assert (mine.won, mine.lost, mine.undecided, mine.failed) == (0, 3, 0, 1)
    assert sum(s.won for s in compared.standings) == sum(s.lost for s in compared.standings)


def test_certainty(compared: Comparison) -> None:
    good, fair, poor, _ = compared.standings
    for standing in (good, fair, poor):
        assert standing.ci95 is not None
        assert standing.ci95[0] <= standing.mean_rank <= standing.ci95[1]
    shares = [standing.first_share or 0 for standing in compared.standings]
    assert sum(shares) == pytest.approx(1)
    assert 0.5 < shares[0] < 0.95
    assert "That lead is not certain" in compared.markdown()


def test_a_leader_everywhere_is_certain() -> None:
    found = compare([scenario(f"s{i}", {"good": 0.5, "poor": 0.9}) for i in range(3)])
    assert found.standings[0].first_share == 1
    assert found.standings[0].ci95 == (1, 1)
    assert "That lead is certain" in found.markdown()


def test_one_scenario_claims_no_certainty() -> None:
    found = compare([scenario("only", {"good": 0.5, "poor": 0.9})])
    assert found.standings[0].ci95 is None
    assert "n/a" in found.markdown()
    assert "certain:" not in found.markdown()


def test_markdown(compared: Comparison) -> None:
    text = compared.markdown()
    assert "| first | **0.500** ±0.010 | 0.600 ±0.010 | 2.000 ±0.010 |  |" in text
    assert "| second | **0.500** ±0.010 | **0.510** ±0.010 | 1.500 ±0.010 |  |" in text
    assert "| third | 0.700 ±0.010 | **0.600** ±0.010 | 1.000 ±0.010 | failed |" in text
    assert "| fourth | **0.400** ±0.010 |  | 0.900 ±0.010 |  |" in text
    assert "- mine in third: ValueError: matrix \\<3\\> is singular" in text
    assert "1 of 2 met" in text
    assert all(f"]({path})" in text for path in compared.figures())


def test_html_holds_what_the_markdown_does(compared: Comparison) -> None:
    text = compared.html()
    assert "good has the best mean rank" in text
    assert "That lead is not certain" in text
    assert "ValueError: matrix &lt;3&gt; is singular" in text
    assert text.count("<figure") == text.count("<figcaption") == 2
    assert re.search(r'<td data-label="fair" class=" strong">0.510<small>±0.010</small></td>', text)
    assert "://" not in text
    assert compared.html() == text


def test_json(compared: Comparison) -> None:
    found = json.loads(json.dumps(compared.json(), allow_nan=False))
    assert found["scenarios"][0]["trackers"]["fair"]["position_rmse"] == 0.6
    assert found["scenarios"][1]["trackers"]["fair"]["leading"] is True
    assert found["scenarios"][2]["trackers"]["mine"]["position_rmse"] is None
    assert [standing["tracker"] for standing in found["overall"]] == ["good", "fair", "poor", "mine"]


def test_figures_are_images_of_their_own(compared: Comparison) -> None:
    for path, text in compared.figures().items():
        assert path.endswith(".svg")
        root = ElementTree.fromstring(text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.attrib["aria-label"]
        assert "currentColor" not in text
        assert "var(" not in text
    assert compared.figures() == compared.figures()
