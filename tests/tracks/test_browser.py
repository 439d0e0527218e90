"""The report of hidden identities in a real browser, at the width of a phone and of a desktop."""

from __future__ import annotations

import pytest
from tests.support.browser import look

from trackbench.document.html import to_html
from trackbench.report.result import result_document
from trackbench.results import Result


@pytest.mark.browser
@pytest.mark.slow
def test_the_page_fits_its_screen(
    tmp_path_factory: pytest.TempPathFactory, traffic_result: Result, failing_result: Result
) -> None:
    results = {"traffic": traffic_result, "failing": failing_result}
    pages = {name: to_html(result_document(result)) for name, result in results.items()}
    seen = look(tmp_path_factory.mktemp("browser"), pages, (390, 1280))
    assert seen.console == []
    for (page, width), frame in seen.frames.items():
        assert frame["scrollWidth"] <= width, page
        assert frame["overflowing"] == [], page
        assert frame["smallest"] >= 12
        assert len(frame["figures"]) == (5 if page == "traffic" else 3)
