"""The reports in a real browser, at the width of a phone and of a desktop."""

from __future__ import annotations

import pytest
from tests.support.browser import Seen, look
from tests.support.example_result import make_result

from trackbench.compare import compare_results, results_in
from trackbench.document.html import to_html
from trackbench.report.comparison.document import comparison_document
from trackbench.report.result import result_document
from trackbench.results import Result

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PHONE, DESKTOP = 390, 1280


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory, tiny_result: Result) -> Seen:
    scenario = tiny_result.summary.scenario.model_copy(update={"name": "a_second_scenario"})
    several = compare_results(
        [results_in(tmp_path_factory.mktemp("results"), [tiny_result.updated(scenario=scenario), tiny_result])]
    )
    documents = {
        "example": result_document(make_result()),
        "tiny": result_document(tiny_result),
        "comparison": comparison_document(several),
    }
    pages = {name: to_html(found) for name, found in documents.items()}
    return look(tmp_path_factory.mktemp("browser"), pages, (PHONE, DESKTOP))


@pytest.mark.parametrize("width", [PHONE, DESKTOP])
@pytest.mark.parametrize("page", ["example", "tiny", "comparison"])
def test_a_page_fits_its_screen(seen: Seen, page: str, width: int) -> None:
    frame = seen.frames[page, width]
    assert frame["width"] == width
    assert frame["scrollWidth"] <= width
    assert frame["overflowing"] == []
    assert frame["smallest"] >= 12


@pytest.mark.parametrize(("page", "figures"), [("example", 2), ("tiny", 2), ("comparison", 0)])
def test_every_figure_has_a_caption_and_an_alternative(seen: Seen, page: str, figures: int) -> None:
    for width in (PHONE, DESKTOP):
        found = seen.frames[page, width]["figures"]
        assert len(found) == figures
        for figure in found:
            assert len(figure["caption"]) > 30, figure["id"]
            assert len(figure["alternative"]) > 30, figure["id"]
            assert figure["height"] > 60, figure["id"]


def test_the_browser_has_nothing_to_say(seen: Seen) -> None:
    assert seen.console == []
